"""Conditions that proofs in discrete time need, tried along a run: how fast an adaptation may be for its samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from wmr_afl.controllers.direct_adaptation import guessed_inertia
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop

BEYOND = float(np.finfo(float).max)  # stands for what floating point cannot hold
MOST = 20_000  # samples that are looked at, evenly spread


@dataclass(frozen=True)
class Condition:
    """A number that has to stay below a bound at every sample, for an energy that falls; sufficient, not necessary."""

    statement: str
    at_start: float
    largest: float
    time: float  # [s], of the largest
    bound: float
    share: float  # of the samples at which it does not hold
    remedy: str

    @property
    def holds(self) -> bool:
        """Whether it held at every sample that was looked at."""
        return self.share == 0.0

    def __str__(self) -> str:
        return f"{self.statement}: up to {self.largest:.3g} at {self.time:g} s, the bound is {self.bound:.3g}"


def conditions(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[Condition]:
    """The conditions of a loop's law; `signals` (T, ...) and `numbers` of the robot, by name."""
    samples = len(signals["x"])
    if not samples:
        return
    rows = np.arange(0, samples, -(-samples // MOST))
    times = np.asarray(rows * loop.sample_time, dtype=np.float64)
    seen = {name: signal[rows] for name, signal in signals.items()}
    with np.errstate(all="ignore"):  # far away numbers overflow: then no bound holds
        if "adaptation.Gamma" in numbers:
            remedy = "sample faster, lower the adaptation gain, or start closer to the reference"
            speeds, bound = _of_the_gradient(loop, seen, numbers), float(numbers["outer_loop.alpha"].min())
            yield _condition("dt eig_max(W Gamma W^T) < alpha", speeds, bound, times, remedy)
        if "direct.inertia" in numbers:
            remedy = "guess a smaller inertia, sample faster or lower the rate"
            bound = 2.0 - float(numbers["error.rate"][0]) * loop.sample_time
            speeds = _of_direct_adaptation(loop, seen, numbers)
            yield _condition("kappa dt N0/N < 2 - lambda dt", speeds, bound, times, remedy)


def _of_the_gradient(loop: ClosedLoop, seen: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Floats:
    """dt eig_max(W Gamma W^T), (T,): below alpha, the law (25) in steps of dt lessens the Lyapunov function (43)."""
    model = loop.model.in_library("numpy")
    Gamma = numbers["adaptation.Gamma"]
    gain = np.diag(Gamma) if Gamma.ndim == 1 else Gamma
    W = np.asarray(model.regressor(seen["x"], seen["command"], numbers["c"]))
    changes = W @ gain @ np.swapaxes(W, -1, -2)
    speeds, sound = np.full(len(W), np.inf), np.isfinite(changes).all(axis=(-1, -2))
    speeds[sound] = loop.sample_time * np.linalg.eigvalsh(changes[sound])[:, -1]
    return speeds


def _of_direct_adaptation(loop: ClosedLoop, seen: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Floats:
    """kappa dt N0/N, the largest of the groups, (T,), with the inertia N that the robot has at the start."""
    inertia = guessed_inertia(
        loop.model.in_library("numpy"), seen["x"], loop.law.knowledge.truth(numbers["p"]), numbers["c"]
    )
    times = np.max(numbers["direct.inertia"] / inertia, axis=-1)
    return np.asarray(numbers["direct.gain"][0] * loop.sample_time * times)


def _condition(statement: str, values: Floats, bound: float, times: Floats, remedy: str) -> Condition:
    values = np.where(np.isfinite(values), values, BEYOND)
    worst, share = int(np.argmax(values)), float(np.mean(~(values < bound)))
    return Condition(statement, float(values[0]), float(values[worst]), float(times[worst]), bound, share, remedy)
