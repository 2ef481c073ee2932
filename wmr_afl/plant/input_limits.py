"""Saturation of the motor voltages."""

from __future__ import annotations

from types import SimpleNamespace

from numpy.typing import ArrayLike

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Arrays, Vector
from wmr_afl.numerics.vectors import per_entry
from wmr_input.fields import Numbers, Table


class InputLimitsTable(Table):
    """|u| <= volts"""

    volts: Numbers


class InputLimits:
    """|u| <= limit [V], one limit for all motors or one for each."""

    def __init__(self, inputs: int, limit: ArrayLike) -> None:
        self.limit = per_entry("input limit", limit, inputs)
        if (self.limit <= 0).any():
            raise WmrError(f"the input limit is {self.limit}", "choose a positive voltage")

    @property
    def values(self) -> dict[str, Vector]:
        return {"input_limit": self.limit}

    def applied(self, u: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The voltages that reach the motors."""
        return arrays.minimum(arrays.maximum(u, -k.input_limit), k.input_limit)
