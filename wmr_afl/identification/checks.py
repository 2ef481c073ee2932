"""What a log does wrong, before anything is estimated: each check is a line of the report, with a remedy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.identification.log import Log
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.numerics.arrays import Floats

DISAGREE = 0.015  # of a rate, by which encoders and another sensor may differ
SCATTER = 4.0  # standard deviations of that share, which it must exceed besides
LATE = 0.01  # [s], by which a sensor may be later than the encoders
DEGREES = 180.0 / np.pi
UNITS = "units"  # the check that says so
STILL = 3.0  # standard deviations of a channel: less is no motion
ALIKE = 0.9  # of the samples at which two motors have the same voltage to the last digit
MISSING = 5.0  # times its noise, that a pseudo-velocity has at least
LARGEST = 0.98  # of the samples at which a voltage is at its largest
DRIVEN = 0.1  # of the largest voltage, by which a motor's varies that is driven
SHOWN = 3  # times of spikes that are named
JITTER = 0.05  # of a sample, by which times from row to row differ if it is worth a word
MANY = 0.02  # of the rows, that are missing: with more of them a log tells less than it could
LEAST = 2.0  # [s], that a log lasts at least


@dataclass(frozen=True)
class Finding:
    """A check: what it looked at and found, and what to do; `is_fine` if nothing has to be done."""

    name: str
    text: str
    remedy: str = ""

    @property
    def is_fine(self) -> bool:
        """Whether nothing has to be done."""
        return not self.remedy

    def __str__(self) -> str:
        return f"{self.name}: {self.text}" + (f"; {self.remedy}" if self.remedy else "")


def check_length(log: Log) -> None:
    """Whether there is enough of it to look at its noise.

    Raises:
        WmrError: if the log is too short.
    """
    if not log.segments or log.duration < LEAST:
        problem = f"the log lasts {log.duration:.2g} s, and {LEAST:g} s are the least"
        raise WmrError(problem, "log 20 s of motion, better 60")


def check_input(log: Log, noise: Floats) -> None:
    """Whether there is anything to go by.

    Raises:
        WmrError: if the log is too short, at rest, or its voltages never change or are at their limit throughout.
    """
    check_length(log)
    u = np.concatenate([segment.u for segment in log.segments])
    if not np.any(np.ptp(u, axis=0) > 0.0):
        if not np.any(u):
            raise WmrError("the motors never have any voltage", "log the voltages that the motors had")
        raise WmrError(
            "the voltages never change", "vary them, as `wmr-afl excite` proposes, or begin at rest with 0 V"
        )
    moved = [max(float(np.ptp(segment.z[:, k])) for segment in log.segments) for k in range(len(log.channels))]
    if all(range_ < STILL * np.sqrt(12.0) * spread for range_, spread in zip(moved, noise, strict=True)):
        raise WmrError("the robot never moves", "drive it: voltages well above what friction holds")
    most = np.abs(u).max(axis=0)
    is_at_limit = np.all(np.abs(u) > 0.999 * np.where(most > 0.0, most, np.inf), axis=1).mean() > LARGEST
    begins_at_rest = any(not np.any(segment.u[0]) for segment in log.segments)
    if is_at_limit and not begins_at_rest:
        volts = ", ".join(f"{value:g}" for value in most)
        raise WmrError(
            f"the voltages are at their largest ({volts} V) throughout", "log with less, so that none is cut"
        )


def dead_encoders(log: Log) -> list[int]:
    """Channels of motors that stand still, although the motor has voltage."""
    u = np.concatenate([segment.u for segment in log.segments])
    z = np.concatenate([segment.z - segment.z[:1] for segment in log.segments])
    return [
        k
        for k, one in enumerate(log.channels)
        if one.matrix == "motor" and len(np.unique(z[:, k])) <= 2 and np.ptp(u[:, one.index]) > DRIVEN * np.abs(u).max()
    ]


def missing_motions(smoother: Smoother, motions: list[Motion]) -> list[str]:
    """Pseudo-velocities that the log does not show: their noise is all there is of them."""
    effort = smoother.effort
    chosen = [(motion, motion.x[motion.ok]) for motion in motions if motion.ok.any()]
    size = np.sqrt(np.mean(np.concatenate([x[:, effort.n :] for _, x in chosen]) ** 2, axis=0))
    noise = np.max([smoother.spread(motion.segment, x[:: max(1, len(x) // 200)]) for motion, x in chosen], axis=0)
    names = list(effort.model.state_units)[effort.n :]
    return [name for name, own, least in zip(names, size, MISSING * noise, strict=True) if own < least]


def findings(smoother: Smoother, log: Log, motions: list[Motion]) -> Iterator[Finding]:
    """Every check of a log that can be used."""
    if log.turned:
        yield Finding("turns", f"{', '.join(log.turned)} begins anew after a turn: counted on")
    yield from _spikes(log)
    yield from _sensors(smoother, motions)
    yield from _uneven(log)
    yield from _repeated(log)
    yield _voltage(log)


def _sensors(smoother: Smoother, motions: list[Motion]) -> Iterator[Finding]:
    """Encoders against each other way of measuring the same."""
    others = [k for k, one in enumerate(smoother.channels) if one.matrix != "motor" and smoother.used[k]]
    wheels = [k for k, one in enumerate(smoother.channels) if one.matrix == "motor"]
    name = "encoders against other sensors"
    compared = False
    for k in others:
        found = _compared(smoother, motions, k, wheels)
        if found is None:
            continue
        channel = smoother.channels[k].name
        slope, deviation = found.slope, found.slope_deviation
        if deviation > 0.5 * max(abs(slope), 1.0):
            continue  # of a motion that there is not
        compared = True
        if abs(found.lag) > max(LATE, SCATTER * found.lag_deviation):
            when = "later" if found.lag > 0.0 else "earlier"
            text = f"{channel} comes {1e3 * abs(found.lag):.0f} ms {when} than the encoders"
            yield Finding("sensors at one time", text, f"log both at the same instant, or leave {channel} out")
        if abs(abs(slope) / DEGREES - 1.0) < 0.1:
            text = f"{channel} is {abs(slope):.1f} times what the encoders say"
            yield Finding(UNITS, text, f"convert {channel} to rad")
        elif abs(abs(slope) * DEGREES - 1.0) < 0.1:
            text = f"the encoders say {1.0 / abs(slope):.1f} times what {channel} says"
            yield Finding(UNITS, text, "convert the encoders to rad")
        elif slope < 0.0:
            text = f"{channel} runs against the encoders (by a factor of {slope:.2f})"
            yield Finding(name, text, f"multiply {channel} by -1 (counter-clockwise is positive), or the encoders")
        elif abs(slope - 1.0) > max(DISAGREE, SCATTER * deviation):
            text = f"{channel} moves {100 * (slope - 1):+.1f} % against what the encoders say"
            yield Finding(name, text, "measure wheel radius and track again (--set), or wheels slip")
        else:
            yield Finding(name, f"{channel} agrees to {100 * (slope - 1):+.2f} % (+- {200 * deviation:.2f} %)")
    if not compared:
        yield Finding(name, "nothing to compare: no sensor besides the encoders says the same")


@dataclass(frozen=True)
class _Comparison:
    """A channel's rate y beside what the encoders say of it, x: y = slope (x - lag x')."""

    slope: float
    slope_deviation: float
    lag: float  # [s], by which it is later than the encoders
    lag_deviation: float


def _compared(smoother: Smoother, motions: list[Motion], k: int, wheels: list[int]) -> _Comparison | None:
    """By least squares over all motions; None if encoders say nothing of the channel."""
    effort = smoother.effort
    columns, seen = [np.empty((0, 2))], [np.empty(0)]
    for motion in motions:
        good = np.flatnonzero(motion.ok)
        if len(good) < 3:
            continue
        rows, rates = smoother.rows(motion.x[good, : effort.n]), motion.rates[good]
        own, encoders = rows[:, k], rows[:, wheels]
        combination = np.einsum("ti,tij->tj", own, np.linalg.pinv(encoders, rcond=1e-9))
        left = np.linalg.norm(own - np.einsum("tj,tji->ti", combination, encoders), axis=1)
        follows = left < 1e-6 * np.linalg.norm(own, axis=1)
        told = np.einsum("tj,tj->t", combination, rates[:, wheels])
        columns.append(np.column_stack([told, -np.gradient(told, motion.segment.step)])[follows])
        seen.append(rates[follows, k])
    x, y = np.concatenate(columns), np.concatenate(seen)
    if len(x) < 50 or not np.all(np.any(x, axis=0)):
        return None
    found = np.linalg.lstsq(x, y, rcond=None)[0]
    correlated = max(2 * smoother.half(motion.segment.step) + 1 for motion in motions)
    spread = np.sqrt(correlated * np.mean((y - x @ found) ** 2) * np.diag(np.linalg.inv(x.T @ x)))
    slope, lag = float(found[0]), float(found[1] / found[0]) if found[0] else 0.0
    return _Comparison(slope, float(spread[0]), lag, float(spread[1] / abs(slope)) if slope else np.inf)


def _spikes(log: Log) -> Iterator[Finding]:
    """Cells that were left out."""
    for name, at in log.spikes.items():
        text = f"{name} jumps in {len(at)} row{'' if len(at) == 1 else 's'} and is back then, {_times(at)}: left out"
        yield Finding("spikes", text, "look at its cable and how it is read")


def _times(at: Sequence[float]) -> str:
    """The first of them."""
    text = ", ".join(f"{one:.6g}" for one in at[:SHOWN])
    return f"at t = {text} s" + (" ..." if len(at) > SHOWN else "")


def _uneven(log: Log) -> Iterator[Finding]:
    """Rows that do not lie on a grid of time."""
    if log.lost == 0.0 and log.jitter < JITTER:
        return
    step = f"{1e3 * float(np.median([segment.step for segment in log.segments])):.3g} ms"
    text = f"put on a grid of {step}"
    if log.jitter >= JITTER:
        text += f"; times from row to row differ by {log.jitter:.0%}, and voltages are means of what was held"
    if log.lost:
        text += f"; {max(log.lost, 0.001):.1%} of the rows are missing, and voltages there lie between those beside"
    yield Finding("rows", text, "write every row at a fixed rate" if log.lost > MANY else "")


def _repeated(log: Log) -> Iterator[Finding]:
    slow = {one.name: period for one, period in zip(log.channels, log.periods, strict=True) if period > 0.0}
    written = 1e3 * min(segment.step for segment in log.segments)
    if not slow:
        yield Finding("repeated values", "none: every sample is a new one")
    for name, period in slow.items():
        text = f"{name} changes every {1e3 * period:.0f} ms only, and is written every {written:.0f} ms"
        yield Finding(
            "repeated values", text, "log at the rate at which it is measured; smoothing spans two updates here"
        )


def _voltage(log: Log) -> Finding:
    u = np.concatenate([segment.u for segment in log.segments])
    under = np.any(u != 0.0, axis=1)
    name = "voltage"
    if u.shape[1] > 1 and under.any():
        pairs = [
            (i, j)
            for i in range(u.shape[1])
            for j in range(i)
            if np.mean(np.abs(u[under, i]) == np.abs(u[under, j])) > ALIKE
        ]
        if pairs:
            names = list(log.model.input_units)
            alike = " and ".join(names[k] for k in sorted(pairs[0]))
            text = f"{alike} are alike to the last digit: commanded, not measured"
            return Finding(name, text, "log what the motors had; sag of the battery is taken for inertia and back-EMF")
    return Finding(name, "nothing says that it was commanded and not measured")
