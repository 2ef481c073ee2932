"""Degenerate configurations: where the rank of the constraint matrix drops, so that the robot can move in more ways.

The rank drops where all minors of A vanish together. Rows with a coefficient that cannot vanish keep their rank
everywhere; they are eliminated first, and what remains is small: the rows of the wheels that steer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.finite_field import vanishes
from ..algebra.named_terms import Terms, sorted_symbols
from ..algebra.trigonometry import factored, shortest
from ..description.robot import Robot
from .constraints import Constraints, stacked

_MOST_MINORS = 60


Conditions = tuple[Expr, ...]  # expressions that vanish together


def degenerate_configurations(robot: Robot, constraints: Constraints) -> tuple[Conditions, ...] | None:
    """The sets of conditions under which the rank of A drops; None where they are too many to be examined."""
    rates = [robot.rate(q) for q in robot.coordinates]
    everything = _in_root_axes(stacked(list(constraints.rows.values()), rates), robot)
    matrix = _without_certain_rows(everything.copy(), robot)
    rank = constraints.rank - (everything.rows - matrix.rows)
    if rank == 0:
        return ()
    try:
        sets = {frozenset(conditions) for conditions in _Drops(frozenset(robot.coordinates), rank).of(matrix)}
    except _TooMany:
        return None
    smallest = [one for one in sets if not any(other < one for other in sets)]
    return tuple(sorted((tuple(sorted(one, key=sp.default_sort_key)) for one in smallest), key=str))


class _TooMany(Exception):
    """More minors than are examined, or factors that are not solved for a coordinate."""


@dataclass(frozen=True)
class _Drops:
    """Where a matrix has less than the rank that it has almost everywhere."""

    coordinates: frozenset[Symbol]
    rank: int

    def of(self, matrix: Matrix) -> Iterator[Conditions]:
        """The sets of conditions.

        As many rows as the rank tell where to look; rows that follow from these almost everywhere may count there.

        Raises:
            _TooMany: If they cannot be examined.
        """
        rows = _independent_rows(matrix, self.rank)
        others = [i for i in range(matrix.rows) if i not in rows and not all(map(vanishes, matrix[i, :]))]
        for conditions, place in _common_zeros(self._minors(matrix, rows), self.coordinates):
            if place is None:  # not solved for a coordinate: the conditions are named as they stand
                if others:
                    raise _TooMany
                yield conditions
                continue
            there = matrix.applyfunc(lambda entry, place=place: shortest(entry.xreplace(place)))
            if there.has(sp.zoo, sp.nan):
                raise _TooMany
            if not others or Terms().rank(there) < self.rank:
                yield conditions
            else:
                yield from ((*conditions, *more) for more in self.of(there))

    def _minors(self, matrix: Matrix, rows: list[int]) -> list[Expr]:
        if sp.binomial(matrix.cols, self.rank) > _MOST_MINORS:
            raise _TooMany
        columns = combinations(range(matrix.cols), self.rank)
        return [matrix.extract(rows, list(chosen)).det(method="berkowitz") for chosen in columns]


def _independent_rows(matrix: Matrix, rank: int) -> list[int]:
    """The first rows that are independent almost everywhere."""
    rows: list[int] = []
    for i in range(matrix.rows):
        if len(rows) < rank and Terms().rank(matrix.extract([*rows, i], list(range(matrix.cols)))) > len(rows):
            rows.append(i)
    return rows


def _in_root_axes(matrix: Matrix, robot: Robot) -> Matrix:
    """The matrix with the root's heading at zero, where turning the axes of x and y changes no rank."""
    root = robot.frames[0]
    if root.angle in robot.coordinates and set(root.at) <= set(robot.coordinates):
        matrix = matrix.xreplace({root.angle: sp.S.Zero})
    return matrix.applyfunc(shortest)


