"""What a run tells of its robot: persistency of excitation (47), and the parameters that stay undetermined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import SimulationError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import words_of
from wmr_afl.simulation.result import Run

WEAKEST = 1e-6  # of the largest eigenvalue; a direction with a smaller one counts as not determined


@dataclass(frozen=True)
class Excitation:
    """Integrals of W^T W over windows of a run, W scaled so that every base parameter counts relative to its size.

    For the laws that estimate pi, Y(x, v, v', c) stands for W.
    """

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
    if len(time) < 3 or time[-1] - time[0] < window:
        problem = f"{run.controller} holds no window of {window:g} s since {since:g} s"
        raise SimulationError(problem, "choose a shorter window")
    regressor = _regressor(run, rows) * np.abs(scale)
    squares = np.einsum("tij,tik->tjk", regressor, regressor)
    step = float(time[1] - time[0])
    total = np.concatenate([np.zeros((1, *squares.shape[1:])), np.cumsum(squares, axis=0) * step])
    length = round(window / step)
    starts = np.arange(0, len(time) - length + 1, max(1, length // 2))
    integrals = total[starts + length] - total[starts]
    values = np.linalg.eigvalsh(integrals)
    return Excitation(
        window, time[starts], values[:, 0], values[:, -1], _determined(total[-1]), tuple(run.estimate_units)
    )


def estimate_error(run: Run, theta: Floats) -> Floats:
    """(theta_hat - theta) / theta over time, (T, n_theta), for the true theta (n_theta,)."""
    return np.asarray((run.estimate - theta) / theta)


def undetermined(run: Run) -> tuple[str, ...]:
    """The parameters that the run does not determine by themselves: by deviations, or where there are none by (47)."""
    if run.undetermined is not None:
        return run.undetermined
    if len(run.time) < 3:
        return ()
    scale = getattr(run.model.in_library("numpy"), run.estimated)(run.parameters)
    found = excitation(run, scale, float(run.time[-1] - run.time[0]))
    return tuple(name for name in found.names if name not in found.excited)


def left_open(model: Model, estimated: str, names: Sequence[str]) -> tuple[str, ...]:
    """The uncertain physical parameters that act in these parameters only, so that nothing is learned of them."""
    formulas = model.formulas_of(estimated)
    known = {word for name, text in formulas.items() if name not in names for word in words_of(text)}
    there = {word for name in names for word in words_of(formulas[name])}
    return tuple(name for name in model.parameter_units if name in there - known and name not in model.known_units)


def sentence(run: Run) -> str:
    """What the run's reference does not determine, in one sentence; empty if there is nothing to be said.

    Only a law that knows deviations can say that nothing was learned; of others (47) tells what the motion leaves out.
    """
    names = undetermined(run)
    if not names:
        return ""
    formulas = run.model.formulas_of(run.estimated)
    told = listed([f"{name} = {formulas[name]}" for name in names])
    open_ones = left_open(run.model, run.estimated, names)
    if run.deviation is None:
        return f"{told}: not excited by this reference"
    unknown = f"; of {listed(open_ones)} nothing is learned" if open_ones else ""
    return f"{told}: undetermined by this reference, the guess stands{unknown}"


def listed(words: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _regressor(run: Run, rows: NDArray[np.bool_]) -> Floats:
    """W (T, n-m, n_theta), or Y with the accelerations that differences of v give."""
    model, x = run.model.in_library("numpy"), run.state[rows]
    if run.estimated == "base_parameters":
        return np.asarray(model.regressor(x, run.input[rows], run.known))
    v = x[:, model.coordinate_count :]
    return np.asarray(model.passivity_regressor(x, v, np.gradient(v, run.time[rows], axis=0), run.known))


def _determined(integral: Floats) -> Floats:
    """For every axis the squared length of its projection on the space that the integral determines."""
    values, vectors = np.linalg.eigh(integral)
    kept = vectors[:, values > WEAKEST * values[-1]]
    return np.asarray(np.sum(kept**2, axis=1))
