"""References through points at given times."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from wmr_afl.controllers.spline import Spline, with_rest
from wmr_afl.controllers.tabled_reference import TabledReference
from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats

Between = Literal["quintic", "cubic"]
Ends = Literal["rest", "free"]


class Waypoints(TabledReference):
    """A reference through points at given times: a spline, its first and second derivatives with it.

    Before the first time and after the last one it rests there, unless `ends` is "free": then it begins and ends as the
    points themselves suggest, and comes to rest along a straight line by `stop` [output units/s^2]. "quintic": y'' is
    smooth, too; "cubic": y'' is continuous. A step finds its row in a table, however many points there are.

    Raises:
        UnknownNameError: if there is no such spline, or no such kind of ends.
        WmrError: if there are fewer than two points, times do not increase, something is not finite, or an output has
            no values.
    """

    @checked
    def __init__(
        self,
        times: ArrayLike,
        values: Mapping[str, ArrayLike],
        between: Between = "quintic",
        ends: Ends = "rest",
        stop: float = 1.0,
        counts_turns: bool = False,
    ) -> None:
        """`times` (P,) [s]; `values` (P,) of each output by name."""
        for what, name, known in (("spline", between, get_args(Between)), ("kind of ends", ends, get_args(Ends))):
            if name not in known:
                raise UnknownNameError(what, name, known)
        at = real_numbers("times", times, "give times [s]").reshape(-1)
        columns = columns_of(values)
        check_points(at, columns)
        super().__init__(list(columns), counts_turns)
        self.times, self.columns = at, columns
        self.between, self.ends, self.stop = between, ends, float(stop)
        points = np.stack(list(columns.values()), axis=1)
        self._spline = Spline(with_rest(_spline(at, points, between, ends), self.stop))
        self.span = self._spline.first, self._spline.last

    def _inside(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        return self._spline.over(times)

    def _row_inside(self, t: float) -> list[float]:
        return self._spline.row(t)

    def _to_add(self, name: str) -> str:
        return f"add a column {name}"

    def _of(self, outputs: tuple[str, ...]) -> Waypoints:
        values = {name: self.columns[name] for name in outputs}
        return Waypoints(self.times, values, self.between, self.ends, self.stop, self.counts_turns)


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
    if between == "cubic" or (len(times) == 2 and not at_rest):  # two points alone determine a straight line
        return CubicSpline(
            times, values, bc_type="clamped" if at_rest else "not-a-knot" if len(times) > 3 else "natural"
        )
    orders = (1, 2) if at_rest else (3, 4)  # derivatives that vanish at both ends
    ends_there = [(order, 0.0) for order in orders]
    splines = [make_interp_spline(times, one, k=5, bc_type=(ends_there, ends_there)) for one in values.T]
    pieces = [PPoly.from_spline(one) for one in splines]
    inner = slice(5, -5)  # without the knots that a spline repeats at its ends
    return PPoly(np.stack([one.c[:, inner] for one in pieces], axis=2), pieces[0].x[inner])
