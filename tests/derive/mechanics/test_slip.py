"""The rows of the slip matrix: all of them, in their order, also where a robot has few or none."""

from pathlib import Path

import numpy as np
import pytest

from derive.derivation import Derivation
from derive.description.resolve import read_robot
from derive.mechanics.slip import slip_rows
from tests.derive.descriptions import derived, lawful_model, motor, part, robot, steered, wheel

SWEDISH = {"roller_angle": "pi/4"}


def test_every_conventional_wheel_and_every_motor_has_a_row_in_this_order(derivation: Derivation) -> None:
    """Also a wheel whose row of A follows from others."""
    described = derivation.robot
    expected = [{"wheel": w.name, "direction": "sideways"} for w in described.wheels if w.is_conventional]
    for one in described.motors:
        what = {"joint": one.joint} if one.wheel is None else {"wheel": one.wheel, "direction": "along"}
        expected.append({**what, "motor": one.input})
    assert [row.about for row in derivation.kinematics.slip_rows] == expected
    assert derivation.kinematics.slip_matrix.shape == (len(expected), len(described.coordinates))


def test_nothing_in_it_is_eliminated(derivation: Derivation) -> None:
    """It is written in coordinates and lengths: no named term, and no radius, which would cancel."""
    allowed = {*derivation.robot.coordinates, *derivation.robot.parameters, *derivation.robot.constants.values}
    radii = set().union(*(one.radius.free_symbols for one in derivation.robot.wheels))
    lengths = set().union(*(set().union(*(c.free_symbols for c in one.at)) for one in derivation.robot.wheels))
    assert derivation.kinematics.slip_matrix.free_symbols <= allowed - (radii - lengths)


@pytest.mark.parametrize(
    ("parts", "angles", "size"),
    [
        ((), (), 0),
        ((wheel("one"),), (), 1),
        ((wheel("one", **SWEDISH),), (), 0),
        ((wheel("one", at=("a", "b"), **SWEDISH), motor("one")), (), 1),
        ((wheel("one", at=("a", "b"), heading="pi/6"), motor("one")), (), 2),
        ((steered("fork", ("a", "0"), "2*beta"), wheel("one", "fork", ("e", "0")), motor("fork")), ("beta",), 2),
        ((steered("arm", ("a", "0"), "beta"), part("bodies", frame="arm", at=("e", "0"), mass="m", inertia="I"),
          motor("arm")), ("beta",), 1),
        ((wheel("one", at=("0", "b")), wheel("two", at=("0", "-b")), wheel("three", at=("0", "e"))), (), 3),
    ],
    ids=["no wheel", "one wheel", "rollers", "driven rollers", "askew", "geared fork", "arm", "one axle"],
)  # fmt: skip
def test_small_robots_have_as_many_rows_as_slip(
    parts: tuple[str, ...], angles: tuple[str, ...], size: int, tmp_path: Path
) -> None:
    """And obey the laws of all robots, without motors, without constraints, with a row or none."""
    model = lawful_model(derived(robot(*parts, angles=angles), tmp_path))
    n = model.coordinate_count
    assert model.slip_matrix(np.zeros(n), model.parameters()).shape == (size, n)
    assert model.slip_matrix(np.zeros((5, n)), model.parameters()).shape == (5, size, n)
    assert model.in_library("casadi").slip_matrix(np.zeros(n), model.parameters()).shape == (size, n)


def test_two_motors_on_one_wheel_have_a_row_each(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(robot(wheel("one"), motor("one"), motor("one").replace("u_one", "u_two")))
    sideways, one, two = slip_rows(read_robot(path))
    assert [row.about.get("motor") for row in (sideways, one, two)] == [None, "u_one", "u_two"]
    assert one.form == two.form != sideways.form
