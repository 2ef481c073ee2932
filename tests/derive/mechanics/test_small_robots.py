"""How small robots move, against where their parts are: poses in closed form, differentiated by numbers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import sympy as sp

from derive.description.resolve import read_robot
from derive.mechanics.constraints import constraint_rows
from derive.mechanics.dynamics import Dynamics, derive_dynamics
from derive.mechanics.elimination import NotSolvable
from derive.mechanics.kinematics import Kinematics, solve_kinematics
from derive.mechanics.poses import frame_poses
from derive.mechanics.pseudo_velocities import choose_kinematics
from tests.derive.descriptions import motor, part, robot, steered, wheel

AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))
MOTORS = (motor("left"), motor("right"))
ARM = part("frames", name="arm", parent="body", at=["a", "e"], angle="g")
POINT = part("bodies", frame="arm", at=["L", "e"], mass="m")  # without an inertia
DISC = part("bodies", frame="arm", at=["L", "e"], mass="0", inertia="I")
FORK = (steered("fork", ("a", "0"), "beta"), wheel("front", "fork"))
ROBOTS = {
    "two wheels": robot(*AXLE, *MOTORS, part("bodies", frame="body", at=["a", "-e"], mass="2*m", inertia="I/2")),
    "no wheel": robot(),
    "an arm that is a point": robot(*AXLE, *MOTORS, ARM, POINT, motor("arm"), angles=("g",)),
    "an arm that is a disc": robot(*AXLE, *MOTORS, ARM, DISC, motor("arm"), angles=("g",)),
    "a car": robot(*FORK, wheel("rear"), motor("rear"), motor("fork"), angles=("beta",)),
    "a car, its author's velocities": robot(
        *FORK, wheel("rear"), motor("rear"), motor("fork"), angles=("beta",),
        v={"v": "x_dot*cos(phi) + y_dot*sin(phi)", "s": "beta_dot"},
    ),
    "an arm behind a gear": robot(
        *AXLE, *MOTORS, ARM.replace('"g"', '"pi/3 - g/2"'), POINT, motor("arm"), angles=("g",)
    ),
    "an arm that is fixed": robot(*AXLE, *MOTORS, ARM.replace('"g"', '"pi/3"'), POINT),
    "an arm that turns the other way": robot(*AXLE, *MOTORS, ARM.replace('"g"', '"-g"'), POINT, angles=("g",)),
    "a root beside its coordinates": robot(*AXLE, *MOTORS).replace(
        '["x", "y"]', '["x + a*cos(phi)", "y + a*sin(phi)"]'
    ),
    "rollers": robot(
        *(wheel(f"w{k}", at=(f"a*cos({t})", f"a*sin({t})"), heading=f"{t} + pi/2", roller_angle="pi/6")
          for k, t in enumerate(("0", "2*pi/3", "-2*pi/3"))),
        *(motor(f"w{k}") for k in range(3)),
    ),
    "a further constraint": robot(
        wheel("one", at=("a", "b"), roller_angle="0"),
        part("constraints", expression="-x_dot*sin(phi) + y_dot*cos(phi) + e*phi_dot"), motor("one"),
    ),
}  # fmt: skip
Solved = tuple[Kinematics, Dynamics]


@cache
def solved(text: str) -> Solved:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        described = read_robot(path)
    kinematics = choose_kinematics(described, constraint_rows(described))
    return kinematics, derive_dynamics(kinematics)


@pytest.fixture(params=ROBOTS)
def made(request: pytest.FixtureRequest) -> Solved:
    return solved(ROBOTS[request.param])


class Place:
    """A configuration with velocities: values of expressions there."""

    def __init__(self, kinematics: Kinematics, seed: int) -> None:
        self.kinematics = kinematics
        random = np.random.default_rng(seed)
        self.q = random.uniform(0.3, 1.2, len(kinematics.q))
        self.v = random.uniform(0.3, 1.2, len(kinematics.v))
        self.q_dot = self(kinematics.kinematic_matrix) @ self.v

    def __call__(self, matrix: sp.Matrix, given: Mapping[sp.Symbol, float] | None = None) -> np.ndarray:
        """The matrix here: named terms first, each from those before it."""
        k, matrix = self.kinematics, sp.Matrix(matrix)
        numbers = k.robot.numbers | dict(zip((*k.q, *k.v), (*self.q, *self.v), strict=True)) | dict(given or {})
        for symbol, expression in k.terms.needed(matrix).items():
            numbers[symbol] = expression.xreplace(numbers).evalf()
        return np.array(matrix.xreplace(numbers).evalf().tolist(), dtype=float).reshape(matrix.shape)

    def moved(self, q: np.ndarray, v: np.ndarray) -> Place:
        """Another one, so far from here."""
        other = Place(self.kinematics, 0)
        other.q, other.v = self.q + q, self.v + v
        other.q_dot = other(self.kinematics.kinematic_matrix) @ other.v
        return other

    def motion(self, frame: str, at: tuple) -> tuple[np.ndarray, np.ndarray]:
        """(x, y, heading) of a point of a frame, and their rates per pseudo-velocity."""
        pose = frame_poses(self.kinematics.robot)[frame]
        where = sp.Matrix([*pose.point(at), pose.heading])
        jacobian = self(where.jacobian(self.kinematics.q))
        return self(where)[:, 0], jacobian @ self(self.kinematics.kinematic_matrix)


def test_every_motion_obeys_the_constraints_and_is_told_by_its_velocities(made: Solved) -> None:
    """A S = 0, N S = 1, and as many rows as are independent; the others follow from these."""
    kinematics, _ = made
    place, count = Place(kinematics, 0), len(kinematics.v)
    A, S = place(kinematics.constraint_matrix), place(kinematics.kinematic_matrix)
    rates = [kinematics.robot.rate(q) for q in kinematics.q]
    N = place(sp.Matrix([[form.get(rate, 0) for rate in rates] for form in kinematics.pseudo_velocities.values()]))
    np.testing.assert_allclose(A @ S, np.zeros((len(A), count)), atol=1e-12)
    np.testing.assert_allclose(N @ S, np.eye(count), atol=1e-12)
    assert len(A) == len(kinematics.q) - count == len(kinematics.kept)
    assert len(A) == 0 or np.linalg.matrix_rank(A) == len(A)
    robot = kinematics.robot
    slipless = {f"wheel {w.name!r} does not slip sideways" for w in robot.wheels if w.is_conventional}
    further = {f"constraint number {k}" for k in range(1, len(robot.constraints) + 1)}
    assert {*kinematics.kept, *kinematics.dropped} == slipless | further
    assert len(kinematics.kept) + len(kinematics.dropped) == len(slipless | further)


def test_wheels_roll_as_their_places_move(made: Solved) -> None:
    """No speed along an axle; a spin times the radius is the speed ahead, or that across the rollers."""
    kinematics, _ = made
    place = Place(kinematics, 0)
    for one in kinematics.robot.wheels:
        (_, _, heading), slopes = place.motion(one.frame, one.at)
        heading += float(place(sp.Matrix([one.heading]))[0, 0])
        spin = place(kinematics.wheel_rates[one.name].row(kinematics.v))[0]
        radius = float(place(sp.Matrix([one.radius]))[0, 0])
        roller = 0.0 if one.roller_angle is None else float(place(sp.Matrix([one.roller_angle]))[0, 0])
        along = np.cos(heading + roller) * slopes[0] + np.sin(heading + roller) * slopes[1]
        np.testing.assert_allclose(spin * radius * np.cos(roller), along, atol=1e-12)
        if one.roller_angle is None:
            np.testing.assert_allclose(np.cos(heading) * slopes[1] - np.sin(heading) * slopes[0], 0.0, atol=1e-12)


def test_frames_move_as_their_poses_do(made: Solved) -> None:
    """Ahead, aside and turning in a frame's own axes at the point that it is stated for; joints as their angles."""
    kinematics, _ = made
    place = Place(kinematics, 0)
    for frame in kinematics.robot.frames:
        velocity = kinematics.velocities[frame.name]
        (_, _, heading), slopes = place.motion(frame.name, velocity.point)
        c, s = np.cos(heading), np.sin(heading)
        expected = np.array([c * slopes[0] + s * slopes[1], c * slopes[1] - s * slopes[0], slopes[2]])
        forms = (velocity.forward, velocity.lateral, velocity.turning)
        found = np.vstack([place(form.row(kinematics.v)) for form in forms])
        np.testing.assert_allclose(found, expected, atol=1e-12)
        if frame.parent is not None:
            parent = place.motion(frame.parent, (0, 0))[1][2]
            joint = place(kinematics.joint_rates[frame.name].row(kinematics.v))[0]
            np.testing.assert_allclose(joint, slopes[2] - parent, atol=1e-12)


