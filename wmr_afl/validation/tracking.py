"""The controllers of an experiment drive the engine's robot, whose dynamics they have never seen in its own form.

The simulator runs the loop as ever, noise, delays and limits included, but for the motion of the robot itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.plant.joint_stops import JointStops
from wmr_afl.plant.plant import Plant
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.simulation.closed_loop import ClosedLoop, trace
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.layout import Layout
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate
from wmr_afl.simulation.steppers import Chunk
from wmr_afl.validation.engine import Engine, Grip, Watch
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, ample_friction

STEP = 1e-3  # [s], the longest of the engine's first run
LEAST = 1e-3  # [m, rad], of what outputs move by
ROWS = 200  # samples that are looked through for a failure at once
FORCES = "load", "resistance", "rate", "parameters"  # hooks by which an uncertainty acts on the motion


class Standing(Plant):
    """A robot whose state something else moves."""

    def moved(self, t: Array, x: Array, u: Array, k: SimpleNamespace, model: Model, step: Array) -> Array:
        """x as it is."""
        return x


@dataclass(frozen=True)
class Tracked:
    """One controller, in the simulator and in the engine."""

    controller: str
    simulated: Run  # by Runge and Kutta's method
    coarse: Run  # in the engine
    fine: Run  # with half the step
    step: float  # [s], of the engine in the coarse run
    grip: Grip
    left_out: tuple[str, ...]  # uncertainties that neither has

    @property
    def is_complete(self) -> bool:
        """Whether no run failed."""
        return all(run.failure is None for run in (self.simulated, self.coarse, self.fine))

    @property
    def errors(self) -> Floats:
        """(4, n-m), root mean square of y - yr: simulated, in the engine with both steps, and extrapolated."""
        every = (self.simulated.error, self.coarse.error, self.fine.error, 2.0 * self.fine.error - self.coarse.error)
        return np.array([np.sqrt(np.mean(error**2, axis=0)) for error in every])

    @property
    def apart(self) -> Floats:
        """(3, n-m), root mean square of what outputs differ by from the simulator's: both steps, extrapolated."""
        told, coarse, fine = (run.output for run in (self.simulated, self.coarse, self.fine))
        return np.array([np.sqrt(np.mean((y - told) ** 2, axis=0)) for y in (coarse, fine, 2.0 * fine - coarse)])

    @property
    def share(self) -> float:
        """The largest extrapolated difference, over the root mean square of what its kind of output moves by."""
        moves = self.simulated.output - self.simulated.output.mean(axis=0)
        size = np.sqrt(np.mean(moves**2, axis=0))
        units = list(self.simulated.model.output_units.values())
        largest = [max(size[i] for i, other in enumerate(units) if other == unit) for unit in units]
        return float((self.apart[2] / np.maximum(largest, LEAST)).max())


def track(
    loop: ClosedLoop, controller: str, duration: float, height: float | None = None, watch: Watch | None = None
) -> Tracked:
    """Run a loop in the simulator and twice in the engine, in space if `height` [m] of the masses is given.

    Raises:
        WmrError: if the engine cannot have the robot, wheels slip or leave the floor, or a joint comes to its stop,
            which the engine has not.
    """
    parts = [part for part in loop.plant.uncertainties if not isinstance(part, JointStops)]
    left_out = [part for part in parts if _acts_on_motion(part)]
    kept = [part for part in parts if part not in left_out]
    given = loop.model, loop.plant.parameters, loop.plant.start, "rk4", kept
    simulated = simulate(replace(loop, plant=Plant(*given)), duration, controller)
    _check_stops(simulated)
    still, mechanism = replace(loop, plant=Standing(*given)), Mechanism(loop.model, loop.plant.parameters)
    step = loop.sample_time / np.ceil(loop.sample_time / STEP - 1e-9)
    first = _Moving(mechanism, controller, step, height, watch)
    second = _Moving(mechanism, controller, 0.5 * step, height)
    coarse, fine = (simulate(still, duration, controller, moving) for moving in (first, second))
    names = tuple(part.name for part in left_out)
    return Tracked(controller, simulated, coarse, fine, step, first.grip.beside(second.grip), names)


@dataclass
class _Moving:
    """A stepper of the simulator: the loop's own step, traced, and the robot in the engine."""

    mechanism: Mechanism
    controller: str
    step: float  # [s]
    height: float | None
    watch: Watch | None = None

    def __post_init__(self) -> None:
        self.grip = Grip.none(len(self.mechanism.wheels))

    def __call__(self, loop: ClosedLoop, robot: Ensemble, times: Floats, noise: Floats | None) -> Iterator[Chunk]:
        engine, steps = self._engine(loop.plant.start), round(loop.sample_time / self.step)
        step, places, x = trace(loop), loop.signal_layout.places, Layout(loop.states).places["x"]
        z, k, clock = robot.states[:, 0], robot.values[:, 0], loop.clock(times)
        samples = np.zeros((len(times), 0)) if noise is None else noise
        rows: list[Floats] = []
        for i, time in enumerate(times.tolist()):
            z[x] = engine.state
            z, row = (one.full().ravel() for one in step(z, clock[i], samples[i], k))
            rows.append(row)
            is_lost = not np.all(np.isfinite(row)) or row[places["regularity"]][0] <= 0.0
            if is_lost or len(rows) == ROWS or i == len(times) - 1:
                yield Chunk(np.array(rows), False)
                rows = []
            engine.drive(row[places["u"]], steps)
            self.grip = self.grip.beside(engine.grip)
            self.grip.check(self.mechanism, ample_friction(self.mechanism), self.controller)
            if self.watch is not None:
                self.watch(engine, time)

    def _engine(self, start: Floats) -> Engine:
        """At x (2n-m,)."""
        model, p = self.mechanism.model, self.mechanism.p
        q, v = start[: model.coordinate_count], start[model.coordinate_count :]
        contact = Contact(self.step, ample_friction(self.mechanism))
        engine = Engine(self.mechanism, contact, self.mechanism.loads(q), self.height)
        engine.start(q, np.asarray(model.in_library("numpy").kinematic_matrix(q, p)) @ v)
        return engine


def _acts_on_motion(part: Uncertainty) -> bool:
    return any(getattr(type(part), hook) is not getattr(Uncertainty, hook) for hook in FORCES)


def _check_stops(run: Run) -> None:
    """Fails if a joint came to its stop."""
    if not run.model.has("joint_stops"):
        return
    model = run.model.in_library("numpy")
    p = np.broadcast_to(run.parameters, (len(run.state), len(run.parameters)))
    if np.asarray(model.joint_stops(run.state[:, : model.coordinate_count], p)).min() <= 1e-6:
        problem = f"{run.controller} brings a joint of {model.name} to its stop, which the engine does not have"
        raise WmrError(problem, "choose a reference that keeps away from stops")
