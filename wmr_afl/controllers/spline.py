"""Polynomials of time in a row: evaluated with their derivatives, joined smoothly, brought to rest."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PPoly

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import Fixed

AT_REST = 1e-9  # [output units/s], a speed that counts as none


class Spline(Fixed):
    """Polynomials in a row (order, pieces, outputs) with their first and second derivatives, from `first` to `last`.

    At one time they are looked up by Horner's rule, in microseconds, however many pieces there are.
    """

    def __init__(self, polynomials: PPoly) -> None:
        self._polynomials = polynomials
        order, pieces, self._size = polynomials.c.shape
        together = np.zeros((order, pieces, 3 * self._size))  # y, y' and y'' side by side, evaluated at once
        for number in range(3):
            part = polynomials.derivative(number).c
            together[order - len(part) :, :, number * self._size : (number + 1) * self._size] = part
        self._together, self._coefficients = PPoly(together, polynomials.x), together
        self._knots: list[float] = polynomials.x.tolist()
        self.first, self.last = self._knots[0], self._knots[-1]

    def over(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """yr, yr', yr'' at all `times` (T,) [s] between first and last, (T, outputs) each."""
        rows = np.asarray(self._together(times))
        return rows[:, : self._size], rows[:, self._size : 2 * self._size], rows[:, 2 * self._size :]

    def row(self, t: float) -> list[float]:
        """yr, yr', yr'' at time t [s] between first and last, one after the other."""
        piece = min(bisect_right(self._knots, t), len(self._knots) - 1) - 1
        since, (row, *others) = t - self._knots[piece], self._coefficients[:, piece].tolist()
        for coefficients in others:  # Horner's rule, of a few numbers swifter than arrays
            row = [value * since + coefficient for value, coefficient in zip(row, coefficients, strict=True)]
        return row

    def of(self, columns: Sequence[int]) -> Spline:
        """The same of these outputs, in their order."""
        return Spline(PPoly(self._polynomials.c[:, :, list(columns)], self._polynomials.x))


def horner(coefficients: Floats, since: float) -> Floats:
    """A polynomial (order, ...), the highest power first, at `since` [s]."""
    value = np.zeros(coefficients.shape[1:])
    for coefficient in coefficients:
        value = value * since + coefficient
    return value


def joined(a: Floats, b: Floats, step: Floats | float) -> Floats:
    """The polynomial of degree 5 (6, ...) from [yr; yr'; yr''] = a to b, `step` [s] later; the highest power first."""
    (y0, v0, a0), (y1, v1, a1) = a, b
    T = step
    gap, early, late = y1 - y0 - T * v0 - 0.5 * T * T * a0, T * (v1 - v0) - T * T * a0, T * T * (a1 - a0)
    return np.array([
        (6.0 * gap - 3.0 * early + 0.5 * late) / T**5,
        (-15.0 * gap + 7.0 * early - late) / T**4,
        (10.0 * gap - 4.0 * early + 0.5 * late) / T**3,
        0.5 * a0,
        v0,
        y0,
    ])  # fmt: skip


def to_rest(position: Floats, velocity: Floats, stop: float) -> PPoly | None:
    """From here to rest along a straight line by `stop` [output units/s^2], from time zero; None if it rests already.

    Raises:
        WmrError: if `stop` is not positive.
    """
    if not stop > 0.0:
        raise WmrError(f"it stops by {stop:g}", "choose a positive deceleration [output units/s^2]")
    speed = float(np.linalg.norm(velocity))
    if not speed > AT_REST:
        return None
    return PPoly(np.stack([-0.5 * stop * velocity / speed, velocity, position])[:, None], [0.0, speed / stop])


def with_rest(polynomials: PPoly, stop: float) -> PPoly:
    """These polynomials, and behind their end a straight line on which their speed falls to zero, if they have any.

    Raises:
        WmrError: if `stop` is not positive.
    """
    end = polynomials.x[-1]
    line = to_rest(polynomials(end), polynomials(end, 1), stop)
    if line is None:
        return polynomials
    piece = np.zeros((polynomials.c.shape[0], *line.c.shape[1:]))
    piece[-len(line.c) :] = line.c
    return PPoly(np.concatenate([polynomials.c, piece], axis=1), np.append(polynomials.x, end + line.x[-1]))