def test_the_dynamics_are_those_of_masses_at_their_places(made: Solved) -> None:
    """Virtual power: sum m p'' . dp'/dv + I w' dw/dv = what motors and loads do, for every pseudo-velocity."""
    kinematics, dynamics = made
    place, step, random = Place(kinematics, 0), 1e-6, np.random.default_rng(10)
    u = random.normal(size=len(dynamics.inputs))
    w = random.normal(size=len(dynamics.loads))
    given = dict(zip((*dynamics.inputs, *dynamics.loads), (*u, *w), strict=True))
    v_dot = place(dynamics.acceleration, given)[:, 0]
    ahead, behind = (place.moved(sign * step * place.q_dot, sign * step * v_dot) for sign in (1, -1))
    balance = w.copy()
    robot = kinematics.robot
    for one in (*robot.bodies, *robot.wheels):
        mass, inertia = place(sp.Matrix([one.mass, one.inertia]))[:, 0]
        slopes = place.motion(one.frame, one.at)[1]
        rates = [there.motion(one.frame, one.at)[1] @ there.v for there in (ahead, behind)]
        balance += slopes.T @ (np.array([mass, mass, inertia]) * (rates[0] - rates[1]) / (2 * step))
    for one in robot.wheels:
        spin = [there(kinematics.wheel_rates[one.name].row(kinematics.v))[0] for there in (place, ahead, behind)]
        inertia = place(sp.Matrix([one.spin_inertia]))[0, 0]
        balance += inertia * spin[0] * (spin[1] @ ahead.v - spin[2] @ behind.v) / (2 * step)
    X = place(kinematics.actuator_rates_matrix)
    gains, damping = (
        place(sp.Matrix([[getattr(one, name)] for one in robot.motors]))[:, 0] if robot.motors else np.zeros(0)
        for name in ("torque_gain", "back_emf")
    )
    balance -= X.T @ (gains * u - damping * (X @ place.v))
    np.testing.assert_allclose(balance, 0.0, atol=1e-6)
    inertia_matrix = place(dynamics.inertia_matrix)
    np.testing.assert_allclose(inertia_matrix, inertia_matrix.T, atol=1e-12)


