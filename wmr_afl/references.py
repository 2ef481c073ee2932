"""Reference trajectories yr(t) with first and second derivatives, from any expression of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import pi
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_input import Algebra, evaluate

TIME_FUNCTIONS = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "exp": ca.exp,
    "sqrt": ca.sqrt,
    "tanh": ca.tanh,
    "abs": ca.fabs,
    "sign": ca.sign,
    "step": lambda t: ca.if_else(t >= 0, 1.0, 0.0),
}


def time_expression(text: str, t: ca.SX) -> ca.SX:
    """An expression of time `t` [s] as CasADi expression.

    Raises: ExpressionError.
    """
    algebra = Algebra(names={"t": t, "pi": pi}, functions=TIME_FUNCTIONS, number=_number)
    return ca.SX(evaluate(text, algebra))


def _number(fraction: Fraction) -> float:
    return fraction.numerator / fraction.denominator


@dataclass(frozen=True)
class Point:
    """yr, yr', yr'' at one time, (n-m,) each."""

    position: Any
    velocity: Any
    acceleration: Any


class Reference:
    """A trajectory of the outputs, one expression of time for each; derivatives are taken from the expressions.

    Raises: ExpressionError, where an expression is wrong.
    """

    def __init__(self, expressions: Mapping[str, str]) -> None:
        self.expressions = dict(expressions)
        t = ca.SX.sym("t")
        position = ca.vertcat(*(time_expression(text, t) for text in expressions.values()))
        velocity = ca.jacobian(position, t)
        acceleration = ca.jacobian(velocity, t)
        self._function = ca.Function("reference", [t], [ca.densify(e) for e in (position, velocity, acceleration)])

    def at(self, t: Any) -> Point:
        """The reference at time t [s]: columns where t is symbolic, NumPy vectors where it is a number."""
        parts = self._function(t)
        if isinstance(t, ca.SX):
            return Point(*parts)
        return Point(*(part.full()[:, 0] for part in parts))

    def over(self, times: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """yr, yr', yr'' at all `times` (T,), (T, n-m) each."""
        row = np.atleast_1d(np.asarray(times, dtype=float)).reshape(1, -1)
        if not row.size:  # CasADi has no map over nothing
            return (np.zeros((0, len(self.expressions))),) * 3
        position, velocity, acceleration = (part.full().T for part in self._function.map(row.shape[1])(row))
        return position, velocity, acceleration


def circle(center: Sequence[float], radius: float, rate: float) -> list[str]:
    """(92): counter-clockwise at `rate` [rad/s]."""
    return [f"{center[0]!r} + {radius!r}*cos({rate!r}*t)", f"{center[1]!r} + {radius!r}*sin({rate!r}*t)"]


def figure_eight(center: Sequence[float], radius: float, rate: float) -> list[str]:
    """(94): one loop each way in 2 pi/rate seconds."""
    return [f"{center[0]!r} + {radius!r}*sin(2*{rate!r}*t)", f"{center[1]!r} + {radius!r}*sin({rate!r}*t)"]


def line(start: Sequence[float], velocity: Sequence[float]) -> list[str]:
    """From `start` at constant `velocity`, as many entries each."""
    return [f"{s!r} + {v!r}*t" for s, v in zip(start, velocity, strict=True)]
