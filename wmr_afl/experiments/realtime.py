"""A controller for a robot's own loop: measured state in, voltages out, the same law as in the simulator."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.controllers import TrackingController
from wmr_afl.controllers.reference import Reference
from wmr_afl.errors import CompilerError, ShapeError, SimulationError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.model import Language, Model
from wmr_afl.simulation.kernels.block import Watched
from wmr_afl.simulation.kernels.compiled import Kernel
from wmr_afl.simulation.kernels.interpreted import bind
from wmr_afl.simulation.layout import Layout

Numbers = NDArray[np.float64]


class Controller:
    """u = controller.update(t, x), once a sample: the law with its own state, traced once, compiled where possible.

    `reference` is followed at the times that `update` is given; `sample_time` [s] is the time between two updates.
    What reaches the motors is taken to be what was commanded, within `limits` [V] (n_u,) where those are given.
    Raises: MissingTermError, where the law does not fit the model.
    """

    def __init__(
        self,
        model: Model,
        law: TrackingController,
        reference: Reference,
        sample_time: float,
        limits: ArrayLike | None = None,
    ) -> None:
        self.model, self.law, self.reference, self.sample_time = model, law, reference, sample_time
        self._inputs, self._states = len(model.input_units), len(model.state_units)
        self._limits = np.full(self._inputs, np.inf) if limits is None else np.asarray(limits, dtype=float)
        if self._limits.shape != (self._inputs,) or not np.all(self._limits > 0):
            raise ShapeError(f"limits are {limits!r}", f"expected {self._inputs} positive voltages")
        self._x, self._t, self._out = np.zeros(self._states), np.zeros(1), np.zeros(self._inputs + 2)
        self._now = self._before = Layout(law.states).pack(law.states)
        self._run = self._compiled_if_possible(self._traced())

    @classmethod
    def from_experiment(cls, experiment: str | Path, controller: str | None = None) -> Controller:
        """The controller of an experiment, the first unless named, with its reference, sample time and input limits.

        Raises: InputError, UnknownNameError.
        """
        loaded = load_experiment(experiment)
        loop = loaded.loops[loaded.name(controller)]
        limits = loop.plant.limits.limit if loop.plant.limits else None
        return cls(loop.model, loop.controller, loop.reference, loop.sample_time, limits)

    def update(self, t: float, x: ArrayLike) -> Numbers:
        """The voltages (n_u,) at time t [s] for the measured state x (2n-m,).

        Raises: ShapeError, where x does not fit; SimulationError, where Dhat is singular or something is not finite:
        the controller then stays as it was before the call.
        """
        measured = np.asarray(x, dtype=float)
        if measured.shape != (self._states,):
            names = ", ".join(self.model.state_units)
            raise ShapeError(f"x has shape {measured.shape}", f"expected ({self._states},): {names}")
        self._x[:], self._t[0], self._before[:] = measured, t, self._now
        self._run()
        if not (self._out[-1] > 0.0 and isfinite(self._out[-2])):
            self._now[:] = self._before
            raise SimulationError(f"at t = {t} s Dhat is singular, or x, t or what follows from them is not finite")
        return self._out[:-2].copy()

    @property
    def estimate(self) -> Numbers:
        """theta_hat (n_theta,)."""
        return self._now[Layout(self.law.states).places["theta_hat"]].copy()

    def reset(self) -> None:
        """Back to the first estimate."""
        self._now[:] = Layout(self.law.states).pack(self.law.states)

    def _compiled_if_possible(self, step: ca.Function) -> Callable[[], None]:
        """A call that advances the law's state, where `_before` holds it too, from t and x, and leaves the inputs."""
        try:
            kernel = Kernel(step, Watched(regularity=self._inputs + 1), logged=True)
        except CompilerError:
            self._before = self._now.copy()
            return bind(step, (self._before, self._t, self._x, np.zeros(0)), (self._now, self._out))
        block, held = kernel.start(self._now[:, None]), kernel.prepare(np.zeros((0, 1)))
        self._kept, self._now = (block, held), block.state[:, 0]  # `_kept` only lives on
        return kernel.bound(block, self._t, self._x, held, self._out)

    def _traced(self) -> ca.Function:
        """(state of the law, t, x, nothing) -> (next state of the law, [u, a sum of all, regularity])."""
        language, states = Language.of(self.model, "casadi"), Layout(self.law.states)
        k = SimpleNamespace(**{name: ca.DM(value) for name, value in self.law.values.items()})
        flat, t, x = ca.SX.sym("z", states.size), ca.SX.sym("t"), ca.SX.sym("x", self._states)
        z = states.unpack_symbols(flat)
        action = self.law.act(x, self.reference.at(t), z, k, language)
        applied = ca.fmin(ca.fmax(action.input, -self._limits), self._limits)
        following = self.law.update(x, action, applied, z, k, self.sample_time, language)
        after = states.pack_symbols(following)
        total = t + ca.sum1(x) + ca.sum1(action.input) + ca.sum1(after)  # finite only where all of these are
        outputs = ca.cse([ca.densify(after), ca.densify(ca.vertcat(applied, total, action.regularity))])
        return ca.Function("controller", [flat, t, x, ca.SX.sym("none", 0)], outputs)
