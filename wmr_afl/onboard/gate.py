"""A gate for outliers: a pose that jumps farther than the measured velocities explain is not believed."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.outer_loop import shorter_way
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import Fault, Part


class Gate(Part):
    """A sample is refused if an output differs by `bound` [output units] or more from what the last one leads to:

        |y - y_ - dt (y' + y'_)/2| >= bound

    Raises:
        WmrError: if the bound is not positive.
    """

    name = "gate"

    def __init__(self, outputs: int, bound: float) -> None:
        self.outputs, self.bound = outputs, np.array([float(bound)])
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"bound": self.bound}

    @property
    def states(self) -> dict[str, Floats]:
        return {"y": np.zeros(self.outputs), "y_rate": np.zeros(self.outputs), "is_running": np.zeros(1)}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(k.bound > 0, axis=-1),
            lambda k: (f"the gate's bound is {k.bound[0]:g}", "choose a positive number"),
        )

    def look(
        self, x: Array, z: SimpleNamespace, c: Array, model: Model, passed: Array
    ) -> tuple[Array, dict[str, Array]]:
        """By how much this sample surprises, zero for the first one, and the states after it."""
        arrays = model.arrays
        y, rate = model.output(x[: model.coordinate_count], c), model.output_rate(x, c)
        off = shorter_way(y - z.y - 0.5 * passed * (rate + z.y_rate), model)
        largest = 0.0
        for i in range(self.outputs):
            largest = arrays.maximum(largest, arrays.absolute(off[i]))
        return z.is_running[0] * largest, {"y": y, "y_rate": rate, "is_running": arrays.vector([1.0])}
