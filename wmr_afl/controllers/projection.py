"""Projection of the estimates onto prior bounds, so that Dhat stays invertible (Remark 7)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.arrays import Array, Arrays
from wmr_afl.errors import WmrError
from wmr_afl.model import Vector


class Projection:
    """Keeps lower <= theta_hat <= upper, (n_theta,) each; infinite bounds leave an estimate free."""

    def __init__(self, parameters: int, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        self.lower = np.broadcast_to(np.asarray(lower, dtype=float), (parameters,)).copy()
        self.upper = np.broadcast_to(np.asarray(upper, dtype=float), (parameters,)).copy()
        if not np.all(self.lower < self.upper):
            raise WmrError(f"bounds {self.lower} to {self.upper} leave nothing; choose lower < upper")

    @property
    def values(self) -> dict[str, Vector]:
        return {"lower": self.lower, "upper": self.upper}

    def project(self, theta_hat: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The nearest estimate within the bounds."""
        return arrays.minimum(arrays.maximum(theta_hat, k.lower), k.upper)
