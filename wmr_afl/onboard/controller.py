"""A controller for a robot's own loop: measured state in, voltages out, the same law as in the simulator."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.law import Law
from wmr_afl.controllers.live_reference import LiveReference, ReferenceBuffer, Setpoint
from wmr_afl.controllers.reference import Reference
from wmr_afl.errors import CompilerError, ShapeError, SimulationError, UnknownNameError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.model import Model
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import Fixed, by_part
from wmr_afl.onboard.runners import Compiled, Interpreted, Runner
from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.onboard.status import Status
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_input.errors import plain, shown

PARTS = ("yr", "yr1", "yr2")  # of a setpoint
SAME = 1e-6  # of a sample time, by which clocks jitter: steps that differ less are a sample time, as in the simulator
ARRAY = np.ndarray  # looked up at every sample
MEASURED = "fiuO"  # NumPy's types of what is measured: no truth values, no text
UNSOUND = "measure again; where Dhat is inverted bound the estimates, else keep away from there"
LATEST = 1e11  # [s], some 3000 years: beyond, the clock counts something else than seconds


@dataclass(frozen=True)
class Diagnostics:
    """What the last call of `Controller.update` tells besides voltages; zeros unless it came to be computed."""

    status: Status
    command: Floats  # (n_u,) [V], before any limit
    saturated: tuple[str, ...]  # motors whose voltage is not what the law asked for
    error: Floats  # e = y - yr (n-m,)
    filtered_error: Floats  # E1 = e' + alpha e (n-m,)
    regularity: float  # positive if what is inverted is regular
    at_bound: tuple[str, ...]  # estimates that lie on a bound
    reference_age: float | None  # [s] since the last setpoint of a buffer, negative if there are points to come
    observed: Floats | None  # x as an observer makes it out
    surprise: float | None  # [m, rad], by how much what is measured differs from what an observer or the gate expected


class Controller(Fixed):
    """u = controller.update(t, x), once a sample: the law with its own state, traced once, compiled if possible.

    `reference` is followed at the times that `update` is given; `sample_time` [s] is the time between two updates that
    the gains were chosen for. Time that really passed moves estimates and other states, up to two sample times at once.
    After a gap of more than `max_gap` [s], ten sample times unless given, voltages are computed as ever, but the states
    stay as they are for that sample: nobody knows what happened in between. Parts that compare a sample with the last
    one, as least squares and a reference model, then begin again.

    `drive`: what the robot's drive does to a command, such as limits and a delay, see `SampledLaw`.

    `gate` [output units]: a sample whose outputs are farther from what the last one leads to is refused.

    With `hears_applied` each call may tell what reached the motors after the last one.

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
        hears_applied: bool = False,
        gate: float | None = None,
    ) -> None:
        self.sampled = sampled = SampledLaw(model, law, reference, sample_time, drive, max_gap, gate)
        self.model, self.law, self.reference = model, law, sampled.reference
        self.sample_time, self.max_gap, self.measured = sampled.sample_time, sampled.max_gap, sampled.measured
        self._shape = (len(self.measured),)
        self._usual = (1.0 - SAME) * self.sample_time, (1.0 + SAME) * self.sample_time
        self._is_formula = sampled.clock_size == 1
        self._runner = _runner(sampled)
        self._state = self._runner.state
        # To be written at every sample; a view of memory takes half the time of an array.
        views: list[Any] = [memoryview(array) for array in (self._runner.dt, self._runner.x, self._runner.clock)]  # type: ignore[arg-type]
        self._dt, self._x, self._clock = views
        self._sample, self._u = self._runner.sample, self._runner.u
        if hears_applied and not sampled.minds_applied:
            raise WmrError(
                "nothing that this law learns depends on what reached the motors",
                'leave hears_applied out, or learn from it: adaptation = { input = "applied" }, or the composite law',
            )
        self._told = _runner(sampled, is_told=True) if hears_applied else None
        self._lock, self._learns = threading.Lock(), [True]
        self._last = [-inf, self.sample_time]  # time of the last sound update, and the step to it [s]
        self._seen: list[Any] = [Status.OK, None]  # status of the last call, and the age of its reference

    @classmethod
    @checked
    def from_experiment(
        cls,
        experiment: str | Path,
        controller: str | None = None,
        is_live: bool = False,
        hears_applied: bool = False,
        gate: float | None = None,
    ) -> Controller:
        """The controller of an experiment, the first unless named, with its reference, sample time and drive.

        With `is_live` the reference is given with each sample instead.

        Raises:
            InputError: if the file has a mistake.
            UnknownNameError: if there is no such experiment or controller.
        """
        loaded = load_experiment(experiment)
        loop = loaded.loops[loaded.name(controller)]
        reference, drive = loop.reference, loop.plant.drive
        if is_live:
            reference = LiveReference(list(loop.model.output_units), reference.counts_turns)
        return cls(loop.model, loop.law, reference, loop.sample_time, drive, hears_applied=hears_applied, gate=gate)

    def update(
        self,
        t: float,
        x: ArrayLike,
        reference: Setpoint | ReferenceBuffer | None = None,
        applied: ArrayLike | None = None,
    ) -> Floats:
        """The voltages (n_u,) at time t [s] for what is measured, x: entries as `measured` names them.

        These are the state (2n-m,), unless the controller's table says which entries, or rates of motors, are measured.

        `reference`: yr, yr', yr'' (n-m,) each of a `LiveReference`, or the `ReferenceBuffer` that gives them.

        `applied`: the voltages (n_u,) that reached the motors since the last sample that was sound, if that is known
        better than by what the drive was said to do: what was learned from that sample is learned again with these.

        A second call at the same time is no new sample: for the same x it gives the same voltages, and changes nothing.

        Raises:
            ShapeError: if x or t does not fit.
            SimulationError: if what is inverted is singular, something is not finite, or time goes back; the
                controller then stays as it was, and `diagnostics` tells why.
        """
        try:
            time = t if type(t) is float else _seconds(t)
        except ShapeError:
            self._refused(Status.BAD_TIME_STEP)
            raise
        try:
            wanted = None if self._is_formula and reference is None else self._reference_at(time, reference)
        except WmrError:
            self._refused(Status.BAD_REFERENCE)
            raise
        with self._lock:
            passed, call = time - self._last[0], self._sample
            if self._usual[0] < passed < self._usual[1]:
                step = self.sample_time
            elif passed == 0.0:  # the same sample, from where it was computed
                step, call = self._last[1], self._runner.same_sample
            else:
                step = self._step(time, passed)
            try:
                self._x[:] = x if type(x) is ARRAY else self._converted(x)
            except ValueError:  # an array of other numbers, or of another shape
                self._x[:] = self._converted(x)
            self._dt[0], self._clock[0] = step, time
            if wanted is not None:
                self._runner.clock[1:], self._seen[1] = wanted
            is_usual = applied is None and self._learns[0]
            status = self._seen[0] = call() if is_usual else self._attended(call, applied)
            if status:
                raise SimulationError(*self._unsound(time, Status(status)))
            self._last[0], self._last[1] = time, step
            return self._u.copy()

    def _refused(self, status: Status) -> None:
        """What `diagnostics` tells of a call that came to nothing."""
        with self._lock:
            self._seen[1] = None
            self._nothing(status)

    def _nothing(self, status: Status) -> None:
        """The same within a call, unless what follows says otherwise."""
        self._seen[0] = status
        for told in self._runner.told.values():
            told[:] = 0.0

    def _order(self, outputs: tuple[str, ...]) -> list[int]:
        """Where the model's outputs lie in a buffer's.

        Raises:
            UnknownNameError: if it is of other outputs.
        """
        wanted = list(self.model.output_units)
        for name in {*outputs} ^ {*wanted}:
            raise UnknownNameError("output", name, wanted)
        return [outputs.index(name) for name in wanted]

    def _attended(self, call: Callable[[], int], applied: ArrayLike | None) -> int:
        """A sample before which the last one is corrected, or from which nothing is learned."""
        kept, is_new = self._state.copy(), call is self._sample
        if applied is not None and is_new:
            self._correct(applied)
        corrected, pauses = self._state.copy(), is_new and not self._learns[0]
        if pauses:
            self._state[self.sampled.silent] = 0.0
        status = call()
        if status:
            self._state[:] = kept
        elif pauses:
            self._state[self.sampled.learned] = corrected[self.sampled.learned]
        return status

    def _correct(self, applied: ArrayLike) -> None:
        """The states after the last sample, had `applied` reached the motors.

        Raises:
            ShapeError: if it does not fit.
            SimulationError: if it is not finite, or the controller was not built to hear of it.
        """
        self._nothing(Status.BAD_MEASUREMENT)
        if self._told is None:
            raise SimulationError(
                "the controller does not hear of applied voltages", "build it with hears_applied=True"
            )
        motors = list(self.model.input_units)
        volts = real_numbers("applied", applied, f"give {len(motors)} voltages", kinds=MEASURED)
        if volts.shape != (len(motors),):
            raise ShapeError(f"applied is {shown(applied)}", f"expected ({len(motors)},): {', '.join(motors)}")
        if not np.isfinite(volts).all():
            raise SimulationError(f"applied is {shown(applied)}", "give what is known, or leave it out")
        if self._last[0] == -inf:  # nothing has been learned yet
            return
        told, last, measured = self._told, self._runner.last, 1 + len(self.measured)
        told.state[:] = self._runner.before
        told.now[:] = np.concatenate([last[:measured], volts, last[measured:]])
        if told.sample() == Status.OK:
            moves = slice(None) if self._learns[0] else ~self.sampled.learned
            self._state[moves] = told.state[moves]

    def pause_learning(self) -> None:
        """From now on estimates stay, and data of the past is not joined to that of the future; the law goes on."""
        with self._lock:
            self._learns[0] = False

    def resume_learning(self) -> None:
        """Learn again from the next sample on."""
        with self._lock:
            self._learns[0] = True

    @property
    def is_learning(self) -> bool:
        """Whether estimates move, where the law has any that do."""
        return self.law.adapts and self._learns[0]

    def _converted(self, x: ArrayLike) -> Floats:
        """What is measured as numbers; of the whole state what is measured of it."""
        self._nothing(Status.BAD_MEASUREMENT)
        measured = real_numbers("x", x, kinds=MEASURED)
        if measured.shape == (len(self.model.state_units),) != self._shape and self.law.measurement is not None:
            picked = self.law.measurement.picked(measured)  # whoever has all of the state may give it
            measured = measured if picked is None else picked
        if measured.shape != self._shape:
            raise ShapeError(
                f"x has shape {measured.shape}", f"expected ({self._shape[0]},): {', '.join(self.measured)}"
            )
        return np.ascontiguousarray(measured, dtype=float)

    def _reference_at(self, time: float, given: Setpoint | ReferenceBuffer | None) -> tuple[Floats, float | None]:
        """What the step is given of the reference besides the time, and the age of a buffer's last point [s]."""
        if given is None:
            if isinstance(self.reference, LiveReference):
                self.reference.at(time)
            return np.ravel(self.reference.clock(np.array([time]), self.law.lead))[1:], None
        if not isinstance(self.reference, LiveReference):
            raise SimulationError(
                "the controller has a reference of its own", "build it with a LiveReference, or give no reference"
            )
        size = len(self.model.output_units)
        if isinstance(given, ReferenceBuffer):
            return np.concatenate([row[self._order(given.outputs)] for row in given.at(time)]), given.age(time)
        if not isinstance(given, Sequence | np.ndarray) or len(given) != len(PARTS):
            raise ShapeError(f"the reference given is {shown(given)}", f"give {', '.join(PARTS)}, or a ReferenceBuffer")
        rows = [real_numbers(name, one, f"give {size} numbers") for name, one in zip(PARTS, given, strict=True)]
        for name, row in zip(PARTS, rows, strict=True):
            if row.shape != (size,):
                raise ShapeError(
                    f"{name} has shape {row.shape}", f"expected ({size},): {', '.join(self.model.output_units)}"
                )
        return np.concatenate(rows), None

    @property
    def diagnostics(self) -> Diagnostics:
        """What the last call of `update` tells besides voltages."""
        with self._lock:
            told = {name: value.copy() for name, value in self._runner.told.items()}
            status, age = Status(self._seen[0]), self._seen[1]
            motors = [list(self.model.input_units)[i] for i in self._runner.saturated]
            estimates = [list(self.law.knowledge.units)[i] for i in self._runner.at_bound]
        return Diagnostics(
            status=status,
            command=told["command"],
            saturated=tuple(motors),
            error=told["error"],
            filtered_error=told["filtered_error"],
            regularity=float(told["regularity"][0]),
            at_bound=tuple(estimates),
            reference_age=age,
            observed=told.get("observed"),
            surprise=float(told["surprise"][0]) if "surprise" in told else None,
        )

    @property
    def deviation(self) -> Floats | None:
        """The standard deviation of each estimate as the law knows it, (n_theta,); None if it knows none."""
        if not self.law.knows_deviation:
            return None
        with self._lock:
            z = by_part(self.sampled.states.unpack(self._state.copy()))
        return self.law.deviation(z, self.model.in_library("numpy").arrays)

    @property
    def last_step(self) -> float:
        """The time between the last two sound samples as it was taken into account [s]."""
        return float(self._last[1])

    @property
    def as_measured(self) -> Floats:
        """What the last sample was given of what is measured, entries as `measured` names them."""
        with self._lock:
            return self._runner.x.copy()

    @property
    def states(self) -> Floats:
        """All states of law and drive, one after the other; `state_dict` names them."""
        with self._lock:
            return self._state.copy()

    @property
    def estimate(self) -> Floats:
        """theta_hat (n_theta,), not to be written into; see `load_state`."""
        with self._lock:
            estimate = self._state[self.sampled.states.places["theta_hat"]].copy()
        estimate.flags.writeable = False
        return estimate

    def state_dict(self) -> dict[str, list[float]]:
        """The states of law and drive by name, ready for JSON: what `load_state` takes after a restart."""
        with self._lock:
            return {
                name: np.ravel(value).tolist() for name, value in self.sampled.states.unpack(self._state.copy()).items()
            }

    @checked
    def load_state(self, state: Mapping[str, ArrayLike]) -> None:
        """Goes on with states as `state_dict` gave them, or with some of them; gains and bounds stay as they are.

        What was of the moment does not come back: parts that compare a sample with the last one begin again, the drive
        is at rest, and the clock has not started.

        Raises:
            ShapeError: if a name or a number does not fit; the controller then stays as it was.
            WmrError: if an estimate is beyond its bounds.
        """
        with self._lock:
            following = self.sampled.states.unpack(self._state.copy())
            for name, value in state.items():
                if name not in following:
                    remedy = f"there is {', '.join(following)}"
                    raise ShapeError(f"{plain(name)!r} is not a state of this controller", remedy)
                numbers = real_numbers(f"state {name}", value, kinds=MEASURED)
                if numbers.shape != following[name].shape or not np.isfinite(numbers).all():
                    remedy = f"expected {following[name].size} finite numbers"
                    raise ShapeError(f"state {name} is {shown(value)}", remedy)
                following[name] = numbers
            if self.law.bounds is not None:
                self.law.bounds.check(following["theta_hat"], list(self.law.knowledge.units))
            self._state[:] = self.sampled.states.pack(following)
            self._state[self.sampled.of_the_moment] = 0.0
            self._runner.before[:] = self._state
            self._last[:] = -inf, self.sample_time

    def reset(self) -> None:
        """Back to the first estimate, and to a clock that has not started."""
        with self._lock:
            self._state[:] = self._runner.before[:] = self.sampled.start
            self._last[:] = -inf, self.sample_time

    def __reduce__(self) -> tuple[Callable[..., Controller], tuple[Any, ...]]:
        """A copy is a controller of its own, in the same state."""
        drive = list(self.sampled.drive)
        hears_applied = self._told is not None
        gate = None if self.sampled.gate is None else float(self.sampled.gate.bound[0])
        built = (self.model, self.law, self.reference, self.sample_time, drive, self.max_gap, hears_applied, gate)
        with self._lock:
            memory = [array.copy() for array in self._memory]
            return _restored, (built, memory, list(self._last), list(self._learns))

    @property
    def _memory(self) -> tuple[Floats, ...]:
        """All that goes on from sample to sample."""
        return self._state, self._runner.before, self._runner.last, self._runner.now

    def _step(self, time: float, passed: float) -> float:
        """The time since the last sound update [s]; before the first one a sample time."""
        if passed == inf and abs(time) < LATEST:  # the first one
            return self.sample_time
        self._nothing(Status.BAD_TIME_STEP)
        if passed < 0.0:
            raise SimulationError(f"time went back from {self._last[0]} s to {time} s", "call reset() to start again")
        if abs(time) >= LATEST:
            raise SimulationError(f"t is {time:g}", "give seconds")
        return passed

    def _unsound(self, time: float, status: Status) -> tuple[str, str]:
        """Why there are no voltages, the first cause that shows, and what helps."""
        when = f"at t = {time} s"
        if status == Status.BAD_REFERENCE:
            if not isfinite(time):
                return f"{when} the time is not finite", "give seconds"
            return f"{when} the reference as given is not finite", "give finite numbers"
        if status == Status.BAD_MEASUREMENT:
            wrong = [name for name, value in zip(self.measured, self._runner.x, strict=True) if not isfinite(value)]
            return f"{when} {', '.join(wrong)} as measured {'is' if len(wrong) == 1 else 'are'} not finite", UNSOUND
        if status == Status.LOST:
            surprise = float(self._runner.told["surprise"][0])
            is_gate = self.sampled.gate is not None
            who = "the gate refuses a sample: it" if is_gate else "the observer is lost: what is measured"
            return (
                f"{when} {who} differs by {surprise:.3g} m or rad from what was expected",
                f"measure again, wait for a gap of {self.max_gap:g} s, after which it begins again, or call reset()",
            )
        if status == Status.SINGULAR:
            return f"{when} what is inverted is singular", UNSOUND
        return f"{when} the voltages, or the estimates after them, are not finite", UNSOUND


def _runner(sampled: SampledLaw, is_told: bool = False) -> Runner:
    """Machine code if there is a compiler, else CasADi's virtual machine."""
    try:
        return Compiled(sampled, is_told)
    except CompilerError:
        return Interpreted(sampled, is_told)


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


def _restored(built: tuple[Any, ...], memory: list[Floats], last: list[float], learns: list[bool]) -> Controller:
    controller = Controller(*built)
    for array, kept in zip(controller._memory, memory, strict=True):
        array[:] = kept
    controller._last[:], controller._learns[:] = last, learns
    return controller
