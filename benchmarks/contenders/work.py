"""What every contender is given: robots as plain numbers, taken by name from an assembled loop."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import Experiment, read_experiment
from wmr_afl.simulation.closed_loop import ClosedLoop

Numbers = NDArray[np.float64]
LOGGED = ("x", "u", "e", "theta_hat")  # signals of a trajectory, one row a sample


@dataclass(frozen=True)
class Summary:
    """What is left of many runs."""

    final: Numbers  # (N, 2n-m), the state at the end of the last sample
    rms: Numbers  # (N, n-m), of the tracking error


@dataclass(frozen=True)
class Work:
    """One controller of an experiment's file, for N robots that differ in their starts and physical parameters.

    Parameters may differ where the first estimate does not follow from them.
    """

    file: Path
    controller: str
    start: Mapping[str, Numbers] = field(default_factory=dict)  # (N,) each
    parameters: Mapping[str, Numbers] = field(default_factory=dict)

    @cached_property
    def experiment(self) -> Experiment:
        return read_experiment(self.file)[0]

    @cached_property
    def loop(self) -> ClosedLoop:
        return assemble(self.experiment, self.file)[self.controller]

    @property
    def robots(self) -> int:
        return max((len(column) for column in (*self.start.values(), *self.parameters.values())), default=1)

    @cached_property
    def times(self) -> Numbers:
        """(T,) [s]"""
        count = round(self.experiment.simulation.duration / self.loop.sample_time) + 1
        return np.arange(count) * self.loop.sample_time

    def states(self) -> Numbers:
        """The loops' states at the start, (N, states)."""
        return self._flat(self.loop.states, "x", list(self.loop.model.state_units), self.start)

    def values(self) -> Numbers:
        """The loops' parameters and gains, (N, values)."""
        return self._flat(self.loop.values, "p", list(self.loop.model.parameter_units), self.parameters)

    def few(self, robots: int) -> Work:
        """The same for the first robots only."""
        start, parameters = (
            {name: column[:robots] for name, column in part.items()} for part in (self.start, self.parameters)
        )
        return Work(self.file, self.controller, start, parameters)

    def _flat(
        self, named: Mapping[str, Numbers], varied: str, entries: list[str], columns: Mapping[str, Numbers]
    ) -> Numbers:
        arrays = {name: np.tile(np.ravel(value), (self.robots, 1)) for name, value in named.items()}
        for name, column in columns.items():
            arrays[varied][:, entries.index(name)] = column
        if "p" in arrays:
            arrays["c"] = self.loop.model.known(arrays["p"])  # the controller knows each robot's own constants
        return np.ascontiguousarray(np.concatenate(list(arrays.values()), axis=1))


def lasting(experiment: str, duration: float, folder: Path) -> Path:
    """A copy of a shipped experiment that takes `duration` [s]."""
    text = read_experiment(experiment)[1].read_text(encoding="utf-8")
    copy = folder / f"{experiment}.toml"
    copy.write_text(re.sub(r"(?m)^duration = \S+", f"duration = {duration!r}", text), encoding="utf-8")
    return copy


def places(work: Work) -> dict[str, slice]:
    """Where each of the loop's signals lies in a row of all."""
    ends = np.cumsum([0, *work.loop.signals.values()])
    return {name: slice(a, b) for name, a, b in zip(work.loop.signals, ends[:-1], ends[1:], strict=True)}


def split(work: Work, rows: Numbers) -> dict[str, Numbers]:
    """The signals of a trajectory's rows, in the order of LOGGED."""
    ends = np.cumsum([work.loop.signals[name] for name in LOGGED])
    return dict(zip(LOGGED, np.split(rows, ends[:-1], axis=1), strict=True))
