"""Plant, law and reference as one step in discrete time: the same code is run by NumPy and traced by CasADi."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np

from wmr_afl.controllers.law import Law
from wmr_afl.controllers.outer_loop import tracking_error
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.sight import View
from wmr_afl.model.model import Model
from wmr_afl.model.slip import wheel_rows
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import disjoint
from wmr_afl.plant.plant import Plant
from wmr_afl.simulation.layout import Layout


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """One robot, one law, one reference, sampled every `sample_time` [s]; hashed by identity, as a key of caches."""

    model: Model
    plant: Plant
    law: Law
    reference: Reference
    sample_time: float

    def __post_init__(self) -> None:
        """The reference in the order of the model's outputs.

        Raises:
            UnknownNameError: if the reference names another output.
            WmrError: if an output has no reference.
        """
        object.__setattr__(self, "reference", self.reference.ordered(list(self.model.output_units)))

    @functools.cached_property
    def values(self) -> dict[str, Floats]:
        """Parameters and gains: the numbers that may differ between robots of a batch, which share the step."""
        return disjoint(self.plant.values, self.law.values)

    @functools.cached_property
    def states(self) -> dict[str, Floats]:
        """The loop's states at the start."""
        return disjoint(self.plant.states, self.law.states)

    @functools.cached_property
    def signals(self) -> dict[str, int]:
        """What is logged at every sample, with sizes."""
        outputs, inputs = len(self.model.output_units), len(self.model.input_units)
        optional = {"deviation": len(self.law.knowledge.units), "unexplained": 1} if self.law.knows_deviation else {}
        if self.law.observes:
            optional |= {"observed": len(self.model.state_units), "unexpected": outputs, "surprise": 1}
        if self.law.slip_names:
            slips = {"slip": len(self.law.slip_names)}
            optional |= slips | ({"slip_true": slips["slip"]} if self.plant.slips else {})
        return {
            "x": len(self.model.state_units),
            "u": inputs,
            "command": inputs,
            "e": outputs,
            "theta_hat": len(self.law.knowledge.units),
            "reference": outputs,
            "regularity": 1,
            **optional,
        }

    @functools.cached_property
    def checked(self) -> tuple[int, ...]:
        """Entries of a row of signals that must be finite: then all are.

        The command takes in the errors, and a state that is not a number usually shows in it; those that do not are
        found by trying each.
        """
        places = self.signal_layout.places
        command = range(places["command"].start, places["command"].stop)
        state, unseen = Layout(self.states).pack(self.states), []
        numbers, sample = Layout(self.values).pack(self.values), np.zeros(self.plant.samples)
        for name in ("x", "theta_hat"):
            for entry in range(places[name].start, places[name].stop):
                wrong = state.copy()
                wrong[Layout(self.states).places[name].start + entry - places[name].start] = np.nan
                row = trace(self)(wrong, self.clock(np.zeros(1))[0], sample, numbers)[1].full()[:, 0]
                if np.isfinite(row[list(command)]).all():
                    unseen.append(entry)
        return (*command, *unseen)

    def clock(self, times: Floats) -> Floats:
        """What a step is given of time and reference at each of `times` (T,) [s], (T,) or (T, numbers)."""
        return self.reference.clock(times, self.law.lead)

    @functools.cached_property
    def signal_layout(self) -> Layout:
        """Where each signal lies in a row of the log."""
        return Layout({name: np.zeros(size) for name, size in self.signals.items()})

    def step(
        self, clock: Array, z: SimpleNamespace, k: SimpleNamespace, sample: Array, model: Model
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """From sample to sample: the next states of the loop, and the signals now.

        clock: t [s], or a row of `clock`; z: states and k: numbers by part and name; sample: standard normal numbers;
        model: in the library to use.
        """
        t, reference, ahead = self.reference.seen(clock, self.law.lead)
        seen = self.plant.measured(z.x, sample, k, model.arrays)
        if self.law.measurement is not None:
            seen = self.law.measurement.of(seen, self.plant.parameters_at(t, k, model.arrays), model)
        action, applied, learned = self.law.sample(
            seen, ahead, lambda u: self.plant.applied(u, z, k, model.arrays), z, k, model, self.sample_time
        )
        signals = {
            "x": z.x,
            "u": applied,
            "command": action.input,
            "e": tracking_error(z.x, k.c, reference, model).e,
            "theta_hat": z.theta_hat,
            "reference": reference.position,
            "regularity": action.regularity,
        }
        if self.law.knows_deviation:
            signals["deviation"] = self.law.deviation(z, model.arrays)
            signals["unexplained"] = self.law.unexplained(z, k, model.arrays, self.sample_time)
        if self.law.observes:
            view: View = action.memory["view"]
            signals |= {
                "observed": view.now,
                "unexpected": view.unexpected,
                "surprise": model.arrays.vector([view.surprise]),
            }
            if view.slip is not None:
                signals["slip"] = view.slip.speeds
        if "slip_true" in self.signals:
            rows, true = wheel_rows(model), self.plant.slip(t, z.x, k, model)
            signals["slip_true"] = model.arrays.vector([true[rows[name]] for name in self.law.slip_names])
        return {**self.plant.update(t, action.input, z, k, model, self.sample_time), **learned}, signals


@functools.lru_cache(maxsize=32)
def sample_times(loop: ClosedLoop, duration: float) -> Floats:
    """The times of all samples from 0 to `duration` [s], (T,); read-only, because all callers share them."""
    times = np.asarray(np.arange(round(duration / loop.sample_time) + 1) * loop.sample_time, dtype=np.float64)
    times.flags.writeable = False
    return times


@functools.lru_cache(maxsize=32)
def trace(loop: ClosedLoop) -> ca.Function:
    """The loop's step as a function of flat columns: (state, clock, noise sample, values) -> (next state, signals)."""
    states, values = Layout(loop.states), Layout(loop.values)
    z, k = ca.SX.sym("state", states.size), ca.SX.sym("values", values.size)
    clock, sample = ca.SX.sym("t", loop.clock(np.zeros(1)).size), ca.SX.sym("sample", loop.plant.samples)
    model = loop.model.in_library("casadi")
    following, now = loop.step(clock, states.unpack_symbols(z), values.unpack_symbols(k), sample, model)
    outputs = [ca.densify(states.pack_symbols(following)), ca.densify(loop.signal_layout.pack_symbols(now))]
    return ca.Function(
        "step", [z, clock, sample, k], ca.cse(outputs), ["state", "clock", "sample", "values"], ["next", "signals"]
    )
