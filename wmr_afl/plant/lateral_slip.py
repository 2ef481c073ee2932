"""Lateral slip of the wheels (96): the root frame moves sideways, which no pseudo-velocity describes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

from wmr_afl.errors import MissingTermError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array
from wmr_afl.numerics.formulas import TimeFunction
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable


class LateralSlipTable(UncertaintyTable):
    """rU(t) of (96) [m/s], an expression of time t."""

    key: ClassVar[str] = "speed"

    speed: str

    def build(self, surroundings: Surroundings) -> LateralSlip:
        return LateralSlip(surroundings.model, self.speed)


class LateralSlip(Uncertainty):
    """q' = S v + rU(t) [-sin phi, cos phi, 0 ...]^T (96), rU [m/s] an expression of time.

    Raises:
        MissingTermError: if the root's pose is not made of coordinates.
        ExpressionError: if the expression is wrong.
    """

    name = "lateral_slip"

    def __init__(self, model: Model, speed: str) -> None:
        root = next(iter(model.metadata["geometry"]["frames"].values()))
        names = list(model.state_units)[: model.coordinate_count]
        pose = [root[part] for part in ("x", "y", "heading")]
        if any(part not in names for part in pose):
            raise MissingTermError(
                f"model {model.name} cannot slip: its root's pose {', '.join(pose)} is not made of coordinates",
                "leave lateral_slip out",
            )
        self.places = [names.index(part) for part in pose]
        self._speed = TimeFunction([speed])

    def rate(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        east, north, heading = self.places
        speed, arrays = self._speed(t)[0][0], model.arrays
        parts = {east: -speed * arrays.sin(x[heading]), north: speed * arrays.cos(x[heading])}
        return arrays.vector([parts.get(i, 0.0) for i in range(x.shape[0])])
