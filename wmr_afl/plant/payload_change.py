"""A payload that is picked up or set down: physical parameters that jump at a time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.errors import ShapeError, WmrError
from wmr_afl.model.model import Model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.rules import Rules
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import NotNegative, Number


class PayloadTable(UncertaintyTable):
    """Physical parameters of the plant that change at a time [s]."""

    key: ClassVar[str] = "parameters"

    time: NotNegative
    parameters: Annotated[dict[str, Number], Field(min_length=1)]

    def build(self, surroundings: Surroundings) -> PayloadChange:
        model = surroundings.model
        for name in self.parameters:
            if name in model.known_units:
                problem = f"{name} is a known constant, not part of the payload"
                raise WmrError(problem, "change uncertain parameters")
        loaded = model.replaced(surroundings.parameters, self.parameters)
        check_robots(model, {}, loaded)
        return PayloadChange(model, self.time, loaded)

    def rules(self, model: Model) -> Rules:
        return {"parameters": lambda n: model.replaced(n["p"], self.parameters)}


class PayloadChange(Uncertainty):
    """The plant's parameters are `loaded` (n_p,) from `time` [s] on.

    Raises:
        ShapeError: if they do not fit.
    """

    name = "payload"

    def __init__(self, model: Model, time: float, loaded: ArrayLike) -> None:
        self.time, self.loaded = np.array([float(time)]), np.asarray(loaded, dtype=float)
        if self.loaded.shape != (len(model.parameter_units),):
            raise ShapeError(f"parameters have shape {self.loaded.shape}", f"expected ({len(model.parameter_units)},)")

    @property
    def values(self) -> dict[str, Floats]:
        return {"time": self.time, "parameters": self.loaded}

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        return {"time": {"": "s"}, "parameters": model.parameter_units}

    def parameters(self, t: Array, p: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        return arrays.where(t >= k.time[0], k.parameters, p)
