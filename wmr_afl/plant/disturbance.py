"""Disturbing forces and torques over time (95)."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Annotated, Literal

from wmr_afl.errors import UnknownNameError
from wmr_afl.model.model import Language, Model
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.numerics.formulas import TimeFunction
from wmr_afl.plant.loads import Place
from wmr_input.fields import Table, either


class DisturbanceTable(Table):
    """Expressions of time t: one for all channels, or by the name of a pseudo-velocity or of a motor's input."""

    expression: Annotated[str | dict[str, str], either("an expression, or a table channel = expression")]
    on: Literal["pseudo_velocities", "wheels"]


class Disturbance:
    """tau_d(t), an expression of time for every channel, or one for all; channels that are not named are free of it.

    Raises: UnknownNameError, where there is no such channel; ExpressionError, where an expression is wrong.
    """

    def __init__(self, model: Model, expressions: str | Mapping[str, str], on: str = "pseudo_velocities") -> None:
        self.place = Place(model, on)
        channels = self.place.channels
        told = dict.fromkeys(channels, expressions) if isinstance(expressions, str) else dict(expressions)
        for name in told:
            if name not in channels:
                raise UnknownNameError("channel", name, channels)
        self._of_time = TimeFunction([told.get(name, "0") for name in channels])

    @property
    def values(self) -> dict[str, Vector]:
        return {}

    def force(self, t: Array, q: Array, v: Array, p: Array, k: SimpleNamespace, language: Language) -> Array:
        """taubar_d (n-m,)."""
        return self.place.on_v(self._of_time(t)[0], q, p, language)
