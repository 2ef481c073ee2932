"""A new quantity costs one entry in the list: every file then holds it."""

import json
from typing import Any

import casadi as ca
import numpy as np
import pytest
from sympy import Matrix

from derive.codegen.quantities import QUANTITIES, Entry
from derive.codegen.write import Files, files_of
from derive.derivation import Derivation, derive_robot
from tests.conftest import DESCRIPTIONS


def kinetic_energy(derivation: Derivation) -> Matrix:
    v = Matrix(derivation.kinematics.v)
    return v.T * derivation.dynamics.inertia_matrix * v / 2


ENTRY = Entry("kinetic_energy", "x p", "1", "(14)", "v^T Mbar v / 2 [J]", kinetic_energy)
ABSENT = Entry("no_such_thing", "x", "1", "(0)", "what a robot does not have", lambda derivation: None)


@pytest.fixture(scope="module")
def files() -> Files:
    path = DESCRIPTIONS["type_2_0"]
    return files_of(derive_robot(path), path, entries=[*QUANTITIES, ENTRY, ABSENT])


def test_its_signature_is_in_model_json(files: Files) -> None:
    functions = json.loads(files["model.json"])["functions"]
    assert list(functions)[-1] == "kinetic_energy"
    assert functions["kinetic_energy"] == {
        "arguments": ["x", "p"],
        "shape": ["1"],
        "size": [1],
        "equation": "(14)",
        "meaning": "v^T Mbar v / 2 [J]",
    }


@pytest.mark.parametrize("file", ["numpy_model.py", "casadi_model.py"])
def test_both_modules_compute_its_trusted_value(files: Files, file: str) -> None:
    module: dict[str, Any] = {}
    exec(files[file], module)  # noqa: S102
    trusted = json.loads(files["trusted_values.json"])
    x, p = trusted["arguments"]["x"], trusted["arguments"]["p"]
    value = np.ravel(ca.DM(module["kinetic_energy"](x, p)).full())
    v, inertia = np.array(x[3:]), np.array(trusted["values"]["inertia_matrix"])
    np.testing.assert_allclose(value, trusted["values"]["kinetic_energy"], rtol=1e-14)
    np.testing.assert_allclose(value, v @ inertia @ v / 2, rtol=1e-14)


def test_the_report_lists_it(files: Files) -> None:
    assert "| `kinetic_energy` | (14) | " in files["derivation.md"]


def test_a_robot_without_it_has_no_trace_of_it(files: Files) -> None:
    assert [name for name, text in files.items() if "no_such_thing" in text] == []
