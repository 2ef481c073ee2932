"""The distribution spanned by the columns of S and its growth under Lie brackets, at a generic configuration.

Brackets are not expanded symbolically: nested ones are evaluated exactly with dual numbers over a finite field at a
random configuration, [g, X] = DX g - Dg X, which costs the same whatever the expressions look like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sympy import Matrix
from sympy.polys.matrices import DomainMatrix

from ..algebra.dual_numbers import Dual
from ..algebra.finite_field import FIELD, TRIED_POINTS, Element, Point, usable
from .kinematics import Kinematics

Vector = list[Element]


Word = tuple[int, ...]  # (i, j, k): the bracket [g_i, [g_j, g_k]]


@dataclass(frozen=True)
class Growth:
    """`dimensions[k]`: dimension spanned by brackets of up to k + 1 columns of S; the last one is the closure's."""

    coordinates: int
    dimensions: tuple[int, ...]
    closure: tuple[tuple[int, ...], ...]  # a basis of the closure at the generic point, over the finite field
    seed: int  # the generic point

    @property
    def degree_of_nonholonomy(self) -> int:
        """The length of brackets after which nothing new appears; 1 where the constraints are holonomic."""
        return len(self.dimensions)

    @property
    def integrable(self) -> int:
        """How many independent functions of the coordinates the constraints hold constant."""
        return self.coordinates - self.dimensions[-1]

    @property
    def controllable(self) -> bool:
        """Whether the kinematics q' = S v are small-time locally controllable (Lie algebra rank condition)."""
        return self.integrable == 0


def bracket_growth(kinematics: Kinematics) -> Growth:
    """The growth of the robot's distribution at a random configuration.

    Raises:
        NotRepresentable: If S has no value at any of the configurations tried.
    """
    return next(usable(lambda seed: _Brackets(kinematics, seed).growth(), 1, TRIED_POINTS))


class _Brackets:
    def __init__(self, kinematics: Kinematics, seed: int) -> None:
        self.kinematics, self.seed = kinematics, seed
        point = Point(seed, kinematics.terms.definitions)
        self.configuration: Vector = [point(q) for q in kinematics.q]

    def growth(self) -> Growth:
        count = len(self.kinematics.v)
        basis: list[Vector] = []
        new: list[Word] = []
        dimensions: list[int] = []
        candidates: list[Word] = [(j,) for j in range(count)]
        while True:
            new = []
            for word in candidates:
                vector = self.value(word, self.configuration)
                if self._rank([*basis, vector]) > len(basis):
                    basis.append(vector)
                    new.append(word)
                if len(basis) == len(self.configuration):
                    break
            if not new:
                break
            dimensions.append(len(basis))
            if len(basis) == len(self.configuration):
                break
            candidates = [(i, *word) for word in new for i in range(count)]
        closure = tuple(tuple(int(entry) for entry in vector) for vector in basis)
        return Growth(len(self.configuration), tuple(dimensions), closure, self.seed)

    def value(self, word: Word, q: Vector) -> Vector:
        """The bracket `word` at `q`."""
        first, *rest = word
        here = self.field(first, q)
        if not rest:
            return here
        along = self.value(tuple(rest), [Dual(a, b) for a, b in zip(q, here, strict=True)])
        inner = [_real(entry) for entry in along]
        moved = self.field(first, [Dual(a, b) for a, b in zip(q, inner, strict=True)])
        return [_tangent(a) - _tangent(b) for a, b in zip(along, moved, strict=True)]

    def field(self, column: int, q: Vector) -> Vector:
        values = dict(zip(self.kinematics.q, q, strict=True))
        point = Point(self.seed, self.kinematics.terms.definitions, values)
        return [point(entry) for entry in self.kinematics.kinematic_matrix[:, column]]

    def _rank(self, vectors: Sequence[Vector]) -> int:
        rows = [[FIELD(int(entry)) for entry in vector] for vector in vectors]
        return DomainMatrix(rows, (len(rows), len(self.configuration)), FIELD).rank()


def _real(entry: Element) -> Element:
    return entry.real if isinstance(entry, Dual) else entry


def _tangent(entry: Element) -> Element:
    return entry.tangent if isinstance(entry, Dual) else 0


def annihilates(row: Matrix, growth: Growth, kinematics: Kinematics) -> bool:
    """Whether a constraint's row is zero on the whole closure: then it belongs to the integrable part."""
    point = Point(growth.seed, kinematics.terms.definitions)
    values = [point(entry) for entry in row]
    return all(sum((a * b for a, b in zip(values, vector, strict=True)), FIELD(0)) == 0 for vector in growth.closure)
