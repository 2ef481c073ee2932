"""Groups of rows and base parameters that share an uncertain motor factor: what is estimated apart from the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.covariance import Rows, from_upper_half, upper_half


@dataclass(frozen=True)
class Group:
    """Rows of R u = Y pi, and the base parameters that act in these rows only."""

    rows: tuple[int, ...]
    parameters: tuple[int, ...]


def groups_of(model: Model) -> tuple[Group, ...]:
    """The groups of a model."""
    names = list(model.units_of("passivity_parameters"))
    return tuple(
        Group(tuple(group["rows"]), tuple(names.index(name) for name in group["parameters"]))
        for group in model.metadata["passivity_groups"]
    )


class RowsOfGroups:
    """Vectors of what is not zero: in every row the entries of its group, and of symmetric blocks the upper halves."""

    def __init__(self, groups: Sequence[Group]) -> None:
        self.groups = tuple(groups)
        self.rows = sum(len(group.rows) for group in groups)
        self.entries = sum(len(group.rows) * len(group.parameters) for group in groups)
        self._order = [index for group in groups for index in group.parameters]

    def picked(self, matrix: Array, arrays: Arrays) -> Array:
        """The entries of a matrix (n-m, n_pi) that may differ from zero."""
        return arrays.vector([matrix[i, j] for group in self.groups for i in group.rows for j in group.parameters])

    def rows_of(self, entries: Array) -> Iterator[tuple[Group, Rows]]:
        """Each group with its rows out of such a vector."""
        start = 0
        for group in self.groups:
            width = len(group.parameters)
            rows = [[entries[start + width * n + j] for j in range(width)] for n in range(len(group.rows))]
            start += width * len(group.rows)
            yield group, rows

    def blocks_of(self, packed: Array) -> Iterator[tuple[Group, Rows]]:
        """Each group with its symmetric block, whose upper halves stand in a vector."""
        start = 0
        for group in self.groups:
            size = len(group.parameters)
            yield group, from_upper_half(packed, size, start)
            start += size * (size + 1) // 2

    def packed(self, blocks: Sequence[Rows], arrays: Arrays) -> Array:
        """The upper halves of symmetric blocks, one after the other."""
        return arrays.vector([entry for P in blocks for entry in upper_half(P)])

    def packed_diagonals(self, diagonal: Floats) -> Floats:
        """Blocks that are diagonal, packed; `diagonal` (..., n_pi) by parameter."""
        entries = [
            diagonal[..., group.parameters[i]] if i == j else 0.0 * diagonal[..., 0]
            for group in self.groups
            for i in range(len(group.parameters))
            for j in range(i, len(group.parameters))
        ]
        return np.stack(entries, axis=-1)

    def in_order(self, by_group: Sequence[Array], arrays: Arrays) -> Array:
        """Numbers of the parameters, group after group, in the order of the parameters."""
        return arrays.vector([by_group[self._order.index(index)] for index in range(len(self._order))])


def inner(a: Sequence[Array], b: Sequence[Array]) -> Array:
    """The sum of products, term by term in a fixed order."""
    total = a[0] * b[0]
    for one, other in zip(a[1:], b[1:], strict=True):
        total = total + one * other
    return total