def test_a_value_at_the_defaults_is_a_finite_real_number_or_none() -> None:
    """Through names, and with nothing to be caught."""
    kinematics, _ = solved(ROBOTS["two wheels"])
    a, b, e = (sp.Symbol(name, real=True) for name in "abe")
    named = kinematics.terms.name("length_squared", a**2 + b**2)
    assert kinematics.at_defaults(named / e) == pytest.approx((0.3**2 + 0.25**2) / 0.05)
    assert kinematics.at_defaults(sp.S(3)) == 3.0
    for expression in (1 / (a - 6 * e), sp.sqrt(b - a), a / (a - 6 * e) - b / (a - 6 * e), b + sp.Symbol("free")):
        assert np.isnan(kinematics.at_defaults(expression))


def test_pseudo_velocities_are_refused_if_one_is_left_out_or_there_twice(made: Solved) -> None:
    """They have to describe the motion that the constraints leave, all of it and nothing else."""
    kinematics, _ = made
    described, (first, *others) = kinematics.robot, kinematics.v
    constraints, forms = constraint_rows(described), kinematics.pseudo_velocities
    assert solve_kinematics(described, forms, constraints).kinematic_matrix == kinematics.kinematic_matrix
    with pytest.raises(NotSolvable):
        solve_kinematics(described, {v: forms[v] for v in others}, constraints)
    again = sp.Symbol("again", real=True)
    with pytest.raises(NotSolvable):
        solve_kinematics(described, {**forms, again: forms[first]}, constraints)
