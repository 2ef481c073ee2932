"""Disturbing forces and torques over time (95)."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Annotated, ClassVar, Literal

from wmr_afl.errors import UnknownNameError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array
from wmr_afl.numerics.formulas import TimeFunction
from wmr_afl.plant.loads import Place
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import either


class DisturbanceTable(UncertaintyTable):
    """Expressions of time t: one for all channels, or by the name of a pseudo-velocity or of a motor's input."""

    key: ClassVar[str] = "expression"

    expression: Annotated[str | dict[str, str], either("an expression, or a table channel = expression")]
    on: Literal["pseudo_velocities", "wheels"]

    def build(self, surroundings: Surroundings) -> Disturbance:
        return Disturbance(surroundings.model, self.expression, self.on)


class Disturbance(Uncertainty):
    """tau_d(t), an expression of time for every channel, or one for all; channels that are not named are free of it.

    Raises:
        UnknownNameError: if there is no such channel.
        ExpressionError: if an expression is wrong.
    """

    name = "disturbance"

    def __init__(self, model: Model, expressions: str | Mapping[str, str], on: str = "pseudo_velocities") -> None:
        self.place = Place(model, on)
        channels = self.place.channels
        each = dict.fromkeys(channels, expressions) if isinstance(expressions, str) else dict(expressions)
        for name in each:
            if name not in channels:
                raise UnknownNameError("channel", name, channels)
        self._of_time = TimeFunction([each.get(name, "0") for name in channels])

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        return self.place.on_v(self._of_time(t)[0], x[: model.coordinate_count], p, model)
