"""What a description says stands in the robot that is read from it, and what it must not say is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import sympy as sp

from derive.description.reader import Reader, rational
from derive.description.resolve import read_robot
from derive.description.robot import Robot
from tests.derive.descriptions import AHEAD, motor, part, robot, steered, wheel
from wmr_input import InputError

x, y, phi, beta = (sp.Symbol(name, real=True) for name in ("x", "y", "phi", "beta"))
r, a, b, L, m, inertia, k = (sp.Symbol(name, real=True) for name in ("r", "a", "b", "L", "m", "I", "k"))


def read(text: str, folder: Path) -> Robot:
    path = folder / "robot.toml"
    path.write_text(text)
    return read_robot(path)


def refused(text: str, folder: Path) -> str:
    """What is told of a description that is wrong, without the file's name."""
    with pytest.raises(InputError) as caught:
        read(text, folder)
    return str(caught.value).removeprefix(f"{folder / 'robot.toml'}: ")


WHOLE = robot(
    steered("fork", ("a", "0"), "beta + 0.5").replace("angle =", 'limits = ["-pi/4", 0.6]\nangle ='),
    wheel("rear", at=("0", "b"), heading="pi/6"),
    wheel("front", "fork", roller_angle="pi/4"),
    motor("rear"),
    motor("fork").replace('torque_gain = "k"\n', ""),
    part("constraints", expression="cos(phi)*x_dot - 2*a*phi_dot + 0*y_dot"),
    angles=("beta",),
    outputs=AHEAD,
    v={"v": "x_dot*cos(phi) + y_dot*sin(phi)", "s": "beta_dot - phi_dot/3"},
)


def test_a_robot_holds_what_its_description_says(tmp_path: Path) -> None:
    """Expressions over its symbols, coefficients of rates, and the units and values of all quantities."""
    found = read(WHOLE, tmp_path)
    rate = {q: found.rate(q) for q in found.coordinates}
    assert found.coordinates == (x, y, phi, beta)
    assert found.units == {"x": "m", "y": "m", "phi": "rad", "beta": "rad"} | {
        p.name: unit
        for p, unit in zip(
            found.parameters,
            ("m", "m", "m", "m", "m", "kg", "kg m^2", "kg m^2", "kg m^2", "N m/V", "N m s/rad"),
            strict=True,
        )
    }
    assert found.defaults[L] == sp.Rational(2, 5)
    assert found.constraints == ({rate[x]: sp.cos(phi), rate[phi]: -2 * a},)
    assert found.pseudo_velocities == {
        sp.Symbol("v", real=True): {rate[x]: sp.cos(phi), rate[y]: sp.sin(phi)},
        sp.Symbol("s", real=True): {rate[beta]: sp.S.One, rate[phi]: -sp.Rational(1, 3)},
    }
    assert found.outputs == {"y1": x + L * sp.cos(phi), "y2": y + L * sp.sin(phi)}
    body, fork = found.frames
    assert (body.parent, body.at, body.angle, body.limits) == (None, (x, y), phi, None)
    assert (fork.parent, fork.at, fork.limits) == ("body", (a, 0), (-sp.pi / 4, sp.Symbol("0.6", real=True)))
    assert fork.angle.xreplace(found.constants.values) == beta + sp.Rational(1, 2)
    assert found.numbers == found.defaults | found.constants.values
    (mass,) = found.bodies
    assert (mass.frame, mass.at, mass.mass, mass.inertia) == ("body", (0, 0), m, inertia)
    rear, front = found.wheels
    assert (rear.name, rear.frame, rear.at, rear.radius, rear.heading) == ("rear", "body", (0, b), r, sp.pi / 6)
    assert (rear.roller_angle, front.roller_angle) == (None, sp.pi / 4)
    assert (rear.is_conventional, front.is_conventional) == (True, False)
    volts, torque = found.motors
    assert (volts.input, volts.wheel, volts.joint, volts.torque_gain, volts.unit) == ("u_rear", "rear", None, k, "V")
    assert (torque.wheel, torque.joint, torque.torque_gain, torque.unit) == (None, "fork", 1, "N m")


def test_a_model_alone_has_no_outputs_and_may_leave_its_velocities_to_be_chosen(tmp_path: Path) -> None:
    found = read(robot(wheel("w")), tmp_path)
    assert (found.outputs, found.pseudo_velocities) == ({}, None)


