"""How the robots of a batch differ: their starts, numbers and seeds, one column a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.experiment import Experiment
from wmr_afl.first_estimates import adaptation_gain, first_estimate, relative_bounds

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Variation:
    """N robots."""

    states: Numbers  # (states of the loop, N)
    values: Numbers  # (values of the loop, N)
    seeds: NDArray[np.int64]  # (N,), or (0,) without noise

    @property
    def count(self) -> int:
        return int(self.states.shape[1])

    def block(self, lanes: slice, width: int) -> Variation:
        """Some robots, the last one repeated up to `width`."""
        chosen = np.minimum(np.arange(lanes.start, lanes.start + width), lanes.stop - 1)
        seeds = self.seeds[chosen] if len(self.seeds) else self.seeds
        return Variation(self.states[:, chosen], self.values[:, chosen], seeds)


def vary(
    told: Experiment,
    loop: ClosedLoop,
    controller: str,
    parameters: Mapping[str, ArrayLike],
    start: Mapping[str, ArrayLike],
    values: Mapping[str, ArrayLike],
    seeds: ArrayLike | None,
) -> Variation:
    """The robots that differ from an experiment's loop in what is given, each (N,) or (N, ...).

    Raises: UnknownNameError; ShapeError, where the numbers of robots differ.
    """
    model, table = loop.model, told.controller(controller)
    given = {**parameters, **start, **values, **({} if seeds is None else {"seeds": seeds})}
    count = _count(given)
    physical = {**told.parameters, **parameters}
    p = np.broadcast_to(model.parameters(**physical), (count, len(model.parameter_units)))
    numbers: dict[str, Numbers] = {**loop.values, "p": p, "c": model.known(p)}
    if told.uncertainties.payload is not None:
        numbers["payload_parameters"] = model.parameters(**{**physical, **told.uncertainties.payload.parameters})
    states: dict[str, Numbers] = dict(loop.states)
    estimate = states["theta_hat"] = first_estimate(model, physical, table)
    if table.adaptation is not None and table.adaptation.relative_gain is not None:
        gain = adaptation_gain(table.adaptation, estimate, list(model.base_parameter_units))
        numbers["Gamma"] = np.asarray(gain, dtype=float)
    if table.projection is not None and table.projection.relative is not None:
        numbers["lower"], numbers["upper"] = relative_bounds(table.projection, estimate)
    x = np.broadcast_to(loop.states["x"], (count, len(model.state_units))).copy()
    for name, column in start.items():
        if name not in model.state_units:
            raise UnknownNameError("state", name, model.state_units)
        x[:, list(model.state_units).index(name)] = np.asarray(column, dtype=float)
    states["x"] = x
    for name, column in values.items():
        if name not in loop.values:
            raise UnknownNameError("value of the loop", name, loop.values)
        numbers[name] = np.asarray(column, dtype=float)
    drawn = np.zeros(0, dtype=np.int64)
    if loop.plant.noise is not None:
        drawn = np.broadcast_to(np.asarray(loop.plant.noise.seed if seeds is None else seeds, dtype=np.int64), (count,))
    return Variation(_columns(states, loop.states, count), _columns(numbers, loop.values, count), drawn)


def _columns(given: Mapping[str, Numbers], example: Mapping[str, Numbers], count: int) -> Numbers:
    """Named arrays, one a robot or one for all, as columns in the layout of `example`."""
    parts = []
    for name, shape in Layout(example).shapes.items():
        array = np.asarray(given[name], dtype=float)
        if shape == (1,) and array.shape == (count,):  # one number a robot
            array = array[:, None]
        try:
            parts.append(np.broadcast_to(array, (count, *shape)).reshape(count, -1))
        except ValueError:
            raise ShapeError(f"{name} has shape {array.shape}; expected {shape} or {(count, *shape)}") from None
    return np.ascontiguousarray(np.concatenate([np.zeros((count, 0)), *parts], axis=1).T)


def _count(given: Mapping[str, Any]) -> int:
    counts = {name: len(np.atleast_1d(np.asarray(value))) for name, value in given.items() if np.ndim(value)}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise ShapeError(f"the numbers of robots differ: {told}")
    if not counts or 0 in counts.values():
        raise ShapeError("nothing says how many robots there are; give parameters, start, values or seeds as arrays")
    return next(iter(counts.values()))
