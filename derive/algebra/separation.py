"""A function of state and parameters as a sum of products: state functions times parameter functions.

Named terms are taken apart once and only where they mix the two, and what is pure stays as it is written, so that the
number of products grows with the mixture and not with the length of the expressions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from .named_terms import Terms


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
        raise NotSeparable(expression)

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
        base = {m: p for m, p in self.products(power.base).items() if not self.terms.is_zero(p)}
        if len(base) != 1 or next(iter(base))[0] is not None:
            raise NotSeparable(power)
        (((_, state_function), parameter),) = base.items()
        return {(None, state_function**power.exp): parameter**power.exp}
