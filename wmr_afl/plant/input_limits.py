"""Saturation of the motor voltages."""

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
from wmr_input.fields import Numbers


class InputLimitsTable(UncertaintyTable):
    """|u| <= volts"""

    key: ClassVar[str] = "volts"

    volts: Numbers

    def build(self, surroundings: Surroundings) -> InputLimits:
        return InputLimits(len(surroundings.model.input_units), self.volts)


class InputLimits(Uncertainty):
    """|u| <= volts [V], one limit for all motors or one for each.

    Raises:
        WmrError: if a limit is not positive.
    """

    name, is_of_drive, limits_inputs = "input_limits", True, True

    def __init__(self, inputs: int, volts: ArrayLike) -> None:
        self.volts = per_entry("input limit", volts, inputs)
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"volts": self.volts}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            np.any(k.volts <= 0, axis=-1),
            lambda k: (f"the input limit is {told(k.volts)}", "choose a positive voltage"),
        )

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        return {"volts": model.input_units}

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        return arrays.minimum(arrays.maximum(u, -k.volts), k.volts)
