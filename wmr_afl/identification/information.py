"""What a motion tells of a robot's numbers: the columns of the effort form, each scaled by its guess.

    R diag(rho) u = Y pi + R F kappa                       rows of X^T u, as in (I5)
    information = sum over samples of A^T A,  A = [Y |pi|, -R_k u_k |rho_k|, R F |kappa|]

A row counts as a voltage: it is divided by the size that R has in it over all angles. So the inverse of the
information, times the variance of a voltage, is the covariance of the numbers relative to their guesses.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.identification.effort import Effort
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

FRICTION = 0.06  # of the voltage there is: the guess of Coulomb friction
POSES = 64  # at which the size of a row is measured


@dataclass(frozen=True)
class Unknowns:
    """What is to be determined: base parameters, ratios of torque gains, Coulomb friction of each kind of motor."""

    names: tuple[str, ...]
    columns: ca.Function  # (x, u) -> A (n-m, k) [V]

    def information(self, states: ArrayLike, voltages: ArrayLike) -> Floats:
        """Of samples (T, 2n-m), (T, n_u): (k, k) [V^2]."""
        rows = self.columns.map(len(np.asarray(states)))(np.asarray(states).T, np.asarray(voltages).T).full()
        blocks = rows.reshape(rows.shape[0], -1, len(self.names))
        return np.einsum("itk,itl->kl", blocks, blocks)


def unknowns(model: Model, parameters: Floats, volts: float) -> Unknowns:
    """What is to be determined of a robot whose parameters are guessed as p (n_p,), driven with up to `volts`.

    Raises:
        MissingTermError: if the model has no effort form; the text says why.
    """
    effort = Effort(model, parameters)
    rubbing = effort.ratios(parameters)[[group[0] for group in effort.friction_groups.values()]]
    guess = np.concatenate([np.abs(effort.base(parameters)), FRICTION * volts * rubbing])
    made, n, w = model.in_library("casadi"), effort.n, np.zeros(effort.n_v)
    x, u = ca.SX.sym("x", n + effort.n_v), ca.SX.sym("u", len(model.input_units))
    a = made.state_derivative(x, u, w, parameters)[n:]
    scaled = effort.columns(x, u, a) @ ca.diag(np.where(guess == 0.0, 1.0, guess))
    rows = ca.diag(1.0 / _row_sizes(effort)) @ scaled
    return Unknowns(tuple(effort.units), ca.Function("columns", [x, u], [ca.densify(rows)]))


def log_determinant(information: Floats) -> float:
    """Minus infinity if something is not determined at all, or the robot was lost."""
    if not np.all(np.isfinite(information)):
        return -np.inf
    sign, value = np.linalg.slogdet(information)
    return float(value) if sign > 0.0 else -np.inf


def condition(information: Floats) -> float:
    """Of the columns: the root of the ratio of the largest eigenvalue to the smallest."""
    values = np.linalg.eigvalsh(information)
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0.0 else np.inf


def deviations(information: Floats, noise: float) -> Floats:
    """Standard deviations relative to the guesses, (k,), if each row of each sample has an error of `noise` [V]."""
    values, vectors = np.linalg.eigh(information)
    shares = vectors**2
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.where(shares > 0.0, shares / np.maximum(values, 0.0), 0.0).sum(axis=1)
    return noise * np.sqrt(variances)


def _row_sizes(effort: Effort) -> Floats:
    """The root mean square of the length of each row of R diag(rho), over joint angles within a radian."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (POSES, effort.n))
    rows = effort.map(q) * effort.ratios(effort.p)
    return np.asarray(np.sqrt((rows**2).sum(axis=-1).mean(axis=0)))
