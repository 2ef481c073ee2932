"""What a motion tells of a robot's numbers: the columns of the effort form, each scaled by its guess.

    R diag(rho) (u - F c) = Y pi                           rows of X^T u, as in (I5)
    information = sum over samples of A^T A,  A = [Y |pi|, -R_k u_k |rho_k|, R diag(rho) F |c|]

A row counts as a voltage: it is divided by the size that R has in it over all angles. So the inverse of the
information, times the variance of a voltage, is the covariance of the numbers relative to their guesses.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import WmrError
from wmr_afl.identification.alike import gain_kinds, motor_kinds
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

FRICTION = 0.06  # of the voltage there is: the guess of Coulomb friction
ROUNDED = 0.2  # [rad/s] of a shaft: below it friction fades, which keeps the design smooth
POSES = 64  # at which the size of a row is measured


@dataclass(frozen=True)
class Unknowns:
    """What is to be determined: effort parameters, ratios of torque gains, Coulomb friction of each kind of motor."""

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
        WmrError: if the model has no effort form; the text says why.
    """
    if not model.has("effort_regressor"):
        obstacle = model.metadata.get("effort_obstacle") or "it was derived before there was one"
        raise WmrError(f"{model.name} has no form that is linear in its numbers", str(obstacle))
    made, n, c = model.in_library("casadi"), model.coordinate_count, model.known(parameters)
    pi = np.asarray(model.effort_parameters(parameters))
    rho = np.asarray(model.gain_ratios(parameters)) if model.has("gain_ratios") else np.ones(len(model.input_units))
    x, u = ca.SX.sym("x", len(model.state_units)), ca.SX.sym("u", len(model.input_units))
    a = made.state_derivative(x, u, np.zeros(model.pseudo_velocity_count), parameters)[n:]
    effort = made.effort_map(x[:n], c) @ ca.diag(rho)
    friction = effort @ ca.diag(ca.tanh(made.actuator_rates_matrix(x[:n], parameters) @ x[n:] / ROUNDED))
    of_ratios, of_friction = gain_kinds(model), motor_kinds(model)
    motors = list(model.input_units)
    columns = [made.effort_regressor(x, a, c) @ ca.diag(np.where(pi == 0.0, 1.0, np.abs(pi)))]
    columns += [-(effort[:, kind] @ u[kind]) for kind in of_ratios]
    columns += [FRICTION * volts * ca.sum2(friction[:, kind]) for kind in of_friction]
    together = ca.diag(1.0 / _row_sizes(model, c, rho)) @ ca.horzcat(*columns)
    names = [
        *model.units_of("effort_parameters"),
        *(f"torque gain of {motors[kind[0]]}" for kind in of_ratios),
        *(f"friction of {motors[kind[0]]}" for kind in of_friction),
    ]
    return Unknowns(tuple(names), ca.Function("columns", [x, u], [ca.densify(together)]))


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


def _row_sizes(model: Model, c: Floats, rho: Floats) -> Floats:
    """The root mean square of the length of each row of R diag(rho), over joint angles within a radian."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (POSES, model.coordinate_count))
    rows = np.asarray(model.effort_map(q, np.broadcast_to(c, (POSES, len(c))))) * rho
    return np.sqrt((rows**2).sum(axis=-1).mean(axis=0))
