"""A function of state and parameters as a sum of products: state functions times parameter functions.

Named terms are taken apart once and only where they mix the two, and what is pure stays as it is written, so that the
number of products grows with the mixture and not with the length of the expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from .finite_field import TRIED_POINTS, Element, NotRepresentable, Point, usable, with_constants
from .named_terms import Terms, sorted_symbols
from .trigonometry import factored, normal_form, shortest

_LONGEST = 2000  # operations; longer factors are not split


_STATES = (sp.S.Zero, sp.S.One, sp.Rational(7, 5))  # of coordinates and velocities: at one, d has a value


_FAR = 10**6  # between the seeds of two draws, which parameter sets do not reach


@dataclass(frozen=True)
class Parameters:
    """The physical parameters: `known` constants, which a controller may use, and `uncertain` ones."""

    known: frozenset[Symbol]
    uncertain: frozenset[Symbol]

    @property
    def all(self) -> frozenset[Symbol]:
        return self.known | self.uncertain


class NotSeparable(Exception):
    """A factor mixes state and uncertain parameters: `factor`."""

    def __init__(self, factor: Expr) -> None:
        self.factor = factor
        super().__init__(str(factor))


Monomial = tuple[Symbol | None, Expr]  # (the s_j it is linear in, state function)


Products = dict[Monomial, Expr]  # monomial -> parameter function


_ONE: Monomial = (None, sp.S.One)


class Separation:
    """Takes functions apart that are affine in the symbols `linear`."""

    def __init__(self, linear: Iterable[Symbol], parameters: Parameters, terms: Terms) -> None:
        self.linear, self.parameters, self.terms = frozenset(linear), parameters, terms
        self._memo: dict[Expr, Products] = {}

    def products(self, expression: Expr) -> Products:
        """`expression` as a sum of products; factors of known constants stand with the state.

        Raises:
            NotSeparable: If a factor contains both state and uncertain parameters.
        """
        if expression not in self._memo:
            self._memo[expression] = self._products(expression)
        return self._memo[expression]

    def _products(self, expression: Expr) -> Products:
        if expression in self.linear:
            return {(expression, sp.S.One): sp.S.One}
        atoms = self.terms.atoms(expression)
        if expression.is_Number or (atoms and atoms <= self.parameters.all and not atoms <= self.parameters.known):
            return {_ONE: expression} if expression != 0 else {}
        if atoms.isdisjoint(self.linear) and atoms.isdisjoint(self.parameters.uncertain):
            number, rest = expression.as_coeff_Mul()
            return {(None, rest): number}
        if expression in self.terms.definitions:
            return self.products(self.terms.definitions[expression])
        if expression.is_Add:
            return self._sum(self.products(term) for term in expression.args)
        if expression.is_Mul:
            return self._product([self.products(factor) for factor in expression.args])
        if expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
            return self._product([self.products(expression.base)] * int(expression.exp))
        if expression.is_Pow and expression.exp.is_Integer:
            return self._inverse(expression)
        return self._split(expression)

    def _sum(self, parts: Iterable[Products]) -> Products:
        total: Products = {}
        for part in parts:
            for monomial, parameter in part.items():
                total[monomial] = total.get(monomial, sp.S.Zero) + parameter
        return {monomial: parameter for monomial, parameter in total.items() if parameter != 0}

    def _product(self, factors: list[Products]) -> Products:
        whole: Products = {_ONE: sp.S.One}
        for factor in factors:
            whole = self._sum({self._times(m1, m2): p1 * p2} for m1, p1 in whole.items() for m2, p2 in factor.items())
        return whole

    def _times(self, first: Monomial, second: Monomial) -> Monomial:
        if first[0] is not None and second[0] is not None:
            raise NotSeparable(first[0] * second[0])
        return (first[0] if second[0] is None else second[0], first[1] * second[1])

    def _inverse(self, power: Expr) -> Products:
        """1/base^n, where the base is one product."""
        try:
            base = {m: p for m, p in self.products(power.base).items() if not self.terms.is_zero(p)}
        except NotSeparable:
            base = {}
        if len(base) != 1:
            return self._split(power)
        (((slope, state_function), parameter),) = base.items()
        if slope is not None:
            raise NotSeparable(power)
        return {(None, state_function**power.exp): parameter**power.exp}

    def _split(self, factor: Expr) -> Products:
        """A factor d = f(x) g(p) that is not written so: f = d(x, p0) / d(x0, p0) and g = d(x0, p).

        Raises:
            NotSeparable: If d is no such product, which exact values show.
        """
        if not self.terms.atoms(factor).isdisjoint(self.linear) or not self._is_product(factor):
            raise NotSeparable(factor)
        whole = self.terms.expand(factor)
        if sp.count_ops(whole) > _LONGEST:
            raise NotSeparable(factor)
        uncertain = sorted_symbols(whole.free_symbols & self.parameters.uncertain)
        state = sorted_symbols(whole.free_symbols - self.parameters.all)
        p0 = {symbol: sp.Integer(k) for k, symbol in enumerate(uncertain, 1)}
        for number in _STATES:
            parameter = whole.xreplace(dict.fromkeys(state, number))
            scale = parameter.xreplace(p0)
            if scale.has(sp.zoo, sp.nan, sp.oo) or self.terms.is_zero(scale):
                continue
            state_function = whole.xreplace(p0) / scale
            if not self.terms.is_zero(whole - state_function * parameter):
                break
            return {(None, _reduced(state_function)): sp.factor(parameter)}
        raise NotSeparable(factor)

    def _is_product(self, factor: Expr) -> bool:
        try:
            (a, b), (c, d) = MixedValues(factor, self.parameters, self.terms).table(2)
        except NotRepresentable:
            return False
        return bool(a * d == b * c)


class MixedValues:
    """Exact values of an expression at numbered states and sets of uncertain parameters; known constants stay."""

    def __init__(self, expression: Expr, parameters: Parameters, terms: Terms) -> None:
        self.expression, self.terms = expression, terms
        self.known, self.uncertain = sorted_symbols(parameters.known), sorted_symbols(parameters.uncertain)

    def table(self, count: int) -> list[list[Element]]:
        """The values at `count` states, a row each, and as many sets of parameters, where all roots exist.

        Raises:
            NotRepresentable: If there are not as many.
        """

        def both(draw: int, number: int) -> tuple[int, int]:
            self(number, number, draw)
            return draw, number

        ((draw, first),) = with_constants(both, 1, TRIED_POINTS)

        def existing(value: Callable[[int], Element]) -> list[int]:
            def number(k: int) -> int:
                value(k)
                return k

            return list(usable(number, count, TRIED_POINTS + 10 * count))

        states = existing(lambda state: self(state, first, draw))
        choices = existing(lambda choice: self(first, choice, draw))
        return [[self(state, choice, draw) for choice in choices] for state in states]

    def __call__(self, state: int, choice: int, draw: int) -> Element:
        known, uncertain = Point(-1 - _FAR * draw), Point(-2 - choice)
        values = {c: known(c) for c in self.known} | {p: uncertain(p) for p in self.uncertain}
        return Point(state, self.terms.definitions, values)(self.expression)


def _reduced(expression: Expr) -> Expr:
    """A short form: sin^2/cos + cos is 1/cos."""
    numerator, denominator = sp.fraction(sp.together(normal_form(expression)))
    return min((shortest(numerator / denominator), factored(numerator) / factored(denominator)), key=sp.count_ops)
