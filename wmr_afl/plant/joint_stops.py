"""Stops of joints: a joint whose angle has limits turns no further, and stays until it is turned back."""

from __future__ import annotations

from types import SimpleNamespace

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array
from wmr_afl.plant.uncertainty import Resistance, Uncertainty


class JointStops(Uncertainty):
    """Every joint stays within the `limits` of the description; it hits a stop without bouncing.

    A stop pushes a joint away as hard as needed and never pulls.
    """

    name = "joint_stops"

    def resistance(self, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Resistance:
        q = x[: model.coordinate_count]
        matrix = model.joint_stops_matrix(q, p)
        count = matrix.shape[0]
        return Resistance(matrix, [None] * count, [0.0] * count, model.joint_stops(q, p))
