"""Gradient adaptation of the base parameters (25), with leakage (51) or normalized (Remark 5)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from wmr_afl.controllers.leakage import Leakage
from wmr_afl.controllers.normalization import Normalization
from wmr_afl.errors import ShapeError, WmrError
from wmr_afl.numerics.arrays import Array, Vector
from wmr_input.errors import FieldError
from wmr_input.fields import Gain, Named, Positive, Table


class AdaptationTable(Table):
    """(25); `relative_gain` g gives Gamma_i = g theta_hat_i(0)^2, for base parameters that differ in size and unit."""

    gain: Gain | None = None
    relative_gain: Positive | None = None
    leakage: Named | None = None  # Sigma of (51)
    normalization: Positive | None = None  # Remark 5
    input: Literal["commanded", "applied"] = "commanded"  # at which W is taken

    @model_validator(mode="after")
    def _one_gain(self) -> AdaptationTable:
        if (self.gain is None) == (self.relative_gain is None):
            raise FieldError("names no or two gains", "give gain or relative_gain")
        return self


class GradientAdaptation:
    """theta_hat' = Gamma W^T E1 (25), Gamma (n_theta, n_theta) or its diagonal, positive definite.

    With `leakage` (51), with `normalization` Remark 5. `sees_applied`: W is taken at the input that reaches the motors
    instead of the one that was commanded, where the two differ.
    Raises: WmrError, where Gamma is not positive definite.
    """

    def __init__(
        self,
        parameters: int,
        gain: ArrayLike,
        leakage: Leakage | None = None,
        normalization: Normalization | None = None,
        sees_applied: bool = False,
    ) -> None:
        self.leakage, self.normalization, self.sees_applied = leakage, normalization, sees_applied
        try:
            self.gain = np.asarray(gain, dtype=float)
        except (TypeError, ValueError):
            raise ShapeError("the rows of the adaptation gain differ in length", "give rows of equal length") from None
        if self.gain.ndim == 0:
            self.gain = np.full(parameters, float(self.gain))
        if self.gain.shape not in ((parameters,), (parameters, parameters)):
            raise ShapeError(
                f"the adaptation gain has shape {self.gain.shape}",
                f"expected a number, a diagonal ({parameters},) or a matrix ({parameters}, {parameters})",
            )
        matrix = np.diag(self.gain) if self.gain.ndim == 1 else self.gain
        if not np.allclose(matrix, matrix.T) or not np.all(np.linalg.eigvalsh(matrix) > 0):
            raise WmrError(f"the adaptation gain {self.gain.tolist()} is not symmetric positive definite")

    @property
    def values(self) -> dict[str, Vector]:
        values = {"Gamma": self.gain}
        for part in (self.leakage, self.normalization):
            values |= part.values if part else {}
        return values

    def change(
        self, regressor: Array, filtered_error: Array, theta_hat: Array, k: SimpleNamespace, step: Array
    ) -> Array:
        """step theta_hat' (n_theta,), for W (n-m, n_theta) and E1 (n-m,)."""
        direction = regressor.T @ filtered_error
        if self.normalization is not None:
            direction = self.normalization.factor(regressor, k) * direction
        if self.leakage is not None:
            direction = direction - self.leakage.pull(theta_hat, k)
        gain = step * k.Gamma  # the same at every step, so that it is multiplied once
        return gain * direction if self.gain.ndim == 1 else gain @ direction
