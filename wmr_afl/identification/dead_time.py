"""By how much the motors answer later than the log says that they had their voltage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import Prior
from wmr_afl.identification.log import Segment
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.output_error import delayed
from wmr_afl.identification.weak_form import weak_form

MOST = 0.12  # [s], that is tried
CLEAR = 0.05  # of what the weak form leaves unexplained, which a delay has to explain to be believed


def later(segment: Segment, delay: float) -> Segment:
    """The segment with its voltages `delay` [s] later."""
    return segment if delay == 0.0 else replace(segment, u=delayed(segment.u, delay, segment.step))


def dead_time(smoother: Smoother, motions: Sequence[Motion], window: float, prior: Prior) -> tuple[float, float]:
    """The delay [s] for which the weak form leaves least, and by what share it leaves less than without."""
    step = float(np.median([motion.segment.step for motion in motions]))
    count = min(8, max(2, round(MOST / step)))
    tried = np.linspace(-0.5 * MOST, MOST, 3 * count + 1)
    left = np.array([_left(smoother.effort, _delayed(smoother, motions, delay), window, prior) for delay in tried])
    best = int(np.argmin(left))
    if best in (0, len(tried) - 1):
        return float(tried[best]), _gain(left[best], left[np.argmin(np.abs(tried))])
    curve = np.polyfit(tried[best - 1 : best + 2], left[best - 1 : best + 2], 2)
    return float(-curve[1] / (2.0 * curve[0])), _gain(left[best], left[np.argmin(np.abs(tried))])


def _gain(least: float, without: float) -> float:
    return float(1.0 - least / without) if without > 0.0 else 0.0


def _delayed(smoother: Smoother, motions: Sequence[Motion], delay: float) -> list[Motion]:
    """Only the voltages are smoothed again."""
    return [replace(motion, u=smoother.smoothed(later(motion.segment, delay))) for motion in motions]


def _left(effort: Effort, motions: Sequence[Motion], window: float, prior: Prior) -> float:
    return weak_form(effort, motions, window, prior).left
