"""Linear dependence of functions over the field of known constants, decided by exact evaluation.

Functions f_1 ... f_N of some variables are given as columns of expressions. Which of them are combinations of
others, with coefficients that may contain the known constants c only? Ranks come from random points of a finite
field; the coefficients are then recovered as rational functions of c and checked at fresh points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isqrt, lcm

import sympy as sp
from sympy import Expr, Symbol
from sympy.polys.matrices import DomainMatrix

from .finite_field import FIELD, PRIME, TRIED_POINTS, Element, NotRepresentable, Point, usable, with_constants
from .named_terms import Terms, sorted_symbols
from .trigonometry import without_sums_of_angles

_GROWTH = 4  # of a constant whose power is read off; a square, so that roots stay


_POWERS = {pow(_GROWTH, power, PRIME): power for power in range(-12, 13)}


class NotCombined(ArithmeticError):
    """A function follows from others, but its coefficients were not found as functions of the known constants."""

    def __init__(self, function: Expr) -> None:
        self.function = function
        super().__init__(f"no combination found for {function}")


Column = Sequence[Expr]  # a vector-valued function


@dataclass(frozen=True)
class Dependence:
    """`independent`: indices of a basis; `combination[j][i]`: coefficient of basis function i in function j."""

    independent: list[int]
    combination: dict[int, dict[int, Expr]]

    def exchanged(self, cost: Callable[[Expr], int]) -> Dependence:
        """Another basis of the same functions, in whose combinations the coefficients cost less."""
        best = self
        improved = True
        while improved:
            improved = False
            pairs = [(j, i) for j, combination in sorted(best.combination.items()) for i in sorted(combination)]
            for j, i in pairs:
                other = best._swapped(j, i)
                if other._cost(cost) < best._cost(cost):
                    best, improved = other, True
                    break
        return best

    def _swapped(self, joins: int, leaves: int) -> Dependence:
        """The basis with function `joins` in the place of `leaves`."""
        joining = self.combination[joins]
        pivot = joining[leaves]
        leaving = {i: sp.factor(-c / pivot) for i, c in joining.items() if i != leaves} | {joins: sp.factor(1 / pivot)}
        combination = {leaves: leaving}
        for j, old in self.combination.items():
            if j != joins:
                new = {i: c for i, c in old.items() if i != leaves}
                for i, c in leaving.items() if leaves in old else ():
                    new[i] = sp.factor(new.get(i, sp.S.Zero) + old[leaves] * c)
                combination[j] = {i: c for i, c in new.items() if c != 0}
        return Dependence(sorted({*self.independent, joins} - {leaves}), combination)

    def _cost(self, cost: Callable[[Expr], int]) -> int:
        return sum(cost(c) for combination in self.combination.values() for c in combination.values())


def dependence(columns: Sequence[Column], known: frozenset[Symbol], terms: Terms) -> Dependence:
    """Splits `columns` into a basis, first come first kept, and combinations of it.

    Raises:
        NotCombined: If the coefficients of a combination are not found.
    """
    reduced, pivots = _reduced(columns, known, terms, draw=0)
    again, _ = _reduced(columns, known, terms, draw=1)
    combination: dict[int, dict[int, Expr]] = {}
    for j in range(len(columns)):
        if j in pivots:
            continue
        support = [k for k, _ in enumerate(pivots) if reduced[k][j] != 0]
        basis = [columns[pivots[k]] for k in support]
        numbers = [(fraction_of(int(reduced[k][j])), fraction_of(int(again[k][j]))) for k in support]
        coefficients = [first for first, second in numbers if first is not None and first == second]
        if len(coefficients) < len(support) or not _combine(basis, coefficients, columns[j], terms):
            found = _monomials(basis, columns[j], known, terms)
            if found is None or not _combine(basis, found, columns[j], terms):
                found = _symbolic(basis, columns[j], known, terms)
            coefficients = found
        combination[j] = {pivots[k]: c for k, c in zip(support, coefficients, strict=True)}
    return Dependence(list(pivots), combination)


def _reduced(
    columns: Sequence[Column], known: frozenset[Symbol], terms: Terms, draw: int
) -> tuple[list[list[Element]], tuple[int, ...]]:
    """The reduced row echelon form of the columns' values, with the constants `known` at one random value each."""
    enough = len(columns) + 4  # points: more than there can be independent functions of the state

    def values(redraw: int, seed: int) -> list[list[Element]]:
        constant = Point(-1 - draw - 2 * redraw)
        point = Point(1000 * draw + seed, terms.definitions, {c: constant(c) for c in sorted_symbols(known)})
        return [[point(column[r]) for column in columns] for r in range(len(columns[0]))]

    points = with_constants(values, enough, TRIED_POINTS + 8 * enough)
    rows = [row for point in points for row in point if any(row)]
    reduced, pivots = DomainMatrix(rows, (len(rows), len(columns)), FIELD).rref()
    return reduced.to_list(), pivots


