"""White noise on the measured state."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.arrays import Array
from wmr_afl.controllers.outer_loop import per_entry
from wmr_afl.errors import WmrError
from wmr_afl.model import Vector


class MeasurementNoise:
    """x + standard deviation * normal samples; the deviation [state units] for all entries or for each."""

    def __init__(self, states: int, deviation: ArrayLike, seed: int = 0) -> None:
        self.deviation, self.seed = per_entry("noise deviation", deviation, states), seed
        if np.any(self.deviation < 0):
            raise WmrError(f"the noise deviation is {self.deviation}; choose zero or more")

    @property
    def values(self) -> dict[str, Vector]:
        return {"noise_deviation": self.deviation}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace) -> Array:
        """The state that the controller sees."""
        return x + k.noise_deviation * sample


def normal_samples(generator: np.random.Generator, count: int, size: int) -> Vector:
    """The next standard normal samples, (count, size); taken in parts they are the same."""
    return generator.standard_normal((count, size))
