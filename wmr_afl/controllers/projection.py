"""Projection of the estimates onto prior bounds, so that Dhat stays invertible (Remark 7)."""

from __future__ import annotations

from collections.abc import Sequence
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

    def check(self, estimate: Vector, names: Sequence[str]) -> None:
        """The first estimate must lie within the bounds.

        Raises: WmrError, naming the one that does not.
        """
        for name, value, low, high in zip(names, estimate, self.lower, self.upper, strict=True):
            if not low <= value <= high:
                raise WmrError(
                    f"the first estimate of {name}, {value:g}, is not within {low:g} and {high:g}; change one of them"
                )

    @property
    def values(self) -> dict[str, Vector]:
        """Bounds that bound anything."""
        bounds = {"lower": self.lower, "upper": self.upper}
        return {name: bound for name, bound in bounds.items() if np.isfinite(bound).any()}

    def project(self, theta_hat: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The nearest estimate within the bounds."""
        raised = arrays.maximum(theta_hat, k.lower) if "lower" in self.values else theta_hat
        return arrays.minimum(raised, k.upper) if "upper" in self.values else raised