def _combine(basis: Sequence[Column], coefficients: Sequence[Expr], column: Column, terms: Terms) -> bool:
    """Whether the combination of the basis functions is the function `column`."""
    return all(
        terms.is_zero(sum((c * function[r] for c, function in zip(coefficients, basis, strict=True)), -entry))
        for r, entry in enumerate(column)
    )


def fraction_of(residue: int) -> sp.Rational | None:
    """The small fraction that `residue` stands for, by the Euclidean algorithm; None if there is none."""
    bound = isqrt(isqrt(PRIME))
    previous, current = (PRIME, 0), (residue % PRIME, 1)
    while current[0] > bound:
        quotient = previous[0] // current[0]
        previous, current = current, (previous[0] - quotient * current[0], previous[1] - quotient * current[1])
    return sp.Rational(*current) if 0 < abs(current[1]) <= bound else None


def _monomials(basis: Sequence[Column], column: Column, known: frozenset[Symbol], terms: Terms) -> list[Expr] | None:
    """Coefficients that are fractions times powers of known constants, read off as one constant grows; else None."""
    functions = [*basis, column]
    constants = sorted_symbols(known & set().union(*(terms.atoms(entry) for one in functions for entry in one)))
    at = Point(-1)
    here = {c: at(c) for c in constants}
    try:
        values = _solution(functions, here, terms)
        if values is None or 0 in values:
            return None
        coefficients: list[Expr] = [sp.S.One] * len(basis)
        for c in constants:
            grown = _solution(functions, here | {c: _GROWTH * here[c]}, terms)
            if grown is None:
                return None
            for k, (value, changed) in enumerate(zip(values, grown, strict=True)):
                power = _POWERS.get(int(changed / value))
                if power is None:
                    return None
                coefficients[k] *= c**power
    except NotRepresentable:
        return None
    monomials = (Point(0, values=here)(coefficient) for coefficient in coefficients)
    fractions = [fraction_of(int(value / one)) for value, one in zip(values, monomials, strict=True)]
    if None in fractions:
        return None
    return [fraction * coefficient for fraction, coefficient in zip(fractions, coefficients, strict=True)]


def _solution(functions: Sequence[Column], constants: Mapping[Symbol, Element], terms: Terms) -> list[Element] | None:
    """The coefficients with which the last of `functions` follows from the others, at one value of the constants."""
    wanted = len(functions)

    def values(seed: int) -> list[list[Element]]:
        point = Point(seed, terms.definitions, constants)
        return [[point(function[r]) for function in functions] for r in range(len(functions[0]))]

    rows = [row for there in usable(values, wanted + 1, TRIED_POINTS) for row in there if any(row)]
    reduced, pivots = DomainMatrix(rows, (len(rows), wanted), FIELD).rref()
    return [row[-1] for row in reduced.to_list()[: wanted - 1]] if pivots == tuple(range(wanted - 1)) else None


def _symbolic(basis: Sequence[Column], column: Column, known: frozenset[Symbol], terms: Terms) -> list[Expr]:
    """Coefficients in the known constants with sum of coefficient times basis function = column.

    Raises:
        NotCombined: If they are not found.
    """
    rows: list[list[Expr]] = []
    right: list[Expr] = []
    functions = [[terms.expand(entry) for entry in function] for function in basis]
    wanted = [terms.expand(entry) for entry in column]
    if any(_has_root_of_state(entry, known) for one in [*functions, wanted] for entry in one):
        raise NotCombined(max(column, key=sp.count_ops))  # rational values leave roots of the constants, without end
    parts = _parts([*wanted, *(entry for function in functions for entry in function)], known)
    for draw in range(8 * len(basis) + 40):
        values = _RationalState(draw, known, parts)
        for r, entry in enumerate(wanted):
            row = [values(function[r]) for function in functions]
            try:
                is_new = Terms().rank(sp.Matrix([*rows, row])) == len(rows) + 1
            except NotRepresentable:  # a root of a number that the field lacks
                continue
            if is_new:
                rows.append(row)
                right.append(values(entry))
            if len(rows) == len(basis):
                return _solved(rows, right, basis, column, terms)
    raise NotCombined(max(column, key=sp.count_ops))


