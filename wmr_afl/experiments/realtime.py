"""A controller for a robot's own loop: measured state in, voltages out, the same law as in the simulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.tracking_law import TrackingLaw
from wmr_afl.errors import CompilerError, ShapeError, SimulationError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import Parts, by_part, disjoint, prefixed
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.simulation.kernels.block import Watched
from wmr_afl.simulation.kernels.compiled import Kernel
from wmr_afl.simulation.kernels.interpreted import bind
from wmr_afl.simulation.layout import Layout


class Controller:
    """u = controller.update(t, x), once a sample: the law with its own state, traced once, compiled if possible.

    `reference` is followed at the times that `update` is given; `sample_time` [s] is the time between two updates.
    `drive`: what the robot's drive does to a command, such as limits and a delay: what has no memory is done to the
    voltages that are returned, and all of it is taken into account by a law that looks at the applied input.

    Raises:
        MissingTermError: if the law does not fit the model.
    """

    def __init__(
        self,
        model: Model,
        law: TrackingLaw,
        reference: Reference,
        sample_time: float,
        drive: Sequence[Uncertainty] = (),
    ) -> None:
        self.model, self.law, self.reference, self.sample_time = model, law, reference, sample_time
        self.drive = Parts(drive)
        self._inputs, self._states = len(model.input_units), len(model.state_units)
        self._start = disjoint(law.states, self.drive.states)
        self._x, self._t, self._out = np.zeros(self._states), np.zeros(1), np.zeros(self._inputs + 2)
        self._now = self._before = Layout(self._start).pack(self._start)
        self._run = self._compiled_if_possible(self._traced())

    @classmethod
    def from_experiment(cls, experiment: str | Path, controller: str | None = None) -> Controller:
        """The controller of an experiment, the first unless named, with its reference, sample time and drive.

        Raises:
            InputError: if the file has a mistake.
            UnknownNameError: if there is no such experiment or controller.
        """
        loaded = load_experiment(experiment)
        loop = loaded.loops[loaded.name(controller)]
        drive = [part for part in loop.plant.uncertainties if part.is_of_drive]
        return cls(loop.model, loop.law, loop.reference, loop.sample_time, drive)

    def update(self, t: float, x: ArrayLike) -> Floats:
        """The voltages (n_u,) at time t [s] for the measured state x (2n-m,).

        Raises:
            ShapeError: if x does not fit.
            SimulationError: if Dhat is singular or something is not finite; the controller then stays as it was.
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
    def estimate(self) -> Floats:
        """theta_hat (n_theta,)."""
        return self._now[Layout(self._start).places["theta_hat"]].copy()

    def reset(self) -> None:
        """Back to the first estimate."""
        self._now[:] = Layout(self._start).pack(self._start)

    def _compiled_if_possible(self, step: ca.Function) -> Callable[[], None]:
        """A call that advances the states `_now`, copied in `_before`, from `_t` and `_x`, and writes `_out`."""
        try:
            kernel = Kernel(step, Watched(regularity=self._inputs + 1), logged=True)
        except CompilerError:
            self._before = self._now.copy()
            return bind(step, (self._before, self._t, self._x, np.zeros(0)), (self._now, self._out))
        block, held = kernel.start(self._now[:, None]), kernel.prepare(np.zeros((0, 1)))
        self._kept, self._now = (block, held), block.state[:, 0]  # `_kept` only lives on
        return kernel.bound(block, self._t, self._x, held, self._out)

    def _traced(self) -> ca.Function:
        """(states, t, x, nothing) -> (next states, [u, a sum of all, regularity])."""
        model, layout = self.model.in_library("casadi"), Layout(self._start)
        values = disjoint(self.law.values, self.drive.values)
        k = by_part({name: ca.DM(value) for name, value in values.items()})
        flat, t, x = ca.SX.sym("z", layout.size), ca.SX.sym("t"), ca.SX.sym("x", self._states)
        z = layout.unpack_symbols(flat)
        action = self.law.act(x, self.reference.at(t), z, k, model)
        returned = applied = action.input
        following: dict[str, Any] = {}
        for key, part, state, own in self.drive.with_states(z, k):
            following |= prefixed(key, part.update(applied, state, own, model.arrays))
            applied = part.applied(applied, state, own, model.arrays)
            returned = returned if part.states else part.applied(returned, state, own, model.arrays)
        following |= self.law.update(x, action, applied, z, k, model, self.sample_time)
        after = layout.pack_symbols(following)
        total = t + ca.sum1(x) + ca.sum1(action.input) + ca.sum1(after)  # finite only if all of these are
        outputs = ca.cse([ca.densify(after), ca.densify(ca.vertcat(returned, total, action.regularity))])
        return ca.Function("controller", [flat, t, x, ca.SX.sym("none", 0)], outputs)
