"""TODO wmr_afl.experiments.vary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.tracking_law import ControllerTable
from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.experiments.initial_estimates import adaptation_gain, first_estimate, relative_bounds
from wmr_afl.model.plausibility import check_robots
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.ensemble import Numbers, Variation


def vary(
    told: Experiment,
    loop: ClosedLoop,
    controller: str,
    parameters: Mapping[str, ArrayLike],
    start: Mapping[str, ArrayLike],
    values: Mapping[str, ArrayLike],
    seeds: ArrayLike | None,
    scale: Mapping[str, ArrayLike] | None = None,
) -> Variation:
    """The robots that differ from an experiment's loop in what is given, each (N,) or (N, ...).

    `scale` multiplies physical parameters or values by one factor a robot.
    Raises: UnknownNameError; ShapeError, where the numbers of robots differ; WmrError, where no robot is like that.
    """
    scale = scale or {}
    seeded = {} if seeds is None else {"seeds": seeds}
    count = _count({**parameters, **start, **values, **{f"scale of {name}": s for name, s in scale.items()}, **seeded})
    for name in scale:
        if name not in loop.model.parameter_units and name not in loop.values:
            known = [*loop.model.parameter_units, *loop.values]
            raise UnknownNameError("parameter or value of the loop", name, known)
    physical = _physical(told, loop, parameters, scale)
    p = np.broadcast_to(loop.model.parameters(**physical), (count, len(loop.model.parameter_units)))
    check_robots(loop.model, told.start, p)
    estimate = first_estimate(loop.model, physical, told.controller(controller))
    states = {**loop.states, "theta_hat": estimate, "x": _starts(loop, start, count)}
    numbers: dict[str, Numbers] = {**loop.values, "p": p, "c": loop.model.known(p)}
    if told.uncertainties.payload is not None:
        changed = {**physical, **told.uncertainties.payload.parameters}
        numbers["payload_parameters"] = loop.model.parameters(**changed)
    numbers |= _gains(told.controller(controller), loop, estimate, values, scale, count)
    drawn = np.zeros(0, dtype=np.int64)
    if loop.plant.noise is not None:
        drawn = np.broadcast_to(np.asarray(loop.plant.noise.seed if seeds is None else seeds, dtype=np.int64), (count,))
    return Variation(_columns(states, loop.states, count), _columns(numbers, loop.values, count), drawn)


def _physical(
    told: Experiment, loop: ClosedLoop, parameters: Mapping[str, ArrayLike], scale: Mapping[str, ArrayLike]
) -> dict[str, ArrayLike]:
    """Physical parameters that are not the defaults."""
    physical: dict[str, ArrayLike] = {**told.parameters, **parameters}
    for name in loop.model.parameter_units:
        if name in scale:
            nominal = physical.get(name, loop.model.metadata["defaults"][name])
            physical[name] = np.asarray(nominal, dtype=float) * np.asarray(scale[name], dtype=float)
    return physical


def _starts(loop: ClosedLoop, start: Mapping[str, ArrayLike], count: int) -> Numbers:
    """Every robot's state at the start, (N, 2n-m)."""
    names = list(loop.model.state_units)
    x = np.broadcast_to(loop.states["x"], (count, len(names))).copy()
    for name, column in start.items():
        if name not in names:
            raise UnknownNameError("state", name, names)
        x[:, names.index(name)] = np.asarray(column, dtype=float)
    return x


def _gains(
    table: ControllerTable,
    loop: ClosedLoop,
    estimate: Numbers,
    values: Mapping[str, ArrayLike],
    scale: Mapping[str, ArrayLike],
    count: int,
) -> dict[str, Numbers]:
    """Values of the loop that differ; what an experiment tells relative to others follows these."""
    gains: dict[str, Numbers] = {}
    if table.adaptation is not None and table.adaptation.relative_gain is not None:
        gain = adaptation_gain(table.adaptation, estimate, list(loop.model.base_parameter_units))
        gains["Gamma"] = np.asarray(gain, dtype=float)
    if table.projection is not None and table.projection.relative is not None:
        gains["lower"], gains["upper"] = relative_bounds(table.projection, estimate)
    for name, column in values.items():
        if name not in loop.values:
            raise UnknownNameError("value of the loop", name, loop.values)
        gains[name] = np.asarray(column, dtype=float)

    def each(name: str) -> Numbers:
        return _each(gains.get(name, loop.values[name]), loop.values[name], count, name)

    for name in [name for name in scale if name in loop.values]:
        factor = np.broadcast_to(np.asarray(scale[name], dtype=float), (count,))
        gains[name] = each(name) * factor.reshape(count, *[1] * loop.values[name].ndim)
    if not {"b1", "b2"}.isdisjoint(gains) and "alpha" not in gains and _alpha_follows(table):
        gains["alpha"] = each("b2") / each("b1")
    return gains


def _alpha_follows(table: ControllerTable) -> bool:
    return table.outer_loop is not None and table.outer_loop.alpha is None


def _columns(given: Mapping[str, Numbers], example: Mapping[str, Numbers], count: int) -> Numbers:
    """Named arrays, one a robot or one for all, as columns in the layout of `example`."""
    parts = [_each(given[name], like, count, name).reshape(count, -1) for name, like in example.items()]
    return np.ascontiguousarray(np.concatenate([np.zeros((count, 0)), *parts], axis=1).T)


def _each(given: ArrayLike, example: Numbers, count: int, name: str) -> Numbers:
    """An array for all robots or one for each, as one for each: (count, *shape of the example)."""
    array, shape = np.asarray(given, dtype=float), np.shape(example)
    if shape == (1,) and array.shape == (count,):  # one number a robot
        array = array[:, None]
    if np.isnan(array).any():
        raise ShapeError(f"{name} holds what is no number (NaN)", "give numbers")
    try:
        return np.broadcast_to(array, (count, *shape))
    except ValueError:
        raise ShapeError(f"{name} has shape {array.shape}", f"expected {shape} or {(count, *shape)}") from None


def _count(given: Mapping[str, Any]) -> int:
    counts = {name: len(np.atleast_1d(np.asarray(value))) for name, value in given.items() if np.ndim(value)}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise ShapeError(f"the numbers of robots differ: {told}")
    if not counts or 0 in counts.values():
        raise ShapeError("nothing says how many robots there are", "give parameters, start, values or seeds as arrays")
    return next(iter(counts.values()))
