"""Leakage of the estimates, the sigma-modification (51): estimates cannot drift without end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.modification import Modification
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault
from wmr_afl.numerics.vectors import by_name, per_entry, told
from wmr_input.fields import Named


class Leakage(Modification):
    """theta_hat' = Gamma W^T E1 - Gamma Sigma theta_hat (51), Sigma diagonal, not negative, (n_theta,) [1/s].

    Raises:
        WmrError: if it is negative.
    """

    name = "leakage"

    def __init__(self, count: int, sigma: ArrayLike) -> None:
        self.sigma = per_entry("leakage", sigma, count)
        self.check_numbers()

    @classmethod
    def from_setting(cls, setting: Named, parameters: Sequence[str]) -> Leakage:
        missing = 0.0 if isinstance(setting, dict) else None
        return cls(len(parameters), by_name("base parameter", setting, parameters, missing))

    @property
    def values(self) -> dict[str, Floats]:
        return {"Sigma": self.sigma}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield np.any(k.Sigma < 0, axis=-1), lambda k: (f"the leakage is {told(k.Sigma)}", "choose zero or more")

    def modify(
        self,
        direction: Array,
        regressor: Array,
        filtered_error: Array,
        theta_hat: Array,
        k: SimpleNamespace,
        arrays: Arrays,
    ) -> Array:
        return direction - k.Sigma * theta_hat
