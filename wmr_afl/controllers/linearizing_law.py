"""The input-output linearizing law (23), with estimates (25)."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.linear_algebra import least_norm, regularity
from wmr_afl.numerics.parts import Fault, Part
from wmr_afl.numerics.vectors import per_entry, told


class LinearizingLaw(Part):
    """u = Dhat^-1 (eta - L_f^2 h - L_q L_f h_hat) (25).

    With more motors than outputs the inputs that make sum weights u^2 least are taken; `weights` (n_u,), positive.

    Raises:
        WmrError: if a weight is not positive.
    """

    name = "linearizing"

    def __init__(self, inputs: int, weights: ArrayLike = 1.0) -> None:
        self.weights = per_entry("input weights", weights, inputs)
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"input_weights": self.weights}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        wrong = np.any(k.input_weights <= 0, axis=-1)
        yield wrong, lambda k: (f"input weights are {told(k.input_weights)}", "choose positive ones")

    def inputs(
        self, x: Array, eta: Array, theta_hat: Array, c: Array, k: SimpleNamespace, model: Model
    ) -> tuple[Array, Array]:
        """u [V] (n_u,), and whether Dhat is regular: see `linear_algebra.regularity`."""
        decoupling = model.decoupling_matrix(x, theta_hat, c)
        right = eta - self._drift(x, theta_hat, c, model)
        return least_norm(decoupling, right, k.input_weights, model.arrays), regularity(decoupling, model.arrays)

    def acceleration(self, x: Array, u: Array, theta_hat: Array, c: Array, model: Model) -> Array:
        """y'' (n-m,) that the estimated robot has under voltages u (n_u,), (20)."""
        return self._drift(x, theta_hat, c, model) + model.decoupling_matrix(x, theta_hat, c) @ u

    @staticmethod
    def _drift(x: Array, theta_hat: Array, c: Array, model: Model) -> Array:
        return model.lie_f2_h(x, c) + model.lie_q_lie_f_h(x, theta_hat, c)
