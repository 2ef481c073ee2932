"""Linear dependence of functions over the field of known constants, decided by exact evaluation.

Functions f_1 ... f_N of some variables are given as columns of expressions. Which of them are combinations of
others, with coefficients that may contain the known constants c only? Ranks come from random points of a finite
field; the coefficients are then recovered as rational functions of c and checked at fresh points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

import sympy as sp
from sympy import Expr, Symbol
from sympy.polys.matrices import DomainMatrix

from derive.exact import FIELD, PRIME, Element, NotRepresentable, Point
from derive.terms import Terms, sorted_symbols

Column = Sequence[Expr]  # a vector-valued function


@dataclass(frozen=True)
class Dependence:
    """`independent`: indices of a basis; `combination[j][i]`: coefficient of basis function i in function j."""

    independent: list[int]
    combination: dict[int, dict[int, Expr]]


def dependence(columns: Sequence[Column], known: frozenset[Symbol], terms: Terms) -> Dependence:
    """Splits `columns` into a basis, first come first kept, and combinations of it."""
    reduced, pivots = _reduced(columns, known, terms, draw=0)
    again, _ = _reduced(columns, known, terms, draw=1)
    combination: dict[int, dict[int, Expr]] = {}
    for j in range(len(columns)):
        if j in pivots:
            continue
        support = [k for k, _ in enumerate(pivots) if reduced[k][j] != 0]
        coefficients: list[Expr | None] = []
        for k in support:
            number, other = _fraction(int(reduced[k][j])), _fraction(int(again[k][j]))
            coefficients.append(number if number is not None and number == other else None)
        if None in coefficients:
            coefficients = list(_symbolic([columns[pivots[k]] for k in support], columns[j], known, terms))
        combination[j] = {pivots[k]: c for k, c in zip(support, coefficients, strict=True) if c is not None}
    return Dependence(list(pivots), combination)


def _reduced(
    columns: Sequence[Column], known: frozenset[Symbol], terms: Terms, draw: int
) -> tuple[list[list[Element]], tuple[int, ...]]:
    """The reduced row echelon form of the columns' values, with the constants `known` at one random value each."""
    constants = Point(-1 - draw)
    rows: list[list[Element]] = []
    for seed in range(4 * len(columns) + 16):
        point = Point(seed + 1000 * draw, terms.definitions, {c: constants(c) for c in sorted_symbols(known)})
        try:
            rows.extend([point(column[r]) for column in columns] for r in range(len(columns[0])))
        except NotRepresentable:
            continue
        if len(rows) >= 2 * len(columns) + 8:
            break
    reduced, pivots = DomainMatrix(rows, (len(rows), len(columns)), FIELD).rref()
    return reduced.to_list(), pivots


def _fraction(residue: int) -> sp.Rational | None:
    """The small fraction that `residue` stands for, by the Euclidean algorithm; None where there is none."""
    bound = isqrt(isqrt(PRIME))
    previous, current = (PRIME, 0), (residue % PRIME, 1)
    while current[0] > bound:
        quotient = previous[0] // current[0]
        previous, current = current, (previous[0] - quotient * current[0], previous[1] - quotient * current[1])
    return sp.Rational(*current) if 0 < abs(current[1]) <= bound else None


def _symbolic(basis: Sequence[Column], column: Column, known: frozenset[Symbol], terms: Terms) -> list[Expr]:
    """Coefficients in the known constants with sum of coefficient times basis function = column."""
    rows: list[list[Expr]] = []
    right: list[Expr] = []
    for draw in range(4 * len(basis) + 8):
        values = _RationalState(draw, known)
        candidate = [[values(terms.expand(function[r])) for function in basis] for r in range(len(column))]
        for r, row in enumerate(candidate):
            trial = sp.Matrix([*rows, row])
            if trial.rank() == len(rows) + 1:
                rows.append(row)
                right.append(values(terms.expand(column[r])))
        if len(rows) == len(basis):
            break
    solution = sp.Matrix(rows).LUsolve(sp.Matrix(right)).applyfunc(sp.factor)
    for r, entry in enumerate(column):
        combined = sum((c * function[r] for c, function in zip(solution, basis, strict=True)), sp.S.Zero)
        if not terms.is_zero(combined - entry):
            raise ArithmeticError(f"no combination found for {entry}")
    return list(solution)


class _RationalState:
    """Small rational values for every symbol but the known constants; angles on the unit circle."""

    def __init__(self, draw: int, known: frozenset[Symbol]) -> None:
        self.draw, self.known = draw, known

    def __call__(self, expression: Expr) -> Expr:
        expression = sp.expand_trig(expression)
        values: dict[Expr, Expr] = {}
        for function in sorted(expression.atoms(sp.sin, sp.cos, sp.tan), key=sp.default_sort_key):
            angle = function.args[0]
            if angle.free_symbols.isdisjoint(self.known):
                t = self._number(angle)
                sine, cosine = 2 * t / (1 + t**2), (1 - t**2) / (1 + t**2)
                values[function] = {sp.sin: sine, sp.cos: cosine, sp.tan: sine / cosine}[function.func]
        for symbol in expression.free_symbols - self.known:
            values.setdefault(symbol, self._number(symbol))
        return sp.cancel(expression.xreplace(values))

    def _number(self, key: Expr) -> sp.Rational:
        value = int(Point(self.draw)(sp.Symbol(f"state {key}")))  # drawn from the name, the same in every process
        return sp.Rational(value % 17 + 2, value % 11 + 2 + 17)
