"""Limits that software puts on a command before it leaves for the drive: least and most, change, and direction."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault
from wmr_afl.numerics.vectors import per_entry, told
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import Numbers, Positive


class CommandLimitsTable(UncertaintyTable):
    """least <= u <= most, which change by `slew` at most"""

    key: ClassVar[str] = "most"

    most: Numbers
    least: Numbers | None = None  # -most unless given
    slew: Positive | None = None  # [V/s]
    keeps_direction: bool = False  # all motors are lessened alike

    def build(self, surroundings: Surroundings) -> CommandLimits:
        room = None if self.slew is None else self.slew * surroundings.sample_time
        return CommandLimits(len(surroundings.model.input_units), self.most, self.least, room, self.keeps_direction)


class CommandLimits(Uncertainty):
    """least <= u <= most [V], -most unless given; from sample to sample u changes by `room` [V] at most, first from 0.

    With `keeps_direction` all motors are lessened by the factor that the one farthest beyond needs; so are changes.

    Raises:
        WmrError: if least < 0 < most does not hold, or there is no room for a change.
    """

    name, is_of_drive, limits_inputs = "command_limits", True, True

    def __init__(
        self,
        inputs: int,
        most: ArrayLike,
        least: ArrayLike | None = None,
        room: float | None = None,
        keeps_direction: bool = False,
    ) -> None:
        self.most = per_entry("most", most, inputs)
        self.least = -self.most if least is None else per_entry("least", least, inputs)
        self.room = None if room is None else np.array([float(room)])
        self.keeps_direction = keeps_direction
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"most": self.most, "least": self.least} | ({} if self.room is None else {"room": self.room})

    @property
    def states(self) -> dict[str, Floats]:
        return {} if self.room is None else {"last": np.zeros(len(self.most))}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all((k.least < 0.0) & (k.most > 0.0), axis=-1),
            lambda k: (f"limits are {told(k.least)} to {told(k.most)}", "choose least < 0 < most"),
        )
        if self.room is not None:
            yield (
                ~np.all(k.room > 0.0, axis=-1),
                lambda k: (f"a command may change by {k.room[0]:g} V", "choose a positive slew"),
            )

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        return {"most": model.input_units, "least": model.input_units, "room": {"": "V"}}

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        within = self._within(u, k.least, k.most, arrays)
        if self.room is None:
            return within
        room, last = k.room[0] + 0.0 * k.most, self._within(z.last, k.least, k.most, arrays)
        return last + self._within(within - last, -room, room, arrays)

    def update(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> dict[str, Array]:
        return {} if self.room is None else {"last": self.applied(u, z, k, arrays)}

    def _within(self, u: Array, least: Array, most: Array, arrays: Arrays) -> Array:
        """u (n_u,) within bounds, entry by entry or all lessened alike."""
        if not self.keeps_direction:
            return arrays.minimum(arrays.maximum(u, least), most)
        beyond = 1.0
        for i in range(u.shape[0]):
            beyond = arrays.maximum(beyond, arrays.maximum(u[i] / most[i], u[i] / least[i]))
        return u / beyond
