"""Normalized adaptation, for regressors that are not bounded (Remark 5)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.numerics.linear_algebra import sum_of_squares


class Normalization:
    """theta_hat' = Gamma W^T E1 / (1 + n |W|^2): however large the regressor, the estimates move at a bounded rate.

    Raises: WmrError, where n is not positive.
    """

    def __init__(self, weight: float) -> None:
        if not (np.isfinite(weight) and weight > 0):
            raise WmrError(f"the normalization is {weight}", "choose a positive number")
        self.weight = np.array([float(weight)])

    @property
    def values(self) -> dict[str, Vector]:
        return {"normalization": self.weight}

    def factor(self, regressor: Array, k: SimpleNamespace) -> Array:
        """1 / (1 + n |W|^2), |W| Frobenius' norm of W (n-m, n_theta)."""
        return 1.0 / (1.0 + k.normalization[0] * sum_of_squares(regressor))
