"""A controller for a robot's own loop: measured state in, voltages out, the same law as in the simulator."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from decimal import Decimal
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.law import Law
from wmr_afl.controllers.live_reference import LiveReference, Setpoint
from wmr_afl.controllers.observer import Observer
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.errors import CompilerError, ShapeError, SimulationError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.model import Model
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import Fixed, Parts, by_part, disjoint, prefixed
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.simulation.kernels.block import Watched
from wmr_afl.simulation.kernels.compiled import Kernel
from wmr_afl.simulation.kernels.interpreted import bind
from wmr_afl.simulation.layout import Layout
from wmr_input.errors import plain, shown

PARTS = ("yr", "yr1", "yr2")  # of a setpoint
SAME = 1e-6  # of a sample time, by which clocks jitter: steps that differ less are a sample time, as in the simulator
STALE = 1.5  # sample times; after a longer step nothing is learned by comparing a sample with the one before
LONGEST_STEP = 2.0  # sample times; the law's states move by no more at once
LONGEST_GAP = 10.0  # sample times; after a longer gap nothing is learned from the sample before
MEASURED = "fiuO"  # NumPy's types of what is measured: no truth values, no text
UNSOUND = "measure again; where Dhat is inverted bound the estimates, else keep away from there"
LATEST = 1e11  # [s], some 3000 years: beyond, the clock counts something else than seconds


class Controller(Fixed):
    """u = controller.update(t, x), once a sample: the law with its own state, traced once, compiled if possible.

    `reference` is followed at the times that `update` is given; `sample_time` [s] is the time between two updates that
    the gains were chosen for. Time that really passed moves estimates and other states, up to two sample times at once.
    After a gap of more than `max_gap` [s], ten sample times unless given, voltages are computed as ever, but the states
    stay as they are for that sample: nobody knows what happened in between. Parts that compare a sample with the last
    one, as least squares and a reference model, then begin again.

    `drive`: what the robot's drive does to a command, such as limits and a delay: what has no memory is done to the
    voltages that are returned, and all of it is taken into account by a law that looks at the applied input.

    One controller may be called from several threads; each call is done before the next begins.

    Raises:
        MissingTermError: if the law does not fit the model.
        UnknownNameError: if the reference names another output.
        WmrError: if an output has no reference, or a time is not positive.
    """

    @checked
    def __init__(
        self,
        model: Model,
        law: Law,
        reference: Reference,
        sample_time: float,
        drive: Sequence[Uncertainty] = (),
        max_gap: float | None = None,
    ) -> None:
        self.model, self.law, self.sample_time = model, law, float(sample_time)
        self.reference = reference.ordered(list(model.output_units))
        self.max_gap = LONGEST_GAP * self.sample_time if max_gap is None else float(max_gap)
        if not (0.0 < self.sample_time < inf and self.max_gap >= self.sample_time):
            raise WmrError(
                f"a sample time of {sample_time} s and a longest gap of {self.max_gap} s",
                "choose 0 < sample_time <= max_gap",
            )
        self.drive = Parts(drive)
        self.measured = tuple(model.state_units) if law.measurement is None else law.measurement.names
        self._inputs, self._size = len(model.input_units), len(self.measured)
        self._layout = Layout(disjoint(law.states, self.drive.states))
        self._start = self._layout.pack(disjoint(law.states, self.drive.states))
        places = {name: place for name, place in self._layout.places.items() if name.endswith(".is_running")}
        self._restarts = [place.start for place in places.values()]
        exact = tuple(f"{part.name}." for part in (ReferenceModel, Observer))  # go by the time that has passed
        self._comparing = [place.start for name, place in places.items() if not name.startswith(exact)]
        self._watching = [place.start for name, place in places.items() if name.startswith(f"{Observer.name}.")]
        self._usual = (1.0 - SAME) * self.sample_time, (1.0 + SAME) * self.sample_time
        self._given, self._out = np.zeros(self._size + 1), np.zeros(self._inputs + 2)
        self._now_given = np.ravel(
            self.reference.clock(np.zeros(1), law.lead)
        ).copy()  # t, and more unless it is a formula
        self._is_formula = self._now_given.size == 1
        self._x, self._step_given = self._given[:-1], self._given[-1:]
        self._now, self._before, self._run = self._compiled_if_possible(self._traced())
        self._lock, self._clock = threading.Lock(), [-inf]  # time of the last update [s]
        self._last, self._recent = self._start.copy(), [0.0]  # the states and the step of the last update

    @classmethod
    @checked
    def from_experiment(
        cls, experiment: str | Path, controller: str | None = None, is_live: bool = False
    ) -> Controller:
        """The controller of an experiment, the first unless named, with its reference, sample time and drive.

        With `is_live` the reference is given with each sample instead.

        Raises:
            InputError: if the file has a mistake.
            UnknownNameError: if there is no such experiment or controller.
        """
        loaded = load_experiment(experiment)
        loop = loaded.loops[loaded.name(controller)]
        drive = [part for part in loop.plant.uncertainties if part.is_of_drive]
        reference = loop.reference
        if is_live:
            reference = LiveReference(list(loop.model.output_units), reference.counts_turns)
        return cls(loop.model, loop.law, reference, loop.sample_time, drive)

    def update(self, t: float, x: ArrayLike, reference: Setpoint | None = None) -> Floats:
        """The voltages (n_u,) at time t [s] for what is measured, x: entries as `measured` names them.

        `reference`: yr, yr', yr'' (n-m,) each of a `LiveReference`, as `ReferenceBuffer.at` gives them.

        These are the state (2n-m,), unless the controller's table says which entries, or rates of motors, are measured.

        A second call at the same time is no new sample: for the same x it gives the same voltages, and changes nothing.

        Raises:
            ShapeError: if x or t does not fit.
            SimulationError: if what is inverted is singular, something is not finite, or time goes back; the
                controller then stays as it was.
        """
        measured = x if type(x) is np.ndarray and x.dtype == np.float64 else real_numbers("x", x, kinds=MEASURED)
        if measured.shape == (len(self.model.state_units),) != (self._size,) and self.law.measurement is not None:
            picked = self.law.measurement.picked(measured)  # whoever has all of the state may give it
            measured = measured if picked is None else picked
        if measured.shape != (self._size,):
            names = ", ".join(self.measured)
            raise ShapeError(f"x has shape {measured.shape}", f"expected ({self._size},): {names}")
        time = t if type(t) is float else _seconds(t)
        wanted = None if self._is_formula and reference is None else self._reference_at(time, reference)
        with self._lock:
            passed = time - self._clock[0]
            step = self.sample_time if self._usual[0] < passed < self._usual[1] else self._step(time, passed)
            kept, is_again = self._now.copy(), passed == 0.0
            if is_again:  # the same sample, from where it was computed
                step = self._recent[0]
                self._now[:] = self._last
            elif STALE * self.sample_time < passed < inf:
                self._now[self._comparing] = 0.0
                if passed > self.max_gap:  # nobody knows where the robot went: the observer begins again
                    self._now[self._watching] = 0.0
            self._x[:], self._step_given[0], self._now_given[0], self._before[:] = measured, step, time, self._now
            if wanted is not None:
                self._now_given[1:] = wanted
            self._run()
            is_sound = self._out[-1] > 0.0 and isfinite(self._out[-2])
            if is_again or not is_sound:
                self._now[:] = kept
            else:
                self._last[:], self._recent[0] = self._before, step
                if step == 0.0:  # a gap
                    self._now[:] = kept
                    self._now[self._restarts] = 0.0
            if not is_sound:
                why, remedy = self._unsound(time, measured)
                raise SimulationError(f"at t = {t} s {why}", remedy)
            self._clock[0] = time
            return self._out[:-2].copy()

    def _reference_at(self, time: float, given: Setpoint | None) -> Floats:
        """What the step is given of the reference besides the time."""
        if given is None:
            if isinstance(self.reference, LiveReference):
                self.reference.at(time)
            return np.ravel(self.reference.clock(np.array([time]), self.law.lead))[1:]
        if not isinstance(self.reference, LiveReference):
            raise SimulationError(
                "the controller has a reference of its own", "build it with a LiveReference, or give no reference"
            )
        size = len(self.model.output_units)
        rows = [real_numbers(name, one, f"give {size} numbers") for name, one in zip(PARTS, given, strict=True)]
        for name, row in zip(PARTS, rows, strict=True):
            if row.shape != (size,):
                raise ShapeError(
                    f"{name} has shape {row.shape}", f"expected ({size},): {', '.join(self.model.output_units)}"
                )
        return np.concatenate(rows)

    @property
    def estimate(self) -> Floats:
        """theta_hat (n_theta,), not to be written into; see `load_state`."""
        with self._lock:
            estimate = self._now[self._layout.places["theta_hat"]].copy()
        estimate.flags.writeable = False
        return estimate

    def state_dict(self) -> dict[str, list[float]]:
        """The states of law and drive by name, ready for JSON: what `load_state` takes after a restart."""
        with self._lock:
            return {name: np.ravel(value).tolist() for name, value in self._layout.unpack(self._now.copy()).items()}

    @checked
    def load_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Goes on with states as `state_dict` gave them, or with some of them; gains and bounds stay as they are.

        Raises:
            ShapeError: if a name or a number does not fit; the controller then stays as it was.
        """
        with self._lock:
            following = self._layout.unpack(self._now.copy())
            for name, value in state.items():
                if name not in following:
                    remedy = f"there is {', '.join(following)}"
                    raise ShapeError(f"{plain(name)!r} is not a state of this controller", remedy)
                numbers = real_numbers(f"state {name}", value, kinds=MEASURED)
                if numbers.shape != following[name].shape or not np.isfinite(numbers).all():
                    remedy = f"expected {following[name].size} finite numbers"
                    raise ShapeError(f"state {name} is {shown(value)}", remedy)
                following[name] = numbers
            self._now[:] = self._layout.pack(following)
            self._last[:], self._recent[0] = self._now, 0.0

    def reset(self) -> None:
        """Back to the first estimate, and to a clock that has not started."""
        with self._lock:
            self._now[:], self._clock[0] = self._start, -inf
            self._last[:] = self._start

    def __reduce__(self) -> tuple[Callable[..., Controller], tuple[Any, ...]]:
        """A copy is a controller of its own, in the same state."""
        built = (self.model, self.law, self.reference, self.sample_time, list(self.drive), self.max_gap)
        return _restored, (built, self.state_dict(), self._clock[0])

    def _step(self, time: float, passed: float) -> float:
        """By how much the states move [s]: the time that passed since the last update, within bounds."""
        if passed == inf and abs(time) < LATEST:  # the first one
            return self.sample_time
        if passed < 0.0:
            raise SimulationError(f"time went back from {self._clock[0]} s to {time} s", "call reset() to start again")
        if abs(time) >= LATEST:
            raise SimulationError(f"t is {time:g}", "give seconds")
        if passed > self.max_gap:
            return 0.0
        return min(passed, LONGEST_STEP * self.sample_time)

    def _unsound(self, time: float, measured: Floats) -> tuple[str, str]:
        """Why there are no voltages, the first cause that shows, and what helps."""
        if not isfinite(time):
            return "the time is not finite", UNSOUND
        if not np.isfinite(self._now_given).all():
            return "the reference as given is not finite", UNSOUND
        wrong = [name for name, value in zip(self.measured, measured, strict=True) if not isfinite(value)]
        if wrong:
            return f"{', '.join(wrong)} as measured {'is' if len(wrong) == 1 else 'are'} not finite", UNSOUND
        surprise = self._surprise()
        if surprise is not None:
            return (
                f"the observer is lost: what is measured differs by {surprise:.3g} m or rad from what it expected",
                f"measure again, wait for a gap of {self.max_gap:g} s, after which it begins again, or call reset()",
            )
        if not self._out[-1] > 0.0:
            return "what is inverted is singular", UNSOUND
        return "the voltages, or the estimates after them, are not finite", UNSOUND

    def _surprise(self) -> float | None:
        """By how much the last sample differs from what an observer expected, if that is what made it unsound."""
        if not self.law.observes or self._out[-1] > 0.0:
            return None
        model = self.model.in_library("numpy")
        k, z = by_part(disjoint(self.law.values, self.drive.values)), by_part(self._layout.unpack(self._before.copy()))
        _, _, wanted = self.reference.seen(
            self._now_given if not self._is_formula else float(self._now_given[0]), self.law.lead
        )
        with np.errstate(all="ignore"):
            action = self.law.act(self._x.copy(), wanted, z, k, model, float(self._step_given[0]))
        surprise = float(action.memory["view"].surprise)
        return surprise if surprise >= float(k.observer.bound[0]) else None

    def _compiled_if_possible(self, step: ca.Function) -> tuple[Floats, Floats, Callable[[], None]]:
        """The states, room for the states before, and a call that advances them from t and x and leaves the inputs."""
        now = self._start.copy()
        try:
            kernel = Kernel(step, Watched(regularity=self._inputs + 1, checked=(self._inputs,)), logged=True)
        except CompilerError:
            before = now.copy()
            return now, before, bind(step, (before, self._now_given, self._given, np.zeros(0)), (now, self._out))
        block, held = kernel.start(now[:, None]), kernel.prepare(np.zeros((0, 1)))
        self._kept = block, held  # which the bound call reads
        return block.state[:, 0], now, kernel.bound(block, self._now_given, self._given, held, self._out)

    def _traced(self) -> ca.Function:
        """(states, t, [x; time that passed], nothing) -> (next states, [u, a sum of all, regularity])."""
        model = self.model.in_library("casadi")
        k = by_part({name: ca.DM(value) for name, value in disjoint(self.law.values, self.drive.values).items()})
        flat, given = ca.SX.sym("z", self._layout.size), ca.SX.sym("given", self._size + 1)
        clock = ca.SX.sym("t", self._now_given.size)
        _, _, wanted = self.reference.seen(clock, self.law.lead)
        z, x, step = self._layout.unpack_symbols(flat), given[:-1], given[-1]
        action = self.law.act(x, wanted, z, k, model, step)
        returned = applied = action.input
        following: dict[str, Any] = {}
        for key, part, state, own in self.drive.with_states(z, k):
            following |= prefixed(key, part.update(applied, state, own, model.arrays))
            applied = part.applied(applied, state, own, model.arrays)
            returned = returned if part.states else part.applied(returned, state, own, model.arrays)
        following |= self.law.update(x, action, applied, z, k, model, step)
        after = self._layout.pack_symbols(following)
        total = ca.sum1(clock) + ca.sum1(x) + ca.sum1(action.input) + ca.sum1(after)  # finite only if all of these are
        outputs = ca.cse([ca.densify(after), ca.densify(ca.vertcat(returned, total, action.regularity))])
        return ca.Function("controller", [flat, clock, given, ca.SX.sym("none", 0)], outputs)


def _seconds(t: Any) -> float:
    """A time [s] as a float.

    Raises:
        ShapeError: if it is not a real number.
    """
    value = t[()] if isinstance(t, np.ndarray) and t.shape == () else t
    if not isinstance(value, bool | np.timedelta64) and isinstance(value, Real | Decimal):
        with suppress(OverflowError):
            return float(value)
    raise ShapeError(f"t is {shown(t)}", "give seconds as a number")


def _restored(built: tuple[Any, ...], state: Mapping[str, ArrayLike], clock: float) -> Controller:
    controller = Controller(*built)
    controller.load_state(state)
    controller._clock[0] = clock
    return controller
