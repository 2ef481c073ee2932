"""Trusted values are given at arguments that belong together, and where every function is finite."""

import json
from pathlib import Path

import numpy as np
import pytest

from derive.codegen.write import generate_one
from tests.conftest import DESCRIPTIONS, ROOT
from wmr_input import InputError


def test_the_arguments_belong_together(robot: str) -> None:
    folder = ROOT / "generated" / robot
    trusted, model = (json.loads((folder / name).read_text()) for name in ("trusted_values.json", "model.json"))
    arguments, defaults = trusted["arguments"], list(model["defaults"].values())
    parameters = dict(zip(model["parameters"], arguments["p"], strict=True))
    assert arguments["x"][: len(arguments["q"])] == arguments["q"]
    assert arguments["c"] == [parameters[name] for name in model["known"]]
    assert arguments["theta"] == trusted["values"]["base_parameters"]
    assert np.all(np.abs(np.divide(arguments["p"], defaults) - 1.0) <= 0.2 + 1e-12)
    assert len(set(arguments["x"])) == len(arguments["x"])


def described(folder: Path, output: str) -> Path:
    path = folder / "robot.toml"
    path.write_text(DESCRIPTIONS["type_2_0"].read_text().replace('"x + L*cos(phi)"', f'"{output}"'))
    return path


def test_another_configuration_is_taken_if_a_function_is_not_finite_at_the_first(tmp_path: Path) -> None:
    """The first has x < 0, where sqrt(x L) is not real."""
    usual = json.loads((ROOT / "generated" / "type_2_0" / "trusted_values.json").read_text())["arguments"]["q"]
    files = generate_one(described(tmp_path, "sqrt(x*L) + L*cos(phi)"))
    trusted = json.loads(files["trusted_values.json"])
    assert usual[0] < 0 < trusted["arguments"]["q"][0]
    assert all(np.isfinite(np.array(value)).all() for value in trusted["values"].values())


def test_a_function_that_is_finite_nowhere_near_is_a_mistake_of_the_description(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not defined at random configurations"):
        generate_one(described(tmp_path, "x + L*cos(phi) + L*sqrt(-1000000 + x/L)"))
