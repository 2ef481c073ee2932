"""Wheels whose axles have no common centre are refused by name, with what people do about it; what is meant is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from derive.derivation import derive_robot
from derive.description.resolve import read_robot
from derive.mechanics.constraints import constraint_rows
from derive.mechanics.over_constraint import check_axles
from tests.derive.descriptions import AHEAD, CORNERS, derived, motor, part, robot, steered, wheel
from wmr_input import InputError

SWERVE = [steered(f"m_{name}", at, f"g_{name}") for name, at in CORNERS.items()]
SWERVE += [wheel(name, f"m_{name}") for name in CORNERS]
STEERING = tuple(f"g_{name}" for name in CORNERS)
POSTURE = {"X": "x", "Y": "y", "P": "phi"}
FOUR = [wheel(name, at=at) for name, at in CORNERS.items()]
FRONT = [steered("left", ("a", "b"), "g_l"), steered("right", ("a", "-b"), "g_r")]
CAR = [
    wheel("rear_l", at=("0", "b")),
    wheel("rear_r", at=("0", "-b")),
    wheel("front_l", "left"),
    wheel("front_r", "right"),
]
TANDEM = part("frames", name="trailer", parent="body", at=["-a", "0"], angle="g")
AXLES = [wheel("t1", "trailer", ("-b", "0")), wheel("t2", "trailer", ("-L", "0"))]
PAIR = [wheel("l", at=("0", "b")), wheel("r", at=("0", "-b")), motor("l"), motor("r")]

# a robot, the wheels that are named, and what follows
REFUSED = {
    "swerve modules": (
        robot(*SWERVE, *map(motor, CORNERS), angles=STEERING, outputs=POSTURE),
        "'fl', 'fr', 'rl' have no common centre",
        "leave no motion",
    ),
    "swerve modules, the model alone": (
        robot(*SWERVE, *map(motor, CORNERS), angles=STEERING),
        "'fl', 'fr', 'rl' have no common centre",
        "leave no motion",
    ),
    "four fixed wheels": (
        robot(*FOUR, motor("fl"), motor("fr"), outputs=AHEAD),
        "'fl', 'rl' have no common centre",
        "'body' cannot turn",
    ),
    "four fixed wheels, the model alone": (
        robot(*FOUR, *map(motor, CORNERS)),
        "'fl', 'rl' have no common centre",
        "'body' cannot turn",
    ),
    "two steering angles": (
        robot(*FRONT, *CAR, motor("rear_l"), motor("left"), angles=("g_l", "g_r"), outputs=AHEAD),
        "'rear_l', 'front_l', 'front_r' have no common centre",
        "leave no motion",
    ),
    "a trailer on two axles": (
        robot(TANDEM, *AXLES, *PAIR, angles=("g",), outputs=AHEAD),
        "'t1', 't2' have no common centre",
        "'trailer' cannot turn",
    ),
    "a wheel across": (
        robot(wheel("along"), wheel("across", at=("a", "b"), heading="pi/2"), motor("along")),
        "'along', 'across' have no common centre",
        "can only turn about one point",
    ),
}


def refusal(text: str, folder: Path) -> str:
    path = folder / "small.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        derive_robot(path)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


@pytest.mark.parametrize("case", REFUSED)
def test_axles_without_a_common_centre_are_named_with_what_people_do(case: str, tmp_path: Path) -> None:
    text, wheels, consequence = REFUSED[case]
    said = refusal(text, tmp_path)
    assert "[[wheels]]: the axles of " + wheels in said
    assert consequence in said
    for remedy in ("one steering angle", "roller_angle = 0", "fixed centre of rotation", "docs/robots.md"):
        assert remedy in said


def test_who_names_the_motion_that_is_left_may_have_it(tmp_path: Path) -> None:
    """A cart on rails: two fixed axles, one speed."""
    derived(robot(*FOUR, motor("fl"), v={"v": "x_dot*cos(phi) + y_dot*sin(phi)"}), tmp_path)


def test_skid_steering_with_a_fixed_centre_of_rotation_is_derived(tmp_path: Path) -> None:
    wheels = [wheel(name, at=at, roller_angle="0") for name, at in CORNERS.items()]
    centre = part("constraints", expression="-x_dot*sin(phi) + y_dot*cos(phi) + e*phi_dot")
    v = {"v": "x_dot*cos(phi) + y_dot*sin(phi)", "omega": "phi_dot"}
    derived(robot(*wheels, centre, motor("fl"), motor("fr"), outputs=AHEAD, v=v), tmp_path)


def across(heading: str, right: str = "-b", **kind: object) -> str:
    """A differential drive along y, whose two wheels have the same heading on paper."""
    wheels = [wheel("left", at=("-b", "0"), heading=heading), wheel("right", at=("b", right), heading=heading)]
    outputs = {"y1": "x - L*sin(phi)", "y2": "y + L*cos(phi)"}
    return robot(*wheels, motor("left"), motor("right"), outputs=outputs if kind.get("outputs", True) else None)


MISPRINTS = {
    "1.5708": (across("1.5708", "0"), "differ by 7.3e-06", "write pi/2 for 1.5708"),
    "1.57, the model alone": (across("1.57", "0", outputs=False), "differ by 1.6e-03", "write pi/2 for 1.57"),
    "-1.5708": (across("-1.5708", "0"), "differ by 7.3e-06", "write pi/2 for 1.5708"),
    "a micrometre": (across("pi/2", "0.000001"), "differ by", "agree exactly"),
}


@pytest.mark.parametrize("case", MISPRINTS)
def test_axles_that_agree_but_for_a_misprint_are_named(case: str, tmp_path: Path) -> None:
    text, by, remedy = MISPRINTS[case]
    said = refusal(text, tmp_path)
    assert "'left' and 'right'" in said
    assert by in said
    assert remedy in said


@pytest.mark.parametrize("angle", ["0", "6/5", "-6/5", "1/3"])
def test_axles_that_fall_together_in_one_configuration_are_no_misprint(angle: str, tmp_path: Path) -> None:
    """Of a fixed wheel that stands on the axle of a steered one, once that is turned by the angle."""
    beside = (f"a - b*sin({angle})", f"b*cos({angle})")
    text = robot(steered("fork", ("a", "0"), "g"), wheel("front", "fork"), wheel("rear", at=beside, heading=angle),
                 motor("rear"), angles=("g",))  # fmt: skip
    path = tmp_path / "small.toml"
    path.write_text(text)
    read = read_robot(path)
    check_axles(read, constraint_rows(read))


def test_a_short_caster_is_no_misprint(tmp_path: Path) -> None:
    """Its trail is small beside the robot, and makes its row independent all the same."""
    caster = part("frames", name="caster", parent="body", at=["a", "0"], angle="g")
    text = robot(caster, wheel("c_w", "caster", ("-e/1000", "0")), *PAIR, angles=("g",), outputs=AHEAD)
    derived(text, tmp_path)
