"""The same held voltages through the model and through the engine, whose error is of first order in its step.

Two runs of the engine, one with half the step of the other, therefore extrapolate to a step of zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.integrators import rk4
from wmr_afl.validation.engine import Engine, Grip, Watch
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact
from wmr_afl.validation.voltages import Waves

STEP = 1e-3  # [s], of the engine's first run
HELD = 0.01  # [s], for which voltages are held
SUBSTEPS = 5  # of the model, within
SETTLED = 0.5  # [s], before which friction is not told: voltages rise
EVERY = 2  # samples, at which friction is read


@dataclass(frozen=True)
class Driven:
    """One drive, T samples."""

    time: Floats  # (T,) [s]
    model: Floats  # (T, 2n-m), states of the generated model
    coarse: Floats  # (T, 2n-m), of the engine
    fine: Floats  # (T, 2n-m), of the engine with half the step
    grip: Grip  # once it is under way

    @property
    def extrapolated(self) -> Floats:
        """(T, 2n-m), what the engine's states tend to."""
        return 2.0 * self.fine - self.coarse

    def differences(self, n: int) -> Floats:
        """(3, n-m), of v with the coarse and the fine step and extrapolated, over the root mean square of each v."""
        size = np.sqrt(np.mean(self.model[:, n:] ** 2, axis=0))
        left = np.array([one[:, n:] - self.model[:, n:] for one in (self.coarse, self.fine, self.extrapolated)])
        return np.asarray(np.sqrt(np.mean(left**2, axis=1)) / size)

    def ends(self, place: Callable[[Floats], Floats]) -> Floats:
        """(3,), how far apart the paths end, over the length of the path; `place` (T, 2) of states."""
        path = place(self.model)
        length = float(np.sum(np.hypot(*np.diff(path, axis=0).T)))
        others = (place(one[-1:])[0] for one in (self.coarse, self.fine, self.extrapolated))
        return np.array([float(np.hypot(*(one - path[-1]))) for one in others]) / max(length, 1e-9)


def drive(
    mechanism: Mechanism,
    start: Floats,
    seconds: float = 10.0,
    height: float | None = None,
    watch: Watch | None = None,
) -> Driven:
    """From rest at `start` q (n,); in space if `height` [m] of the masses is given.

    Raises:
        WmrError: if wheels slip or leave the floor, or the engine cannot have the robot.
    """
    count = round(seconds / HELD)
    voltages = Waves.of(mechanism).at(HELD * np.arange(count))
    told = _by_model(mechanism.model, mechanism.p, start, voltages)
    runs, grip = [], Grip.none(len(mechanism.wheels))
    for step in (STEP, 0.5 * STEP):
        contact = Contact(step)
        engine = Engine(mechanism, contact, mechanism.loads(start), height)
        engine.start(start, np.zeros_like(start))
        states = [engine.state]
        for k in range(count):
            engine.drive(voltages[k], round(HELD / step))
            states.append(engine.state)
            if HELD * k > SETTLED and k % EVERY == 0:
                grip = grip.beside(engine.grip)
                grip.check(mechanism, contact.friction, "the drive")
            if watch is not None and step == STEP:
                watch(engine, HELD * (k + 1))
        runs.append(np.array(states))
    coarse, fine = runs
    return Driven(np.array(HELD * np.arange(count + 1), dtype=float), told, coarse, fine, grip)


def _by_model(model: Model, p: Floats, start: Floats, voltages: Floats) -> Floats:
    """(T, 2n-m), the generated model by Runge and Kutta's method."""
    made = model.in_library("casadi")
    x, u = ca.SX.sym("x", len(model.state_units)), ca.SX.sym("u", voltages.shape[1])
    w = ca.DM.zeros(model.pseudo_velocity_count)

    def rate(_: float, x: ca.SX) -> ca.SX:
        return ca.SX(made.state_derivative(x, u, w, ca.DM(p)))

    following = x
    for _ in range(SUBSTEPS):
        following = rk4(rate, 0.0, following, HELD / SUBSTEPS)
    step = ca.Function("step", [x, u], [following])
    first = np.concatenate([start, np.zeros(model.pseudo_velocity_count)])
    later = step.mapaccum(len(voltages))(first, voltages.T).full().T
    return np.vstack([first, later])
