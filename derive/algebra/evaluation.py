"""Values of expressions at given numbers, to the working precision of mpmath, through named terms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mpmath
import sympy as sp
from mpmath import mpf
from sympy import Expr, Matrix, Symbol

_DIGITS = 50
_NOISE = mpf("1e-30")  # of the largest singular value
_PLACES = 20

FUNCTIONS = {
    sp.Abs: mpmath.fabs,
    sp.acos: mpmath.acos,
    sp.asin: mpmath.asin,
    sp.atan: mpmath.atan,
    sp.atan2: mpmath.atan2,
    sp.cos: mpmath.cos,
    sp.exp: mpmath.exp,
    sp.sign: mpmath.sign,
    sp.sin: mpmath.sin,
    sp.tan: mpmath.tan,
    sp.tanh: mpmath.tanh,
}


class NotFinite(ArithmeticError):
    """A value that is no finite real number."""


class Evaluation:
    """Values of expressions at given `numbers`, each node computed once."""

    def __init__(self, numbers: Mapping[Symbol, float | mpf], definitions: Mapping[Symbol, Expr]) -> None:
        self._numbers, self._definitions = numbers, definitions
        self._found: dict[Expr, mpf] = {}

    def __call__(self, expression: Expr) -> mpf:
        """The value of `expression`.

        Raises:
            NotFinite, ZeroDivisionError: If it has none.
        """
        if expression not in self._found:
            value = self._computed(expression)
            if not isinstance(value, mpf) or not mpmath.isfinite(value):
                raise NotFinite(expression)
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
        if expression.func not in FUNCTIONS:
            raise NotImplementedError(f"no value of {expression.func.__name__}")
        return FUNCTIONS[expression.func](*arguments)


def rank_in_numbers(matrix: Matrix, numbers: Mapping[Symbol, Expr], definitions: Mapping[Symbol, Expr]) -> int:
    """The rank of `matrix` where some symbols have given `numbers` and all others ordinary ones, to many digits.

    For functions that no exact field holds, as the root of a number.

    Raises:
        NotFinite: If it has no value at any of the places tried.
    """
    with mpmath.workdps(_DIGITS):
        given = {symbol: Evaluation({}, {})(number) for symbol, number in numbers.items()}
        for draw in range(_PLACES):
            free = sorted(_undefined(matrix, definitions) - given.keys(), key=lambda symbol: symbol.name)
            drawn = {symbol: mpf((29 + 37 * k + 53 * draw) % 101) / 101 for k, symbol in enumerate(free)}
            values = Evaluation(given | drawn, definitions)
            try:
                rows = [[values(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]
            except (NotFinite, ZeroDivisionError):
                continue
            sizes = mpmath.svd_r(mpmath.matrix(rows), compute_uv=False) if rows and rows[0] else []
            return sum(size > _NOISE * max(sizes) for size in sizes)
    raise NotFinite(matrix)


def _undefined(matrix: Matrix, definitions: Mapping[Symbol, Expr]) -> set[Symbol]:
    """The symbols without a definition that a matrix rests on."""
    found: set[Symbol] = set()
    left = list(matrix.free_symbols)
    while left:
        symbol = left.pop()
        if symbol not in found:
            found.add(symbol)
            left.extend(definitions[symbol].free_symbols if symbol in definitions else ())
    return found - definitions.keys()
