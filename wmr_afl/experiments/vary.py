"""What differs between robots -> the numbers of N robots in a closed loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.experiments.assembly import rules_of
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.model.plausibility import RobotFault, robot_faults, start_faults
from wmr_afl.numerics.arguments import real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.numerics.rules import Numbers
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.ensemble import Ensemble
from wmr_input.errors import plain, shown

LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Differences:
    """What differs between N robots, by name."""

    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)  # physical ones, (N,)
    start: Mapping[str, ArrayLike] = field(default_factory=dict)  # states, (N,)
    gains: Mapping[str, ArrayLike] = field(default_factory=dict)  # numbers of parts, (N, ...)
    scale: Mapping[str, ArrayLike] = field(default_factory=dict)  # factors on parameters, gains, estimates, (N,)
    seeds: ArrayLike | None = None  # of the measurement noise, (N,)

    @property
    def count(self) -> int:
        """N.

        Raises:
            ShapeError: if nothing says how many robots there are, or numbers of robots differ.
        """
        scale = {f"scale of {plain(name)}": factor for name, factor in self.scale.items()}
        seeds = {} if self.seeds is None else {"seeds": self.seeds}
        given: dict[str, Any] = {**self.parameters, **self.start, **self.gains, **scale, **seeds}
        counts = {plain(name): len(array) for name, value in given.items() if np.ndim(array := _numbers(name, value))}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise ShapeError(f"the numbers of robots differ: {listed}", "give as many of each")
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
        WmrError: if a name is ambiguous, or a robot cannot have its numbers.
    """
    ensemble, faults = vary_where_possible(experiment, controller, loop, differences)
    if faults:
        robot, (problem, remedy) = min(faults.items())
        where = f"robot {robot}: " if ensemble.count > 1 else ""
        raise WmrError(where + problem, remedy)
    return ensemble


def vary_where_possible(
    experiment: Experiment, controller: str, loop: ClosedLoop, differences: Differences
) -> tuple[Ensemble, dict[int, tuple[str, str]]]:
    """As `vary`, but robots that cannot have their numbers get those of the loop; with problem and remedy for each."""
    model, count = loop.model, differences.count
    factors: dict[str, dict[str, Floats]] = {"parameters": {}, "gains": {}, "estimates": {}}
    for name, factor in differences.scale.items():
        place, whole = _place(name, loop)
        factors[place][whole] = _column(f"scale of {name}", factor, count)
    p = np.empty((count, len(model.parameter_units)))
    of_each = {name: _column(name, value, count) for name, value in differences.parameters.items()}
    p[:] = model.replaced(loop.values["p"], of_each)
    for name, factor in factors["parameters"].items():
        p[:, list(model.parameter_units).index(name)] *= factor
    names = list(loop.law.knowledge.units)
    if factors["estimates"]:
        factors["gains"]["theta_hat"] = np.ones((count, len(names)))
        for name, factor in factors["estimates"].items():
            factors["gains"]["theta_hat"][:, names.index(name)] = factor
    given = {"p": p, "x": _starts(loop, differences.start, count)}
    for name, column in differences.gains.items():
        whole = gain_name(name, loop)
        given[whole] = _each(name, column, loop.values[whole], count)
    usual = {**loop.values, **loop.states}
    with np.errstate(all="ignore"):  # what is not finite is among the faults
        numbers = Numbers(rules_of(experiment, controller, model), given, usual, factors["gains"])
        values = {name: _spread(numbers[name], like, count).copy() for name, like in loop.values.items()}
        states = {name: _spread(numbers[name], like, count).copy() for name, like in loop.states.items()}
    faults: dict[int, tuple[str, str]] = {}
    for is_wrong, describe in _faults(experiment, loop, values, states):
        for robot in np.flatnonzero(is_wrong):
            faults.setdefault(int(robot), describe(int(robot)))
    for name, column in (*values.items(), *states.items()):
        column[list(faults)] = usual[name]
    return Ensemble(_columns(states), _columns(values), _seeds(loop, differences.seeds, count)), faults


def _faults(
    experiment: Experiment, loop: ClosedLoop, values: Mapping[str, Floats], states: Mapping[str, Floats]
) -> Iterator[RobotFault]:
    """What robots cannot have: the checks of a robot and of every part of its loop, for all robots at once."""
    for name, column in (*values.items(), *states.items()):
        is_bound = name in ("projection.lower", "projection.upper")  # which may be open
        wrong = np.isnan(column) if is_bound else ~np.isfinite(column)
        yield wrong.reshape(len(column), -1).any(axis=1), _not_finite(name)
    q = states["x"][:, : loop.model.coordinate_count]
    yield from robot_faults(loop.model, q, values["p"])
    yield from start_faults(loop.model, q, values["p"])
    k = by_part(values)
    for own, (is_wrong, describe) in (*loop.plant.uncertainties.faults(k), *loop.law.parts.faults(k)):
        yield is_wrong, _of_part(own, describe)


