"""References from functions in Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from math import ceil, inf

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly, make_interp_spline

from wmr_afl.controllers.spline import Spline, joined, with_rest
from wmr_afl.controllers.tabled_reference import TabledReference
from wmr_afl.errors import WmrError
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import plain

FEWEST, MOST = 10, 500_000  # samples; the most take 120 MB for two outputs
ROUNDING = 1e-9  # of a number of samples
SHORTEST = 1e-6  # [s]
LIKE = 1e-2  # of the largest derivative, by which one that is given may differ from what is found
SAME = 1e-3  # [output units/s] and [output units/s^2], by which it may besides
SELDOM = 0.1  # of the samples, at which it may differ by more: where it jumps


class Sampled(TabledReference):
    """A reference from a function of time: `Sampled(["y1", "y2"], lambda t: [t, sin(t)], duration=20.0)`.

    `yr(t)` gives a number for each output, from 0 to `duration` [s]. Functions are called at samples `step` [s] apart
    while it is built, and never again: no mistake in them waits for the robot to drive. Polynomials of degree 5 join
    yr, yr' and yr'' of samples, so that derivatives are its own. `yr1` and `yr2` give yr' and yr''; what is not given
    is that of the spline of degree 5 through what is.

    Of a sine of amplitude 1, sampled every 10 ms, yr' misses by 6e-12 and yr'' by 4e-9 at 1 rad/s; at 5 rad/s by 4e-10
    and 3e-7, by 6e-8 and 4e-5 within 0.2 s of both ends; with yr' and yr'' given by 2e-10 and 9e-8 everywhere.
    Coordinates of 5e6 m have no more digits than to tell yr'' within 1e-3. Where yr'' jumps by 1, it is off by 0.2 a
    sample away and by 1e-4 ten samples away; with yr' and yr'' given only in between two samples.

    Before 0 it rests; if it ends at a velocity, it comes to rest along a straight line by `stop` [output units/s^2].

    Raises:
        ShapeError: if a function gives something else than a number for each output.
        WmrError: if a function raises an error or gives what is not finite, a derivative is not that of yr, or a time
            is not positive.
    """

    @checked
    def __init__(
        self,
        outputs: Sequence[str],
        yr: Callable[[float], ArrayLike],
        duration: float,
        yr1: Callable[[float], ArrayLike] | None = None,
        yr2: Callable[[float], ArrayLike] | None = None,
        step: float = 0.01,
        stop: float = 1.0,
        counts_turns: bool = False,
    ) -> None:
        super().__init__(outputs, counts_turns)
        times = _samples(duration, step)
        with np.errstate(all="ignore"):  # of numbers that are too large the polynomials tell
            position = _values("yr", yr, times, self.outputs)
            spline = make_interp_spline(times, position, k=5)
            velocity = _derivative("yr1", yr1, spline(times, 1), times, self.outputs)
            if yr1 is not None:
                spline = make_interp_spline(times, velocity, k=5).antiderivative()
            acceleration = _derivative("yr2", yr2, spline(times, 2), times, self.outputs)
            samples = np.stack([position, velocity, acceleration])
            polynomials = joined(samples[:, :-1], samples[:, 1:], times[1])
        if not np.isfinite(polynomials).all():
            raise WmrError("no polynomials join its samples, whose numbers are too large", "give smaller ones")
        self._spline = Spline(with_rest(PPoly(polynomials, times), stop))
        self.span = self._spline.first, self._spline.last

    def _inside(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        return self._spline.over(times)

    def _row_inside(self, t: float) -> list[float]:
        return self._spline.row(t)

    def _to_add(self, name: str) -> str:
        return f"name {name} among its outputs, and give its values"

    def _of(self, outputs: tuple[str, ...]) -> Sampled:
        other = copy(self)
        spline = self._spline.of([self.outputs.index(name) for name in outputs])
        other.__dict__.update(outputs=outputs, _spline=spline)  # functions are called once only
        return other


def _samples(duration: float, step: float) -> Floats:
    """Times from 0 to `duration`, `step` [s] apart or a little less."""
    if not (SHORTEST <= duration < inf and SHORTEST <= step < inf):
        problem = f"a duration of {duration:g} s and a step of {step:g} s"
        raise WmrError(problem, f"choose positive times, {SHORTEST:g} s or more")
    count = duration / step
    if count > MOST:
        raise WmrError(f"{count:.3g} samples are too many", f"choose a step of {duration / MOST:.3g} s or more")
    return np.linspace(0.0, duration, max(FEWEST, ceil(count - ROUNDING)) + 1)


def _values(name: str, function: Callable[[float], ArrayLike], times: Floats, outputs: Sequence[str]) -> Floats:
    """What a user's function gives at these times, (T, n-m)."""
    expected = f"give a number for each of {', '.join(outputs)}"
    rows = np.empty((len(times), len(outputs)))
    for row, t in zip(rows, times.tolist(), strict=True):
        try:
            given = function(t)
        except Exception as error:  # it may raise anything
            what = ": ".join([type(error).__name__, *([plain(str(error))] if str(error) else [])])
            raise WmrError(f"{name}({t:g}) raised {what}", f"let it be defined from 0 to {times[-1]:g} s") from None
        numbers = real_numbers(f"{name}({t:g})", given, expected)
        if numbers.size != len(outputs) or numbers.ndim > 2:
            raise WmrError(f"{name}({t:g}) has shape {numbers.shape}", expected)
        row[:] = numbers.reshape(-1)
        if not np.isfinite(row).all():
            raise WmrError(f"{name}({t:g}) is {row.tolist()}", "give finite numbers")
    return rows


def _derivative(
    name: str, function: Callable[[float], ArrayLike] | None, found: Floats, times: Floats, outputs: Sequence[str]
) -> Floats:
    """What a user's function of a derivative gives, if it is like what was found; without a function that."""
    if function is None:
        return found
    given = _values(name, function, times, outputs)
    off = np.abs(given - found) - SAME - LIKE * np.abs(given).max(axis=0)
    if np.mean((off > 0.0).any(axis=1)) > SELDOM:
        at, which = divmod(int(np.argmax(off)), len(outputs))
        raise WmrError(
            f"{name}({times[at]:g}) gives {given[at, which]:g} for {outputs[which]}, whose samples tell "
            f"{found[at, which]:g}",
            f"correct {name}, leave it out, or choose a shorter step",
        )
    return given
