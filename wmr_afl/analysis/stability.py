"""The error system (37)-(42), the Lyapunov functions (43) and (75), and the ultimate bound (65), as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.leakage import Leakage
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats


@dataclass(frozen=True)
class ErrorSystem:
    """X' = A X + B W theta~, E1 = C X (39) for X = [e_1, e_1', e_2, ...]; A^T P + P A = -Q, P B = C^T (41)."""

    A: Floats  # (2k, 2k)
    B: Floats  # (2k, k)
    C: Floats  # (k, 2k)
    P: Floats  # (2k, 2k)
    Q: Floats  # (2k, 2k)


def error_system(outer_loop: OuterLoop) -> ErrorSystem:
    """The error system of an outer loop.

    P B = C^T fixes P's second column to (alpha, 1); the remaining entry alpha b1 + b2 makes Q diagonal, and P and Q are
    positive definite exactly if b1 > alpha > 0 and b2 > 0, which the outer loop requires.
    """
    blocks = [_of_one_output(*gains) for gains in zip(outer_loop.b1, outer_loop.b2, outer_loop.alpha, strict=True)]
    return ErrorSystem(*(_block_diagonal([block[i] for block in blocks]) for i in range(5)))


def lyapunov_function(
    error: ArrayLike,
    error_rate: ArrayLike,
    estimate_error: ArrayLike,
    system: ErrorSystem,
    adaptation: GradientAdaptation,
) -> Floats:
    """V = X^T P X + theta~^T Gamma^-1 theta~ (43), for e and e' (..., k) and theta~ (..., n_theta)."""
    pairs = np.stack([np.asarray(error, dtype=float), np.asarray(error_rate, dtype=float)], axis=-1)
    x = pairs.reshape(*pairs.shape[:-2], -1)
    theta = np.asarray(estimate_error, dtype=float)
    return np.einsum("...i,ij,...j->...", x, system.P, x) + np.einsum(
        "...i,ij,...j->...", theta, _inverse_gain(adaptation), theta
    )


def robust_lyapunov_function(
    value: ArrayLike, bound_error: ArrayLike, mu: ArrayLike, gamma: float, mu_decay: float
) -> Floats:
    """V1 = V + a~^T a~ / gamma + mu / k_mu (75), for V (43) and a~ = a - a_hat (..., 2)."""
    difference = np.asarray(bound_error, dtype=float)
    return np.asarray(
        np.asarray(value, dtype=float) + np.sum(difference**2, axis=-1) / gamma + np.asarray(mu, dtype=float) / mu_decay
    )


@dataclass(frozen=True)
class UltimateBound:
    """What leakage guarantees in the end (65), and how fast: V decays at least at `rate` [1/s] towards it."""

    error: float  # |X|
    estimate_error: float  # |theta~|
    rate: float  # kappa (61)


def ultimate_bound(
    system: ErrorSystem, adaptation: GradientAdaptation, theta: ArrayLike, disturbance: float, k: float = 1.0
) -> UltimateBound:
    """The bounds (65) under leakage, for |delta| <= `disturbance` [output units/s^2] and any k > sqrt(1/2).

    If the entries of Sigma differ, the largest one is used in the place of the smallest one in the paper's (54).

    Raises:
        WmrError: if an estimate has no leakage, or k is too small.
    """
    leaks = [part.sigma for part in adaptation.modifications if isinstance(part, Leakage)]
    leakage = leaks[0] if leaks else np.zeros(1)
    lowest, highest = float(leakage.min()), float(leakage.max())
    if lowest <= 0.0 or k <= np.sqrt(0.5):
        raise WmrError("the bound (65) needs leakage > 0 on every estimate, and k > sqrt(1/2)", "choose such numbers")
    m_q = float(np.linalg.svd(system.Q, compute_uv=False).min())
    s1, s2 = 0.5 * m_q, 2.0 * lowest * (1.0 - 0.5 / k**2)  # (58)
    size = float(np.linalg.norm(np.asarray(theta, dtype=float)))
    rho = highest**2 / lowest * k**2 * size**2 + 2.0 / m_q * float(np.linalg.norm(system.C, 2)) ** 2 * disturbance**2
    p, gain = np.linalg.eigvalsh(system.P), np.linalg.eigvalsh(_inverse_gain(adaptation))
    rate = float(min(s1 / p.max(), s2 / gain.max()))  # (61)
    return UltimateBound(float(np.sqrt(rho / rate / p.min())), float(np.sqrt(rho / rate / gain.min())), rate)


def _inverse_gain(adaptation: GradientAdaptation) -> Floats:
    gain = np.diag(adaptation.gain) if adaptation.gain.ndim == 1 else adaptation.gain
    return np.asarray(np.linalg.inv(gain))


def _of_one_output(b1: float, b2: float, alpha: float) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    A = np.array([[0.0, 1.0], [-b2, -b1]])
    B, C = np.array([[0.0], [1.0]]), np.array([[alpha, 1.0]])
    P = np.array([[alpha * b1 + b2, alpha], [alpha, 1.0]])
    Q = np.diag([2.0 * alpha * b2, 2.0 * (b1 - alpha)])
    return A, B, C, P, Q


def _block_diagonal(blocks: list[Floats]) -> Floats:
    rows, columns = (sum(block.shape[axis] for block in blocks) for axis in (0, 1))
    whole = np.zeros((rows, columns))
    row = column = 0
    for block in blocks:
        whole[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return whole
