"""Normalized adaptation, for regressors that are not bounded (Remark 5)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.modification import Modification
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.linear_algebra import sum_of_squares
from wmr_afl.numerics.parts import Fault


class Normalization(Modification):
    """theta_hat' = Gamma W^T E1 / (1 + n |W|^2): however large the regressor, the estimates move at a bounded rate.

    |W| is Frobenius' norm of W (n-m, n_theta).

    Raises:
        WmrError: if n is not positive.
    """

    name = "normalization"

    def __init__(self, weight: float) -> None:
        self.weight = np.array([float(weight)])
        self.check_numbers()

    @classmethod
    def from_setting(cls, setting: float, parameters: Sequence[str]) -> Normalization:
        return cls(setting)

    @property
    def values(self) -> dict[str, Floats]:
        return {"weight": self.weight}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.weight) & (k.weight > 0), axis=-1),
            lambda k: (f"the normalization is {k.weight[0]:g}", "choose a positive number"),
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
        return 1.0 / (1.0 + k.weight[0] * sum_of_squares(regressor)) * direction
