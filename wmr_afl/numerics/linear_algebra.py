"""Small dense systems without branches, for NumPy and CasADi alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from itertools import combinations

from wmr_afl.numerics.arrays import Array, Arrays

SINGULAR = 1e-9  # volume (no unit) of rows scaled to length one; below it an inverse is mostly rounding errors


def determinant(rows: list[list[Array]]) -> Array:
    """By expansion along the first row; meant for a handful of rows."""
    if len(rows) == 1:
        return rows[0][0]
    total = 0.0
    for j, entry in enumerate(rows[0]):
        minor = [row[:j] + row[j + 1 :] for row in rows[1:]]
        total = total + (-1) ** j * entry * determinant(minor)
    return total


def solve(matrix: Array, right: Array, arrays: Arrays) -> Array:
    """s with matrix s = right, by Cramer's rule: exact zeros stay zero and nothing branches, (k,)."""
    rows = entries(matrix)
    whole = determinant(rows)
    size = len(rows)
    replaced = [[[*row[:j], right[i], *row[j + 1 :]] for i, row in enumerate(rows)] for j in range(size)]
    return arrays.vector([determinant(numerator) / whole for numerator in replaced])


def solve_positive(matrix: Array, rights: Sequence[Array], arrays: Arrays) -> list[Array]:
    """s with matrix s = right for each of `rights`, (k,) each, of a symmetric positive definite matrix (k, k).

    By elimination in the order of the rows, which such a matrix allows: k^3 operations where Cramer's rule takes k!.
    """
    rows, size = entries(matrix), matrix.shape[0]
    columns = [[right[i] for i in range(size)] for right in rights]
    for j in range(size):
        for i in range(j + 1, size):
            factor = rows[i][j] / rows[j][j]
            rows[i] = [
                *rows[i][: j + 1],
                *(a - factor * b for a, b in zip(rows[i][j + 1 :], rows[j][j + 1 :], strict=True)),
            ]
            for column in columns:
                column[i] = column[i] - factor * column[j]
    for column in columns:
        for j in reversed(range(size)):
            for i in range(j + 1, size):
                column[j] = column[j] - rows[j][i] * column[i]
            column[j] = column[j] / rows[j][j]
    return [arrays.vector(column) for column in columns]


def least_norm(matrix: Array, right: Array, weights: Array, arrays: Arrays) -> Array:
    """The s with matrix s = right that makes sum weights s^2 least: the weighted right inverse, (n_u,)."""
    scaled = entries(matrix)
    columns = len(scaled[0])
    if columns == len(scaled):
        return solve(matrix, right, arrays)
    gram = [[_sum(a[j] * b[j] / weights[j] for j in range(columns)) for b in scaled] for a in scaled]
    whole = determinant(gram)
    size = len(gram)
    multipliers = [
        determinant([[*row[:j], right[i], *row[j + 1 :]] for i, row in enumerate(gram)]) / whole for j in range(size)
    ]
    return arrays.vector(
        [_sum(scaled[i][j] * multipliers[i] for i in range(size)) / weights[j] for j in range(columns)]
    )


def regularity(matrix: Array, arrays: Arrays) -> Array:
    """Positive if a matrix has a meaningful inverse; zero, negative or NaN if not.

    The square of the rows' volume less that of SINGULAR times the product of their lengths: no unit and no scale of a
    row matters to the sign, and nothing is divided. For more columns than rows the largest of the square minors counts.
    """
    rows = entries(matrix)
    lengths: Array = SINGULAR * SINGULAR
    for row in rows:
        lengths = lengths * _sum(entry * entry for entry in row)
    minors = [determinant([[row[j] for j in chosen] for row in rows]) for chosen in _choices(rows)]
    return reduce(arrays.maximum, [minor * minor for minor in minors]) - lengths


def sum_of_squares(matrix: Array) -> Array:
    """The square of Frobenius' norm."""
    return _sum(entry * entry for row in entries(matrix) for entry in row)


def entries(matrix: Array) -> list[list[Array]]:
    """The entries of a matrix by row."""
    return [[matrix[i, j] for j in range(matrix.shape[1])] for i in range(matrix.shape[0])]


def _choices(rows: list[list[Array]]) -> Iterable[tuple[int, ...]]:
    return combinations(range(len(rows[0])), len(rows))


def _sum(values: object) -> Array:
    total = None
    for value in values:  # type: ignore[attr-defined]
        total = value if total is None else total + value
    return total
