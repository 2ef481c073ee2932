"""An estimate of what is unknown, with its covariance; and what one goes by before there is a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wmr_afl.identification.effort import Effort
from wmr_afl.numerics.arrays import Floats

VAGUE = 3.0  # times its value, which a number of the description may be off: it only decides what the log leaves open
ROUGH = 0.05  # of the value, beyond which two standard deviations tell it roughly
NOT_DETERMINED = 0.3  # of the value, beyond which two standard deviations leave a number undetermined


@dataclass(frozen=True)
class Prior:
    """What the description says, vaguely: a log decides all that it determines at all."""

    mean: Floats  # (unknown,)
    spread: Floats  # (unknown,), infinite where the description says nothing
    is_free: NDArray[np.bool_]  # (unknown,), whether a log decides it; the others are known

    @property
    def precision(self) -> Floats:
        """1/spread^2 of the free ones."""
        return np.asarray(self.spread[self.is_free] ** -2.0)

    def whole(self, free: Floats) -> Floats:
        """All numbers (..., unknown), of which the free ones are (..., free)."""
        every = np.broadcast_to(self.mean, (*free.shape[:-1], len(self.mean))).copy()
        every[..., self.is_free] = free
        return every

    def spread_out(self, covariance: Floats) -> Floats:
        """The covariance of all numbers, of which known ones have none."""
        every = np.zeros((len(self.mean), len(self.mean)))
        every[np.ix_(self.is_free, self.is_free)] = covariance
        return every


def prior_of(effort: Effort, largest_voltage: float) -> Prior:
    """From the description's parameters; friction is some per cent of the voltage."""
    base = effort.base(effort.p)
    friction = np.full(len(effort.friction_groups), 0.03 * largest_voltage)
    mean = np.concatenate([base, friction])
    return Prior(mean, np.where(mean != 0.0, VAGUE * np.abs(mean), np.inf), effort.is_free)


@dataclass(frozen=True)
class Estimate:
    """Numbers that a method found."""

    method: str
    unknown: Floats  # (unknown,)
    covariance: Floats  # (unknown, unknown), of noise
    cost: float | None = None  # root mean square of what is left of the windows, in units of the noise

    @property
    def interval(self) -> Floats:
        """Two standard deviations, (unknown,)."""
        return np.asarray(2.0 * np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def jackknife(normals: Floats, slopes: Floats, prior: Floats) -> Floats:
    """The covariance of an estimate from clusters of residuals that are not independent within a cluster.

        cov = (W-1)/W sum_w d_w d_w^T + H^-1 diag(prior) H^-1,      d_w = (H - H_w)^-1 G_w            (I9)

    d_w is by how much the estimate moves if cluster w is left out: H_w (W, n, n) are its products of sensitivities, G_w
    (W, n) those with what is left, H is their sum with the `prior`, 1/spread^2 (n,).

    Reference: MacKinnon, Nielsen, Webb, Cluster-robust inference, Journal of Econometrics 232, 2023.
    """
    sizes = np.sqrt(np.maximum(np.einsum("wii->i", normals) + prior, 1e-300))
    scaled = normals / np.outer(sizes, sizes)
    whole = scaled.sum(axis=0) + np.diag(prior / sizes**2)
    without = whole - scaled + 1e-14 * np.eye(len(sizes))
    moves = np.linalg.solve(without, (slopes / sizes)[..., None])[..., 0]
    count = len(moves)
    inverse = np.linalg.inv(whole + 1e-14 * np.eye(len(sizes)))
    told = (count - 1) / count * moves.T @ moves + inverse @ np.diag(prior / sizes**2) @ inverse
    return np.asarray(told / np.outer(sizes, sizes))
