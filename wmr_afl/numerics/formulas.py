"""Expressions of time `t` [s], for references and for what disturbs: read once, then values for NumPy and CasADi."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import pi
from typing import Any

import casadi as ca

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


class TimeFunction:
    """A vector of expressions of time, with derivatives up to `order`.

    Raises: ExpressionError, where an expression is wrong.
    """

    def __init__(self, expressions: Sequence[str], order: int = 0) -> None:
        t = ca.SX.sym("t")
        parts = [ca.vertcat(*(time_expression(text, t) for text in expressions))]
        for _ in range(order):
            parts.append(ca.jacobian(parts[-1], t))
        self.function = ca.Function("of_time", [t], [ca.densify(part) for part in parts])

    def __call__(self, t: Any) -> list[Any]:
        """Value and derivatives at time t [s]: columns where t is symbolic, NumPy vectors where it is a number."""
        parts = self.function.call([t])
        return parts if isinstance(t, ca.SX) else [part.full()[:, 0] for part in parts]
