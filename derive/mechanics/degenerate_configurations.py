"""Degenerate configurations: where the rank of the constraint matrix drops, so that the robot can move in more ways.

The rank drops where all minors of A vanish together. Rows with a coefficient that cannot vanish keep their rank
everywhere; they are eliminated first, and what remains is small: the rows of the wheels that steer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import sorted_symbols
from ..algebra.trigonometry import factored, shortest
from ..description.robot import Robot
from .constraints import Constraints, stacked

_MOST_MINORS = 60


Conditions = tuple[Expr, ...]  # expressions that vanish together


def degenerate_configurations(robot: Robot, constraints: Constraints) -> tuple[Conditions, ...] | None:
    """The sets of conditions under which the rank of A drops; None where they are too many to be examined."""
    rates = [robot.rate(q) for q in robot.coordinates]
    matrix = _without_certain_rows(_in_root_axes(stacked(constraints.basis, rates), robot), robot)
    if matrix.rows == 0:
        return ()
    if sp.binomial(matrix.cols, matrix.rows) > _MOST_MINORS:
        return None
    columns = combinations(range(matrix.cols), matrix.rows)
    minors = [matrix.extract(list(range(matrix.rows)), list(chosen)).det(method="berkowitz") for chosen in columns]
    sets = {frozenset(conditions) for conditions in _common_zeros(minors, frozenset(robot.coordinates))}
    smallest = [one for one in sets if not any(other < one for other in sets)]
    return tuple(sorted((tuple(sorted(one, key=sp.default_sort_key)) for one in smallest), key=str))


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


def _common_zeros(expressions: Sequence[Expr], coordinates: frozenset[Symbol]) -> Iterator[Conditions]:
    """Sets of factors whose vanishing makes all `expressions` vanish: one factor of the shortest, then of the rest."""

    def coupling(product: Expr) -> tuple[int, int, str]:
        """Products whose factors speak of one coordinate each come first."""
        most = max(len(factor.free_symbols & coordinates) for factor in sp.Mul.make_args(product))
        return most, int(sp.count_ops(product)), str(product)

    products = sorted({factored(e) for e in expressions} - {sp.S.Zero}, key=coupling)
    if any(e.free_symbols.isdisjoint(coordinates) for e in products):
        return
    if not products:
        yield ()
        return
    first, *rest = products
    for factor in sp.Mul.make_args(first):
        base = factor.as_base_exp()[0]
        if base.free_symbols.isdisjoint(coordinates):
            continue
        places = list(_zeros(base, coordinates))
        if not places:  # not solved for a coordinate: the others are named as they stand
            yield (base, *rest)
        for place in places:
            for others in _common_zeros([shortest(e.xreplace(place)) for e in rest], coordinates):
                yield (base, *others)


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
