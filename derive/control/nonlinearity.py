"""The proof that dynamics are not linear in any base parameters.

v' = sum_k f_k(x) theta_k(p) has, in the state x, the poles of the f_k, wherever p is. So where v' has a denominator
whose zeros in x move with uncertain parameters, no such sum exists, however long. Two exact findings show it:
- the denominator is no product f(x) g(p), for then d(x1, p1) d(x2, p2) = d(x1, p2) d(x2, p1) would hold everywhere;
- it does not cancel, for then the values of v' at k states and k parameter sets had the rank of a short sum, not k.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix
from sympy.polys.matrices import DomainMatrix

from ..algebra.finite_field import FIELD, Element, NotRepresentable, Point
from ..algebra.named_terms import Terms, sorted_symbols
from ..algebra.separation import Parameters

_ENOUGH = 20  # states and parameter sets


@dataclass(frozen=True)
class Obstacle:
    """Why there is no forward form."""

    factor: Expr  # the factor that mixes state and uncertain parameters
    is_mixed: bool  # it is no product of a function of the state and one of the parameters
    rank: int  # of the values of v' at `samples` states and as many parameter sets
    samples: int

    @property
    def is_proof(self) -> bool:
        return self.is_mixed and self.rank == self.samples


def obstacle(factor: Expr, function: Matrix, parameters: Parameters, terms: Terms) -> Obstacle:
    """What `factor`, met in taking `function` apart, means for its linearity in base parameters."""
    values = _Values(parameters, terms)
    corner = [values(factor, state, choice) for state in (0, 1) for choice in (0, 1)]
    row = max(function, key=lambda entry: (len(terms.atoms(entry)), sp.count_ops(entry)))
    table = [[values(row, state, choice) for choice in range(_ENOUGH)] for state in range(_ENOUGH)]
    rank = DomainMatrix(table, (_ENOUGH, _ENOUGH), FIELD).rank()
    return Obstacle(factor, corner[0] * corner[3] != corner[1] * corner[2], rank, _ENOUGH)


class _Values:
    """Exact values at numbered states and numbered sets of uncertain parameters; known constants stay."""

    def __init__(self, parameters: Parameters, terms: Terms) -> None:
        self.parameters, self.terms = parameters, terms

    def __call__(self, expression: Expr, state: int, choice: int) -> Element:
        for attempt in range(50):  # some points lack a square root
            known, uncertain = Point(-1), Point(-2 - choice - _ENOUGH * attempt)
            values = {c: known(c) for c in sorted_symbols(self.parameters.known)}
            values |= {p: uncertain(p) for p in sorted_symbols(self.parameters.uncertain)}
            try:
                return Point(state, self.terms.definitions, values)(expression)
            except NotRepresentable:
                continue
        raise NotRepresentable(expression)
