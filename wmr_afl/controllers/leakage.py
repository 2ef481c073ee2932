"""Leakage of the estimates, the sigma-modification (51): estimates cannot drift without end."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.numerics.vectors import per_entry


class Leakage:
    """theta_hat' = Gamma W^T E1 - Gamma Sigma theta_hat (51), Sigma diagonal, not negative, (n_theta,).

    Raises: WmrError, where it is negative.
    """

    def __init__(self, parameters: int, sigma: ArrayLike) -> None:
        self.sigma = per_entry("leakage", sigma, parameters)
        if np.any(self.sigma < 0):
            raise WmrError(f"the leakage is {self.sigma}", "choose zero or more")

    @property
    def values(self) -> dict[str, Vector]:
        return {"Sigma": self.sigma}

    def pull(self, theta_hat: Array, k: SimpleNamespace) -> Array:
        """Sigma theta_hat (n_theta,)."""
        return k.Sigma * theta_hat
