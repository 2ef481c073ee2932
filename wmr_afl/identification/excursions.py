"""Robots that are not as they were guessed: what bounds their motion, loops around their steering, one sample of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.identification.alike import is_geometry
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.formulas import numpy_value, words_of
from wmr_afl.plant.integrators import rk4

SUBSTEP = 1.0  # of the time constant of what is fastest in the robot: the longest step of integration
MOST_STEPS = 40  # of integration in a sample
SMALLEST = 1e-3  # [rad] of a limit
REGULAR = 0.8  # of the way from the start to where the kinematics are singular, that angles may go unless limited
SPREAD = 0.3  # by which uncertain parameters are off, relative to the guess


@dataclass(frozen=True)
class Space:
    """What a motion has to keep within: the position of the root frame, and angles."""

    names: tuple[str, ...]  # of coordinates; of a joint whose angle is not a coordinate
    lower: Floats
    upper: Floats
    function: ca.Function  # x -> these quantities (k,)
    start: Floats  # x at rest, (2n-m,)

    @property
    def middle(self) -> Floats:
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> Floats:
        return 0.5 * (self.upper - self.lower)

    def values(self, states: Floats) -> Floats:
        """Of states (..., 2n-m): (..., k)."""
        flat = states.reshape(-1, states.shape[-1])
        found = self.function.map(len(flat))(flat.T).full().T
        return found.reshape(*states.shape[:-1], len(self.names))

    def fractions(self, states: Floats) -> Floats:
        """How much of the way from the middle to a limit is gone over (T, ..., 2n-m), (..., k): infinite if lost."""
        with np.errstate(invalid="ignore"):
            found = np.abs(self.values(states) - self.middle) / self.half
        return np.where(np.isfinite(found), found, np.inf).max(axis=0)


def space_of(model: Model, parameters: Floats, room: float, limits: Mapping[str, float]) -> Space:
    """Within `room` [m] of the start in x and y, `limits` [rad] of coordinates, and those of the description.

    Angles also keep away from where the kinematics are singular: there a robot that is off is lost.

    Raises:
        UnknownNameError: if no coordinate has the name of a limit.
        WmrError: if a limit is not positive, or contradicts the description.
    """
    coordinates = list(model.state_units)[: model.coordinate_count]
    frames = model.metadata["geometry"]["frames"].values()
    root = next(frame for frame in frames if "parent" not in frame)
    position = [root["x"], root["y"]]
    if not set(position) <= set(coordinates):
        problem = f"the root frame of {model.name} is at {', '.join(position)}"
        raise WmrError(problem, "let its position be two of the coordinates")
    bounds = dict.fromkeys(position, (-room, room))
    for name, value in limits.items():
        if name not in coordinates or name in position:
            raise UnknownNameError(f"limit of {model.name}", name, [one for one in coordinates if one not in position])
        if not SMALLEST <= value < np.inf:
            raise WmrError(f"the limit of {name} is {value:g} rad", f"give an angle of {SMALLEST:g} rad or more")
        bounds[name] = (-value, value)
    made = model.in_library("casadi")
    x = ca.SX.sym("x", len(model.state_units))
    quantities = {name: x[coordinates.index(name)] for name in bounds}
    for joint, first, last, angle in _stops(model, made, x, parameters):
        own = _coordinate(angle, x, coordinates)
        name = joint if own is None else own
        least, most = bounds.get(name, (-np.inf, np.inf))
        bounds[name], quantities[name] = (max(least, first), min(most, last)), angle
        if not bounds[name][0] < bounds[name][1]:
            problem = f"the limit of {name} excludes every angle of {joint!r}"
            raise WmrError(problem, f"it turns from {first:g} to {last:g} rad")
    start = np.zeros(len(model.state_units))
    for name, (least, most) in bounds.items():
        if name in coordinates and not least < 0.0 < most:
            start[coordinates.index(name)] = 0.5 * (least + most)
    for name, reach in _regular(model, parameters, coordinates, start):
        if name in position:
            continue
        at, (least, most) = start[coordinates.index(name)], bounds.get(name, (-np.inf, np.inf))
        bounds[name] = max(least, at - reach), min(most, at + reach)
        quantities.setdefault(name, x[coordinates.index(name)])
    lower, upper = (np.array(side, dtype=float) for side in zip(*bounds.values(), strict=True))
    function = ca.Function("bounded", [x], [ca.densify(ca.vertcat(*quantities.values()))])
    return Space(tuple(bounds), lower, upper, function, start)


def _regular(model: Model, p: Floats, coordinates: Sequence[str], start: Floats) -> Iterator[tuple[str, float]]:
    """How far the coordinates of each singularity of S(q) may go from the start, in whatever directions [rad]."""
    known = dict(zip(model.parameter_units, p, strict=True)) | dict(zip(coordinates, start, strict=False))
    way = np.linspace(0.0, np.pi, 721)
    for text in model.findings["kinematic_singularities"]:
        factor = str(text).removesuffix("= 0")
        there = [name for name in coordinates if name in words_of(factor)]
        reach = np.inf
        for signs in product((-1.0, 1.0), repeat=len(there)):
            moved_on = {name: known[name] + sign * way for name, sign in zip(there, signs, strict=True)}
            value = np.broadcast_to(numpy_value(factor, known | moved_on), way.shape)
            beyond = np.flatnonzero(value * value[0] <= 0.0)
            reach = min(reach, way[beyond[0]] if len(beyond) else np.inf)
        if 0.0 < reach < np.inf:
            yield from ((name, REGULAR * reach) for name in there)


def _stops(model: Model, made: Model, x: ca.SX, p: Floats) -> list[tuple[str, float, float, ca.SX]]:
    """Joints that the description limits: name, lower and upper angle, and the angle of x."""
    if not model.has("joint_stops"):
        return []
    values = dict(zip(model.parameter_units, p, strict=True))
    frames = model.metadata["geometry"]["frames"].items()
    limited = {name: frame["limits"] for name, frame in frames if "limits" in frame}
    left = made.joint_stops(x[: model.coordinate_count], p)
    found = []
    for index, (name, texts) in enumerate(limited.items()):
        lower, upper = (float(numpy_value(text, values)) for text in texts)
        found.append((name, lower, upper, left[2 * index] + lower))
    return found


def _coordinate(angle: ca.SX, x: ca.SX, coordinates: Sequence[str]) -> str | None:
    """The coordinate that an angle is, if it is one."""
    function, state = ca.Function("angle", [x], [angle]), np.random.default_rng(0).normal(size=x.shape[0])
    value = float(function(state))
    return next((name for name, one in zip(coordinates, state, strict=False) if abs(value - one) < 1e-9), None)


@dataclass(frozen=True)
class SteeringLoop:
    """u = feedforward + gain (reference - angle) of a motor that turns a joint, once a sample, within the voltage."""

    motor: str
    joint: str
    coordinate: str  # whose angle it is
    gain: float  # [V/rad]
    reference: Floats  # (T,) [rad]


def steering_gains(model: Model, p: Floats, start: Floats, sample: float) -> dict[str, tuple[str, str, float]]:
    """Motor -> joint, coordinate and gain [V/rad], for each motor that turns a joint.

    From angle'' = -a angle' + b u: the gain gives a damping of 0.7, or less bandwidth if samples are too slow.
    """
    n, motors = model.coordinate_count, list(model.input_units)
    rest, none = np.zeros(len(motors)), np.zeros(model.pseudo_velocity_count)
    rates = np.asarray(model.actuator_rates_matrix(start[:n], p))
    kinematics = np.asarray(model.kinematic_matrix(start[:n], p))
    drift = np.asarray(model.state_jacobian(start, rest, none, p))[n:, n:]
    effect = np.asarray(model.input_jacobian(start, rest, none, p))[n:]
    found = {}
    for row in model.metadata["slip_rows"]:
        if "joint" not in row or row.get("motor") is None:
            continue
        j = motors.index(row["motor"])
        same = [i for i in range(n) if np.allclose(kinematics[i], rates[j]) or np.allclose(kinematics[i], -rates[j])]
        if not same:
            continue
        b = float(kinematics[same[0]] @ effect[:, j])
        a = -float(kinematics[same[0]] @ drift @ effect[:, j]) / b
        bandwidth = min(0.5 * a, 0.25 / sample)
        found[row["motor"]] = (row["joint"], list(model.state_units)[same[0]], a / b * bandwidth)
    return found


def substeps(model: Model, p: Floats, start: Floats, sample: float) -> int:
    """How many steps of integration a sample takes.

    Raises:
        WmrError: if the robot is so fast that they would be too many.
    """
    none = np.zeros(model.pseudo_velocity_count)
    with np.errstate(all="ignore"):
        jacobian = np.asarray(model.state_jacobian(start, np.zeros(len(model.input_units)), none, p))
    fastest = np.inf
    if np.all(np.isfinite(jacobian)):
        fastest = float(np.abs(np.linalg.eigvals(jacobian)).max(initial=0.0)) / (1.0 - SPREAD)
    if fastest * sample > MOST_STEPS * SUBSTEP:
        problem = f"{model.name} changes by {fastest:.3g} 1/s, too fast for voltages that are held for {sample:g} s"
        raise WmrError(problem, "look at its masses and motor constants")
    return max(1, int(np.ceil(fastest * sample / SUBSTEP)))


def moved(model: Model, p: Array, x: Array, u: Array, sample: float, count: int) -> Array:
    """The state one sample later, the voltages held."""
    none = np.zeros(model.pseudo_velocity_count)
    for _ in range(count):
        x = rk4(lambda _, state: model.state_derivative(state, u, none, p), 0.0, x, sample / count)
    return x


def others(model: Model, p: Floats, count: int, seed: int) -> Floats:
    """Robots whose uncertain parameters are off by up to SPREAD, (count, n_p), the first one as guessed.

    Lengths that the kinematics depend on, and known constants, are kept. Every other robot is off by all of SPREAD.
    """
    off = np.random.default_rng(seed).uniform(-SPREAD, SPREAD, (count, len(p)))
    off[1::2] = SPREAD * np.sign(off[1::2])
    off[0] = 0.0
    return p * (1.0 + np.where(is_geometry(model, p), 0.0, off))