ORDERS = ["arm hand finger", "finger hand arm", "hand finger arm"]


@pytest.mark.parametrize("order", ORDERS)
def test_parents_stand_before_their_children(order: str, tmp_path: Path) -> None:
    """However they are listed."""
    parents = {"arm": "body", "hand": "arm", "finger": "hand"}
    frames = [part("frames", name=n, parent=parents[n], at=["a", "0"], angle="beta") for n in order.split()]
    found = read(robot(*frames, angles=("beta",)), tmp_path)
    assert [frame.name for frame in found.frames] == ["body", "arm", "hand", "finger"]


TEXTS = {  # of an output
    "1/(L - L)": "not a finite real number",
    "abs(1/(L - L))": "not a finite real number",
    "-abs(1/(L - L))": "not a finite real number",
    "x - abs(1/(L - L))": "not a finite real number",
    "0*(1/(L - L))": "not a finite real number",
    "x*sqrt(-2)": "not a finite real number",
    "x + 1/(1e30*1e30*1e30)": "holds constants out of range",
    "x + 1e30*1e30*1e30": "holds constants out of range",
    "abs(x)": "is an absolute value, which has a kink",
    "x*abs(L + y)": "is an absolute value, which has a kink",
    "x*sign(phi)": "has a sign that jumps",
    "x +": "",
    "x + z": "unknown name 'z'",
    "x + phi*m": "mind the units",
    "x + L/r": "mind the units",
}


@pytest.mark.parametrize("text", TEXTS)
def test_what_no_output_can_be_is_refused(text: str, tmp_path: Path) -> None:
    told = refused(robot(wheel("w"), outputs=AHEAD | {"y1": text}), tmp_path)
    assert told.startswith("[outputs] y1: ")
    assert TEXTS[text] in told
    assert "this place" not in told


@pytest.mark.parametrize(
    "text", ["x + abs(L)", "x*sign(a - b)", "x + 1e30*1e30*L", "x + L*sin(0.3)", "-x", "x*phi/phi"]
)
def test_what_an_output_can_be_is_read(text: str, tmp_path: Path) -> None:
    """Kinks of parameters stay where they are."""
    assert "y1" in read(robot(wheel("w"), outputs=AHEAD | {"y1": text}), tmp_path).outputs


MASSES = {
    "m*x": "unknown name 'x'; this place takes parameters only",
    "m +": "(this place takes parameters only)",
    "a": "has the unit m; this place takes kg",
    "m + a": "mind the units",
    "-m": "is -20 with the default parameters; it must not be negative",
    "m*sqrt(1 - 2*b/a)": "has no finite value with the default parameters; change them",
    "m*a/(a - 3*e - 3*e)": "has no finite value with the default parameters; change them",
    "m*a/free": "has no finite value with the default parameters; free may not be zero; change them",
    "m*sqrt(b - a)/a*a/sqrt(a) + m*free/a": "has no finite value with the default parameters; free may not be zero",
}
FREE = {"free": (0.0, "m")}


@pytest.mark.parametrize("text", MASSES)
def test_what_no_mass_can_be_is_refused(text: str, tmp_path: Path) -> None:
    """With what the place takes, and, where the defaults are at fault, those that are zero."""
    told = refused(
        robot(wheel("w"), parameters=FREE if "free" in text else None).replace('mass = "m"', f'mass = "{text}"'),
        tmp_path,
    )
    assert told.startswith("[[bodies]] number 1 mass: ")
    for words in MASSES[text].split("; "):
        assert words in told
    assert ("may not be zero" in told) == ("free" in text)


@pytest.mark.parametrize(
    ("radius", "told"), [("0", "is 0 with the default"), ("-r", "it must be positive"), ("r - r", "must be positive")]
)
def test_a_wheel_has_a_size(radius: str, told: str, tmp_path: Path) -> None:
    assert told in refused(robot(wheel("w").replace('radius = "r"', f'radius = "{radius}"')), tmp_path)


