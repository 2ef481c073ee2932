"""Forward dynamics of every robot, and forces of the floor, equal an independent derivation.

The witness takes Lagrange's equations of the first kind from the description: poses as functions of the coordinates,
every wheel's spin as one coordinate more, rates by automatic differentiation, and all conditions on rates, redundant
ones too, as rows with multipliers. Nothing is projected, simplified or dropped.

Spins have to be coordinates: with a rolling rate put into the energy first, Lagrange's equations would be wrong for
Swedish wheels, by a force that does no work and that no law of energy notices.
"""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tests.conftest import DESCRIPTIONS
from tests.derive import descriptions
from wmr_afl import Model, load_model
from wmr_input import Algebra, evaluate

FUNCTIONS = {name: getattr(ca, name) for name in ("sin", "cos", "tan", "sqrt", "exp")}
COUNT = 50  # random states
TOLERANCE = 1e-9  # relative, entry by entry
LARGEST_ANGLE = 1.0  # rad: keeps away from steering angles of 90 degrees, where models may be singular


@dataclass(frozen=True)
class Pose:
    """Where a frame is in the plane, as a function of the coordinates."""

    origin: ca.SX  # [m]
    heading: ca.SX  # [rad]

    def point(self, at: ca.SX) -> ca.SX:
        """The position of the frame's point `at`."""
        return self.origin + ca.horzcat(direction(self.heading), direction(self.heading + math.pi / 2)) @ at


