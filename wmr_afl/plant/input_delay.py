"""Delay between command and motor, in whole samples."""

from __future__ import annotations

from types import SimpleNamespace
from typing import ClassVar

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import Positive

MOST_LATE = 1_000_000  # samples; each command under way is a state of the loop


class InputDelayTable(UncertaintyTable):
    """Commands reach the motors late, by whole samples."""

    key: ClassVar[str] = "seconds"

    seconds: Positive

    def build(self, surroundings: Surroundings) -> InputDelay:
        step = surroundings.sample_time
        if self.seconds / step > MOST_LATE:
            problem = f"{self.seconds:g} s are more than {MOST_LATE} samples of {step:g} s"
            raise WmrError(problem, "choose a shorter delay")
        samples = round(self.seconds / step)
        if samples < 1 or abs(samples * step - self.seconds) > 1e-9 * self.seconds:
            raise WmrError(f"{self.seconds:g} s are no whole number of samples of {step:g} s", "choose a multiple")
        return InputDelay(len(surroundings.model.input_units), samples)


class InputDelay(Uncertainty):
    """What was commanded `samples_late` samples ago reaches the motors now; before the first command they get 0 V.

    Raises:
        WmrError: if the number is not positive.
    """

    name, is_of_drive = "input_delay", True

    def __init__(self, inputs: int, samples_late: int) -> None:
        if samples_late < 1:
            raise WmrError(f"a delay of {samples_late} samples", "choose at least one sample")
        self.inputs, self.samples_late = inputs, samples_late

    @property
    def states(self) -> dict[str, Floats]:
        return {"under_way": np.zeros(self.inputs * self.samples_late)}  # the latest command first

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        return z.under_way[self.inputs * (self.samples_late - 1) :]

    def update(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> dict[str, Array]:
        return {"under_way": arrays.join([u, z.under_way[: self.inputs * (self.samples_late - 1)]])}
