"""Commands that a late drive has not carried out yet: what acts now, and where they will have taken the outputs."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.observer import Seen
from wmr_afl.controllers.pose_observer import moved
from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.linear_algebra import solve
from wmr_afl.numerics.parts import Part


class CommandsUnderWay(Part):
    """v' that each command under way was meant to bring about, and what it cancelled: the oldest of them acts now.

    With `predicts` the law goes by where the outputs will be when its command acts, `samples` later,

        y += T y' + T^2/2 y''       y' += T y''       y'' = E v' + E' v

    command by command, E and E' v as they are now, and by the reference of that time.

    Raises:
        WmrError: if there is no sample of delay.
    """

    name = "under_way"

    def __init__(self, count: int, samples: int, sample_time: float, predicts: bool = False) -> None:
        if samples < 1:
            raise WmrError(f"a delay of {samples} samples", "choose at least one sample")
        self.count, self.samples, self.predicts = count, samples, predicts
        self.seconds = samples * sample_time

    @property
    def states(self) -> dict[str, Floats]:
        return {name: np.zeros(self.count * self.samples) for name in ("accelerations", "removed")}  # the oldest first

    def acting(self, queue: Array) -> Array:
        """The entry of the command that acts now, (n-m,)."""
        return queue[: self.count]

    def ahead(self, seen: Seen, E: Array, drift: Array, z: SimpleNamespace, arrays: Arrays, step: Array) -> Seen:
        """What will be seen when the next command acts; `drift` is E' v."""
        if not self.predicts:
            return seen
        y, y_rate, n = seen.y, seen.y_rate, self.count
        for i in range(self.samples):
            acceleration = E @ z.accelerations[i * n : (i + 1) * n] + drift
            y, y_rate = moved(y, y_rate, acceleration, step)
        q = seen.x[: seen.x.shape[0] - n]
        return replace(seen, x=arrays.join([q, solve(E, y_rate, arrays)]), y=y, y_rate=y_rate)

    def update(self, acceleration: Array, removed: Array, z: SimpleNamespace, arrays: Arrays) -> dict[str, Array]:
        """The states one sample later."""
        n = self.count
        return {
            "accelerations": arrays.join([z.accelerations[n:], acceleration]),
            "removed": arrays.join([z.removed[n:], removed]),
        }
