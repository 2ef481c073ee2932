"""Rows of a log as they were written, cut at gaps and put on a uniform grid of time.

A grid needs no regular rows: a voltage is held from its row to the next one, so that its mean over a sample is known
exactly, and an angle lies on the line between two rows. A row that is lost takes a voltage with it: a line from the
row before to the one after is late or early alike, where holding would be late on average.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import WmrError
from wmr_afl.identification.columns import between, new_values
from wmr_afl.numerics.arrays import Floats

GAP = 5.5  # sample times without a row: a segment ends there
LONGEST = 0.5  # [s], from row to row
LOST = 1.75  # sample times from row to row: a row is missing in between; with less it comes late
MOST_LOST = 0.25  # of the rows, that may be missing: with more of them base parameters are off by a per cent
EVEN = 1e-6  # of a sample: rows that are no further off were written at a fixed rate


@dataclass(frozen=True)
class Rows:
    """Rows without a gap."""

    name: str
    t: Floats  # (T,) [s]
    u: Floats  # (T, n_u) [V]
    z: Floats  # (T, channels)

    @property
    def step(self) -> float:
        """The usual time from row to row [s]."""
        return float(np.median(np.diff(self.t)))


@dataclass(frozen=True)
class Grid:
    """The same at T samples, `step` [s] apart."""

    step: float
    u: Floats  # (T, n_u) [V], the mean until the next sample
    z: Floats  # (T, channels)
    is_new: NDArray[np.bool_]  # (T, channels), not a value between two that were measured
    lost: float  # of the rows, that are missing
    jitter: float  # of a sample, by which the time from row to row usually differs


def cut(rows: Rows, before: int) -> Iterator[Rows]:
    """Rows cut at gaps; parts that are too short are left out. `before` them the file has so many.

    Raises:
        WmrError: if rows are far apart, or time does not go on.
    """
    if len(rows.t) < 3:
        return
    steps = np.diff(rows.t)
    if rows.step > LONGEST:
        problem = f"rows are {rows.step:.3g} s apart"
        raise WmrError(problem, "give t in seconds (not milliseconds), and log at 50 Hz or more")
    if np.any(steps <= 0.0):
        at = int(np.flatnonzero(steps <= 0.0)[0])
        doing = "stands still" if steps[at] == 0.0 else "goes backwards"
        problem = f"time {doing} at t = {rows.t[at + 1]:g} s (row {before + at + 2})"
        raise WmrError(problem, "order the rows, and name tests that were run one after another in a column `segment`")
    cuts = [0, *(np.flatnonzero(steps > GAP * rows.step) + 1), len(rows.t)]
    for first, last in pairwise(cuts):
        if last - first >= 3:
            part = slice(first, last)
            yield Rows(rows.name, rows.t[part], rows.u[part], rows.z[part])


def on_grid(rows: Rows, periods: Floats, is_spike: NDArray[np.bool_]) -> Grid:
    """Rows on a uniform grid; `periods` (channels,) [s] are those for which channels keep their values.

    Cells that are spikes (T, channels) are left out.

    Raises:
        WmrError: if too many rows are missing.
    """
    t, taken = rows.t, np.diff(rows.t) / rows.step
    count = max(int(np.round(taken).sum()), 1)
    step = float(t[-1] - t[0]) / count
    grid = t[0] + step * np.arange(count + 1)
    lost = _lost(t, taken)
    share = len(lost) / (len(lost) + len(t))
    if share > MOST_LOST:
        problem = f"{share:.0%} of the rows after t = {t[0]:g} s are missing (one each {1e3 * step:.3g} ms is usual)"
        raise WmrError(problem, "log at a fixed rate and write every row, or leave this part out")
    times = np.concatenate([t, lost])
    order = np.argsort(times)
    nearest = order[_nearest(grid, times[order])]  # row of each sample; beyond the rows are those that are lost
    z, is_new = np.empty((len(grid), rows.z.shape[1])), np.empty((len(grid), rows.z.shape[1]), dtype=bool)
    for k, period in enumerate(periods):
        is_own = ~is_spike[:, k]
        at, column = t[is_own], rows.z[is_own, k]
        z[:, k] = between(grid, at, column, period)
        if period:
            new = at[new_values(column)]
            is_new[:, k] = np.isin(np.arange(len(grid)), np.round((new - t[0]) / step))
        else:
            is_new[:, k] = np.append(is_own, np.zeros(len(lost), dtype=bool))[nearest]
    jitter = float(np.median(np.abs(taken - np.round(taken))))
    return Grid(step, _held(grid, t, rows.u, step, times[order]), z, is_new, share, jitter)


def _lost(t: Floats, taken: Floats) -> Floats:
    """The times at which rows are missing, evenly between two; `taken` samples pass from row to row."""
    wide = np.flatnonzero(taken > LOST)
    counts = np.round(taken[wide]).astype(int)
    return np.concatenate([
        np.zeros(0), *(np.linspace(t[k], t[k + 1], count + 1)[1:-1] for k, count in zip(wide, counts, strict=True))
    ])  # fmt: skip


def _nearest(grid: Floats, times: Floats) -> NDArray[np.intp]:
    """The place of the time that is nearest to each sample."""
    after = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    return np.where(grid - times[after - 1] <= times[after] - grid, after - 1, after)


def _held(grid: Floats, t: Floats, u: Floats, step: float, times: Floats) -> Floats:
    """The mean over each sample of voltages (., n_u) that are held from time to time, on a line where rows are lost."""
    if len(t) == len(grid) and np.all(np.abs(t - grid) <= EVEN * step):
        return u  # to the last digit
    every = np.column_stack([np.interp(times, t, column) for column in u.T])
    sums = np.vstack([np.zeros((1, u.shape[1])), np.cumsum(every[:-1] * np.diff(times)[:, None], axis=0)])
    means = np.column_stack([np.diff(np.interp(grid, times, one)) for one in sums.T]) / step
    return np.vstack([means, every[-1:]])
