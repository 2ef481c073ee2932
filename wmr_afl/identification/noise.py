"""How exactly a channel was measured, read off the channel itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wmr_afl.identification.log import Log
from wmr_afl.numerics.arrays import Floats

_WHOLE = 0.05  # of a step, by which a multiple of it may be off in a file of six digits
_MOST = 0.9  # of the changes that are whole steps where a channel has steps
_SMALLEST = 1e-9  # of a channel's range: what is smaller is rounding


def parabola(half: int) -> Floats:
    """Weights of 2 half + 1 samples: the value in their middle of the parabola closest to them.

    Reference: Savitzky, Golay, Smoothing and differentiation of data, Analytical Chemistry 36, 1964.
    """
    return np.asarray(np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), 3, increasing=True))[0])


def quantum(column: Floats) -> float:
    """The step of an encoder, of which all changes are multiples; zero if there is none."""
    changes = np.abs(np.diff(column))
    changes = changes[changes > _SMALLEST * max(float(np.ptp(column)), 1e-300)]
    if len(changes) < 10:
        return 0.0
    small = np.sort(changes)[: max(len(changes) // 20, 5)]
    step = float(np.median(small[small < 1.5 * small[0]]))
    near = changes[changes < 1.0 / _WHOLE * step]  # beyond, any number is nearly a multiple
    multiple = near / step
    is_whole = np.abs(multiple - np.round(multiple)) < _WHOLE
    return step if len(near) >= 10 and is_whole.mean() > _MOST else 0.0


def standard_deviations(log: Log, periods: Floats) -> Floats:
    """Of each channel's samples, (channels,): quantum/sqrt 12, or what smoothing takes away if there are no steps.

    `periods` is how many samples each keeps its value.
    """
    found = []
    for k in range(len(log.channels)):
        columns = [segment.z[:, k] for segment in log.segments]
        if periods[k] > 1.0:
            columns = [column[is_new(column)] for column in columns]
        steps = [step for step in map(quantum, columns) if step > 0.0]
        if 2 * len(steps) > len(columns):
            found.append(min(steps) / np.sqrt(12.0))
            continue
        found.append(_scatter(columns))
    return np.array(found)


def is_new(column: Floats) -> NDArray[np.bool_]:
    """Where a sample differs from the one before, (T,)."""
    return np.concatenate([[True], np.diff(column) != 0.0])


def _scatter(columns: list[Floats]) -> float:
    """The standard deviation about a parabola through seven samples; nothing is more exact than its last digits."""
    kernel = -parabola(3)
    kernel[3] += 1.0
    left = np.concatenate([np.zeros(1), *(np.correlate(one, kernel, "valid") for one in columns if len(one) >= 7)])
    spread = 1.2533 * float(np.mean(np.abs(left))) / float(np.linalg.norm(kernel))  # a median would be that of rest
    return max(spread, 1e-7 * max(float(np.ptp(column)) for column in columns), 1e-12)
