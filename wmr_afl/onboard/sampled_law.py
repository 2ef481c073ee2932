"""A law and what of the drive is known as one step in discrete time: what a robot's own loop calls at every sample."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from math import inf
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.controllers.law import Law
from wmr_afl.controllers.observer import Observer
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import Fixed, Parts, by_part, disjoint, prefixed
from wmr_afl.onboard.gate import Gate
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.simulation.layout import Layout

LATE = 1.5  # sample times; after a longer step nothing is learned by comparing a sample with the one before
LONGEST_STEP = 2.0  # sample times; the law's states move by no more at once
LONGEST_GAP = 10.0  # sample times; after a longer gap nothing is learned from the sample before


class SampledLaw(Fixed):
    """From sample to sample: voltages and the law's next states, for what is measured and the time that has passed.

    Time that really passed moves estimates and other states, by up to two sample times at once. After more than one and
    a half, parts that compare a sample with the last one, as least squares and a reference model, begin again. After a
    gap of more than `max_gap` [s], ten sample times unless given, voltages are computed as ever, but the states stay as
    they are for that sample: nobody knows what happened in between.

    `drive`: what the robot's drive does to a command, such as limits and a delay: limits, and what has no memory, are
    done to the voltages that are returned; all of it is taken into account by a law that looks at the applied input.

    `gate` [output units]: a sample that is farther from what the last one leads to is refused, see `Gate`.

    Raises:
        UnknownNameError: if the reference names another output.
        WmrError: if an output has no reference, or a time is not positive.
    """

    def __init__(
        self,
        model: Model,
        law: Law,
        reference: Reference,
        sample_time: float,
        drive: Sequence[Uncertainty] = (),
        max_gap: float | None = None,
        gate: float | None = None,
    ) -> None:
        self.model, self.law, self.sample_time = model, law, float(sample_time)
        self.reference = reference.ordered(list(model.output_units))
        self.max_gap = LONGEST_GAP * self.sample_time if max_gap is None else float(max_gap)
        if not (0.0 < self.sample_time < inf and self.max_gap >= self.sample_time):
            raise WmrError(
                f"a sample time of {sample_time} s and a longest gap of {self.max_gap} s",
                "choose 0 < sample_time <= max_gap",
            )
        if gate is not None and law.observes:
            raise WmrError("an observer refuses outliers itself", "leave the gate out, and choose the observer's bound")
        self.gate = None if gate is None else Gate(len(model.output_units), gate)
        self.own = Parts([self.gate])
        self.drive = Parts(drive)
        self.measured = tuple(model.state_units) if law.measurement is None else law.measurement.names

    @functools.cached_property
    def states(self) -> Layout:
        """Where the states of law and drive lie in a flat vector."""
        return Layout(self._states)

    @property
    def is_limited(self) -> bool:
        """Whether something limits the voltages that are returned."""
        return self.law.limits_inputs or any(part.limits_inputs for part in self.drive)

    @functools.cached_property
    def flags(self) -> list[int]:
        """Entries of the states that are zero for a part that begins again."""
        return [place.start for name, place in self.states.places.items() if _runs(name)]

    @functools.cached_property
    def learned(self) -> Any:
        """Of each entry of the states whether it is an estimate, or of a part that serves nothing else, (states,)."""
        found = np.zeros(self.states.size, dtype=bool)
        for name, place in self.states.places.items():
            found[place] = name == "theta_hat" or name.partition(".")[0] in self.law.learning
        return found

    @functools.cached_property
    def silent(self) -> list[int]:
        """Entries of the states that are zero if nothing is to be learned from a sample: flags, and parts without."""
        found: list[slice] = []
        for name in self.law.learning:
            own = {key: place for key, place in self.states.places.items() if key.startswith(f"{name}.")}
            flag = own.get(f"{name}.is_running")
            found += own.values() if flag is None else [flag]
        return [entry for place in found for entry in range(place.start, place.stop)]

    @functools.cached_property
    def of_the_moment(self) -> list[int]:
        """Entries of the states that a restart does not bring back: flags, and what was last sent to the drive."""
        drive = [place for name, place in self.states.places.items() if name in self.drive.states]
        return sorted({*self.flags, *(entry for place in drive for entry in range(place.start, place.stop))})

    @property
    def start(self) -> Floats:
        """The states at the start, flat."""
        return self.states.pack(self._states)

    @property
    def values(self) -> dict[str, Floats]:
        """Gains, bounds and known constants by name."""
        return disjoint(self.law.values, self.drive.values, self.own.values)

    @functools.cached_property
    def clock_size(self) -> int:
        """How many numbers a step is given of time and reference."""
        return int(self.reference.clock(np.zeros(1), self.law.lead).size)

    @property
    def surprise_bound(self) -> str:
        """The name of the number beyond which a sample is refused, if there is one."""
        if self.law.observes:
            return f"{Observer.name}.bound"
        return "" if self.gate is None else f"{Gate.name}.bound"

    @functools.cached_property
    def signals(self) -> dict[str, int]:
        """What a step tells besides the next states, with sizes."""
        outputs, inputs = len(self.model.output_units), len(self.model.input_units)
        observed = {"observed": len(self.model.state_units)} if self.law.observes else {}
        observed |= {"surprise": 1} if self.surprise_bound else {}
        return {
            "u": inputs,  # the voltages to be given to the motors
            "command": inputs,  # the same before any limit
            "error": outputs,  # e = y - yr
            "filtered_error": outputs,  # E1 = e' + alpha e
            "at_bound": len(self.law.knowledge.units),  # 1 for an estimate at its bound
            "regularity": 1,  # positive if what is inverted is regular
            **observed,
        }

    def step(
        self,
        clock: Array,
        x: Array,
        passed: Array,
        z: Mapping[str, Array],
        k: SimpleNamespace,
        model: Model,
        applied: Array | None = None,
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """The next states and the signals now, for states `z` by name and `passed` [s] since the last sample.

        `applied`: what is known to have reached the motors; otherwise that is what the drive makes of the command.
        After a gap the next states are not to be used: the states stay, but `flags` become zero.
        """
        arrays = model.arrays
        _, _, wanted = self.reference.seen(clock, self.law.lead)
        is_gap, is_late = passed > self.max_gap, passed > LATE * self.sample_time
        moves = arrays.where(is_gap, 0.0, arrays.minimum(passed, LONGEST_STEP * self.sample_time))
        begins = {name: is_gap if _watches(name) else is_late for name in z if _compares(name)}
        seen = by_part({**z, **{name: arrays.where(begin, 0.0, z[name]) for name, begin in begins.items()}})
        action, _, following = self.law.sample(
            x,
            wanted,
            lambda u: self._applied(u, seen, k, model) if applied is None else applied,
            seen,
            k,
            model,
            moves,
        )
        following |= self._drive_after(action.input, seen, k, model)
        known = action.memory
        signals = {
            "u": self._applied(action.input, seen, k, model, with_memory=False),
            "command": known.get("unlimited", action.input),
            "error": known["error"].e,
            "filtered_error": known["filtered_error"],
            "at_bound": self.law.at_bound(following["theta_hat"], k, arrays),
            "regularity": arrays.vector([action.regularity]),
        }
        if self.law.observes:
            signals |= {"observed": known["view"].now, "surprise": arrays.vector([known["view"].surprise])}
        if self.gate is not None:
            surprise, looked = self.gate.look(x, seen.gate, k.c, model, passed)
            following |= prefixed(self.gate.name, looked)
            is_sound = arrays.minimum(action.regularity, k.gate.bound[0] - surprise)
            signals |= {"surprise": arrays.vector([surprise]), "regularity": arrays.vector([is_sound])}
        return following, signals

    def traced(self, is_tunable: bool = False, is_told: bool = False) -> ca.Function:
        """(states, clock, x, [passed], values) -> (next states, each of the signals), all flat columns.

        The values are built in, and the last argument is empty, unless it `is_tunable`. If it `is_told`, what reached
        the motors stands behind x.
        """
        model, values = self.model.in_library("casadi"), Layout(self.values)
        flat, clock = ca.SX.sym("states", self.states.size), ca.SX.sym("clock", self.clock_size)
        size, inputs = len(self.measured), self.signals["u"] if is_told else 0
        x, passed = ca.SX.sym("x", size + inputs), ca.SX.sym("passed")
        applied = x[size:] if is_told else None
        numbers = ca.SX.sym("values", values.size if is_tunable else 0)
        k = by_part({name: ca.DM(value) for name, value in self.values.items()})
        if is_tunable:
            k = values.unpack_symbols(numbers)
        z = {name: self.states.symbols(flat, name) for name in self.states.shapes}
        following, signals = self.step(clock, x[:size], passed, z, k, model, applied)
        results = [self.states.pack_symbols(following), *(signals[name] for name in self.signals)]
        results = ca.cse([ca.densify(ca.SX(one)) for one in results])
        names = ["states", "clock", "x", "passed", "values"], ["next", *self.signals]
        return ca.Function("controller", [flat, clock, x, passed, numbers], results, *names)

    @property
    def minds_applied(self) -> bool:
        """Whether the states depend on what reaches the motors."""
        step, inputs = self.traced(is_told=True), self.signals["u"]
        return bool(ca.DM.ones(step.jac_sparsity(0, 2))[:, -inputs:].nnz())

    def _applied(
        self, u: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, with_memory: bool = True
    ) -> Array:
        """What reaches the motors of a command, of all of the drive or of what has no memory."""
        for _, part, state, own in self.drive.with_states(z, k):
            is_here = with_memory or part.limits_inputs or not part.states
            u = part.applied(u, state, own, model.arrays) if is_here else u
        return u

    def _drive_after(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model) -> dict[str, Array]:
        """The drive's states one sample later."""
        following = dict[str, Array]()
        for key, part, state, own in self.drive.with_states(z, k):
            following |= prefixed(key, part.update(u, state, own, model.arrays))
            u = part.applied(u, state, own, model.arrays)
        return following

    @property
    def _states(self) -> dict[str, Floats]:
        return disjoint(self.law.states, self.drive.states, self.own.states)


def _runs(name: str) -> bool:
    """Whether a state is the flag of a part that compares a sample with the last one."""
    return name.endswith(".is_running")


def _watches(name: str) -> bool:
    """Whether a part extrapolates over late samples, and begins again after a gap only."""
    return name.startswith((f"{Observer.name}.", f"{Gate.name}."))


def _compares(name: str) -> bool:
    """Whether a part begins again after a late sample or a gap; a reference model goes by the time that has passed."""
    return _runs(name) and not name.startswith(f"{ReferenceModel.name}.")
