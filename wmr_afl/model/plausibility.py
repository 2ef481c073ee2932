"""Numbers that no robot can have are refused before a run, instead of giving a strange one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value

MASSES = ("kg", "kg m^2")  # units of parameters that cannot be negative

RobotFault = tuple[Any, Callable[[int], tuple[str, str]]]  # which robots (N,), and problem and remedy for one of them


def check_robots(model: Model, start: Mapping[str, float], parameters: Floats) -> None:
    """Check parameters p (n_p,), or (N, n_p) for N robots, that start at `start`.

    Raises:
        WmrError: if a robot cannot have them; the text describes the first one.
    """
    _raise_first(robot_faults, model, start, parameters)


def check_start(model: Model, start: Mapping[str, float], parameters: Floats) -> None:
    """Check where robots with parameters p (n_p,), or (N, n_p), start.

    Raises:
        WmrError: if one cannot start there; the text describes the first one.
    """
    _raise_first(start_faults, model, start, parameters)


def _raise_first(
    faults: Callable[[Model, Floats, Floats], Iterator[RobotFault]],
    model: Model,
    start: Mapping[str, float],
    parameters: Floats,
) -> None:
    q = np.array([start.get(name, 0.0) for name in list(model.state_units)[: model.coordinate_count]])
    robots = np.atleast_2d(parameters)
    for is_wrong, describe in faults(model, np.tile(q, (len(robots), 1)), robots):
        if np.any(is_wrong):
            raise WmrError(*describe(int(np.argmax(is_wrong))))


def robot_faults(model: Model, q: Floats, robots: Floats) -> Iterator[RobotFault]:
    """What no robot can have, for parameters p (N, n_p) and coordinates at the start (N, n).

    Masses and inertias are not negative, radii and torque gains positive, base parameters finite, and the inertia
    matrix is positive definite at the start.
    """
    names = dict(zip(model.parameter_units, robots.T, strict=True))
    for name, unit in model.parameter_units.items():
        if unit in MASSES:
            yield names[name] < 0.0, _negative(name, unit, names[name])
    wheels, motors = model.metadata["geometry"]["wheels"], model.metadata["motors"]
    for what, formula in (
        *((f"the radius of wheel {wheel!r}", parts["radius"]) for wheel, parts in wheels.items()),
        *((f"the torque gain of {motor!r}", parts["torque_gain"]) for motor, parts in motors.items()),
    ):
        with np.errstate(all="ignore"):
            value = np.broadcast_to(numpy_value(formula, names), (len(robots),))
        yield ~(value > 0.0), _not_positive(what, value)

    def described(robot: int) -> str:
        changed = zip(names, robots[robot], model.parameters(), strict=True)
        return (
            ", ".join(f"{name} = {value:g}" for name, value, default in changed if value != default) or "the defaults"
        )

    with np.errstate(all="ignore"):
        theta, inertia = model.base_parameters(robots), model.inertia_matrix(q, robots)
    yield (
        ~np.isfinite(theta).all(axis=1),
        lambda i: (f"the base parameters are not finite with {described(i)}", "choose values that a robot can have"),
    )
    finite = np.isfinite(inertia).all(axis=(1, 2))
    inertia[~finite] = 0.0
    yield (
        ~(finite & (np.linalg.eigvalsh(inertia)[:, 0] > 0.0)),
        lambda i: (f"the inertia matrix is not positive definite with {described(i)}", "choose positive masses"),
    )


def start_faults(model: Model, q: Floats, robots: Floats) -> Iterator[RobotFault]:
    """Where no robot can start, for coordinates (N, n) and parameters (N, n_p): with joints beyond their limits."""
    if not model.has("joint_stops"):
        return
    limited = [name for name, frame in model.metadata["geometry"]["frames"].items() if "limits" in frame]
    left = np.asarray(model.joint_stops(q, robots)).reshape(len(robots), len(limited), 2)
    for index, name in enumerate(limited):
        beyond = -left[:, index].min(axis=1)
        yield beyond > 0.0, _beyond(name, beyond)


def _beyond(joint: str, beyond: Floats) -> Callable[[int], tuple[str, str]]:
    return lambda i: (f"the joint {joint!r} starts {beyond[i]:.3g} rad beyond its limits", "start within them")


def _negative(name: str, unit: str, values: Floats) -> Callable[[int], tuple[str, str]]:
    return lambda i: (f"{name} = {values[i]:g} {unit} is negative", "choose a mass or inertia that a robot can have")


def _not_positive(what: str, values: Floats) -> Callable[[int], tuple[str, str]]:
    return lambda i: (f"{what} is {values[i]:g}", "choose a positive one")