def _not_finite(name: str) -> Callable[[int], tuple[str, str]]:
    return lambda robot: (f"{name} is not finite", "give finite numbers")


def _of_part(
    k: SimpleNamespace, describe: Callable[[SimpleNamespace], tuple[str, str]]
) -> Callable[[int], tuple[str, str]]:
    """The description of a part's fault, for one robot out of all."""
    return lambda robot: describe(SimpleNamespace(**{name: column[robot] for name, column in vars(k).items()}))


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
    """Whether a name is one of `parameters`, of `gains` or of `estimates`, and its whole name there."""
    head, _, rest = name.partition(".")
    if head == "gains":
        return "gains", gain_name(name, loop)
    parameters, estimates = loop.model.parameter_units, loop.law.knowledge.units
    if head == "estimates":
        if rest not in estimates:
            raise UnknownNameError(f"estimate of {loop.model.name}", rest, estimates)
        return "estimates", rest
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


def _starts(loop: ClosedLoop, start: Mapping[str, ArrayLike], count: int) -> Floats:
    """Every robot's state at the start, (N, 2n-m)."""
    names = list(loop.model.state_units)
    x = np.broadcast_to(loop.states["x"], (count, len(names))).copy()
    for name, column in start.items():
        if name not in names:
            raise UnknownNameError("state", name, names)
        x[:, names.index(name)] = _column(name, column, count)
    return x


def _seeds(loop: ClosedLoop, seeds: ArrayLike | None, count: int) -> NDArray[np.int64]:
    """Of the noise of each robot, (N,); (0,) if nothing is drawn."""
    drawn = np.asarray(loop.plant.seed if seeds is None else seeds)
    if drawn.dtype.kind not in "iu" or drawn.ndim > 1 or np.any((drawn < 0) | (drawn > LARGEST_SEED)):
        remedy = f"expected whole numbers from zero to {LARGEST_SEED}, one for each robot"
        raise ShapeError(f"seeds are {shown(seeds)}", remedy)
    return np.broadcast_to(drawn.astype(np.int64), (count if loop.plant.samples else 0,))


def _column(name: str, given: ArrayLike, count: int) -> Floats:
    """One number for all robots, or one for each, as (N,)."""
    array = _numbers(name, given)
    if array.shape not in ((), (count,)):
        raise ShapeError(f"{name} has shape {array.shape}", f"expected one number, or {count}: one for each robot")
    return np.broadcast_to(array, (count,))


def _numbers(name: str, given: ArrayLike) -> Floats:
    return real_numbers(plain(name), given, "give one number for each robot")


def _columns(numbers: Mapping[str, Floats]) -> Floats:
    """Named numbers (N, ...) as columns, one a robot."""
    count = len(next(iter(numbers.values())))
    parts = [column.reshape(count, -1) for column in numbers.values()]
    return np.ascontiguousarray(np.concatenate([np.zeros((count, 0)), *parts], axis=1).T)


def _spread(array: Floats, example: Floats, count: int) -> Floats:
    """Numbers shaped as the example, or with robots in front, as those of each: (N, ...)."""
    return np.broadcast_to(array, (count, *np.shape(example)))


def _each(name: str, given: ArrayLike, example: Floats, count: int) -> Floats:
    """A gain as it is given, as that of each robot, (N, ...): by its shape for all, for each entry, or for each robot.

    Raises:
        ShapeError: if the shape fits none of these, or two of them.
    """
    array, shape = _numbers(name, given), np.shape(example)
    whole = (count, *shape)
    for_entries, for_robots = array.shape == shape, array.shape == (count,)
    if for_entries and for_robots and count > 1:
        raise ShapeError(
            f"{name} has shape {array.shape}: one value for each of {count} entries, or one for each of {count} robots",
            f"give the shape {whole}",
        )
    if for_robots:
        array = array.reshape(count, *(1 for _ in shape))
    elif array.shape not in ((), shape, whole):
        raise ShapeError(f"{name} has shape {array.shape}", f"expected {(count,)}, {shape} or {whole}")
    return np.broadcast_to(array, whole)
