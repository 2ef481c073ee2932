"""Formulas as text: expressions of time `t` for NumPy and CasADi, and formulas of model.json for NumPy."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from math import pi
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.errors import ArgumentError
from wmr_afl.numerics.parts import Fixed
from wmr_input import LONGEST_FORMULA, Algebra, evaluate
from wmr_input.errors import shown

_ON_ARRAYS: dict[str, Callable[..., Any]] = {  # functions in formulas of model.json
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "tanh": np.tanh,
    "abs": np.abs,
    "sign": np.sign,
}
_OF_TIME: dict[str, Callable[..., Any]] = {  # functions in expressions of time
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "exp": ca.exp,
    "sqrt": ca.sqrt,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "atan2": ca.atan2,
    "tanh": ca.tanh,
    "abs": ca.fabs,
    "sign": ca.sign,
    "step": lambda t: ca.if_else(t >= 0, 1.0, 0.0),
}


_WORD = re.compile(r"[A-Za-z_]\w*")
FUNCTIONS = (*_ON_ARRAYS, "pi")  # what formulas of model.json may hold besides declared names


def words_of(formula: str) -> set[str]:
    """The names and functions that a formula holds."""
    return set(_WORD.findall(formula))


def numpy_value(formula: str, names: Mapping[str, Any]) -> Any:
    """The value of a formula over `names`, which may be arrays.

    Raises:
        ExpressionError: if the formula is not arithmetic over these names.
    """
    return evaluate(formula, Algebra(dict(names) | {"pi": pi}, _ON_ARRAYS, _number), LONGEST_FORMULA)


def casadi_value(formula: str, names: Mapping[str, Any]) -> Any:
    """The value of a formula over `names`, which may be CasADi's symbols.

    Raises:
        ExpressionError: if the formula is not arithmetic over these names.
    """
    functions = {name: _OF_TIME[name] for name in _ON_ARRAYS}
    return evaluate(formula, Algebra(dict(names) | {"pi": pi}, functions, _number), LONGEST_FORMULA)


def time_expression(text: str, t: ca.SX) -> ca.SX:
    """An expression of time `t` [s] as a CasADi expression.

    Raises:
        ExpressionError: if it is not arithmetic over `t`.
    """
    return ca.SX(evaluate(text, Algebra({"t": t, "pi": pi}, _OF_TIME, _number)))


class TimeFunction(Fixed):
    """A vector of expressions of time `t` [s], with derivatives up to `order`.

    Raises:
        ExpressionError: if an expression is wrong.
    """

    def __init__(self, expressions: Sequence[str], order: int = 0) -> None:
        self._text = (tuple(expressions), order)
        t = ca.SX.sym("t")
        parts = [ca.vertcat(*(time_expression(text, t) for text in expressions))]
        for _ in range(order):
            parts.append(ca.jacobian(parts[-1], t))
        self.function = ca.Function("of_time", [t], [ca.densify(part) for part in parts])
        together = ca.Function("row", [t], [ca.densify(ca.vertcat(*parts))])
        self._given, self._found, self._lock = np.zeros(1), np.zeros(together.size1_out(0)), threading.Lock()
        self._buffer, self._run = together.buffer()
        self._buffer.set_arg(0, memoryview(self._given))  # type: ignore[arg-type, call-arg]
        self._buffer.set_res(0, memoryview(self._found))  # type: ignore[arg-type, call-arg]

    def __reduce__(self) -> tuple[type[TimeFunction], tuple[Any, ...]]:
        """A copy reads the expressions again."""
        return TimeFunction, self._text

    def __call__(self, t: Any) -> list[Any]:
        """Value and derivatives at time t [s]: columns if t is symbolic, NumPy vectors if it is a number.

        Raises:
            ArgumentError: if it is neither.
        """
        try:
            parts = self.function.call([t])
            return parts if isinstance(t, ca.SX) else [part.full()[:, 0] for part in parts]
        except (
            NotImplementedError,
            RuntimeError,
            AttributeError,
        ):  # what CasADi cannot read
            raise ArgumentError(f"t is {shown(t)}", "give seconds as a number") from None

    def row(self, t: float) -> list[float]:
        """Value and derivatives at time t [s], one after the other: in microseconds, and in any thread."""
        with self._lock:
            self._given[0] = t
            self._run()
            return self._found.tolist()


def _number(fraction: Fraction) -> float:
    return fraction.numerator / fraction.denominator
