"""What a model foretells of a part of the log that it was not made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import InputError
from wmr_afl.identification.estimate import Estimate
from wmr_afl.identification.log import Log
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.simulated import Simulated
from wmr_afl.numerics.arrays import Floats

WHOLE = 20.0  # [s], that a segment may last to be foretold as a whole; longer ones in windows
WINDOW = 2.0  # [s]
SHORT = 10.0  # [s], a test that is held out or not as a whole


def split(log: Log, hold_out: str | float) -> tuple[Log, Log]:
    """What estimates are made from, and what they are tried on: segments by name (`*backward`), or a share of the log.

    A share is the end of each segment, where they last; of many short tests, some from all over the log.

    Raises:
        InputError: if there is no such segment, nothing would be left, or the share is none.
    """
    if isinstance(hold_out, str) and not (_is_number(hold_out) and all(one.name != hold_out for one in log.segments)):
        held = [one for one in log.segments if fnmatchcase(one.name, hold_out)]
        kept = [one for one in log.segments if not fnmatchcase(one.name, hold_out)]
        names = ", ".join(dict.fromkeys(one.name or "(no name)" for one in log.segments))
        if not held or not kept:
            problem = "is the whole log" if held else "is no segment of the log"
            raise InputError("hold_out", repr(hold_out), problem, f"name one of several (there is {names}), or a share")
        return log.of(kept), log.of(held)
    share = float(hold_out)
    if not 0.0 < share <= 0.8:
        wanted = "choose one above 0 and up to 0.8, or name a segment"
        raise InputError("hold_out", f"{share:g}", "is no share of the log that can be held out", wanted)
    lengths = [len(one) * one.step for one in log.segments]
    if len(lengths) > 2 and np.median(lengths) < SHORT:
        count = max(1, round(share * len(lengths)))
        chosen = {int((i + 0.5) * len(lengths) / count) for i in range(count)}
        kept, held = ([one for i, one in enumerate(log.segments) if (i in chosen) is so] for so in (False, True))
        return log.of(kept), log.of(held)
    cuts = [round((1.0 - share) * len(one)) for one in log.segments]
    kept = [one.part(0, cut) for one, cut in zip(log.segments, cuts, strict=True)]
    return log.of(kept), log.of([one.part(cut, len(one)) for one, cut in zip(log.segments, cuts, strict=True)])


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def foretold(smoother: Smoother, motion: Motion, estimate: Estimate) -> tuple[NDArray[np.intp], Floats]:
    """Rows (T,) of a motion, and v (T, n-m) simulated there from the voltages alone, window after window.

    A window begins with the measured state. What is simulated passes the filter that what was measured has passed.
    """
    effort, segment = smoother.effort, motion.segment
    good, reach = np.flatnonzero(motion.ok), smoother.reach(segment.step)
    duration = len(good) * segment.step
    count = len(good) - 1 if duration <= WHOLE else min(len(good) - 1, round(WINDOW / segment.step) + 2 * reach)
    if count <= 2 * reach:
        return np.empty(0, dtype=int), np.empty((0, effort.n_v))
    starts = np.arange(good[0], good[-1] - count + 1, count - 2 * reach)
    held = np.stack([segment.u[start : start + count] for start in starts])
    numbers = np.repeat(estimate.unknown[None], len(starts), axis=0)
    states = Simulated(effort, segment.step).states(numbers, motion.x[starts], held)
    rows = (starts[:, None] + np.arange(reach, count - reach)).ravel()
    v = states[:-1, effort.n : effort.n + effort.n_v]
    with np.errstate(invalid="ignore"):  # of a simulation that fails
        filtered = smoother.averaged(v, segment.step)
    velocities = filtered.transpose(2, 0, 1).reshape(-1, effort.n_v)
    return rows, velocities


@dataclass(frozen=True)
class Score:
    """100 (1 - |v - vhat|/|v - mean v|) over all that was held out, simulated from the voltages."""

    each: Floats  # (n-m,) [%], of each pseudo-velocity; NaN where it never changes, -inf where the simulation fails
    overall: float  # [%], of all motors' rates together, in which each has its weight


def score(smoother: Smoother, motions: Sequence[Motion], estimate: Estimate) -> Score:
    """How well an estimate foretells what was held out."""
    effort = smoother.effort
    velocities: list[tuple[Floats, Floats]] = []
    rates: list[tuple[Floats, Floats]] = []
    for motion in motions:
        rows, simulated = foretold(smoother, motion, estimate)
        x = motion.x[rows]
        velocities.append((x[:, effort.n :], simulated))
        rates.append((effort.rates(x), effort.rates(np.hstack([x[:, : effort.n], simulated]))))
    each = _fit(*map(np.concatenate, zip(*velocities, strict=True)))
    true, told = map(np.concatenate, zip(*rates, strict=True))
    pooled = _fit((true - true.mean(axis=0)).ravel()[:, None], (told - true.mean(axis=0)).ravel()[:, None])
    return Score(each, float(pooled[0]))


def _fit(measured: Floats, simulated: Floats) -> Floats:
    """The percentage of each column."""
    if len(measured) == 0:
        return np.full(measured.shape[1], np.nan)
    with np.errstate(all="ignore"):
        size = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
        missed = np.linalg.norm(measured - simulated, axis=0)
        found = 100.0 * (1.0 - missed / np.where(size > 0.0, size, np.nan))
    return np.asarray(np.where(np.isfinite(missed), found, -np.inf))
