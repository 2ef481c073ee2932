"""Robots that share a closed loop and differ in numbers: their starts, numbers and seeds, one column a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import ShapeError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.layout import Layout


@dataclass(frozen=True)
class Ensemble:
    """N robots."""

    states: Floats  # (states of the loop, N)
    values: Floats  # (numbers of the loop, N)
    seeds: NDArray[np.int64]  # (N,), or (0,) if nothing is drawn

    @classmethod
    def of(cls, loops: Sequence[ClosedLoop]) -> Ensemble:
        """Loops that differ only in numbers, one robot each.

        Raises:
            ShapeError: if the loops differ in more than numbers.
        """
        states, values = Layout(loops[0].states), Layout(loops[0].values)
        for loop in loops:
            if Layout(loop.states).shapes != states.shapes or Layout(loop.values).shapes != values.shapes:
                raise ShapeError("the loops differ in more than numbers", "run them one by one")
        return cls(
            np.stack([states.pack(loop.states) for loop in loops], axis=1),
            np.stack([values.pack(loop.values) for loop in loops], axis=1),
            np.array([loop.plant.seed for loop in loops if loop.plant.samples], dtype=np.int64),
        )

    @property
    def count(self) -> int:
        """N."""
        return int(self.states.shape[1])

    def generator(self, robot: int) -> np.random.Generator:
        """The stream of one robot's standard normal numbers."""
        return np.random.Generator(np.random.Philox(int(self.seeds[robot])))

    def block(self, lanes: slice, width: int) -> Ensemble:
        """Some robots, the last one repeated up to `width`."""
        chosen = np.minimum(np.arange(lanes.start, lanes.start + width), lanes.stop - 1)
        seeds = self.seeds[chosen] if len(self.seeds) else self.seeds
        return Ensemble(self.states[:, chosen], self.values[:, chosen], seeds)