class Witness:
    """Lagrange's equations with multipliers of one described robot, in coordinates [q; spins of the wheels]."""

    def __init__(self, description: dict, pseudo_velocities: dict[str, str]) -> None:
        self.description = description
        names, wheels = list(description["coordinates"]), description.get("wheels", [])
        self.q = ca.SX.sym("q", len(names) + len(wheels))
        self.rate = ca.SX.sym("rate", self.q.numel())
        self.p = ca.SX.sym("p", len(description["parameters"]))
        self.u = ca.SX.sym("u", len(description["motors"]))
        self.w = ca.SX.sym("w", len(pseudo_velocities))
        self.spin = {wheel["name"]: self.q[len(names) + i] for i, wheel in enumerate(wheels)}
        self.names = {"pi": math.pi}
        self.names |= dict(zip(description["parameters"], ca.vertsplit(self.p), strict=True))
        for i, name in enumerate(names):
            self.names |= {name: self.q[i], f"{name}_dot": self.rate[i]}
        self.pose = {frame["name"]: self._pose(frame) for frame in description["frames"]}
        v = ca.vertcat(*(self._value(text) for text in pseudo_velocities.values()))
        self.function = ca.Function("witness", [self.q, self.rate, self.u, self.w, self.p], self._equations(v))

    def motion(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At one state x, u, w, p: x' = [q'; v'], the force on q of all that is sideways, and each wheel's force along.

        Rates come from v, then accelerations and multipliers, both by least squares.
        """
        x, u, w, p = arguments
        n = len(self.description["coordinates"])
        q, v = np.append(x[:n], np.zeros(len(self.spin))), x[n:]  # what is spun so far does not matter
        A, _, N, *_ = self._numbers(q, 0 * q, u, w, p)
        rate = least_squares(np.vstack([A, N]), np.append(np.zeros(len(A)), v))
        A, A_drift, N, N_drift, M, force = self._numbers(q, rate, u, w, p)
        system = np.block([[M, -A.T], [A, np.zeros((len(A), len(A)))]])
        acceleration, multipliers = np.split(least_squares(system, np.append(force, -A_drift)), [len(q)])
        along = np.array([row in self.along for row in range(len(A))])
        sideways = A[~along, :n].T @ multipliers[~along]
        return np.append(rate[:n], N @ acceleration + N_drift), sideways, multipliers[along]

    def _numbers(self, *arguments: np.ndarray) -> list[np.ndarray]:
        matrices = [value.full() for value in self.function(*arguments)]
        return [value.ravel() if i in (1, 3, 5) else value for i, value in enumerate(matrices)]

    def _equations(self, v: ca.SX) -> list[ca.SX]:
        """A, A' rate, N, N' rate, M and f in A rate = 0, N rate = v, M rate' = f + A^T lambda."""
        rows, energy = self._conditions(), self._energy()
        momentum = ca.gradient(energy, self.rate)
        A, N = ca.jacobian(rows, self.rate), ca.jacobian(v, self.rate)
        force = self._motor_forces() - N.T @ self.w + ca.gradient(energy, self.q) - self._rate_of(momentum)
        return [A, self._rate_of(rows), N, self._rate_of(v), ca.jacobian(momentum, self.rate), force]

    def _energy(self) -> ca.SX:
        """Kinetic energy: every mass at its own place, every wheel's own spin."""
        energy = ca.SX(0)
        for body in [*self.description.get("bodies", []), *self.description.get("wheels", [])]:
            pose = self.pose[body["frame"]]
            speed, turning = self._rate_of(pose.point(self._vector(body["at"]))), self._rate_of(pose.heading)
            energy += self._value(body.get("mass", 0)) / 2 * ca.sumsqr(speed)
            energy += self._value(body.get("inertia", 0)) / 2 * turning**2
        for wheel in self.description.get("wheels", []):
            energy += self._value(wheel.get("spin_inertia", 0)) / 2 * self._rate_of(self.spin[wheel["name"]]) ** 2
        return energy

    def _conditions(self) -> ca.SX:
        """What vanishes: wheels' slip sideways and along, and the description's further constraints."""
        rows = [self._value(constraint["expression"]) for constraint in self.description.get("constraints", [])]
        self.along: list[int] = []  # rows of rolling, in the order of wheels
        for wheel in self.description.get("wheels", []):
            pose = self.pose[wheel["frame"]]
            speed = self._rate_of(pose.point(self._vector(wheel["at"])))
            heading, roller = pose.heading + self._value(wheel.get("heading", 0)), ca.SX(0)
            if "roller_angle" in wheel:
                roller = self._value(wheel["roller_angle"])
            else:
                rows.append(ca.dot(direction(heading + math.pi / 2), speed))
            self.along.append(len(rows))
            rolled = self._value(wheel["radius"]) * self._rate_of(self.spin[wheel["name"]]) * ca.cos(roller)
            rows.append(ca.dot(direction(heading + roller), speed) - rolled)
        return ca.vertcat(*rows)

    def _motor_forces(self) -> ca.SX:
        """Generalized forces of the motors, from the virtual power torque times rate."""
        frames = self.description["frames"]
        joints = {frame["name"]: self._value(frame["angle"]) for frame in frames if "angle" in frame}
        force = ca.SX(self.q.numel(), 1)
        for motor, voltage in zip(self.description["motors"], ca.vertsplit(self.u), strict=True):
            angle = (self.spin | joints)[motor["drives"]]
            back_emf = self._value(motor.get("back_emf", 0)) * self._rate_of(angle)
            force += ca.gradient(angle, self.q) * (self._value(motor["torque_gain"]) * voltage - back_emf)
        return force

    def _pose(self, frame: dict) -> Pose:
        """The pose of a frame, from its parents' down from the root."""
        if "parent" not in frame:
            return Pose(self._vector(frame["position"]), self._value(frame["heading"]))
        parent = self._pose(next(one for one in self.description["frames"] if one["name"] == frame["parent"]))
        return Pose(parent.point(self._vector(frame["at"])), parent.heading + self._value(frame["angle"]))

    def _rate_of(self, value: ca.SX) -> ca.SX:
        return ca.jacobian(value, self.q) @ self.rate

    def _vector(self, texts: list) -> ca.SX:
        return ca.vertcat(*map(self._value, texts))

    def _value(self, text: str | float) -> ca.SX:
        return ca.SX(evaluate(str(text), Algebra(self.names, FUNCTIONS, float)))


def direction(angle: ca.SX) -> ca.SX:
    """The unit vector at `angle`."""
    return ca.vertcat(ca.cos(angle), ca.sin(angle))


def least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The shortest solution, as redundant rows leave multipliers free."""
    return np.linalg.lstsq(matrix, right, rcond=1e-13)[0]


@dataclass(frozen=True)
class Sample:
    """Random states, voltages, loads and parameters of one robot, and what the witness says of them."""

    model: Model
    arguments: tuple[np.ndarray, ...]  # x, u, w, p, a row each state
    expected: np.ndarray  # x'
    sideways: np.ndarray  # A^T lambda
    along: np.ndarray  # of each wheel

    def deviation(self, state_derivative: Callable[..., np.ndarray]) -> float:
        """The largest deviation from the witness, relative to the entry or its median over the states."""
        size = np.abs(self.expected)
        difference = np.abs(state_derivative(*self.arguments) - self.expected)
        return float(np.max(difference / np.maximum(size, np.median(size, axis=0))))


@pytest.fixture
def sample(robot: str) -> Sample:
    return sample_of(load_model(robot), DESCRIPTIONS[robot].read_text(encoding="utf-8"))


def sample_of(model: Model, text: str) -> Sample:
    description = tomllib.loads(text)
    formulas = description.get("pseudo_velocities", model.findings["pseudo_velocities"])
    witness = Witness(description, formulas)
    arguments = random_arguments(model)
    found = zip(*(witness.motion(*row) for row in zip(*arguments, strict=True)), strict=True)
    return Sample(model, arguments, *map(np.array, found))


def random_arguments(model: Model) -> tuple[np.ndarray, ...]:
    """x, u, w, p: moderate angles, parameters within 20 % of their defaults."""
    random = np.random.default_rng(11)
    x = random.normal(size=(COUNT, len(model.state_units)))
    angles = [i for i, unit in enumerate(model.state_units.values()) if unit == "rad"]
    x[:, angles] = random.uniform(-LARGEST_ANGLE, LARGEST_ANGLE, (COUNT, len(angles)))
    u = random.normal(scale=10.0, size=(COUNT, len(model.input_units)))
    w = random.normal(scale=10.0, size=(COUNT, model.pseudo_velocity_count))
    p = model.parameters() * random.uniform(0.8, 1.2, (COUNT, len(model.parameter_units)))
    return x, u, w, p


def test_forward_dynamics_equal_an_independent_derivation(sample: Sample) -> None:
    assert sample.deviation(sample.model.state_derivative) <= TOLERANCE


def test_forces_of_the_floor_equal_an_independent_derivation(sample: Sample) -> None:
    assert force_deviation(sample) <= TOLERANCE


@pytest.mark.parametrize("term", ["constraint_forces", "rolling_forces"])
def test_a_millionth_more_in_any_force_is_noticed(term: str, sample: Sample) -> None:
    forces = sample.model.functions()[term]
    for index in range(sample.model.metadata["functions"][term]["size"][0]):
        sample.model._add(term, lambda *given, index=index: forces(*given) * (1 + 1e-6 * one_at(index, forces(*given))))
        is_always_zero = not np.any(forces(*given_forces(sample))[:, index])
        assert is_always_zero or force_deviation(sample) > TOLERANCE


def force_deviation(sample: Sample) -> float:
    """The largest deviation of a force from the witness, relative to the largest one at its state."""
    model, (x, _, _, p) = sample.model, sample.arguments
    A = model.constraint_matrix(x[:, : model.coordinate_count], p)
    sideways = np.einsum("kmn,km->kn", A, model.constraint_forces(*given_forces(sample)))
    along = model.rolling_forces(*given_forces(sample))
    deviation = 0.0
    for value, expected in ((sideways, sample.sideways), (along, sample.along)):
        size = np.maximum(np.abs(expected), np.median(np.abs(expected), axis=0))
        difference = np.abs(value - expected) - TOLERANCE * 1e-3 * np.abs(expected).max(axis=1, keepdims=True)
        deviation = max(deviation, float(np.max(difference / np.maximum(size, 1e-300), initial=0.0)))
    return deviation


def given_forces(sample: Sample) -> tuple[np.ndarray, ...]:
    """x, u, a, p with the accelerations of the witness."""
    x, u, _, p = sample.arguments
    return x, u, sample.expected[:, sample.model.coordinate_count :], p


def one_at(index: int, values: np.ndarray) -> np.ndarray:
    return np.eye(values.shape[1])[index]


OFF_CENTRE = descriptions.robot(
    descriptions.wheel("left", at=("-e", "b")),
    descriptions.wheel("right", at=("-e", "-b")),
    descriptions.steered("fork", ("a", "0"), "beta"),
    descriptions.wheel("caster", "fork", ("-L", "0")),
    descriptions.part("bodies", frame="fork", at=("e", "b"), mass="m", inertia="I"),
    descriptions.part("bodies", frame="body", at=("b", "e"), mass="m", inertia="0"),
    descriptions.motor("left"),
    descriptions.motor("right"),
    angles=("beta",),
)


def test_no_frame_needs_its_origin_on_an_axle_or_in_its_mass(tmp_path: Path) -> None:
    """Derived now: an axle behind the body's origin, a fork whose wheel is off the joint, bodies anywhere."""
    sample = sample_of(load_model(descriptions.derived(OFF_CENTRE, tmp_path)), OFF_CENTRE)
    assert sample.deviation(sample.model.state_derivative) <= TOLERANCE
    assert force_deviation(sample) <= TOLERANCE


def test_a_millionth_more_in_any_rate_is_noticed(sample: Sample) -> None:
    for factor in 1 + 1e-6 * np.eye(sample.expected.shape[1]):
        deviation = sample.deviation(lambda *given, factor=factor: factor * sample.model.state_derivative(*given))
        assert deviation > TOLERANCE
