"""Running a closed loop: step by step in NumPy, or traced once and run by CasADi's virtual machine or machine code."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wmr_afl.block import Watched
from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.errors import SimulationError, UnknownNameError
from wmr_afl.kernels import KERNELS, Kernel
from wmr_afl.language import Language
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.run import Failure, Run
from wmr_afl.variation import Variation, nominal

CHUNK = 1000  # samples that CasADi runs between two looks at the result
COMPILED_CHUNK = 100_000  # and that machine code runs
WORTH_BUILDING = 500_000  # samples from which a run takes longer than a C compiler

Progress = Callable[[int], None]  # told how many samples were done
Rows = NDArray[np.float64]


class SimulationWarning(UserWarning):
    """A run ended before its time."""


def simulate(
    loop: ClosedLoop,
    duration: float,
    name: str = "",
    backend: str = "auto",
    progress: Progress = lambda done: None,
    robot: Variation | None = None,
) -> Run:
    """Runs `loop` for `duration` [s], as it is or with the numbers of one `robot`.

    A singular Dhat or a state that is not finite ends the run: it keeps what was computed up to there, names time and
    cause in `failure`, and a SimulationWarning is given.
    Raises: SimulationError, where the run is shorter than a sample; UnknownNameError, where there is no such backend.
    """
    if loop.sample_time > duration:
        raise SimulationError(f"a sample of {loop.sample_time:g} s is longer than the run of {duration:g} s")
    times, signals = sample_times(loop, duration), loop.signal_layout
    robot = robot or _as_it_is(loop)
    noise = normal_samples(robot.generator(0), len(times), loop.signals["x"]) if loop.plant.noise else None
    blocks, done, failure = [], 0, None
    with np.errstate(all="ignore"):  # what is not finite is looked for below
        for block in _stepper(backend)(loop, robot, times, noise):
            blocks.append(block)
            failure = _failure(block, times[done:], signals)
            done = done + len(block) if failure is None else int(np.searchsorted(times, failure.time))
            progress(len(block))
            if failure is not None:
                warnings.warn(f"{name or loop.model.name} {failure}", SimulationWarning, stacklevel=2)
                break
    rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    logged = {signal: rows[:done, place] for signal, place in signals.places.items()}
    return Run(
        controller=name,
        model=loop.model,
        time=times[:done],
        state=logged["x"],
        input=logged["u"],
        command=logged["command"],
        error=logged["e"],
        estimate=logged["theta_hat"],
        reference=logged["reference"],
        failure=failure,
    )


@functools.lru_cache(maxsize=32)
def _as_it_is(loop: ClosedLoop) -> Variation:
    return nominal([loop])


def sample_times(loop: ClosedLoop, duration: float) -> Rows:
    """The times of all samples from 0 to `duration` [s], (T,)."""
    return np.asarray(np.arange(round(duration / loop.sample_time) + 1) * loop.sample_time, dtype=np.float64)


def _failure(block: Rows, times: Rows, signals: Layout) -> Failure | None:
    """The first sample of a block that is singular or not finite."""
    regularity = block[:, signals.places["regularity"]][:, 0]
    if np.isfinite(np.vdot(block, block)) and regularity.min() > 0.0:  # the usual case, looked at quickly
        return None
    finite = np.isfinite(block).all(axis=1)
    bad = np.flatnonzero(~finite | (regularity <= 0.0))
    if not len(bad):
        return None
    k = int(bad[0])
    for signal, cause in _CAUSES.items():  # from cause to effect
        value = block[k, signals.places[signal]]
        if not np.isfinite(value).all() or (signal == "regularity" and value[0] <= 0.0):
            return Failure(float(times[k]), cause)
    return Failure(float(times[k]), "a signal is not finite")


_CAUSES = {
    "x": "the state is not finite: the loop diverged",
    "theta_hat": "the estimate is not finite",
    "e": "the reference or the output is not finite there",
    "regularity": "the estimated decoupling matrix is singular; bound the estimates",
    "command": "the input is not finite: the loop diverged; bound the estimates, lower the gains or sample faster",
}


Stepper = Callable[[ClosedLoop, Variation, Rows, Rows | None], Iterator[Rows]]


def _numpy_steps(loop: ClosedLoop, robot: Variation, times: Rows, noise: Rows | None) -> Iterator[Rows]:
    """One row of signals a step."""
    language = Language.of(loop.model, "numpy")
    z = SimpleNamespace(**Layout(loop.states).unpack(robot.states[:, 0]))
    k = SimpleNamespace(**Layout(loop.values).unpack(robot.values[:, 0]))
    samples = np.zeros((len(times), loop.signals["x"])) if noise is None else noise
    for t, sample in zip(times, samples, strict=True):
        following, now = loop.step(t, z, k, sample, language)
        z = SimpleNamespace(**following)
        yield loop.signal_layout.pack(now)[None, :]


@functools.lru_cache(maxsize=32)
def trace(loop: ClosedLoop) -> ca.Function:
    """The loop's step as one function of flat columns: (state, t, noise sample, values) -> (next state, signals)."""
    language = Language.of(loop.model, "casadi")
    states, values = Layout(loop.states), Layout(loop.values)
    z, k = ca.SX.sym("state", states.size), ca.SX.sym("values", values.size)
    t, sample = ca.SX.sym("t"), ca.SX.sym("sample", loop.signals["x"])
    following, now = loop.step(t, states.unpack_symbols(z), values.unpack_symbols(k), sample, language)
    outputs = [ca.densify(states.pack_symbols(following)), ca.densify(loop.signal_layout.pack_symbols(now))]
    return ca.Function(
        "step", [z, t, sample, k], ca.cse(outputs), ["state", "t", "sample", "values"], ["next", "signals"]
    )


def _steps_of(backend: str, chunk: int) -> Stepper:
    """Blocks of rows, by a kernel that runs the traced step."""

    @functools.lru_cache(maxsize=32)
    def kernel_of(loop: ClosedLoop) -> Kernel:
        return KERNELS[backend](trace(loop), Watched(loop.signal_layout.places["regularity"].start), 1, True)

    def steps(loop: ClosedLoop, robot: Variation, times: Rows, noise: Rows | None) -> Iterator[Rows]:
        kernel = kernel_of(loop)
        block, held = kernel.start(robot.states), kernel.prepare(robot.values)
        for start in range(0, len(times), chunk):
            part = slice(start, start + chunk)
            sample = None if noise is None else noise[part, :, None]
            yield kernel.advance(block, times[part], sample, held)[:, :, 0]

    return steps


_casadi_steps = _steps_of("casadi", CHUNK)
_compiled_if_possible_steps = _steps_of("auto", COMPILED_CHUNK)


def _fastest_steps(loop: ClosedLoop, robot: Variation, times: Rows, noise: Rows | None) -> Iterator[Rows]:
    """Machine code where a long run pays for its building, else CasADi's virtual machine."""
    return (_compiled_if_possible_steps if len(times) >= WORTH_BUILDING else _casadi_steps)(loop, robot, times, noise)


_STEPPERS: dict[str, Stepper] = {
    "numpy": _numpy_steps,
    "casadi": _casadi_steps,
    "compiled": _steps_of("compiled", COMPILED_CHUNK),
    "auto": _fastest_steps,
}


def _stepper(backend: str) -> Stepper:
    if backend not in _STEPPERS:
        raise UnknownNameError("backend", backend, _STEPPERS)
    return _STEPPERS[backend]
