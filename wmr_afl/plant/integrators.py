"""One sample of x' = rate(t, x), the input held."""

from __future__ import annotations

from collections.abc import Callable

from wmr_afl.numerics.arrays import Array

Rate = Callable[[Array, Array], Array]  # (t, x) -> x'


def euler(rate: Rate, t: Array, x: Array, step: Array) -> Array:
    """First order, as in the paper."""
    return x + step * rate(t, x)


def rk4(rate: Rate, t: Array, x: Array, step: Array) -> Array:
    """Runge and Kutta's classical fourth-order step."""
    half = 0.5 * step
    k1 = rate(t, x)
    k2 = rate(t + half, x + half * k1)
    k3 = rate(t + half, x + half * k2)
    k4 = rate(t + step, x + step * k3)
    return x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


INTEGRATORS: dict[str, Callable[[Rate, Array, Array, Array], Array]] = {"euler": euler, "rk4": rk4}
