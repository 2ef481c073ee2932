"""How small robots can move: degrees, brackets and integrable constraints, against what is known of them."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from derive.algebra.attempts import Attempts
from derive.description.resolve import read_robot
from derive.mechanics.constraints import constraint_rows
from derive.mechanics.mobility import Mobility, classify
from derive.mechanics.pseudo_velocities import choose_kinematics
from tests.derive.descriptions import motor, part, robot, steered, wheel

AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))
ARM = part("frames", name="arm", parent="body", at=["a", "e"], angle="g")
FORK = (steered("fork", ("a", "0"), "beta"), wheel("front", "fork"))


def mobility_of(text: str) -> Mobility:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        described = read_robot(path)
    constraints, attempts = constraint_rows(described), Attempts()
    mobility = classify(choose_kinematics(described, constraints), constraints, attempts)
    assert attempts.missed == {}
    return mobility


ROBOTS = {
    "two wheels": robot(*AXLE),
    "no wheel": robot(),
    "an arm": robot(*AXLE, ARM, angles=("g",)),
    "a caster": robot(*AXLE, ARM, wheel("free", "arm", ("-L", "0")), angles=("g",)),
    "a car": robot(*FORK, wheel("rear"), motor("rear"), motor("fork"), angles=("beta",)),
    "a further constraint": robot(part("constraints", expression="-x_dot*sin(phi) + y_dot*cos(phi) + e*phi_dot")),
}
GROWTH = {  # dimensions of what brackets of so many columns of S span; degrees; how the constraints are called
    "two wheels": ((2, 3), (2, 0), "completely nonholonomic"),
    "no wheel": ((3,), (3, 0), "completely nonholonomic"),
    "a caster": ((2, 3, 4), (2, 0), "completely nonholonomic"),
    "an arm": ((3, 4), (2, 0), "completely nonholonomic"),
    "a car": ((2, 3, 4), (1, 1), "completely nonholonomic"),
    "a further constraint": ((2, 3), (2, 0), "completely nonholonomic"),
}


@pytest.mark.parametrize("name", GROWTH)
def test_brackets_span_as_much_as_is_known(name: str) -> None:
    """A car is parked by brackets of three, a pair of wheels by brackets of two."""
    dimensions, degrees, integrability = GROWTH[name]
    mobility = mobility_of(ROBOTS[name])
    assert mobility.growth is not None
    assert mobility.growth.dimensions == dimensions
    assert mobility.growth.degree_of_nonholonomy == len(dimensions)
    assert (mobility.degree_of_mobility, mobility.degree_of_steerability) == degrees
    assert mobility.type_name == f"({degrees[0]},{degrees[1]})"
    assert mobility.integrability == integrability
    assert mobility.holonomic == ()


HOLONOMIC = {  # constraints of a body without wheels: what brackets span, what is integrable, and its rows
    "x_dot": ((2,), "holonomic", ("constraint number 1",)),
    "y*x_dot + x*y_dot": ((2,), "holonomic", ("constraint number 1",)),
    "x_dot - y*phi_dot": ((2, 3), "completely nonholonomic", ()),
}


@pytest.mark.parametrize("text", HOLONOMIC)
def test_constraints_that_can_be_integrated_are_named(text: str) -> None:
    """The second one is the rate of x y."""
    dimensions, integrability, rows = HOLONOMIC[text]
    mobility = mobility_of(robot(part("constraints", expression=text)))
    assert mobility.growth is not None
    assert (mobility.growth.dimensions, mobility.integrability, mobility.holonomic) == (dimensions, integrability, rows)
    assert mobility.growth.controllable == (rows == ())


def test_one_integrable_constraint_beside_one_that_is_none() -> None:
    """A pair of wheels that also turns an arm with its heading."""
    text = robot(*AXLE, part("constraints", expression="g_dot - 2*phi_dot"), angles=("g",))
    mobility = mobility_of(text)
    assert mobility.growth is not None
    assert mobility.growth.dimensions == (2, 3)
    assert mobility.integrability == "nonholonomic with 1 integrable combination(s)"
    assert mobility.holonomic == ("constraint number 1",)
