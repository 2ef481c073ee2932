"""What a column of a log is before it stands on a grid: steps of an encoder, values that only repeat, turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from wmr_afl.numerics.arrays import Floats

REPEATED = 0.2  # of the samples of a moving channel that only repeat the one before
FAR = 4.0  # times what a channel usually bends by over three rows: motions of ten robots stay within 1.6
_BESIDE = 3  # rows at each side of a cell
_FEWEST = 20  # values, of which one can tell what is usual
_OVER = 8  # samples, over which a channel that moves does so by more than three of its steps
_LONG = 1.5  # updates, for which a value is kept only where nothing moves
_WHOLE = 0.05  # of a step, by which a multiple of it may be off in a file of six digits
_MOST = 0.9  # of the changes that are whole steps where a channel has steps
_SMALLEST = 1e-9  # of a channel's range: what is smaller is rounding


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


def update_period(times: Sequence[Floats], columns: Sequence[Floats]) -> float:
    """How long a channel keeps its value while it moves [s]; 0 if each sample is a new one.

    `times` and `columns` (T,) are those of each segment; segments in which it hardly moves say nothing.
    """
    longest = 0.0
    for t, z in zip(times, columns, strict=True):
        if len(z) <= _OVER:
            continue
        over = np.abs(z[_OVER:] - z[:-_OVER])  # steps of an encoder hide no repeats if it moves faster than them
        moving = over > max(3.0 * _OVER * quantum(z), 0.02 * float(over.max()), 0.0)
        share = np.mean(np.diff(z)[3:-4][moving] == 0.0) if moving.sum() > 30 else 0.0
        if share > REPEATED:
            longest = max(longest, float(np.median(np.diff(t))) / (1.0 - min(float(share), 0.95)))
    return longest


def new_values(column: Floats) -> NDArray[np.bool_]:
    """Where a column that keeps its values has a new one, (T,)."""
    return np.concatenate([[True], np.diff(column) != 0.0])


def between(grid: Floats, t: Floats, column: Floats, period: float) -> Floats:
    """The column (T,) at the times of a grid: lines from one new value to the next.

    A value that is kept for longer than `period` [s], as at rest, is left a period before the next one.
    """
    if period == 0.0:
        return np.asarray(np.interp(grid, t, column))
    new = new_values(column)
    at, values = t[new], column[new]
    late = np.flatnonzero(np.diff(at) > _LONG * period)
    at = np.insert(at, late + 1, at[late + 1] - period)
    values = np.insert(values, late + 1, values[late])
    return np.asarray(np.interp(grid, at, values))


def spikes(column: Floats) -> NDArray[np.bool_]:
    """Cells that jump for up to three rows and are back then, (T,): far from the median of the seven rows around them.

    Far beside what the column usually bends by over three rows, and beside how far the four that are closest to the
    median lie apart: a motion runs through its median, however fast, and where it turns its neighbours do so, too. What
    is kept over several rows counts as one value.
    """
    is_new = new_values(column)
    values = column[is_new]
    none = np.zeros(len(column), dtype=bool)
    if len(values) < _FEWEST:
        return none
    beside = sliding_window_view(np.pad(values, _BESIDE, mode="edge"), 2 * _BESIDE + 1)
    bent = np.abs(beside[:, 0] - 2.0 * beside[:, _BESIDE] + beside[:, -1]) / 2.0
    apart = np.abs(beside - np.median(beside, axis=1, keepdims=True))
    off, close = apart[:, _BESIDE], np.sort(apart, axis=1)[:, _BESIDE]
    largest = sliding_window_view(np.pad(off, _BESIDE), 2 * _BESIDE + 1).max(axis=1)  # moves its neighbours' median
    is_spike = (off > np.maximum(FAR * np.quantile(bent, 0.95), 2.0 * close)) & (off > 0.5 * largest)
    return np.asarray(is_spike[np.cumsum(is_new) - 1])


def unwrapped(column: Floats) -> Floats:
    """An angle that begins anew after a turn, counted on; the column itself if it does not."""
    kept = np.delete(column, np.flatnonzero(spikes(column)))  # a spike may be as large as a turn
    changes = np.abs(np.diff(kept))
    is_turn = np.abs(changes - 2.0 * np.pi) < 0.5 * np.pi
    if is_turn.any() and np.all(changes[~is_turn] < 0.5 * np.pi):
        return np.asarray(np.unwrap(column))
    return column
