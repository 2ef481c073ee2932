"""A payload that is picked up or set down: physical parameters that jump at a time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.errors import ShapeError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Vector
from wmr_input.fields import NotNegative, Number, Table


class PayloadTable(Table):
    """Physical parameters of the plant that change at a time [s]."""

    time: NotNegative
    parameters: Annotated[dict[str, Number], Field(min_length=1)]


class PayloadChange:
    """The plant's parameters are `parameters` (n_p,) from `time` [s] on.

    Raises: ShapeError, where they do not fit.
    """

    def __init__(self, model: Model, time: float, parameters: ArrayLike) -> None:
        self.time, self.parameters = np.array([float(time)]), np.asarray(parameters, dtype=float)
        if self.parameters.shape != (len(model.parameter_units),):
            raise ShapeError(
                f"parameters have shape {self.parameters.shape}", f"expected ({len(model.parameter_units)},)"
            )

    @property
    def values(self) -> dict[str, Vector]:
        return {"payload_time": self.time, "payload_parameters": self.parameters}

    def now(self, t: Array, p: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The parameters at time t."""
        return arrays.where(t >= k.payload_time[0], k.payload_parameters, p)
