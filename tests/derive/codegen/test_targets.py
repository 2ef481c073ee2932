"""A target language is a dialect with its templates: a toy one prints every robot and means the same as the others."""

import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from derive.codegen.program import Program
from derive.codegen.python_code import PythonCode
from derive.codegen.targets import TARGETS
from derive.codegen.targets.dialect import Dialect
from derive.codegen.write import Files, files_of
from derive.derivation import Derivation
from tests.conftest import DESCRIPTIONS, ROOT

TOLERANCE = 1e-12  # of a function's largest entry


class Lists(Dialect):
    """Plain Python: a function returns nested lists of numbers, and nothing is ever assigned to an entry."""

    def result(self, program: Program, code: PythonCode) -> list[str]:
        rows, columns = program.quantity.expression.shape
        entries = [[code.doprint(program.steps.entries.get((i, j), 0)) for j in range(columns)] for i in range(rows)]
        printed = [row[0] if program.quantity.is_vector else f"[{', '.join(row)}]" for row in entries]
        return ["return [", *(f"    {row}," for row in printed), "]"]


@pytest.fixture
def lists(tmp_path: Path) -> Dialect:
    (tmp_path / "imports.jinja").write_text("from math import {{ used | join(', ') }}\n")
    (tmp_path / "helpers.jinja").write_text("def _function(**sizes):\n    return lambda term: term\n")
    return Lists(tmp_path, "lists_model.py", "plain Python", ("Every argument is a sequence of numbers.",), ())


def test_a_toy_language_agrees_with_the_trusted_values(robot: str, derivation: Derivation, lists: Dialect) -> None:
    files = files_of(derivation, DESCRIPTIONS[robot], targets=[lists])
    assert "out[" not in files[lists.file]
    assert deviations(files, lists) == {}


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.title)
def test_registered_languages_agree_with_the_trusted_values(robot: str, target: Dialect) -> None:
    files = {path.name: path.read_text() for path in (ROOT / "generated" / robot).glob("*.*")}
    assert deviations(files, target) == {}


def deviations(files: Files, target: Dialect) -> dict[str, float]:
    """The functions of a module that are not what the trusted values say, and by how much."""
    module: dict[str, Any] = {}
    exec(files[target.file], module)  # noqa: S102
    trusted, functions = json.loads(files["trusted_values.json"]), json.loads(files["model.json"])["functions"]
    assert list(functions) == list(trusted["values"])
    found = {}
    for name, function in functions.items():
        value = module[name](*(trusted["arguments"][argument] for argument in function["arguments"]))
        exact = np.reshape(trusted["values"][name], function["size"])
        difference = np.reshape(value.full() if isinstance(value, ca.DM) else value, function["size"]) - exact
        deviation = np.abs(difference).max(initial=0.0) / (np.abs(exact).max(initial=0.0) or 1.0)
        if not deviation <= TOLERANCE:
            found[name] = float(deviation)
    return found
