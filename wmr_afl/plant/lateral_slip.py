"""Lateral slip of the wheels (96): the root frame moves sideways, which no pseudo-velocity says."""

from __future__ import annotations

from wmr_afl.errors import MissingTermError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays
from wmr_afl.numerics.formulas import TimeFunction
from wmr_input.fields import Table


class LateralSlipTable(Table):
    """rU(t) of (96) [m/s], an expression of time t."""

    speed: str


class LateralSlip:
    """q' = S v + rU(t) [-sin phi, cos phi, 0 ...]^T (96), rU [m/s] an expression of time.

    Raises: MissingTermError, where the root's pose is not made of coordinates; ExpressionError.
    """

    def __init__(self, model: Model, speed: str) -> None:
        root = next(iter(model.metadata["geometry"]["frames"].values()))
        names = list(model.state_units)[: model.coordinate_count]
        pose = [root[part] for part in ("x", "y", "heading")]
        if any(part not in names for part in pose):
            raise MissingTermError(
                f"model {model.name} cannot slip: its root's pose {', '.join(pose)} is not made of coordinates"
            )
        self.places = [names.index(part) for part in pose]
        self._speed = TimeFunction([speed])

    def rate(self, t: Array, x: Array, arrays: Arrays) -> Array:
        """What the slip adds to x', (2n-m,)."""
        east, north, heading = self.places
        speed = self._speed(t)[0][0]
        parts = {east: -speed * arrays.sin(x[heading]), north: speed * arrays.cos(x[heading])}
        return arrays.vector([parts.get(i, 0.0) for i in range(x.shape[0])])
