"""References through points at given times."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from wmr_afl.controllers.reference import Point, Reference
from wmr_afl.errors import ArgumentError, UnknownNameError, WmrError
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import shown

Between = Literal["quintic", "cubic"]


class Waypoints(Reference):
    """A reference through points at given times: a spline, its first and second derivatives with it.

    Before the first time and after the last one it rests there, unless `ends` is "free": then it begins and ends as the
    points themselves suggest, and comes to rest along a straight line by `stop` [output units/s^2]. "quintic": y'' is
    smooth, too; "cubic": y'' is continuous. A step finds its row in a table, however many points there are.

    Raises:
        WmrError: if there are fewer than two points, times do not increase, something is not finite, or an output has
            no values.
    """

    @checked
    def __init__(
        self,
        times: ArrayLike,
        values: Mapping[str, ArrayLike],
        between: Between = "quintic",
        ends: Literal["rest", "free"] = "rest",
        stop: float = 1.0,
        counts_turns: bool = False,
    ) -> None:
        """`times` (P,) [s]; `values` (P,) of each output by name."""
        at = real_numbers("times", times, "give times [s]").reshape(-1)
        columns = columns_of(values)
        check_points(at, columns)
        if not stop > 0.0:
            raise WmrError(f"it stops by {stop:g}", "choose a positive deceleration [output units/s^2]")
        self.times, self.columns, self.counts_turns = at, columns, counts_turns
        self.between, self.ends, self.stop = between, ends, float(stop)
        self.expressions: dict[str, str] = dict.fromkeys(columns, "")
        values_there = np.stack(list(columns.values()), axis=1)
        spline = _stopped(_spline(at, values_there, between, ends), self.stop)
        self._knots: list[float] = spline.x.tolist()
        self._derivatives = (spline, spline.derivative(), spline.derivative(2))

    @property
    def duration(self) -> float:
        """When it has come to rest [s]."""
        return float(self._derivatives[0].x[-1])

    @checked
    def ordered(self, outputs: Sequence[str]) -> Waypoints:
        """The same reference with the values of these outputs, in their order.

        Raises:
            UnknownNameError: if it names another output.
            WmrError: if an output has no values.
        """
        for name in self.columns:
            if name not in outputs:
                raise UnknownNameError("output", name, outputs)
        for name in outputs:
            if name not in self.columns:
                raise WmrError(f"output {name!r} has no values", f"add a column {name}")
        if list(self.columns) == list(outputs):
            return self
        values = {name: self.columns[name] for name in outputs}
        return Waypoints(self.times, values, self.between, self.ends, self.stop, self.counts_turns)

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
        row = real_numbers("times", times, "give times [s]").reshape(-1)
        first, last = self._derivatives[0].x[[0, -1]]
        moves = ((row >= first) & (row <= last))[:, None]
        position, velocity, acceleration = (np.asarray(part(np.clip(row, first, last))) for part in self._derivatives)
        return position, np.where(moves, velocity, 0.0), np.where(moves, acceleration, 0.0)

    def clock(self, times: Floats, lead: float = 0.0) -> Floats:
        """Rows [t, yr, yr', yr''], and these again `lead` [s] later if there is any."""
        if len(times) == 1:  # in a control loop: a lookup, in microseconds
            row = self._row(float(times[0])), self._row(float(times[0]) + lead) if lead else []
            return np.array([[times[0], *row[0], *row[1]]])
        rows = [times[:, None], *self.over(times)]
        return np.ascontiguousarray(np.hstack([*rows, *(self.over(times + lead) if lead else ())]))

    def _row(self, t: float) -> list[float]:
        """yr, yr', yr'' at time t [s], one after the other, by Horner's rule."""
        inside = min(max(t, self._knots[0]), self._knots[-1])
        piece = min(bisect_right(self._knots, inside), len(self._knots) - 1) - 1
        since, row = inside - self._knots[piece], list[float]()
        for polynomial in self._derivatives:
            value = np.zeros(len(self.columns))
            for coefficients in polynomial.c[:, piece]:
                value = value * since + coefficients
            row += (value if inside == t or polynomial is self._derivatives[0] else 0.0 * value).tolist()
        return row

    def seen(self, clock: Any, lead: float = 0.0) -> tuple[Any, Point, Point]:
        """Of a row of `clock` the time [s], the reference then, and the one `lead` [s] later."""
        size = len(self.columns)

        def point(start: int) -> Point:
            position, velocity, acceleration = (clock[start + size * n : start + size * (n + 1)] for n in range(3))
            return Point(position, velocity, acceleration, self.counts_turns)

        now = point(1)
        return clock[0], now, point(1 + 3 * size) if lead else now


def columns_of(values: Mapping[str, ArrayLike]) -> dict[str, Floats]:
    """The values of each output by name, (P,) each."""
    return {name: real_numbers(f"values of {name}", one, "give numbers").reshape(-1) for name, one in values.items()}


def check_points(times: Floats, columns: Mapping[str, Floats]) -> None:
    """Raise a WmrError where points make no reference."""
    if not columns:
        raise WmrError("no output has values", "add a column for each output")
    for name, column in columns.items():
        if len(column) != len(times):
            raise WmrError(f"{len(column)} values of {name} for {len(times)} points", "give one for each")
        if not np.isfinite(column).all():
            raise WmrError(f"value {int(np.argmin(np.isfinite(column))) + 1} of {name} is not finite", "give numbers")
    if len(times) < 2:
        raise WmrError(f"{len(times)} points are no way", "give two or more")
    if not np.isfinite(times).all():
        raise WmrError(f"time {int(np.argmin(np.isfinite(times))) + 1} is not finite", "give seconds")
    steps = np.diff(times)
    if not (steps > 0.0).all():
        where = int(np.argmin(steps > 0.0))
        raise WmrError(
            f"time {times[where + 1]:g} s follows {times[where]:g} s (point {where + 2})", "give times that increase"
        )


def _spline(times: Floats, values: Floats, between: str, ends: str) -> PPoly:
    """The spline as polynomials, (order, pieces, outputs)."""
    at_rest = ends == "rest"
    if between == "cubic":
        return CubicSpline(
            times, values, bc_type="clamped" if at_rest else "not-a-knot" if len(times) > 3 else "natural"
        )
    orders = (1, 2) if at_rest else (3, 4)  # derivatives that vanish at both ends
    ends_there = [(order, 0.0) for order in orders]
    splines = [make_interp_spline(times, one, k=5, bc_type=(ends_there, ends_there)) for one in values.T]
    pieces = [PPoly.from_spline(one) for one in splines]
    inner = slice(5, -5)  # without the knots that a spline repeats at its ends
    return PPoly(np.stack([one.c[:, inner] for one in pieces], axis=2), pieces[0].x[inner])


def _stopped(spline: PPoly, stop: float) -> PPoly:
    """The spline, and behind its end a straight line on which its speed falls to zero, if it has any."""
    velocity = spline(spline.x[-1], 1)
    speed = float(np.linalg.norm(velocity))
    if speed < 1e-9:
        return spline
    lasts = speed / stop
    piece = np.zeros((spline.c.shape[0], 1, spline.c.shape[2]))
    piece[-1, 0], piece[-2, 0], piece[-3, 0] = spline(spline.x[-1]), velocity, -0.5 * stop * velocity / speed
    return PPoly(np.concatenate([spline.c, piece], axis=1), np.append(spline.x, spline.x[-1] + lasts))
