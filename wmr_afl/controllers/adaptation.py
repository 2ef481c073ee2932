"""Gradient adaptation of the base parameters (25)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.arrays import Array
from wmr_afl.errors import ShapeError, WmrError
from wmr_afl.model import Vector


class GradientAdaptation:
    """theta_hat' = Gamma W^T E1 (25), Gamma (n_theta, n_theta) or its diagonal, positive definite.

    Raises: WmrError, where it is not.
    """

    def __init__(self, parameters: int, gain: ArrayLike) -> None:
        try:
            self.gain = np.asarray(gain, dtype=float)
        except (TypeError, ValueError):
            raise ShapeError("the rows of the adaptation gain differ in length; give rows of equal length") from None
        if self.gain.ndim == 0:
            self.gain = np.full(parameters, float(self.gain))
        if self.gain.shape not in ((parameters,), (parameters, parameters)):
            raise ShapeError(
                f"the adaptation gain has shape {self.gain.shape}; expected a number, a diagonal ({parameters},) "
                f"or a matrix ({parameters}, {parameters})"
            )
        matrix = np.diag(self.gain) if self.gain.ndim == 1 else self.gain
        if not np.allclose(matrix, matrix.T) or not np.all(np.linalg.eigvalsh(matrix) > 0):
            raise WmrError(f"the adaptation gain {self.gain.tolist()} is not symmetric positive definite")

    @property
    def values(self) -> dict[str, Vector]:
        return {"Gamma": self.gain}

    def rate(self, regressor: Array, filtered_error: Array, k: SimpleNamespace) -> Array:
        """theta_hat' (n_theta,), for W (n-m, n_theta) and E1 (n-m,)."""
        gradient = regressor.T @ filtered_error
        return k.Gamma * gradient if self.gain.ndim == 1 else k.Gamma @ gradient
