"""By how much the motors answer later than the log says that they had their voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from wmr_afl.identification.log import Segment
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.output_error import OutputError, delayed, windows_of
from wmr_afl.identification.weak_form import WeakForm

MOST = 0.12  # [s], that is tried both ways
COARSE = 4  # steps of the search at first; then each in between
CLEAR = 0.1  # of what simulated windows leave, which a delay has to explain to be believed


def later(segment: Segment, delay: float) -> Segment:
    """The segment with its voltages `delay` [s] later."""
    return segment if delay == 0.0 else replace(segment, u=delayed(segment.u, delay, segment.step))


def dead_time(smoother: Smoother, motions: Sequence[Motion], weak: WeakForm, window: float) -> tuple[float, float]:
    """The delay [s] for which the weak form leaves least, and by what share simulated windows leave less with it.

    What the weak form leaves is found quickly, but a log of coarse rates deceives it: windows (`window` [s]) decide.
    """
    step = float(np.median([motion.segment.step for motion in motions]))
    count = min(8, max(2, round(MOST / step)))
    tried = np.linspace(-MOST, MOST, COARSE * count + 1)

    @cache
    def left(k: int) -> float:
        return weak.estimate(_delayed(smoother, motions, float(tried[k]))).left

    best = min(range(0, len(tried), COARSE), key=left)
    best = min(range(max(0, best - COARSE + 1), min(len(tried), best + COARSE)), key=left)
    if best in (0, len(tried) - 1):  # it would go on: what is wrong is something else
        return float(tried[best]), 0.0
    near = range(best - 1, best + 2)
    curve = np.polyfit(tried[near], [left(k) for k in near], 2)
    found = float(-curve[1] / (2.0 * curve[0]))
    misfits = []
    for delay in (0.0, found):
        moved = _delayed(smoother, motions, delay)
        windows = windows_of(moved, window)
        if not windows:
            return found, 0.0
        misfits.append(OutputError(smoother, windows, weak.prior).misfit(weak.estimate(moved)))
    if not np.isfinite(misfits[1]):
        return found, 0.0
    return found, 1.0 - misfits[1] / misfits[0]  # without the delay a simulation may fail: it then explains all


def _delayed(smoother: Smoother, motions: Sequence[Motion], delay: float) -> list[Motion]:
    """Only the voltages are moved and smoothed again."""
    segments = [later(motion.segment, delay) for motion in motions]
    return [
        replace(motion, segment=segment, u=smoother.smoothed(segment))
        for motion, segment in zip(motions, segments, strict=True)
    ]
