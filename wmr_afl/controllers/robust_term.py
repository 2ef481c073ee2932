"""The adaptive robust term of the outer loop (70)-(74): it outweighs what the regressor does not describe."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from wmr_afl.numerics.arrays import Array, Arrays, Floats, norm
from wmr_afl.numerics.parts import Fault, Part
from wmr_input.fields import NotNegative, Positive, Table

_SMALLEST = 1e-300  # close to the smallest double; keeps 0/0 out once mu has decayed to zero


class RobustTable(Table):
    """(70)-(74); a mu that does not decay wants leakage on a_hat (Remark 9)."""

    gamma: Positive
    mu: Positive = 1.0
    mu_decay: NotNegative = 1.0
    leakage: NotNegative = 0.0


class RobustTerm(Part):
    """vR = -2 rho^2 E1 / (2 rho |E1| + mu), rho = [|v|, 1] a_hat (70), (71), added to eta (74).

    a_hat' = gamma ([|v|, 1]^T |E1| - leakage a_hat) (73); mu' = -decay mu, mu(0) > 0 (72). A mu that does not decay
    smooths the term for good; a_hat then needs leakage (Remark 9).

    Raises:
        WmrError: if a gain has the wrong sign.
    """

    name = "robust"

    def __init__(self, gamma: float, mu: float = 1.0, mu_decay: float = 1.0, leakage: float = 0.0) -> None:
        self.start_mu = np.array([float(mu)])
        self.gains = {"gamma": gamma, "mu_decay": mu_decay, "leakage": leakage}
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {name: np.array([float(value)]) for name, value in self.gains.items()}

    @property
    def states(self) -> dict[str, Floats]:
        return {"a_hat": np.zeros(2), "mu": self.start_mu}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        start_mu = float(self.start_mu[0])
        yield (
            ~np.all((k.gamma > 0) & (start_mu > 0) & (k.mu_decay >= 0) & (k.leakage >= 0), axis=-1),
            lambda k: (
                f"gamma = {k.gamma[0]:g}, mu = {start_mu:g}, mu_decay = {k.mu_decay[0]:g}, leakage = {k.leakage[0]:g}",
                "choose gamma > 0, mu > 0, and the others zero or more",
            ),
        )
        yield (
            np.all((k.mu_decay == 0) & (k.leakage == 0), axis=-1),
            lambda k: ("with a constant mu the bound a_hat would grow without end (Remark 9)", "choose leakage > 0"),
        )

    def acceleration(self, v: Array, filtered_error: Array, z: SimpleNamespace, arrays: Arrays) -> Array:
        """vR (71), (n-m,)."""
        rho = norm(v, arrays) * z.a_hat[0] + z.a_hat[1]
        size = 2.0 * rho * norm(filtered_error, arrays) + z.mu[0]
        return -2.0 * rho * rho / arrays.maximum(size, _SMALLEST) * filtered_error

    def update(
        self, v: Array, filtered_error: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array
    ) -> dict[str, Array]:
        """a_hat and mu one sample later; mu exactly, for (72) is linear."""
        size = norm(filtered_error, arrays)
        growth = arrays.vector([norm(v, arrays) * size, size])
        a_hat = z.a_hat + step * k.gamma[0] * (growth - k.leakage[0] * z.a_hat)
        return {"a_hat": a_hat, "mu": z.mu * arrays.exp(-k.mu_decay[0] * step)}
