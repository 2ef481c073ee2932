"""Estimates with their covariance, corrected one scalar equation at a time, and symmetric matrices by upper halves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import add

from wmr_afl.numerics.arrays import Array

Rows = list[list[Array]]  # of a matrix


def corrected(
    estimate: Sequence[Array], P: Rows, f: Mapping[int, Array], miss: Array, variance: Array
) -> tuple[list[Array], Rows]:
    """The estimate (k,) and P (k, k) after an equation f x = seen of this variance, which was missed by seen - f x.

        x += P f miss/(variance + f P f)        P -= P f f^T P/(variance + f P f)

    `f` by index: entries that it does not name are zero.
    """
    Pf = [reduce(add, (row[j] * weight for j, weight in f.items())) for row in P]
    total = variance + reduce(add, (weight * Pf[j] for j, weight in f.items()))
    share = miss / total
    moved = [entry + Pf[n] * share for n, entry in enumerate(estimate)]
    return moved, symmetric(len(Pf), lambda i, j: P[i][j] - Pf[i] * (Pf[j] / total))


def symmetric(size: int, entry: Callable[[int, int], Array]) -> Rows:
    """A symmetric matrix; each entry above the diagonal is computed once and stands below it, too."""
    rows: Rows = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i, size):
            rows[i][j] = rows[j][i] = entry(i, j)
    return rows


def upper_half(P: Rows) -> list[Array]:
    """The upper half of a symmetric matrix, row by row."""
    return [P[i][j] for i in range(len(P)) for j in range(i, len(P))]


def from_upper_half(entries: Array, size: int, start: int = 0) -> Rows:
    """The symmetric matrix whose upper half stands in a vector from `start` on."""
    ends = [start + i * size - i * (i - 1) // 2 - i for i in range(size)]
    return symmetric(size, lambda i, j: entries[ends[i] + j])
