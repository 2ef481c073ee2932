"""A dead zone: errors that noise explains teach nothing (Peterson, Narendra, Bounded error adaptive control, 1982)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.modification import Modification
from wmr_afl.numerics.arrays import Array, Arrays, Floats, dot
from wmr_afl.numerics.parts import Fault


class DeadZone(Modification):
    """theta_hat' = Gamma W^T E1 where |E1| > `size` [output units/s], else 0: estimates rest while the error is small.

    Raises:
        WmrError: if the size is not positive.
    """

    name = "dead_zone"

    def __init__(self, size: float) -> None:
        self.size = np.array([float(size)])
        self.check_numbers()

    @classmethod
    def from_setting(cls, setting: float, parameters: Sequence[str]) -> DeadZone:
        return cls(setting)

    @property
    def values(self) -> dict[str, Floats]:
        return {"size": self.size}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.size) & (k.size > 0), axis=-1),
            lambda k: (f"the dead zone is {k.size[0]:g}", "choose a positive number"),
        )

    def modify(
        self,
        direction: Array,
        regressor: Array,
        filtered_error: Array,
        theta_hat: Array,
        k: SimpleNamespace,
        arrays: Arrays,
    ) -> Array:
        return arrays.where(dot(filtered_error, filtered_error) > k.size[0] * k.size[0], 1.0, 0.0) * direction
