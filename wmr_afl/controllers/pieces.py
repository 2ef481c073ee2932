"""References of several pieces, one after the other."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import inf
from typing import Any

import numpy as np

from wmr_afl.controllers.live_reference import LiveReference
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.spline import Spline, to_rest
from wmr_afl.controllers.tabled_reference import TabledReference
from wmr_afl.errors import ArgumentError, WmrError
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import shown

MEETS = 1e-6  # [output units] and [output units/s], by which the end of a piece may miss the beginning of the next one
SHOWN = 7  # digits behind the point of what would be right, so that whoever copies them stays within that


class Pieces(TabledReference):
    """References one after the other, each in its own time from zero: `Pieces([(circle, 20.0), waypoints])`.

    A piece is a reference and how long it lasts [s]; one that ends by itself, such as `Waypoints`, needs no duration,
    and is cut short or rests on if it has one. Pieces meet: the next one begins where one ends, at the same velocity,
    within 1e-6 of the outputs' units; yr'' may jump there. Before zero it rests where it begins, behind the last piece
    where that ends; if that ends at a velocity, it comes to rest along a straight line by `stop`
    [output units/s^2]. A step is given numbers that are looked up: no piece is traced.

    Raises:
        ArgumentError: if a piece is something else.
        UnknownNameError: if a piece names another output than the first one.
        WmrError: if there are none, one has no end or does not reach the next one, or some count turns and some do not.
    """

    @checked
    def __init__(self, pieces: Sequence[Reference | tuple[Reference, float]], stop: float = 1.0) -> None:
        given = [_piece(number, one) for number, one in enumerate(pieces, start=1)]
        if not given:
            raise WmrError("there are no pieces", "give one or more")
        first = given[0][0]
        for number, (one, _) in enumerate(given, start=1):
            if one.counts_turns != first.counts_turns:
                raise WmrError(f"one of pieces 1 and {number} counts turns", "let all of them, or none")
        super().__init__(first.outputs, first.counts_turns)
        self.stop = float(stop)
        self.pieces = tuple(
            (_ordered(number, one, first.outputs), lasts) for number, (one, lasts) in enumerate(given, start=1)
        )
        ends = [_ends(number, *piece) for number, piece in enumerate(self.pieces, start=1)]
        for number, ((_, end), (begin, _)) in enumerate(pairwise(ends), start=1):
            _check_meeting(number, end, begin, first.outputs)
        position, velocity, _ = ends[-1][1]
        line = to_rest(position, velocity, self.stop)
        self._sources: list[Reference | Spline] = [one for one, _ in self.pieces]
        lasting = [lasts for _, lasts in self.pieces]
        if line is not None:
            self._sources.append(Spline(line))
            lasting.append(float(line.x[-1]))
        limits = list(accumulate(lasting, initial=0.0))
        self._starts, self.span = limits[:-1], (0.0, limits[-1])

    def _inside(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        rows, which = (
            np.empty((3, len(times), len(self.outputs))),
            np.searchsorted(self._starts, times, side="right") - 1,
        )
        for piece in np.unique(which):
            there = which == piece
            rows[:, there] = self._sources[piece].over(times[there] - self._starts[piece])
        return rows[0], rows[1], rows[2]

    def _row_inside(self, t: float) -> list[float]:
        piece = bisect_right(self._starts, t) - 1
        return self._sources[piece].row(t - self._starts[piece])

    def _to_add(self, name: str) -> str:
        return f"add {name} to every piece"

    def _of(self, outputs: tuple[str, ...]) -> Pieces:
        return Pieces([(one.ordered(outputs), lasts) for one, lasts in self.pieces], self.stop)


def _piece(number: int, given: Any) -> tuple[Reference, float]:
    """A piece and how long it lasts [s]."""
    match given:
        case Reference() as one:
            lasts: Any = one.duration
        case (Reference() as one, lasts):
            pass
        case _:
            raise ArgumentError(f"piece {number} is {shown(given)}", "give a reference, or (reference, duration [s])")
    if isinstance(one, LiveReference):
        raise WmrError(f"piece {number} is not known in advance", "give the whole reference live, or none of it")
    if lasts is None:
        raise WmrError(f"piece {number} goes on for ever", "give it a duration [s]")
    if not isinstance(lasts, int | float | np.floating | np.integer):
        raise ArgumentError(f"the duration of piece {number} is {shown(lasts)}", "give seconds as a number")
    if not 0.0 < lasts < inf:
        raise WmrError(f"piece {number} lasts {lasts:g} s", "give it a positive duration")
    return one, float(lasts)


def _ordered(number: int, one: Reference, outputs: Sequence[str]) -> Reference:
    try:
        return one.ordered(list(outputs))
    except WmrError as error:
        error.problem = f"piece {number}: {error.problem}"
        raise


def _ends(number: int, one: Reference, lasts: float) -> tuple[Floats, Floats]:
    """[yr; yr'; yr''] where a piece begins and where it ends."""
    begin, end = (np.reshape(one.row(t), (3, -1)) for t in (0.0, lasts))
    for t, rows in ((0.0, begin), (lasts, end)):
        if not np.isfinite(rows).all():
            name = one.outputs[int(np.argmin(np.isfinite(rows).all(axis=0)))]
            raise WmrError(f"{name} of piece {number}, or a derivative, is not finite at its {t:g} s", "mend it there")
    return begin, end


def _check_meeting(number: int, end: Floats, begin: Floats, outputs: Sequence[str]) -> None:
    """Raise a WmrError if the piece of this number ends elsewhere than the next one begins, or at another velocity."""
    for mark, unit, here, there in zip(("", "'"), ("", "/s"), end[:2], begin[:2], strict=True):
        gaps = np.abs(there - here)
        worst = int(np.argmax(gaps))
        if not gaps[worst] <= MEETS:
            right = ", ".join(f"{name}{mark} = {round(float(y), SHOWN)}" for name, y in zip(outputs, here, strict=True))
            name = f"{outputs[worst]}{mark}"
            raise WmrError(
                f"piece {number} ends at {name} = {round(float(here[worst]), SHOWN)}, piece {number + 1} begins at "
                f"{round(float(there[worst]), SHOWN)}: {gaps[worst]:.3g} output units{unit} apart",
                f"let piece {number + 1} begin at {right}",
            )
