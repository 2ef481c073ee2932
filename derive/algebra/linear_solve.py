"""Linear systems in named terms. A symbolic inverse, entry by entry, would cost thousands of operations."""

import sympy as sp
from sympy import Expr, Matrix

from .named_terms import Terms


def solve_positive_definite(matrix: Matrix, right: Matrix, names: list[str], terms: Terms) -> Matrix:
    """The solution of `matrix` s = `right` by L D L^T; s_i is named `<name>_dot`, D's entries `pivot_<name>`."""
    size = matrix.rows
    lower = sp.eye(size)
    pivots: list[Expr] = []
    for j in range(size):
        pivot = matrix[j, j] - sum((lower[j, k] ** 2 * pivots[k] for k in range(j)), sp.S.Zero)
        pivots.append(terms.name(f"pivot_{names[j]}", pivot))
        for i in range(j + 1, size):
            entry = matrix[i, j] - sum((lower[i, k] * lower[j, k] * pivots[k] for k in range(j)), sp.S.Zero)
            lower[i, j] = terms.name(f"ratio_{names[i]}_{names[j]}", entry / pivots[j])
    forward: list[Expr] = []
    for i in range(size):
        value = right[i] - sum((lower[i, k] * forward[k] for k in range(i)), sp.S.Zero)
        forward.append(terms.name(f"force_{names[i]}", value))
    solution = sp.zeros(size, 1)
    for i in reversed(range(size)):
        value = forward[i] / pivots[i] - sum((lower[k, i] * solution[k] for k in range(i + 1, size)), sp.S.Zero)
        solution[i] = terms.name(f"{names[i]}_dot", value)
    return solution


def adjugate_over_determinant(matrix: Matrix, terms: Terms, name: str) -> Matrix:
    """The inverse of a small matrix as its adjugate over a determinant that is named once."""
    determinant = terms.name(name, matrix.det(method="berkowitz"))
    return matrix.adjugate() / determinant
