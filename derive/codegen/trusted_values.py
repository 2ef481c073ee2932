"""`trusted_values.json`: every generated function's value at fixed arguments, computed from the derived expressions.

Neither common subexpressions nor a printer have a part in these values: when a new SymPy writes other text, they say
whether the meaning is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import mpmath
import sympy as sp
from mpmath import mpf
from sympy import Expr, Matrix, Symbol

from ..algebra.finite_field import NotRepresentable
from ..derivation import Derivation
from .arguments import arguments_of
from .quantities import Quantity

_DIGITS = 50
_NOISE = mpf("1e-30")  # of a function's largest entry; what cancels leaves less than that
_CANDIDATES = 40

_FUNCTIONS = {
    sp.Abs: mpmath.fabs,
    sp.cos: mpmath.cos,
    sp.exp: mpmath.exp,
    sp.sign: mpmath.sign,
    sp.sin: mpmath.sin,
    sp.tan: mpmath.tan,
}


class _NotFinite(ArithmeticError):
    """A value that is no finite real number."""


def trusted_values(derivation: Derivation, functions: list[Quantity]) -> dict[str, Any]:
    """Arguments and values of `functions` there, correctly rounded: flat for a vector, by rows for a matrix.

    Raises:
        NotRepresentable: If no configuration is found where all of them are finite.
    """
    with mpmath.workdps(_DIGITS):
        for attempt in range(_CANDIDATES):
            try:
                return _at(derivation, functions, attempt)
            except (_NotFinite, ZeroDivisionError):
                continue
    raise NotRepresentable(functions[0].expression)


def _at(derivation: Derivation, functions: list[Quantity], attempt: int) -> dict[str, Any]:
    numbers = _arguments(derivation, attempt)
    value = _Evaluation(numbers, derivation.terms.definitions)
    parameters = zip(derivation.adaptive.theta, derivation.adaptive.base_parameters, strict=True)
    numbers |= {theta: float(value(expression)) for theta, expression in parameters}
    return {
        "arguments": {
            name: [numbers[symbol] for symbol in argument.entries]
            for name, argument in arguments_of(derivation).items()
        },
        "values": {function.name: _rows(function, value) for function in functions},
    }


def _arguments(derivation: Derivation, attempt: int) -> dict[Symbol, float]:
    """Ordinary numbers, other ones for each attempt; parameters within a fifth of their defaults. Not theta."""
    d, numbers = derivation, {}
    for place, symbols in enumerate((d.state, d.dynamics.inputs, d.dynamics.loads, d.adaptive.accelerations)):
        for index, symbol in enumerate(symbols):
            numbers[symbol] = float(3 * _fraction(place, index, attempt) - sp.Rational(149, 100))
    for index, (symbol, default) in enumerate(d.robot.defaults.items()):
        numbers[symbol] = float(default * (sp.Rational(4, 5) + sp.Rational(2, 5) * _fraction(9, index, attempt)))
    return numbers


def _fraction(place: int, index: int, attempt: int) -> sp.Rational:
    """A number of hundredths in [0, 1), well spread over neighbouring indices."""
    return sp.Rational((17 + 29 * place + 37 * index + 13 * attempt) % 100, 100)


def _rows(function: Quantity, value: _Evaluation) -> list[Any]:
    matrix: Matrix = function.expression
    numbers = [value(entry) for entry in matrix]
    noise = _NOISE * max(map(abs, numbers), default=mpf(0))
    rounded = [0.0 if abs(number) <= noise else float(number) for number in numbers]
    if function.is_vector:
        return rounded
    return [rounded[i * matrix.cols : (i + 1) * matrix.cols] for i in range(matrix.rows)]


class _Evaluation:
    """Values of expressions at given `numbers`, each node computed once."""

    def __init__(self, numbers: Mapping[Symbol, float], definitions: Mapping[Symbol, Expr]) -> None:
        self._numbers, self._definitions = numbers, definitions
        self._found: dict[Expr, mpf] = {}

    def __call__(self, expression: Expr) -> mpf:
        """The value of `expression`.

        Raises:
            _NotFinite, ZeroDivisionError: If it has none.
        """
        if expression not in self._found:
            value = self._computed(expression)
            if not isinstance(value, mpf) or not mpmath.isfinite(value):
                raise _NotFinite(expression)
            self._found[expression] = value
        return self._found[expression]

    def _computed(self, expression: Expr) -> mpf:
        if expression in self._numbers:
            return mpf(self._numbers[expression])
        if expression in self._definitions:
            return self(self._definitions[expression])
        if expression.is_Rational:
            return mpf(expression.p) / expression.q
        if expression.is_NumberSymbol:
            return expression._to_mpmath(mpmath.mp.prec)
        arguments: Iterable[mpf] = map(self, expression.args)
        if expression.is_Add:
            return mpmath.fsum(arguments)
        if expression.is_Mul:
            return mpmath.fprod(arguments)
        if expression.is_Pow:
            base, exponent = arguments
            return base ** (int(exponent) if expression.exp.is_Integer else exponent)
        if expression.func not in _FUNCTIONS:
            raise NotImplementedError(f"no value of {expression.func.__name__}")
        return _FUNCTIONS[expression.func](*arguments)
