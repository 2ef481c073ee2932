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

from derive.dependence import dependence
from derive.terms import Terms


@dataclass(frozen=True)
class Parameters:
    """The physical parameters: `known` constants, which a controller may use, and `uncertain` ones."""

    known: frozenset[Symbol]
    uncertain: frozenset[Symbol]

    @property
    def all(self) -> frozenset[Symbol]:
        return self.known | self.uncertain


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


class NotSeparable(Exception):
    """A factor mixes state and uncertain parameters: `factor`."""

    def __init__(self, factor: Expr) -> None:
        self.factor = factor
        super().__init__(str(factor))


def linear_map(
    function: Matrix,
    slope_symbols: Sequence[Symbol],
    parameters: Parameters,
    terms: Terms,
    value: Callable[[Expr], float],
) -> LinearMap:
    """The minimal linear parametrization of `function`, affine in `slope_symbols`.

    `value` gives a parameter function at the default parameters: signs are chosen so that base parameters are positive.
    Raises: NotSeparable, where a factor of a term contains both state and uncertain parameters.
    """
    expanded = [sp.expand(_unmixed(entry, parameters, terms)) for entry in function]
    without = dict.fromkeys(slope_symbols, sp.S.Zero)
    stacked = [entry.xreplace(without) for entry in expanded]
    stacked += [entry.coeff(s) for s in slope_symbols for entry in expanded]
    products = [_products(entry, parameters, terms) for entry in stacked]
    theta, columns = _independent_parameters(products, parameters, terms)
    theta, columns = _independent_columns(theta, columns, parameters, terms)
    signs = [-1 if value(parameter) < 0 else 1 for parameter in theta]
    regressor = sp.zeros(len(stacked), len(theta))
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
    theta: list[Expr], columns: list[Matrix], parameters: Parameters, terms: Terms
) -> tuple[list[Expr], list[Matrix]]:
    """Without columns that are combinations of others: their parameters join those of the others.

    Later columns are kept rather than earlier ones: masses further in then join those further out with positive sign.
    """
    if not theta:
        return [], []
    order = list(range(len(theta)))[::-1]
    found = dependence([list(columns[i]) for i in order], parameters.known, terms)
    kept = {order[k]: theta[order[k]] for k in found.independent}
    for j, combination in found.combination.items():
        for i, factor in combination.items():
            kept[order[i]] += factor * theta[order[j]]
    return [kept[i] for i in sorted(kept)], [columns[i] for i in sorted(kept)]


def _products(expression: Expr, parameters: Parameters, terms: Terms) -> list[Product]:
    """An expanded expression as a sum of products; factors of known constants stand with the state."""
    collected: dict[Expr, Expr] = {}
    for term in sp.Add.make_args(expression):
        state_function, parameter = sp.S.One, sp.S.One
        for factor in sp.Mul.make_args(term):
            atoms = terms.atoms(factor)
            if atoms.isdisjoint(parameters.uncertain) and not factor.is_Number:
                state_function *= factor
            elif atoms <= parameters.all:
                parameter *= factor
            else:
                raise NotSeparable(factor)
        collected[state_function] = collected.get(state_function, sp.S.Zero) + parameter
    simple_first = sorted(collected, key=lambda f: (sp.count_ops(f), sp.default_sort_key(f)))
    return [(f, collected[f]) for f in simple_first if not terms.is_zero(collected[f])]


def _unmixed(expression: Expr, parameters: Parameters, terms: Terms) -> Expr:
    """`expression` with those names resolved that stand for both state and uncertain parameters."""

    def is_mixed(symbol: Symbol) -> bool:
        atoms = terms.atoms(symbol)
        return not atoms.isdisjoint(parameters.uncertain) and not atoms <= parameters.all

    return terms.resolve(expression, is_mixed)