def _without_certain_rows(matrix: Matrix, robot: Robot) -> Matrix:
    """What remains after pivots that depend on no coordinate."""
    while True:
        pivot = next(
            (
                (i, j)
                for j in reversed(range(matrix.cols))
                for i in range(matrix.rows)
                if matrix[i, j] != 0 and matrix[i, j].free_symbols.isdisjoint(robot.coordinates)
            ),
            None,
        )
        if pivot is None:
            return matrix
        i, j = pivot
        for other in range(matrix.rows):
            if other != i and matrix[other, j] != 0:
                matrix[other, :] = (matrix[other, :] - matrix[other, j] / matrix[i, j] * matrix[i, :]).applyfunc(
                    shortest
                )
        matrix.row_del(i)
        matrix.col_del(j)


def _common_zeros(
    expressions: Sequence[Expr], coordinates: frozenset[Symbol]
) -> Iterator[tuple[Conditions, dict[Symbol, Expr] | None]]:
    """Sets of factors whose vanishing makes all `expressions` vanish: one factor of the shortest, then of the rest.

    With each goes the place: the coordinates that the conditions give, or None if one is not solved for a coordinate.
    """

    def coupling(product: Expr) -> tuple[int, int, str]:
        """Products whose factors speak of one coordinate each come first."""
        most = max(len(factor.free_symbols & coordinates) for factor in sp.Mul.make_args(product))
        return most, int(sp.count_ops(product)), str(product)

    products = sorted({factored(e) for e in expressions} - {sp.S.Zero}, key=coupling)
    if any(e.free_symbols.isdisjoint(coordinates) for e in products):
        return
    if not products:
        yield (), {}
        return
    first, *rest = products
    for factor in sp.Mul.make_args(first):
        base = factor.as_base_exp()[0]
        if base.free_symbols.isdisjoint(coordinates):
            continue
        places = list(_zeros(base, coordinates))
        if not places:
            yield (base, *rest), None
        for place in places:
            for others, further in _common_zeros([shortest(e.xreplace(place)) for e in rest], coordinates):
                conditions = (base, *others)
                yield conditions, None if further is None else _together(place, further)


def _together(place: dict[Symbol, Expr], further: dict[Symbol, Expr]) -> dict[Symbol, Expr]:
    return {q: value.xreplace(further) for q, value in place.items()} | further


def _zeros(factor: Expr, coordinates: frozenset[Symbol]) -> Iterator[dict[Symbol, Expr]]:
    """Values of one coordinate at which the sine or cosine `factor` vanishes."""
    if not isinstance(factor, sp.sin | sp.cos):
        return
    angle = factor.args[0]
    turns = (0, sp.pi) if isinstance(factor, sp.sin) else (sp.pi / 2, -sp.pi / 2)
    for q in sorted_symbols(angle.free_symbols & coordinates):
        slope = sp.diff(angle, q)
        if slope in (1, -1):
            for turn in turns:
                yield {q: sp.expand(q + slope * (turn - angle))}
            return
    for q in sorted_symbols(angle.free_symbols & coordinates):
        slope = sp.diff(angle, q)
        rest = sp.expand(angle - slope * q)
        if slope.is_Rational and slope != 0:
            yield from ({q: value} for value in _within_a_turn(q, slope, rest, turns[0]))
            return
        if slope != 0 and slope.free_symbols.isdisjoint(coordinates):  # a ratio of parameters
            yield from ({q: sp.expand((turn - rest) / slope)} for turn in turns)
            return


def _within_a_turn(q: Symbol, slope: sp.Rational, rest: Expr, turn: Expr) -> Iterator[Expr]:
    """The values of `q` within one turn at which slope q + rest is `turn` or differs from it by half turns."""
    most = int(sp.ceiling(abs(slope))) + 1
    for k in range(-most, most + 1):
        value = sp.expand((turn + k * sp.pi - rest) / slope)
        about = sp.expand((turn + k * sp.pi) / slope)
        if -sp.pi < about <= sp.pi:
            yield value