def test_a_mass_may_be_zero_and_a_gain_may_not(tmp_path: Path) -> None:
    assert read(robot(wheel("w")).replace('mass = "m"', 'mass = "0"'), tmp_path).bodies[0].mass == 0
    text = robot(wheel("w"), motor("w"))
    assert "it must be positive" in refused(text.replace('torque_gain = "k"', 'torque_gain = "0"'), tmp_path)
    assert read(text.replace('back_emf = "c"', 'back_emf = "0"'), tmp_path).motors[0].back_emf == 0
    assert "must not be negative" in refused(text.replace('back_emf = "c"', 'back_emf = "-c"'), tmp_path)


@pytest.mark.parametrize(
    ("angle", "drives"),
    [("pi/2", False), ("-pi/2", False), ("1.5707963267948966", False), ("1.5707", True), ("0", True)],
)
def test_rollers_whose_axles_lie_along_the_wheels_cannot_drive(angle: str, drives: bool, tmp_path: Path) -> None:
    text = robot(wheel("w", roller_angle=angle))
    if drives:
        assert read(text, tmp_path).wheels[0].roller_angle is not None
    else:
        assert "so it cannot drive" in refused(text, tmp_path)


FORMS = {  # of a constraint or a pseudo-velocity
    "0": "contains no rate",
    "x_dot - x_dot": "contains no rate",
    "(sin(phi)**2 + cos(phi)**2 - 1)*x_dot": "contains no rate",
    "x_dot + 1": "has a part without a rate, 1",
    "x_dot + x": "has a part without a rate, x",
    "x_dot**2": "is not linear in x_dot",
    "x_dot*y_dot": "is not linear in x_dot",
    "x_dot + sin(y_dot)": "is not linear in y_dot",
    "x_dot**2/y_dot": "is not linear in x_dot",
}


@pytest.mark.parametrize("place", ["constraints", "pseudo_velocities"])
@pytest.mark.parametrize("text", FORMS)
def test_what_is_not_linear_in_the_rates_is_refused(text: str, place: str, tmp_path: Path) -> None:
    """Each at its place."""
    if place == "constraints":
        told = refused(robot(wheel("w"), part("constraints", expression=text)), tmp_path)
        assert told.startswith("[[constraints]] number 1 expression: ")
    else:
        told = refused(robot(wheel("w"), v={"v": text}), tmp_path)
        assert told.startswith("[pseudo_velocities] v: ")
    assert FORMS[text] in told


@pytest.mark.parametrize(("number", "is_read"), [(10**30, True), (10**30 + 1, False), (-(10**31), False), (7, True)])
def test_whole_numbers_have_a_usual_size(number: int, is_read: bool, tmp_path: Path) -> None:
    """As an expression that is written without quotes."""
    text = robot(wheel("w")).replace('at = ["0", "0"]\nmass', f'at = [{number}, "0"]\nmass')
    if is_read:
        assert read(text, tmp_path).bodies[0].at == (number, 0)
    else:
        assert "more than 30 digits" in refused(text, tmp_path)


@pytest.mark.parametrize(
    ("value", "is_read"),
    [("0.0", True), ("1e-12", True), ("-1e12", True), ("9e-13", False), ("1.1e12", False), ("-2e12", False)],
)
def test_values_have_a_usual_size(value: str, is_read: bool, tmp_path: Path) -> None:
    text = robot(wheel("w")).replace("e = { value = 0.05", f"e = {{ value = {value}")
    if is_read:
        assert read(text, tmp_path).defaults[sp.Symbol("e", real=True)] == rational(float(value))
    else:
        assert "is out of range" in refused(text, tmp_path)


@pytest.mark.parametrize("name", ["left", "body"])
@pytest.mark.parametrize(
    "added", [wheel("left"), part("frames", name="left", parent="body", at=["a", "0"], angle="phi")]
)
def test_no_two_frames_and_wheels_have_one_name(added: str, name: str, tmp_path: Path) -> None:
    text = robot(wheel("left", at=("0", "b")), added.replace('"left"', f'"{name}"', 1))
    assert "the name is taken" in refused(text, tmp_path)


def test_decimals_are_read_as_they_are_written() -> None:
    """And angles that hold them are symbols."""
    reader = Reader("file")
    assert reader.expression("0.1 + 1e-3*pi", {}, "") == sp.Rational(1, 10) + sp.pi / 1000
    assert rational(0.1) == sp.Rational(1, 10)
    assert reader.expression("E*I", {"E": x, "I": y}, "") == x * y
    assert reader.expression("sin(0.25)", {}, "").free_symbols == {sp.Symbol("0.25", real=True)}
