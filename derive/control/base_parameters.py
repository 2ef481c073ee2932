"""Base parameters (29)-(32): the smallest theta(p) in which the dynamics are linear.

A map F(x, s; p) = F_0(x; p) + F_1(x; p) s is expanded into products of state functions and parameter functions, and
both families are reduced to independent ones over the known constants: first the parameter functions, so that theta
has no entry that follows from others, then the state functions, so that no two entries of theta act alike.
What remains is minimal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.finite_field import NotRepresentable, Point
from ..algebra.linear_dependence import NotCombined, dependence, fraction_of
from ..algebra.named_terms import Terms
from ..algebra.separation import NotSeparable, Parameters, Separation


@dataclass(frozen=True)
class LinearMap:
    """F(x, s; p) = (drift(x) + sum_j slopes[j](x) s_j) base_parameters(p)."""

    base_parameters: tuple[Expr, ...]
    drift: Matrix  # (rows of F, n_theta)
    slopes: tuple[Matrix, ...]  # one for each s_j

    def regressor(self, slope_symbols: Sequence[Symbol]) -> Matrix:
        """Y with F = Y base_parameters."""
        slopes = (s * slope for s, slope in zip(slope_symbols, self.slopes, strict=True))
        return sum(slopes, self.drift)


def linear_map(
    function: Matrix,
    slope_symbols: Sequence[Symbol],
    parameters: Parameters,
    terms: Terms,
    value: Callable[[Expr], float],
) -> LinearMap:
    """The minimal linear parametrization of `function`, affine in `slope_symbols`.

    `value` gives a parameter function at the default parameters: signs are chosen so that base parameters are positive.
    Raises:
        NotSeparable: If a factor of a term contains both state and uncertain parameters, or what follows from other
            terms could not be told.
    """
    separation = Separation(slope_symbols, parameters, terms)
    rows = [separation.products(entry) for entry in function]
    products = [
        _simple_first({f: p for (s, f), p in row.items() if s == slope and not terms.is_zero(p)})
        for slope in (None, *slope_symbols)
        for row in rows
    ]
    try:
        theta, columns = _independent_parameters(products, parameters, terms)
        theta, columns = _independent_columns(theta, columns, parameters, terms, value)
    except NotCombined as error:
        raise NotSeparable(error.function) from None
    theta = [_number_or(parameter, terms) for parameter in theta]
    signs = [-1 if value(parameter) < 0 else 1 for parameter in theta]
    regressor = sp.zeros(len(products), len(theta))
    for k, column in enumerate(columns):
        regressor[:, k] = signs[k] * column
    size = function.rows
    blocks = [regressor[i * size : (i + 1) * size, :] for i in range(len(slope_symbols) + 1)]
    return LinearMap(
        tuple(sign * parameter for sign, parameter in zip(signs, theta, strict=True)), blocks[0], tuple(blocks[1:])
    )


Product = tuple[Expr, Expr]  # (state function, parameter function)


def _independent_parameters(
    products: list[list[Product]], parameters: Parameters, terms: Terms
) -> tuple[list[Expr], list[Matrix]]:
    """Parameter functions none of which follows from others, and the column of state functions of each."""
    functions = list(dict.fromkeys(parameter for row in products for _, parameter in row))
    if not functions:
        return [], []
    found = dependence([[function] for function in functions], parameters.known, terms)
    columns = {i: sp.zeros(len(products), 1) for i in found.independent}
    for r, row in enumerate(products):
        for state_function, parameter in row:
            j = functions.index(parameter)
            for i, factor in found.combination.get(j, {j: sp.S.One}).items():
                columns[i][r] += factor * state_function
    return [functions[i] for i in columns], list(columns.values())


def _independent_columns(
    theta: list[Expr], columns: list[Matrix], parameters: Parameters, terms: Terms, value: Callable[[Expr], float]
) -> tuple[list[Expr], list[Matrix]]:
    """Without columns that are combinations of others: their parameters join those of the others.

    Where there is a choice, they join without division, for a length may be zero, and as sums rather than differences.
    """
    if not theta:
        return [], []

    def cost(coefficient: Expr) -> int:
        divides = not sp.fraction(sp.together(coefficient))[1].is_number
        return 100 * divides + (value(coefficient) < 0)

    found = dependence([list(column) for column in columns], parameters.known, terms).exchanged(cost)
    kept = {i: theta[i] for i in found.independent}
    for j, combination in found.combination.items():
        for i, factor in combination.items():
            kept[i] += factor * theta[j]
    return list(kept.values()), [columns[i] for i in kept]


def _number_or(parameter: Expr, terms: Terms) -> Expr:
    """A parameter function, or the number that it is: (a m + b m)/(a + b)/m is 1."""
    if not parameter.free_symbols:
        return parameter
    try:
        first, second = (fraction_of(int(Point(seed, terms.definitions)(parameter))) for seed in (0, 1))
    except NotRepresentable:
        return parameter
    return first if first is not None and first == second and terms.is_zero(parameter - first) else parameter


def _simple_first(products: dict[Expr, Expr]) -> list[Product]:
    """In an order in which short state functions come before long ones."""
    return sorted(products.items(), key=lambda product: (sp.count_ops(product[0]), sp.default_sort_key(product[0])))
