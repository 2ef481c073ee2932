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

from ..algebra.finite_field import FIELD, NotRepresentable
from ..algebra.named_terms import Terms
from ..algebra.separation import MixedValues, Parameters

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
    row = max(function, key=lambda entry: (len(terms.atoms(entry)), sp.count_ops(entry)))
    try:
        corner = MixedValues(factor, parameters, terms).table(2)
        table = MixedValues(row, parameters, terms).table(_ENOUGH)
    except NotRepresentable:  # roots of states and parameters together: nothing is shown
        return Obstacle(factor, False, 0, _ENOUGH)
    rank = DomainMatrix(table, (_ENOUGH, _ENOUGH), FIELD).rank()
    is_mixed = corner[0][0] * corner[1][1] != corner[0][1] * corner[1][0]
    return Obstacle(factor, is_mixed, rank, _ENOUGH)
