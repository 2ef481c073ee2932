"""A block of robots underway: states and running summaries, one column a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wmr_afl.numerics.arrays import Floats

LANES = 64  # robots of a block, few enough for their numbers to stay in the first-level cache
CACHE_LINE = 64  # bytes, of usual processors; a vector across two lines costs two accesses


@dataclass(frozen=True)
class Watched:
    """Entries of the signals that are summarized while a loop runs."""

    regularity: int  # the run fails if it is not positive
    checked: tuple[int, ...] = ()  # the run fails if one of them is not finite
    squared: tuple[int, ...] = ()  # whose squares are summed
    sized: tuple[tuple[int, ...], ...] = ()  # groups of which the largest size is kept

    @property
    def rows(self) -> int:
        """Rows of summaries: sums of squares, largest sizes, and the first failure."""
        return len(self.squared) + len(self.sized) + 1


class Block:
    """States and summaries of a block in one contiguous array, so that a kernel gets all of them by one pointer."""

    def __init__(self, state: Floats, watched: Watched) -> None:
        a = len(state)
        b, c = a + len(watched.squared), a + len(watched.squared) + len(watched.sized)
        self.rows = aligned((a + watched.rows, state.shape[1]))
        self.state, self.squares, self.largest = self.rows[:a], self.rows[a:b], self.rows[b:c]
        self.failed = self.rows[-1]  # first sample that was singular or not finite, inf if none was
        self.state[:], self.failed[:] = state, np.inf
        self.samples = 0  # that were run

    def count_from_here(self) -> None:
        """Start the summaries again, but keep failures."""
        self.squares[:], self.largest[:] = 0.0, 0.0


def aligned(shape: tuple[int, ...]) -> Floats:
    """Zeros of this shape, aligned to a cache line."""
    size = math.prod(shape)
    room = np.zeros(size + CACHE_LINE // 8)
    first = -room.ctypes.data % CACHE_LINE // 8
    return room[first : first + size].reshape(shape)
