"""White noise on the measured state."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.numerics.vectors import per_entry
from wmr_input.fields import Named, Table


class MeasurementNoiseTable(Table):
    """White noise on the measured state, standard deviation in the units of the state."""

    deviation: Named
    seed: Annotated[int, Field(ge=0)] = 0


class MeasurementNoise:
    """x + standard deviation * normal samples; the deviation [state units] for all entries or for each."""

    def __init__(self, states: int, deviation: ArrayLike, seed: int = 0) -> None:
        self.deviation, self.seed = per_entry("noise deviation", deviation, states), seed
        if np.any(self.deviation < 0):
            raise WmrError(f"the noise deviation is {self.deviation}", "choose zero or more")

    @property
    def values(self) -> dict[str, Vector]:
        return {"noise_deviation": self.deviation}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace) -> Array:
        """The state that the controller sees."""
        return x + k.noise_deviation * sample


def normal_samples(generator: np.random.Generator, count: int, size: int) -> Vector:
    """The next standard normal samples, (count, size); taken in parts they are the same."""
    return generator.standard_normal((count, size))
