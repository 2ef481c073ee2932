"""Delay between command and motor, in whole samples."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Arrays, Vector
from wmr_input.fields import Positive, Table


class InputDelayTable(Table):
    """Commands reach the motors late, by whole samples."""

    seconds: Positive


class InputDelay:
    """What was commanded `samples` samples ago reaches the motors now; before the first command they get 0 V.

    Raises: WmrError, where the number is not positive.
    """

    def __init__(self, inputs: int, samples: int) -> None:
        if samples < 1:
            raise WmrError(f"a delay of {samples} samples", "choose at least one sample")
        self.inputs, self.samples = inputs, samples

    @property
    def states(self) -> dict[str, Vector]:
        return {"under_way": np.zeros(self.inputs * self.samples)}  # the latest command first

    def arriving(self, z: SimpleNamespace) -> Array:
        """What reaches the motors now."""
        return z.under_way[self.inputs * (self.samples - 1) :]

    def update(self, u: Array, z: SimpleNamespace, arrays: Arrays) -> dict[str, Array]:
        """The commands under way one sample later."""
        return {"under_way": arrays.join([u, z.under_way[: self.inputs * (self.samples - 1)]])}
