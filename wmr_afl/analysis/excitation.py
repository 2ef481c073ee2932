"""Persistency of excitation (47) along a run: which base parameters a reference determines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wmr_afl.errors import SimulationError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Run

WEAKEST = 1e-6  # of the largest eigenvalue; a direction with a smaller one counts as not determined


@dataclass(frozen=True)
class Excitation:
    """Integrals of W^T W over windows of a run, W scaled so that every base parameter counts relative to its size."""

    window: float  # T0 [s]
    starts: Floats  # (windows,) [s]
    level: Floats  # (windows,), alpha of (47): smallest eigenvalue of the integral
    highest: Floats  # (windows,), beta of (47)
    directions: Floats  # (n_theta,): share of each parameter's own axis that the whole run determines, 0 to 1
    names: tuple[str, ...]

    @property
    def is_persistent(self) -> bool:
        """Whether every window determines every direction at least a millionth as well as the best one."""
        return bool(np.all(self.level > WEAKEST * self.highest.max()))

    @property
    def excited(self) -> tuple[str, ...]:
        """The base parameters that the run determines by itself, whatever the others are."""
        return tuple(name for name, share in zip(self.names, self.directions, strict=True) if share > 0.99)


def excitation(run: Run, scale: Floats, window: float = 20.0, since: float = 0.0) -> Excitation:
    """The excitation (47) of a run's regressor from `since` [s] on, in windows of `window` [s] that overlap by half.

    `scale` (n_theta,): the sizes in which base parameters are measured, such as their true values.

    Raises:
        SimulationError: if the run is shorter than a window.
    """
    rows = run.time >= since
    time = run.time[rows]
    if len(time) < 2 or time[-1] - time[0] < window:
        problem = f"{run.controller} holds no window of {window:g} s since {since:g} s"
        raise SimulationError(problem, "choose a shorter window")
    regressor = run.model.in_library("numpy").regressor(run.state[rows], run.input[rows], run.known) * np.abs(scale)
    squares = np.einsum("tij,tik->tjk", regressor, regressor)
    step = float(time[1] - time[0])
    total = np.concatenate([np.zeros((1, *squares.shape[1:])), np.cumsum(squares, axis=0) * step])
    length = round(window / step)
    starts = np.arange(0, len(time) - length + 1, max(1, length // 2))
    integrals = total[starts + length] - total[starts]
    values = np.linalg.eigvalsh(integrals)
    return Excitation(
        window, time[starts], values[:, 0], values[:, -1], _determined(total[-1]), tuple(run.model.base_parameter_units)
    )


def estimate_error(run: Run, theta: Floats) -> Floats:
    """(theta_hat - theta) / theta over time, (T, n_theta), for the true theta (n_theta,)."""
    return np.asarray((run.estimate - theta) / theta)


def _determined(integral: Floats) -> Floats:
    """For every axis the squared length of its projection on the space that the integral determines."""
    values, vectors = np.linalg.eigh(integral)
    kept = vectors[:, values > WEAKEST * values[-1]]
    return np.asarray(np.sum(kept**2, axis=1))