def _has_root_of_state(expression: Expr, known: frozenset[Symbol]) -> bool:
    return any(not power.exp.is_Integer and not power.free_symbols <= known for power in expression.atoms(sp.Pow))


def _solved(
    rows: list[list[Expr]], right: list[Expr], basis: Sequence[Column], column: Column, terms: Terms
) -> list[Expr]:
    matrix = sp.Matrix(rows)
    solution = matrix.adjugate() * sp.Matrix(right) / matrix.det(method="berkowitz")
    coefficients = [sp.factor(sp.together(entry)) for entry in solution]
    if not _combine(basis, coefficients, column, terms):
        raise NotCombined(max(column, key=sp.count_ops))
    return coefficients


class _RationalState:
    """Small rational values for every symbol but the known constants; angles on the unit circle.

    `parts` says for each angle of the state which part of it gets a rational unit, so that its multiples have one.
    """

    def __init__(self, draw: int, known: frozenset[Symbol], parts: Mapping[Expr, int]) -> None:
        self.draw, self.known, self.parts = draw, known, parts

    def __call__(self, expression: Expr) -> Expr:
        return sp.cancel(self._value(without_sums_of_angles(expression)))

    def _value(self, expression: Expr) -> Expr:
        if isinstance(expression, sp.sin | sp.cos | sp.tan):
            cosine, sine = self._unit(expression.args[0])
            return {sp.sin: sine, sp.cos: cosine, sp.tan: sine / cosine}[expression.func]
        if expression.is_Symbol:
            return expression if expression in self.known else self._number(expression)
        return expression.func(*map(self._value, expression.args)) if expression.args else expression

    def _unit(self, angle: Expr) -> tuple[Expr, Expr]:
        """Cosine and sine: rational ones of the state's angles, turned by what remains."""
        cosine, sine, rest = sp.S.One, sp.S.Zero, sp.S.Zero
        for term in sp.Add.make_args(sp.expand(angle)):
            factor, part = term.as_coeff_Mul()
            if part not in self.parts:
                rest += self._value(term)
                continue
            t = self._number(part)
            one = ((1 - t**2) / (1 + t**2), 2 * t / (1 + t**2))
            c, s = _turned(one, int(factor * self.parts[part]))
            cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        if rest == 0:
            return cosine, sine
        c, s = sp.cos(rest), sp.sin(rest)
        return cosine * c - sine * s, sine * c + cosine * s

    def _number(self, key: Expr) -> sp.Rational:
        value = int(Point(self.draw)(sp.Symbol(f"state {key}")))  # drawn from the name, the same in every process
        return sp.Rational(value % 17 + 2, value % 11 + 2 + 17)


def _turned(unit: tuple[Expr, Expr], times: int) -> tuple[Expr, Expr]:
    """The unit of an angle's multiple, by squaring."""
    (c, s), square, left = (sp.S.One, sp.S.Zero), unit, abs(times)
    while left:
        if left % 2:
            c, s = c * square[0] - s * square[1], s * square[0] + c * square[1]
        square = (square[0] ** 2 - square[1] ** 2, 2 * square[0] * square[1])
        left //= 2
    return c, s if times >= 0 else -s


def _parts(expressions: Iterable[Expr], known: frozenset[Symbol]) -> dict[Expr, int]:
    """The state's angles, each with the common denominator of its multiples."""
    parts: dict[Expr, int] = {}
    for expression in expressions:
        for function in expression.atoms(sp.sin, sp.cos, sp.tan):
            for term in sp.Add.make_args(sp.expand(function.args[0])):
                factor, part = term.as_coeff_Mul()
                if part.free_symbols and part.free_symbols.isdisjoint(known):
                    parts[part] = lcm(parts.get(part, 1), int(factor.q))
    return parts
