"""References that a step is given as rows of numbers: one text for how a row is laid out and looked up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.reference import Point, Reference
from wmr_afl.errors import ArgumentError, WmrError
from wmr_afl.numerics.arguments import real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import plain, shown


class RowReference(Reference):
    """A reference of which a step is given a row [t, yr, yr', yr''], and not formulas to be traced.

    Raises:
        WmrError: if it has no outputs, or names one twice.
    """

    def __init__(self, outputs: Sequence[str], counts_turns: bool) -> None:
        names = tuple(outputs)
        if not names or len({*names}) < len(names):
            raise WmrError(f"its outputs are {plain(', '.join(names)) or 'none'}", "name each once")
        self.outputs, self.counts_turns = names, counts_turns

    def seen(self, clock: Any, lead: float = 0.0) -> tuple[Any, Point, Point]:
        """Of a row of `clock` the time [s], the reference then, and the one `lead` [s] later."""
        now = self._point(clock, 0)
        return clock[0], now, self._later(clock, now, lead) if lead else now

    def _later(self, clock: Any, now: Point, lead: float) -> Point:
        """The reference `lead` [s] later, which follows in the row."""
        return self._point(clock, 1)

    def _point(self, clock: Any, number: int) -> Point:
        size = len(self.outputs)
        start = 1 + 3 * size * number
        position, velocity, acceleration = (clock[start + size * n : start + size * (n + 1)] for n in range(3))
        return Point(position, velocity, acceleration, self.counts_turns)


class TabledReference(RowReference):
    """A reference that is looked up: known over a `span` of time [s], before and behind which it rests.

    A subclass says what it is inside of its span, at many times and at one.
    """

    span: tuple[float, float]

    def _inside(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """yr, yr', yr'' at all `times` (T,) [s] inside of its span, (T, n-m) each."""
        raise NotImplementedError

    def _row_inside(self, t: float) -> list[float]:
        """yr, yr', yr'' at time t [s] inside of its span, one after the other."""
        raise NotImplementedError

    @property
    def duration(self) -> float:
        """When it has come to rest [s]."""
        return self.span[1]

    def at(self, t: Any) -> Point:
        """The reference at time t [s], (n-m,) each.

        Raises:
            ArgumentError: if t is not a number; a table cannot be traced with symbols.
        """
        if not isinstance(t, int | float | np.floating | np.integer):
            raise ArgumentError(f"t is {shown(t)}", "give seconds as a number")
        position, velocity, acceleration = (part[0] for part in self.over([float(t)]))
        return Point(position, velocity, acceleration, self.counts_turns)

    def over(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """yr, yr', yr'' at all `times` (T,) [s], (T, n-m) each."""
        asked = real_numbers("times", times, "give times [s]").reshape(-1)
        inside = np.clip(asked, *self.span)
        position, velocity, acceleration = self._inside(inside)
        moves = (asked == inside)[:, None]
        return position, np.where(moves, velocity, 0.0), np.where(moves, acceleration, 0.0)

    def row(self, t: float) -> list[float]:
        """yr, yr', yr'' at time t [s], one after the other: a lookup, in microseconds."""
        inside = min(max(t, self.span[0]), self.span[1])
        row, size = self._row_inside(inside), len(self.outputs)
        return row if inside == t else [*row[:size], *[0.0] * (2 * size)]

    def clock(self, times: Floats, lead: float = 0.0) -> Floats:
        """Rows [t, yr, yr', yr''], and these again `lead` [s] later if there is any."""
        if len(times) == 1:  # in a control loop
            t = float(times[0])
            return np.array([[t, *self.row(t), *(self.row(t + lead) if lead else ())]])
        rows = [times[:, None], *self.over(times)]
        return np.ascontiguousarray(np.hstack([*rows, *(self.over(times + lead) if lead else ())]))
