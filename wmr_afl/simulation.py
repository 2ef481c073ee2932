"""Running a closed loop: step by step in NumPy, or traced into one CasADi function that is mapped over the samples."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.compiled.build import compiler
from wmr_afl.compiled.kernel import Kernel, Progressed
from wmr_afl.errors import SimulationError, UnknownNameError
from wmr_afl.language import Language
from wmr_afl.linear_algebra import SINGULAR
from wmr_afl.run import Failure, Run

CHUNK = 1000  # samples that CasADi runs between two looks at the result
COMPILED_CHUNK = 100_000  # and that machine code runs
WORTH_BUILDING = 500_000  # samples from which a run takes longer than a C compiler

Progress = Callable[[int], None]  # told how many samples were done
Rows = NDArray[np.float64]


class SimulationWarning(UserWarning):
    """A run ended before its time."""


def simulate(
    loop: ClosedLoop, duration: float, name: str = "", backend: str = "auto", progress: Progress = lambda done: None
) -> Run:
    """Runs `loop` for `duration` [s].

    A singular Dhat or a state that is not finite ends the run: it keeps what was computed up to there, names time and
    cause in `failure`, and a SimulationWarning is given.
    Raises: SimulationError, where the run is shorter than a sample; UnknownNameError, where there is no such backend.
    """
    if loop.sample_time > duration:
        raise SimulationError(f"a sample of {loop.sample_time:g} s is longer than the run of {duration:g} s")
    count = round(duration / loop.sample_time) + 1
    times = np.asarray(np.arange(count) * loop.sample_time, dtype=np.float64)
    noise = loop.plant.noise.samples(count) if loop.plant.noise else np.zeros((count, len(loop.states["x"])))
    signals = Layout({name: np.zeros(size) for name, size in loop.signals.items()})
    rows = np.zeros((count, signals.size))
    done, failure = 0, None
    with np.errstate(all="ignore"):  # what is not finite is looked for below
        for block in _stepper(backend)(loop, times, noise, signals):
            rows[done : done + len(block)] = block
            failure = _failure(block, times[done:], signals)
            done = done + len(block) if failure is None else int(np.searchsorted(times, failure.time))
            progress(len(block))
            if failure is not None:
                warnings.warn(f"{name or loop.model.name} {failure}", SimulationWarning, stacklevel=2)
                break
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
        reference=loop.reference.over(times[:done])[0],
        failure=failure,
    )


def _failure(block: Rows, times: Rows, signals: Layout) -> Failure | None:
    """The first sample of a block that is singular or not finite."""
    regularity = block[:, signals.places["regularity"]][:, 0]
    finite = np.isfinite(block).all(axis=1)
    bad = np.flatnonzero(~finite | (regularity < SINGULAR))
    if not len(bad):
        return None
    k = int(bad[0])
    for signal, cause in _CAUSES.items():  # from cause to effect
        value = block[k, signals.places[signal]]
        if not np.isfinite(value).all() or (signal == "regularity" and value[0] < SINGULAR):
            return Failure(float(times[k]), cause.format(*value))
    return Failure(float(times[k]), "a signal is not finite")


_CAUSES = {
    "x": "the state is not finite: the loop diverged",
    "theta_hat": "the estimate is not finite",
    "e": "the reference or the output is not finite there",
    "regularity": "the estimated decoupling matrix is singular (regularity {0:.1e}); bound the estimates",
    "command": "the input is not finite: the loop diverged; bound the estimates, lower the gains or sample faster",
}


Stepper = Callable[[ClosedLoop, Rows, Rows, Layout], Iterator[Rows]]


def _numpy_steps(loop: ClosedLoop, times: Rows, noise: Rows, signals: Layout) -> Iterator[Rows]:
    """One row of signals a step."""
    language = Language.of(loop.model, "numpy")
    z, k = SimpleNamespace(**loop.states), SimpleNamespace(**loop.values)
    for t, sample in zip(times, noise, strict=True):
        following, now = loop.step(t, z, k, sample, language)
        z = SimpleNamespace(**following)
        yield signals.pack(now)[None, :]


def _casadi_steps(loop: ClosedLoop, times: Rows, noise: Rows, signals: Layout) -> Iterator[Rows]:
    """Blocks of rows, by one function mapped over the samples."""
    step = trace(loop)
    z, k = ca.DM(Layout(loop.states).pack(loop.states)), ca.DM(Layout(loop.values).pack(loop.values))
    for start in range(0, len(times), CHUNK):
        part = slice(start, start + CHUNK)
        count = len(times[part])
        mapped = step.mapaccum("steps", count)
        states, rows = mapped(z, times[part][None, :], noise[part].T, ca.repmat(k, 1, count))
        z = states[:, -1]
        yield rows.full().T


def trace(loop: ClosedLoop) -> ca.Function:
    """The loop's step as one function of flat columns: (state, t, noise sample, values) -> (next state, signals)."""
    language = Language.of(loop.model, "casadi")
    states, values = Layout(loop.states), Layout(loop.values)
    signals = Layout({name: np.zeros(size) for name, size in loop.signals.items()})
    z, k = ca.SX.sym("state", states.size), ca.SX.sym("values", values.size)
    t, sample = ca.SX.sym("t"), ca.SX.sym("sample", loop.signals["x"])
    following, now = loop.step(t, states.unpack_symbols(z), values.unpack_symbols(k), sample, language)
    outputs = ca.cse([ca.densify(states.pack_symbols(following)), ca.densify(signals.pack_symbols(now))])
    return ca.Function("step", [z, t, sample, k], outputs, ["state", "t", "sample", "values"], ["next", "signals"])


def _compiled_steps(loop: ClosedLoop, times: Rows, noise: Rows, signals: Layout) -> Iterator[Rows]:
    """Blocks of rows, by machine code."""
    kernel = Kernel(trace(loop), signals.places["regularity"].start)
    z, k = Layout(loop.states).pack(loop.states), Layout(loop.values).pack(loop.values)
    progressed = Progressed.at_start(z[:, None], signals.size)
    for start in range(0, len(times), COMPILED_CHUNK):
        part = slice(start, start + COMPILED_CHUNK)
        rows = kernel.advance(progressed, times[part], noise[part] if loop.plant.noise else None, k[:, None], log=True)
        yield rows[:, :, 0]


def _fastest_steps(loop: ClosedLoop, times: Rows, noise: Rows, signals: Layout) -> Iterator[Rows]:
    """Machine code where a long run pays for its building, else CasADi's virtual machine."""
    worth_building = len(times) >= WORTH_BUILDING and compiler() is not None
    return (_compiled_steps if worth_building else _casadi_steps)(loop, times, noise, signals)


_STEPPERS: dict[str, Stepper] = {
    "numpy": _numpy_steps,
    "casadi": _casadi_steps,
    "compiled": _compiled_steps,
    "auto": _fastest_steps,
}


def _stepper(backend: str) -> Stepper:
    if backend not in _STEPPERS:
        raise UnknownNameError("backend", backend, _STEPPERS)
    return _STEPPERS[backend]
