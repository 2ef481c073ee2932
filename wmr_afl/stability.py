"""The error system (37)-(42) and the Lyapunov function (43) of the adaptive law, as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.model import Vector


@dataclass(frozen=True)
class ErrorSystem:
    """X' = A X + B W theta~, E1 = C X (39) for X = [e_1, e_1', e_2, ...]; A^T P + P A = -Q, P B = C^T (41)."""

    A: Vector  # (2k, 2k)
    B: Vector  # (2k, k)
    C: Vector  # (k, 2k)
    P: Vector  # (2k, 2k)
    Q: Vector  # (2k, 2k)


def error_system(outer_loop: OuterLoop) -> ErrorSystem:
    """The error system of an outer loop.

    P B = C^T fixes P's second column to (alpha, 1); the remaining entry alpha b1 + b2 makes Q diagonal, and P and Q are
    positive definite exactly where b1 > alpha > 0 and b2 > 0, which the outer loop requires.
    """
    blocks = [_of_one_output(*gains) for gains in zip(outer_loop.b1, outer_loop.b2, outer_loop.alpha, strict=True)]
    return ErrorSystem(*(_block_diagonal([block[i] for block in blocks]) for i in range(5)))


def lyapunov_function(
    error: ArrayLike,
    error_rate: ArrayLike,
    estimate_error: ArrayLike,
    system: ErrorSystem,
    adaptation: GradientAdaptation,
) -> Vector:
    """V = X^T P X + theta~^T Gamma^-1 theta~ (43), for e and e' (..., k) and theta~ (..., n_theta)."""
    pairs = np.stack([np.asarray(error, dtype=float), np.asarray(error_rate, dtype=float)], axis=-1)
    x = pairs.reshape(*pairs.shape[:-2], -1)
    theta = np.asarray(estimate_error, dtype=float)
    gain = np.diag(adaptation.gain) if adaptation.gain.ndim == 1 else adaptation.gain
    return np.einsum("...i,ij,...j->...", x, system.P, x) + np.einsum(
        "...i,ij,...j->...", theta, np.linalg.inv(gain), theta
    )


def _of_one_output(b1: float, b2: float, alpha: float) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    A = np.array([[0.0, 1.0], [-b2, -b1]])
    B, C = np.array([[0.0], [1.0]]), np.array([[alpha, 1.0]])
    P = np.array([[alpha * b1 + b2, alpha], [alpha, 1.0]])
    Q = np.diag([2.0 * alpha * b2, 2.0 * (b1 - alpha)])
    return A, B, C, P, Q


def _block_diagonal(blocks: list[Vector]) -> Vector:
    rows, columns = (sum(block.shape[axis] for block in blocks) for axis in (0, 1))
    whole = np.zeros((rows, columns))
    row = column = 0
    for block in blocks:
        whole[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return whole
