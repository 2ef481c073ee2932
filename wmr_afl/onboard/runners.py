"""A sampled law ready to be called: machine code, or CasADi's virtual machine where there is no C compiler."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.c_source import TOLD, Source
from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.onboard.status import Status
from wmr_afl.simulation.kernels.block import aligned
from wmr_afl.simulation.kernels.c_compiler import library
from wmr_afl.simulation.kernels.interpreted import bind


class Runner:
    """Memory that is written before a call and read after it, and the calls.

    Unless a call returns `Status.OK`, u is zero and the state keeps every bit.
    """

    state: Floats  # (states,)
    before: Floats  # the states before the last sample that was sound
    last: Floats  # of that sample [dt; x; clock]
    now: Floats  # what a call is given, [dt; x; clock]
    u: Floats  # voltages
    told: dict[str, Floats]  # what a step tells, by name
    sizes: tuple[int, ...]  # of dt, x and clock
    sample: Callable[[], int]
    same_sample: Callable[[], int]  # the last sample again, from where it was computed; nothing else changes

    @property
    def dt(self) -> Floats:
        """[s] since the last sample, (1,)."""
        return self.now[:1]

    @property
    def x(self) -> Floats:
        """What is measured."""
        return self.now[1 : 1 + self.sizes[1]]

    @property
    def clock(self) -> Floats:
        """Time and reference."""
        return self.now[1 + self.sizes[1] :]

    @property
    def saturated(self) -> list[int]:
        """The motors whose voltage is not what the law asked for."""
        raise NotImplementedError

    @property
    def at_bound(self) -> list[int]:
        """The estimates that lie on a bound."""
        raise NotImplementedError


class Compiled(Runner):
    """The C that `wmr-afl export` writes, in double precision, built by the system's compiler.

    Raises:
        CompilerError: if it cannot be built.
    """

    def __init__(self, sampled: SampledLaw, is_told: bool = False) -> None:
        source = Source(sampled, takes_clock=True, is_told=is_told)
        self.sizes = _sizes(sampled, is_told)
        sizes = {"state": sampled.states.size, "before": sampled.states.size, "last": sum(self.sizes)}
        sizes |= {"now": sum(self.sizes), "u": len(sampled.model.input_units)}
        told = {name: sampled.signals[name] for name in TOLD if name in sampled.signals}
        self._block = aligned((sum(sizes.values()) + sum(told.values()) + 1,))
        ends = np.cumsum([0, *sizes.values(), *told.values()])
        parts = [self._block[a:b] for a, b in pairwise(ends)]
        self.state, self.before, self.last, self.now, self.u = parts[: len(sizes)]
        self.told = dict(zip(told, parts[len(sizes) :], strict=True))
        self._masks = self._block[-1:].view(np.uint32)
        self.state[:] = self.before[:] = sampled.start
        text = source.header() + source.code(has_header=False, is_called_by_python=True)
        built = library(text, is_fused=False)  # the bits of what `wmr-afl export` writes
        memory = ctypes.c_void_p(self._block.ctypes.data)
        self.sample, self.same_sample = (functools.partial(built[name], memory) for name in ("sample", "same_sample"))

    @property
    def saturated(self) -> list[int]:
        return _bits(int(self._masks[0]))

    @property
    def at_bound(self) -> list[int]:
        return _bits(int(self._masks[1]))


class Interpreted(Runner):
    """The same on CasADi's virtual machine."""

    def __init__(self, sampled: SampledLaw, is_told: bool = False) -> None:
        self.state, self.before, self.sizes = sampled.start, sampled.start, _sizes(sampled, is_told)
        self.last, self.now = np.zeros(sum(self.sizes)), np.zeros(sum(self.sizes))
        self._after, self._signals = sampled.start, {name: np.zeros(size) for name, size in sampled.signals.items()}
        self.told = {name: np.zeros(size) for name, size in sampled.signals.items() if name in TOLD}
        self.u = np.zeros(sampled.signals["u"])
        self._from, self._sampled = sampled.start, sampled
        arguments = (self._from, self.clock, self.x, self.dt, np.zeros(0))
        self._run = bind(sampled.traced(is_told=is_told), arguments, (self._after, *self._signals.values()))
        self.sample, self.same_sample = self._once, self._again

    def _once(self) -> int:
        status = self._step(self.state)
        if status == Status.OK:
            self.before[:], self.last[:] = self.state, self.now
            if self.dt[0] <= self._sampled.max_gap:
                self.state[:] = self._after
            else:
                self.state[self._sampled.flags] = 0.0
        return status

    def _again(self) -> int:
        return self._step(self.before)

    def _step(self, state: Floats) -> Status:
        """The step from these states; its results lie in arrays of this object."""
        self._from[:], self.u[:] = state, 0.0
        for told in (*self.told.values(), *self._signals.values()):
            told[:] = 0.0
        status = self._given()
        if status == Status.OK:
            with np.errstate(all="ignore"):
                self._run()
            status = self._found()
            for name, told in self.told.items():
                told[:] = self._signals[name]
            if status == Status.OK:
                self.u[:] = self._signals["u"]
        return status

    def _given(self) -> Status:
        """What is wrong with what a step is given."""
        if not np.isfinite(self.x).all():
            return Status.BAD_MEASUREMENT
        if not np.isfinite(self.clock).all():
            return Status.BAD_REFERENCE
        return Status.OK if 0.0 < self.dt[0] < np.inf else Status.BAD_TIME_STEP

    def _found(self) -> Status:
        """What is wrong with what came out."""
        regularity = self._signals["regularity"][0]
        if regularity <= 0.0:
            bound = self._sampled.values.get("observer.bound", (np.inf,))[0]
            return Status.SINGULAR if self._signals.get("surprise", (-np.inf,))[0] < bound else Status.LOST
        if np.isfinite(self._after).all() and np.isfinite(self._signals["u"]).all() and regularity > 0.0:
            return Status.OK
        return Status.NOT_FINITE if np.isfinite(self._from).all() else Status.BAD_STATE

    @property
    def saturated(self) -> list[int]:
        return np.flatnonzero(self._signals["u"] != self._signals["command"]).tolist()

    @property
    def at_bound(self) -> list[int]:
        return np.flatnonzero(self._signals["at_bound"]).tolist()


def _sizes(sampled: SampledLaw, is_told: bool) -> tuple[int, int, int]:
    """Of dt, x and clock."""
    return 1, len(sampled.measured) + (sampled.signals["u"] if is_told else 0), sampled.clock_size


def _bits(mask: int) -> list[int]:
    return [i for i in range(mask.bit_length()) if mask >> i & 1]
