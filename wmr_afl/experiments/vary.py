"""What differs between robots -> the numbers of N robots in a closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.experiments.assembly import rules_of
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.rules import Numbers
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.ensemble import Ensemble


@dataclass(frozen=True)
class Differences:
    """What differs between N robots, by name."""

    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)  # physical ones, (N,)
    start: Mapping[str, ArrayLike] = field(default_factory=dict)  # states, (N,)
    gains: Mapping[str, ArrayLike] = field(default_factory=dict)  # numbers of parts, (N, ...)
    scale: Mapping[str, ArrayLike] = field(default_factory=dict)  # factors on parameters or gains, (N,)
    seeds: ArrayLike | None = None  # of the measurement noise, (N,)

    @property
    def count(self) -> int:
        """N.

        Raises:
            ShapeError: if nothing says how many robots there are, or numbers of robots differ.
        """
        scale = {f"scale of {name}": factor for name, factor in self.scale.items()}
        seeds = {} if self.seeds is None else {"seeds": self.seeds}
        given: dict[str, Any] = {**self.parameters, **self.start, **self.gains, **scale, **seeds}
        counts = {name: len(np.atleast_1d(np.asarray(value))) for name, value in given.items() if np.ndim(value)}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise ShapeError(f"the numbers of robots differ: {listed}")
        if not counts or 0 in counts.values():
            raise ShapeError(
                "nothing says how many robots there are", "give parameters, start, values, scale or seeds as arrays"
            )
        return next(iter(counts.values()))


def vary(experiment: Experiment, controller: str, loop: ClosedLoop, differences: Differences) -> Ensemble:
    """The robots that differ from an experiment's loop in what is given; what follows from that follows for each.

    Raises:
        UnknownNameError: if a name is not one of the loop's.
        ShapeError: if numbers of robots or shapes do not fit.
        WmrError: if a name is ambiguous, or no robot can have these numbers.
    """
    model, count = loop.model, differences.count
    factors: dict[str, dict[str, Floats]] = {"parameters": {}, "gains": {}}
    for name, factor in differences.scale.items():
        place, whole = _place(name, loop)
        factors[place][whole] = np.broadcast_to(np.asarray(factor, dtype=float), (count,))
    p = np.array(np.broadcast_to(model.replaced(loop.values["p"], differences.parameters), (count, _size(loop, "p"))))
    for name, factor in factors["parameters"].items():
        p[:, list(model.parameter_units).index(name)] *= factor
    check_robots(model, experiment.start, p)
    given = {"p": p, "x": _starts(loop, differences.start, count)}
    for name, column in differences.gains.items():
        whole = gain_name(name, loop)
        given[whole] = _each(np.asarray(column, dtype=float), loop.values[whole], count, name)
    usual = {**loop.values, **loop.states}
    numbers = Numbers(rules_of(experiment, controller, model), given, usual, factors["gains"])
    seeds = np.zeros(0, dtype=np.int64)
    if loop.plant.samples:
        drawn = loop.plant.seed if differences.seeds is None else differences.seeds
        seeds = np.broadcast_to(np.asarray(drawn, dtype=np.int64), (count,))
    return Ensemble(_columns(numbers, loop.states, count), _columns(numbers, loop.values, count), seeds)


def gain_name(name: str, loop: ClosedLoop) -> str:
    """The whole name, `outer_loop.b1`, of a gain that may be named by its last part, `b1`.

    Raises:
        UnknownNameError: if no gain has this name.
        WmrError: if several have.
    """
    gains, wanted = _gains(loop), name.removeprefix("gains.")
    found = [gain for gain in gains if wanted in (gain, gain.partition(".")[2])]
    if len(found) > 1:
        raise WmrError(f"{name!r} names several gains", f"write {' or '.join(found)}")
    if not found:
        raise UnknownNameError("value of the loop", name, [*_short(gains)])
    return found[0]


def _place(name: str, loop: ClosedLoop) -> tuple[str, str]:
    """Whether a name is one of `parameters` or of `gains`, and its whole name there."""
    head, _, rest = name.partition(".")
    if head == "gains":
        return "gains", gain_name(name, loop)
    parameters = loop.model.parameter_units
    if head == "parameters":
        if rest not in parameters:
            raise UnknownNameError(f"parameter of {loop.model.name}", rest, parameters)
        return "parameters", rest
    gains = _gains(loop)
    is_gain = any(name in (gain, gain.partition(".")[2]) for gain in gains)
    if name in parameters and is_gain:
        problem = f"{name!r} names a parameter of {loop.model.name} and a gain"
        raise WmrError(problem, f"write parameters.{name} or gains.{name}")
    if name not in parameters and not is_gain:
        raise UnknownNameError("parameter or value of the loop", name, [*parameters, *_short(gains)])
    return ("parameters", name) if name in parameters else ("gains", gain_name(name, loop))


def _gains(loop: ClosedLoop) -> list[str]:
    """Whole names of the numbers that belong to a part."""
    return [name for name in loop.values if "." in name]


def _short(gains: list[str]) -> list[str]:
    """The last part of each name, or the whole name if others end in the same."""
    ends = [gain.partition(".")[2] for gain in gains]
    return [end if ends.count(end) == 1 else gain for gain, end in zip(gains, ends, strict=True)]


def _size(loop: ClosedLoop, name: str) -> int:
    return len(loop.values[name])


def _starts(loop: ClosedLoop, start: Mapping[str, ArrayLike], count: int) -> Floats:
    """Every robot's state at the start, (N, 2n-m)."""
    names = list(loop.model.state_units)
    x = np.broadcast_to(loop.states["x"], (count, len(names))).copy()
    for name, column in start.items():
        if name not in names:
            raise UnknownNameError("state", name, names)
        x[:, names.index(name)] = np.asarray(column, dtype=float)
    return x


def _columns(numbers: Numbers, example: Mapping[str, Floats], count: int) -> Floats:
    """Named numbers, one a robot or one for all, as columns in the layout of `example`."""
    parts = [_each(numbers[name], like, count, name).reshape(count, -1) for name, like in example.items()]
    return np.ascontiguousarray(np.concatenate([np.zeros((count, 0)), *parts], axis=1).T)


def _each(array: Floats, example: Floats, count: int, name: str) -> Floats:
    """An array for all robots or one for each, as one for each: (count, *shape of the example)."""
    shape = np.shape(example)
    if shape == (1,) and array.shape == (count,):  # one number a robot
        array = array[:, None]
    if np.isnan(array).any():
        raise ShapeError(f"{name} holds what is no number (NaN)", "give numbers")
    try:
        return np.broadcast_to(array, (count, *shape))
    except ValueError:
        raise ShapeError(f"{name} has shape {array.shape}", f"expected {shape} or {(count, *shape)}") from None
