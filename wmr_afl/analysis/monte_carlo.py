"""Many robots at random under one law: what is drawn, and what each run comes to in windows of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wmr_afl.experiments.experiment import Experiment
from wmr_afl.experiments.vary import Differences, vary
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.batch import BatchOptions, advance_all
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times

Draws = dict[str, NDArray[np.float64]]  # by name, one number a robot
Window = tuple[float, float]  # [s], both ends belong to it

SPREAD = 0.3  # of every uncertain parameter of a robot, relative, to both sides
OFF = 3.0  # first estimates are wrong by up to this factor, as likely too small as too large
DISTANCE, ANGLE = 1.0, 1.0  # [m], [rad] between a start and the experiment's


def robots_around(model: Model, random: np.random.Generator, count: int) -> Draws:
    """Factors on the uncertain parameters: robots that are off by up to `SPREAD`."""
    uncertain = [name for name in model.parameter_units if name not in model.known_units]
    return {f"parameters.{name}": random.uniform(1.0 - SPREAD, 1.0 + SPREAD, count) for name in uncertain}


def wrong_guesses(
    model: Model, random: np.random.Generator, count: int, base: str = "passivity_parameters", off: float = OFF
) -> Draws:
    """Factors on every entry of the first estimate, drawn one by one."""
    return {f"estimates.{name}": off ** random.uniform(-1.0, 1.0, count) for name in model.units_of(base)}


def starts_around(loop: ClosedLoop, random: np.random.Generator, count: int) -> Draws:
    """Places in a disc around the start of a robot with x, y and phi, and headings."""
    start = dict(zip(loop.model.state_units, loop.plant.start, strict=True))
    angle, distance = random.uniform(0.0, 2.0 * np.pi, count), DISTANCE * np.sqrt(random.uniform(0.0, 1.0, count))
    return {
        "x": start["x"] + distance * np.cos(angle),
        "y": start["y"] + distance * np.sin(angle),
        "phi": start["phi"] + random.uniform(-ANGLE, ANGLE, count),
    }


@dataclass(frozen=True)
class Scores:
    """What N runs come to; infinite for runs that failed."""

    rms: Floats  # (W, N, n-m), of the tracking error in each window
    travel: Floats  # (N,) [V/s], how far an input travels in the first window, a mean over the motors

    @property
    def worse(self) -> Floats:
        """The larger RMS of the outputs, (W, N)."""
        return self.rms.max(axis=2)


@dataclass(frozen=True)
class Crowd:
    """Robots at random, the same ones for every law: starts, parameters, first estimates, seeds of noise."""

    start: Draws
    robots: Draws
    guesses: Mapping[str, Draws]  # by the generated function whose values a law estimates
    seeds: NDArray[np.int64]

    @classmethod
    def drawn(cls, loop: ClosedLoop, seed: int, count: int) -> Crowd:
        """Around the robot and the start of a loop."""
        random, model = np.random.default_rng(seed), loop.model
        start, robots = starts_around(loop, random, count), robots_around(model, random, count)
        kinds = ("passivity_parameters", "base_parameters")
        guesses = {kind: wrong_guesses(model, random, count, kind) for kind in kinds}
        return cls(start, robots, guesses, seed + np.arange(count))

    def score(
        self, experiment: Experiment, law: str, loop: ClosedLoop, windows: Sequence[Window],
        threads: int = 1, backend: str = "auto",
    ) -> Scores:  # fmt: skip
        """Run every robot under one law of an experiment; a law that says its first estimates keeps them.

        Raises:
            UnknownNameError: if there is no such backend.
            WmrError: if no robot can have these numbers.
        """
        follows = experiment.controller(law).estimate == "exact"
        guesses = self.guesses.get(loop.law.knowledge.estimated, {}) if follows else {}
        seeds = self.seeds if loop.plant.samples else None
        differences = Differences(start=self.start, scale={**self.robots, **guesses}, seeds=seeds)
        ensemble = vary(experiment, law, loop, differences)
        options = BatchOptions(experiment.simulation.duration, threads=threads, backend=backend)
        watched = _Watched(loop, sample_times(loop, options.duration), ensemble.count, windows)
        with np.errstate(all="ignore"):  # runs that fail grow beyond numbers
            return watched.scores(advance_all(loop, ensemble, options, watched.record).failed)


class _Watched:
    """Sums over the samples of runs, so that no trajectory has to be kept."""

    def __init__(self, loop: ClosedLoop, times: Floats, count: int, windows: Sequence[Window]) -> None:
        self._times, self._places, inputs = times, loop.signal_layout.places, loop.signals["u"]
        self._inside = [(times >= since) & (times <= until) for since, until in windows]
        self._squares = np.zeros((len(windows), loop.signals["e"], count))
        self._travel, self._last = np.zeros((inputs, count)), np.full((inputs, count), np.nan)

    def record(self, robots: slice, samples: slice, rows: Floats) -> None:
        """Count samples (T, signals, robots) of some robots; chunks come in the order of time."""
        error, u = rows[:, self._places["e"]], rows[:, self._places["u"]]
        for squares, inside in zip(self._squares, self._inside, strict=True):
            squares[:, robots] += (error[inside[samples]] ** 2).sum(axis=0)
        late = u[self._inside[0][samples]]
        if len(late):
            steps = np.abs(np.diff(np.concatenate([self._last[None, :, robots], late]), axis=0))
            self._travel[:, robots] += np.nansum(steps, axis=0)  # the first sample of all has none before it
            self._last[:, robots] = late[-1]

    def scores(self, failed: NDArray[np.bool_]) -> Scores:
        """Of all runs."""
        counts = np.array([np.count_nonzero(inside) for inside in self._inside])
        rms = np.sqrt(np.moveaxis(self._squares / counts[:, None, None], 2, 1))
        lasts = np.ptp(self._times[self._inside[0]])
        return Scores(
            np.where(failed[None, :, None], np.inf, rms),
            np.where(failed, np.inf, self._travel.mean(axis=0) / lasts),
        )
