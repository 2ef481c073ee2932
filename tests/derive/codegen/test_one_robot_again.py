"""One robot's committed files, derived again in this process: the quickest look at all that is written."""

from __future__ import annotations

import ast
import json

import numpy as np
import pytest
import sympy as sp

from derive.codegen.arguments import arguments_of, unit_text, units_of
from derive.codegen.write import Files, differences, generate_one
from tests.conftest import DESCRIPTIONS, ROOT
from tests.derive.descriptions import AHEAD, derivation_of, files_of, motor, part, robot, wheel

ROBOT = "type_2_0"
SMALL = robot(
    wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), motor("left"), motor("right"), outputs=AHEAD
)  # fmt: skip


def test_the_committed_files_are_derived_byte_for_byte() -> None:
    steps: list[str] = []
    files = generate_one(DESCRIPTIONS[ROBOT], steps.append)
    assert differences(files, ROOT / "generated" / ROBOT) == ""
    assert len(steps) == len(set(steps))
    for step in ("description", "kinematics", "mobility", "dynamics", "linearization", "base parameters"):
        assert step in steps
    assert steps.index("statements") < steps.index("numpy_model.py") < steps.index("values and report")


@pytest.fixture(scope="module")
def files() -> Files:
    return files_of(SMALL)


def test_trusted_values_have_the_shapes_that_are_told(files: Files) -> None:
    """Vectors flat, matrices by rows; and the generated functions compute them."""
    trusted, model = (json.loads(files[name]) for name in ("trusted_values.json", "model.json"))
    module: dict[str, object] = {}
    exec(compile(files["numpy_model.py"], "numpy_model.py", "exec"), module)  # noqa: S102
    assert trusted["values"].keys() == model["functions"].keys()
    for name, signature in model["functions"].items():
        value = np.array(trusted["values"][name], dtype=float)
        if value.size:
            assert list(value.shape) == signature["size"], name
        arguments = [np.array(trusted["arguments"][one]) for one in signature["arguments"]]
        found = np.asarray(module[name](*arguments))  # type: ignore[operator]
        np.testing.assert_allclose(found.reshape(value.shape), value, rtol=1e-12, atol=1e-13, err_msg=name)


def test_every_quantity_has_its_unit(files: Files) -> None:
    """Velocities of frames, loads in units of power over them, and accelerations."""
    model = json.loads(files["model.json"])
    assert model["state"] == {
        "x": "m", "y": "m", "phi": "rad", "body_forward": "m/s", "body_turning": "rad/s",
    }  # fmt: skip
    assert model["inputs"] == {"u_left": "V", "u_right": "V"}
    assert model["known"] == {"L": "m"}
    assert model["outputs"] == {"y1": "m", "y2": "m"}
    text = files["numpy_model.py"]
    for listed in ("w_body_forward [N], w_body_turning [N m]", "a_body_forward [m/s^2], a_body_turning [1/s^2]"):
        assert listed in text
    assert "body_forward_ref [m/s]" in text


def test_a_module_imports_what_it_calls_and_no_more(files: Files) -> None:
    for name in ("numpy_model.py", "casadi_model.py"):
        tree = ast.parse(files[name])
        imported = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module in ("numpy", "casadi")
            for alias in node.names
        }
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        assert imported <= used
        assert all(len(line) <= 120 for line in files[name].splitlines() if '"""' not in line)


def test_the_motion_that_is_told_needs_no_look_at_the_code(files: Files) -> None:
    """Findings, formulas and digests stand in model.json."""
    model = json.loads(files["model.json"])
    assert (model["parametrization"], model["passivity_obstacle"]) == ("forward", None)
    assert model["findings"]["type"] == "(2,0)"
    assert set(model["files_sha256"]) == {"numpy_model.py", "casadi_model.py", "trusted_values.json"}
    names = list(model["passivity_parameters"])
    assert [one for group in model["passivity_groups"] for one in group["parameters"]] == names
    assert list(model["inverse_base_parameters"]) == list(model["inverse_base_parameter_formulas"])
    assert {"inverse_regressor", "inverse_base_parameters", "passivity_regressor", "regressor"} <= set(
        model["functions"]
    )


def test_a_speed_that_adds_lengths_to_angles_has_no_unit_and_stops_nothing() -> None:
    """Nor has the force on it, and what follows from them; all others have theirs."""
    v = {"v": "x_dot*cos(phi) + y_dot*sin(phi)", "s": "phi_dot + x_dot*cos(phi) + y_dot*sin(phi)"}
    axle = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), motor("left"), motor("right"))
    units = {name: argument.units for name, argument in arguments_of(derivation_of(robot(*axle, v=v))).items()}
    assert units["x"] == ("m", "m", "rad", "m/s", "?")
    assert (units["w"], units["a"], units["v_r"]) == (("N", "?"), ("m/s^2", "?"), ("m/s", "?"))


ARM = part("frames", name="arm", parent="body", at=["a", "0"], angle="g")
ARM += part("bodies", frame="arm", at=["0", "0"], mass="m", inertia="I")
TURNED = robot(wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), ARM, angles=("g",))


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("phi", "rad"), ("g", "rad"), ("phi + 2*g", "rad"), ("g/3", "rad"), ("sin(g)", "1"), ("x", "m"),
        ("x/L", "1"), ("x/L + g", "1"), ("b", "m"), ("body_turning", "rad/s"), ("body_forward", "m/s"),
        ("body_forward/L", "1/s"), ("g_rate", "rad/s"), ("m*x", "kg m"), ("3", "1"),
    ],
)  # fmt: skip
def test_angles_are_told_from_numbers_without_a_unit(text: str, unit: str) -> None:
    """What is a polynomial of angles alone, and rates of such."""
    derivation = derivation_of(TURNED)
    names = {s.name: s for s in (*derivation.state, *derivation.robot.parameters)}
    assert unit_text(sp.sympify(text, locals=names), units_of(derivation), derivation) == unit
