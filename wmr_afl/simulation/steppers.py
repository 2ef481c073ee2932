"""The steps of one closed loop, by backend: NumPy, CasADi's virtual machine, or machine code."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from wmr_afl.errors import UnknownNameError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.simulation.closed_loop import ClosedLoop, trace
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.kernels.block import LANES, Watched
from wmr_afl.simulation.kernels.kernel import KERNELS, Kernel
from wmr_afl.simulation.layout import Layout

CHUNK = 1000  # samples between two checks for a failure; CasADi runs them within milliseconds
COMPILED_CHUNK = 100_000  # the same for machine code
WORTH_BUILDING = 500_000  # samples; a longer run gains more by machine code than the C compiler takes


@dataclass(frozen=True)
class Chunk:
    """Samples in a row."""

    rows: Floats  # (samples, signals)
    is_sound: bool  # True: every signal is known to be finite and every Dhat regular


Stepper = Callable[[ClosedLoop, Ensemble, Floats, Floats | None], Iterator[Chunk]]


def stepper(backend: str | Stepper) -> Stepper:
    """The function that runs the steps of a loop on this backend, or a stepper of one's own as it is.

    Raises:
        UnknownNameError: if there is no such backend.
    """
    if callable(backend):
        return backend
    if backend not in _STEPPERS:
        raise UnknownNameError("backend", backend, _STEPPERS)
    return _STEPPERS[backend]


def _numpy_steps(loop: ClosedLoop, robot: Ensemble, times: Floats, noise: Floats | None) -> Iterator[Chunk]:
    """Yield one row of signals for each step."""
    model = loop.model.in_library("numpy")
    z = by_part(Layout(loop.states).unpack(robot.states[:, 0]))
    k = by_part(Layout(loop.values).unpack(robot.values[:, 0]))
    samples = np.zeros((len(times), 0)) if noise is None else noise
    for clock, sample in zip(loop.clock(times), samples, strict=True):
        following, now = loop.step(clock, z, k, sample, model)
        z = by_part(following)
        yield Chunk(loop.signal_layout.pack(now)[None, :], False)


def _steps_of(backend: str, chunk: int, lanes: int = 1) -> Stepper:
    """Steps in chunks of this many samples, by a kernel that runs the traced step."""

    @functools.lru_cache(maxsize=32)
    def kernel_of(loop: ClosedLoop) -> Kernel:
        return KERNELS[backend](
            trace(loop), Watched(loop.signal_layout.places["regularity"].start, loop.checked), lanes, True
        )

    def steps(loop: ClosedLoop, robot: Ensemble, times: Floats, noise: Floats | None) -> Iterator[Chunk]:
        kernel = kernel_of(loop)
        robots, clock = robot.block(slice(0, 1), kernel.lanes), loop.clock(times)
        block, held = kernel.start(robots.states), kernel.prepare(np.ascontiguousarray(robots.values))
        for start in range(0, len(times), chunk):
            part = slice(start, start + chunk)
            sample = None if noise is None else np.repeat(noise[part, :, None], kernel.lanes, axis=2)
            rows = kernel.advance(block, clock[part], sample, held)[:, :, 0]
            yield Chunk(rows, bool(block.failed[0] == np.inf))

    return steps


_casadi_steps = _steps_of("casadi", CHUNK)
_compiled_if_possible_steps = _steps_of("auto", COMPILED_CHUNK)


def _fastest_steps(loop: ClosedLoop, robot: Ensemble, times: Floats, noise: Floats | None) -> Iterator[Chunk]:
    """Machine code if the run is long enough to pay for building it, else CasADi's virtual machine."""
    return (_compiled_if_possible_steps if len(times) >= WORTH_BUILDING else _casadi_steps)(loop, robot, times, noise)


_STEPPERS: dict[str, Stepper] = {
    "numpy": _numpy_steps,
    "casadi": _casadi_steps,
    "compiled": _steps_of("compiled", COMPILED_CHUNK),
    "lockstep": _steps_of("compiled", CHUNK, LANES),  # as robots of a batch run, to the same bits
    "auto": _fastest_steps,
}
