"""White noise on the measured state."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault
from wmr_afl.numerics.vectors import by_name, per_entry, told
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import Named


class MeasurementNoiseTable(UncertaintyTable):
    """White noise on the measured state, standard deviation in the units of the state."""

    key: ClassVar[str] = "deviation"

    deviation: Named
    seed: Annotated[int, Field(ge=0)] = 0

    def build(self, surroundings: Surroundings) -> MeasurementNoise:
        states = list(surroundings.model.state_units)
        return MeasurementNoise(len(states), by_name("state", self.deviation, states, missing=0.0), self.seed)


class MeasurementNoise(Uncertainty):
    """x + standard deviation * normal samples; the deviation [state units] for all entries or for each.

    Raises:
        WmrError: if a deviation is negative.
    """

    name = "measurement_noise"

    def __init__(self, states: int, deviation: ArrayLike, seed: int = 0) -> None:
        self.deviation, self.samples, self.seed = per_entry("noise deviation", deviation, states), states, seed
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"deviation": self.deviation}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            np.any(k.deviation < 0, axis=-1),
            lambda k: (f"the noise deviation is {told(k.deviation)}", "choose zero or more"),
        )

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        return {"deviation": model.state_units}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        return x + k.deviation * sample


def normal_samples(generator: np.random.Generator, count: int, size: int) -> Floats:
    """The next standard normal samples, (count, size); taken in parts they are the same."""
    return generator.standard_normal((count, size))
