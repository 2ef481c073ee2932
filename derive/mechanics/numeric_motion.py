"""S in numbers, with the default parameters: where a choice of pseudo-velocities blows up.

S solves [A; N] S = [0; I]. All rows of A take part, those that follow from others almost everywhere too, so that S is
found wherever it is defined, and near a configuration where A loses rank it is looked at from a small distance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy import Symbol

from ..description.robot import Robot
from .constraints import Constraints, stacked
from .velocities import Form

_NEAR = 1e-6  # rad or m, from a configuration that is looked at
_GRID = 120  # places around a joint
_STEEP = 40.0  # times the usual size: what S reaches within a step of the grid around a pole
_HUGE = 1e4  # times the usual size: what S reaches near a pole

Floats = NDArray[np.float64]


class Poles:
    """How often S blows up for combinations of `candidates`: at zero, along joints, at quarter turns."""

    def __init__(self, robot: Robot, constraints: Constraints, candidates: Mapping[Symbol, Form]) -> None:
        joints = [q for q in robot.coordinates if any(q in frame.angle.free_symbols for frame in robot.frames[1:])]
        count = len(robot.coordinates)
        ordinary = np.array([0.5 + 0.37 * ((5 * k) % 7) / 7 for k in range(count)])
        near = _NEAR * (1 + np.arange(count) / 7)
        columns = [robot.coordinates.index(q) for q in joints]

        def turned(column: int, angle: float) -> Floats:
            place = ordinary.copy()
            place[column] = angle
            return place

        angles = np.linspace(-np.pi, np.pi, _GRID, endpoint=False) + 0.011
        self._along = [slice(1 + k * _GRID, 1 + (k + 1) * _GRID) for k in range(len(columns))]
        places = [near, *(turned(c, angle) for c in columns for angle in angles)]
        places += [turned(c, sign * np.pi / 2 + _NEAR) for c in columns for sign in (1, -1)]
        self._size, self._quarters = count, slice(1 + len(columns) * _GRID, len(places))
        forms = [*constraints.rows.values(), *candidates.values()]
        matrix = stacked(forms, [robot.rate(q) for q in robot.coordinates]).xreplace(robot.numbers)
        self._rows = matrix_values(matrix, robot.coordinates, np.array(places))
        self._fixed = list(range(len(constraints.rows)))
        self._places = {v: len(constraints.rows) + k for k, v in enumerate(candidates)}

    def __call__(self, chosen: Sequence[Symbol]) -> tuple[bool, int, int]:
        """Whether S blows up at zero, along how many joints it does, at how many quarter turns."""
        rows = self._rows[:, [*self._fixed, *(self._places[v] for v in chosen)]]
        finite: Any = np.isfinite(rows).all(axis=(1, 2))
        rows = np.where(finite[:, None, None], rows, 0.0)
        wanted = len(chosen)
        solution = np.linalg.pinv(rows, rcond=1e-13)[:, :, -wanted:] if wanted else np.zeros((len(rows), 1, 1))
        sizes = np.where(finite, np.abs(solution).max(axis=(1, 2)), np.inf)
        usual = max(float(np.median(sizes)), 1e-300)
        along = sum(float(sizes[one].max()) > _STEEP * usual for one in self._along)
        return bool(sizes[0] > _HUGE * usual), along, int((sizes[self._quarters] > _HUGE * usual).sum())


def matrix_values(matrix: sp.Matrix, coordinates: Sequence[Symbol], places: Floats) -> Floats:
    """The matrix at every place, (places, rows, columns)."""
    entries = sp.lambdify(list(coordinates), list(matrix), "numpy", cse=True)
    with np.errstate(all="ignore"):
        columns = np.broadcast_arrays(*entries(*places.T), places[:, 0])[:-1]
    return np.stack(columns, axis=-1).reshape(len(places), *matrix.shape).astype(float)
