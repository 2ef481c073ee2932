"""How exactly a channel was measured, read off the channel itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wmr_afl.identification.columns import quantum
from wmr_afl.identification.log import Log
from wmr_afl.numerics.arrays import Floats


def parabola(half: int) -> Floats:
    """Weights of 2 half + 1 samples: the value in their middle of the parabola closest to them.

    Reference: Savitzky, Golay, Smoothing and differentiation of data, Analytical Chemistry 36, 1964.
    """
    return np.asarray(np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), 3, increasing=True))[0])


def standard_deviations(log: Log) -> Floats:
    """Of each channel's samples, (channels,): quantum/sqrt 12, or what smoothing takes away if there are no steps."""
    found = []
    for k, period in enumerate(log.periods):
        columns = [segment.z[segment.is_new[:, k], k] for segment in log.segments]
        steps = [step for step in map(quantum, columns) if step > 0.0]
        if 2 * len(steps) > len(columns):
            found.append(min(steps) / np.sqrt(12.0))
            continue
        if period == 0.0:  # smoothing goes from sample to sample: not over those that are missing
            columns = [run for segment in log.segments for run in _runs(segment.z[:, k], segment.is_new[:, k])]
        found.append(_scatter(columns))
    return np.array(found)


def _runs(column: Floats, is_new: NDArray[np.bool_]) -> list[Floats]:
    """The parts of a column without a sample that is missing."""
    at = np.flatnonzero(is_new)
    return np.split(column[at], np.flatnonzero(np.diff(at) > 1) + 1)


def _scatter(columns: list[Floats]) -> float:
    """The standard deviation about a parabola through seven samples; nothing is more exact than its last digits."""
    kernel = -parabola(3)
    kernel[3] += 1.0
    left = np.concatenate([np.zeros(1), *(np.correlate(one, kernel, "valid") for one in columns if len(one) >= 7)])
    spread = 1.2533 * float(np.mean(np.abs(left))) / float(np.linalg.norm(kernel))  # a median would be that of rest
    return max(spread, 1e-7 * max(float(np.ptp(column)) for column in columns), 1e-12)
