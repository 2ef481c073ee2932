"""Solving [A; N] S = [0; I] along the tree: every rate as a form in the pseudo-velocities.

Equations are taken as soon as the frames they speak of are there, pivots that cannot vanish first. So a trailer's
joint rate is found from its own axle alone, and what its ancestors contribute is already short and named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import sympy as sp
from sympy import Expr, Symbol

from ..algebra.named_terms import Terms
from .velocities import Form


@dataclass
class Equation:
    """A form that must vanish, and where it comes from."""

    form: Form
    origin: str
    is_constraint: bool


class NotSolvable(Exception):
    """The pseudo-velocities do not describe the motion: `equation` contradicts or repeats the others."""

    def __init__(self, equation: Equation | None) -> None:
        self.equation = equation
        super().__init__(equation.origin if equation else "too few equations")


@dataclass
class Elimination:
    """Equations go in with `add`, unknown rates with `introduce`; `solution` tells what is known of a form."""

    terms: Terms
    given: frozenset[Symbol]  # the pseudo-velocities, in which everything is expressed in the end
    is_constant: Callable[[Expr], bool]
    solved: dict[Symbol, Form] = field(default_factory=dict)
    unsolved: list[Symbol] = field(default_factory=list)
    waiting: list[Equation] = field(default_factory=list)
    independent: list[str] = field(default_factory=list)  # origins of the constraints that count
    dependent: list[str] = field(default_factory=list)  # and of those that follow from others
    divisors: list[Expr] = field(default_factory=list)  # what was divided by and depends on the configuration

    def introduce(self, rates: Iterable[Symbol]) -> None:
        """Further unknown rates."""
        self.unsolved.extend(rates)

    def define(self, rate: Symbol, form: Form) -> None:
        """A rate that is a form in other rates."""
        self.solved[rate] = form.substitute(self.solved)

    def add(self, equations: Iterable[Equation]) -> None:
        self.waiting.extend(equations)

    def solution(self, form: Form) -> Form:
        """`form` in what is not solved yet."""
        return form.substitute(self.solved).map(self.terms.simplified).without_zeros(self.terms.is_zero)

    def named(self, name: str, form: Form) -> Form:
        """What is known of `form`; coefficients that are final and depend on the configuration get names."""
        solution = self.solution(form)
        if not solution.keys() <= self.given:
            return solution
        return solution.map_items(lambda v, c: c if self.is_constant(c) else self.terms.name(f"{name}_{v.name}", c))

    def reduce(self) -> None:
        """Solves as much as the waiting equations allow; those that contain rates not introduced yet wait on."""
        while True:
            ready = self._ready()
            pivot = self._constant_pivot(ready)
            if pivot is not None:
                self._solve([pivot[0]], [pivot[1]])
                continue
            involved = [rate for rate in self.unsolved if any(rate in equation.form for equation in ready)]
            block = self._regular_block(ready, involved)
            if not block:
                return
            self._solve(block, involved)

    def _ready(self) -> list[Equation]:
        ready = []
        for equation in list(self.waiting):
            equation.form = self.solution(equation.form)
            unsolved = equation.form.keys() - self.given
            if unsolved - set(self.unsolved):
                continue
            if unsolved:
                ready.append(equation)
                continue
            self.waiting.remove(equation)
            if equation.form or not equation.is_constraint:
                raise NotSolvable(equation)
            self.dependent.append(equation.origin)
        return ready

    def _constant_pivot(self, equations: list[Equation]) -> tuple[Equation, Symbol] | None:
        """An equation and a rate in it whose coefficient cannot vanish; plain numbers before parameters."""
        found = None
        for equation in equations:
            for rate in self.unsolved:
                coefficient = equation.form.get(rate)
                if coefficient is None or not self.is_constant(coefficient):
                    continue
                if coefficient.is_Number:
                    return equation, rate
                found = found or (equation, rate)
        return found

    def _regular_block(self, equations: list[Equation], rates: list[Symbol]) -> list[Equation]:
        """As many independent equations as there are rates, or none."""
        block: list[Equation] = []
        for equation in equations:
            rows = sp.Matrix.vstack(*(other.form.row(rates) for other in [*block, equation]))
            if self.terms.rank(rows) == len(block) + 1:
                block.append(equation)
        return block if rates and len(block) == len(rates) else []

    def _solve(self, equations: list[Equation], rates: list[Symbol]) -> None:
        matrix = sp.Matrix.vstack(*(equation.form.row(rates) for equation in equations)).applyfunc(self.terms.expand)
        rest = [Form({s: c for s, c in equation.form.items() if s not in rates}) for equation in equations]
        determinant = self.terms.simplified(matrix.det(method="berkowitz"))
        if not self.is_constant(determinant):
            self.divisors.append(determinant)
        inverse = (matrix.adjugate() / determinant).applyfunc(self.terms.simplified)
        for i, rate in enumerate(rates):
            form = Form()
            for j, other in enumerate(rest):
                form = form - inverse[i, j] * other
            self.solved[rate] = self.named(rate.name.replace(" ", "_"), form)
            self.unsolved.remove(rate)
        for rate, form in self.solved.items():
            if not form.keys().isdisjoint(rates):
                self.solved[rate] = self.named(rate.name.replace(" ", "_"), form)
        for equation in equations:
            self.waiting.remove(equation)
            if equation.is_constraint:
                self.independent.append(equation.origin)

    def finish(self) -> None:
        """Fail unless every rate is solved.

        Raises:
            NotSolvable: If a rate or an equation is left.
        """
        if self.unsolved or self.waiting:
            raise NotSolvable(self.waiting[0] if self.waiting else None)
