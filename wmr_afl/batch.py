"""Many closed loops that differ in numbers only: one trace serves all, blocks of robots advance in lockstep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.assembly import assemble
from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.compiled.build import compiler
from wmr_afl.compiled.kernel import Kernel, Progressed
from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.experiment import read_experiment
from wmr_afl.linear_algebra import SINGULAR
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation import trace
from wmr_afl.variation import Variation, vary

Numbers = NDArray[np.float64]

LANES = 32  # robots of a block: their numbers stay in the first cache
CHUNK = 1000  # samples between two looks from Python


@dataclass(frozen=True)
class BatchResult:
    """Summaries of N runs; a run that failed has infinite errors."""

    rms: Numbers  # (N, n-m), of the tracking error since `since`
    largest_error: Numbers  # (N, n-m)
    largest_input: Numbers  # (N, n_u) [V]
    largest_estimate: Numbers  # (N,)
    final_state: Numbers  # (N, 2n-m)
    failure_time: Numbers  # (N,) [s], NaN where none

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(N,)"""
        return np.isfinite(self.failure_time)


def run_batch(
    experiment: str | Path,
    controller: str | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    values: Mapping[str, ArrayLike] | None = None,
    seeds: ArrayLike | None = None,
    since: float = 0.0,
    threads: int = 1,
    backend: str = "auto",
    progress: Callable[[int], None] = lambda done: None,
) -> BatchResult:
    """Runs one controller of an experiment (the first unless named) for many robots that differ in numbers.

    `parameters`, `start`: physical parameters and states by name, (N,) each; the controller knows the known constants
    of each robot, and exact or guessed estimates follow. `values`: gains of the loop by name (b1, Gamma ...), (N, ...);
    `seeds` (N,) of the measurement noise. Errors count since `since` [s]. `backend`: "compiled", "casadi", or "auto".
    Raises: InputError, UnknownNameError; ShapeError, where the numbers of robots differ; WmrError.
    """
    told, path = read_experiment(experiment)
    loops = assemble(told, path)
    name = next(iter(loops)) if controller is None else controller
    if name not in loops:
        raise UnknownNameError("controller", name, loops)
    variation = vary(told, loops[name], name, parameters or {}, start or {}, values or {}, seeds)
    return advance_all(loops[name], variation, told.simulation.duration, since, threads, backend, progress)


def rms_of_many(loops: Sequence[ClosedLoop], duration: float) -> Numbers:
    """Root mean square of every loop's tracking error over `duration` [s], (loops, n-m); inf where a run fails.

    Raises: ShapeError, where the loops differ in more than numbers.
    """
    first = loops[0]
    states, values = Layout(first.states), Layout(first.values)
    for loop in loops:
        if Layout(loop.states).shapes != states.shapes or Layout(loop.values).shapes != values.shapes:
            raise ShapeError("the loops differ in more than numbers; run them one by one")
    variation = Variation(
        np.array([states.pack(loop.states) for loop in loops]).T,
        np.array([values.pack(loop.values) for loop in loops]).T,
        np.array([loop.plant.noise.seed for loop in loops if loop.plant.noise], dtype=int),
    )
    return advance_all(first, variation, duration).rms


def advance_all(
    loop: ClosedLoop,
    variation: Variation,
    duration: float,
    since: float = 0.0,
    threads: int = 1,
    backend: str = "auto",
    progress: Callable[[int], None] = lambda done: None,
) -> BatchResult:
    """Advances all robots of a variation, block by block; results do not depend on the number of threads."""
    signals = Layout({name: np.zeros(size) for name, size in loop.signals.items()})
    step = trace(loop)
    make = _kernels(backend)
    kernel = make(step, signals.places["regularity"].start, min(LANES, variation.count))
    count = round(duration / loop.sample_time) + 1
    times = np.asarray(np.arange(count) * loop.sample_time, dtype=np.float64)
    first = int(np.ceil(since / loop.sample_time - 1e-9))

    def block(lanes: slice) -> Progressed:
        done = _advance_block(kernel, variation.block(lanes, kernel.lanes), times, first, signals.size, loop)
        progress(lanes.stop - lanes.start)
        return done

    parts = [slice(a, min(a + kernel.lanes, variation.count)) for a in range(0, variation.count, kernel.lanes)]
    with ThreadPoolExecutor(max_workers=max(1, threads)) as pool:
        blocks = list(pool.map(block, parts)) if threads > 1 else [block(part) for part in parts]
    return _summary(blocks, parts, signals, loop, count - first)


class _Advancing(Protocol):
    lanes: int

    def advance(
        self, progressed: Progressed, times: Numbers, noise: Numbers | None, values: Numbers, since: int
    ) -> object: ...


def _advance_block(
    kernel: _Advancing, variation: Variation, times: Numbers, since: int, signals: int, loop: ClosedLoop
) -> Progressed:
    progressed = Progressed.at_start(variation.states, signals)
    values = np.ascontiguousarray(variation.values)
    generators = [np.random.Generator(np.random.Philox(int(seed))) for seed in variation.seeds]
    size = loop.signals["x"]
    for a in range(0, len(times), CHUNK):
        part = times[a : a + CHUNK]
        noise = None
        if loop.plant.noise:
            noise = np.stack([normal_samples(g, len(part), size) for g in generators], axis=-1)
        kernel.advance(progressed, part, noise, values, since)
    return progressed


def _summary(
    blocks: Sequence[Progressed], parts: Sequence[slice], signals: Layout, loop: ClosedLoop, counted: int
) -> BatchResult:
    def gathered(rows: Callable[[Progressed], Numbers]) -> Numbers:
        return np.concatenate([rows(b)[..., : p.stop - p.start].T for b, p in zip(blocks, parts, strict=True)])

    failed = gathered(lambda block: block.failed)
    lost = failed >= 0
    state = Layout(loop.states).places["x"]

    def largest(signal: str) -> Numbers:
        return gathered(lambda block: block.largest[signals.places[signal]])

    squares = gathered(lambda block: block.squares[signals.places["e"]])
    rms = np.where(lost[:, None], np.inf, np.sqrt(squares / counted))
    return BatchResult(
        rms=rms,
        largest_error=np.where(lost[:, None], np.inf, largest("e")),
        largest_input=largest("u"),
        largest_estimate=largest("theta_hat").max(axis=1, initial=0.0),
        final_state=gathered(lambda block: block.state[state]),
        failure_time=np.where(lost, failed * loop.sample_time, np.nan),
    )


class InterpretedKernel:
    """What a compiled kernel does, by CasADi's virtual machine, robot after robot."""

    def __init__(self, step: ca.Function, regularity: int, lanes: int) -> None:
        self.step, self.regularity, self.lanes = step, regularity, lanes
        self._mapped: dict[int, ca.Function] = {}

    def advance(
        self, progressed: Progressed, times: Numbers, noise: Numbers | None, values: Numbers, since: int
    ) -> None:
        count, p = len(times), progressed
        steps = self._mapped.setdefault(count, self.step.mapaccum("steps", count))
        kept = max(0, since - p.samples)
        for lane in range(self.lanes):
            sample = np.zeros((self.step.size1_in(2), count)) if noise is None else noise[:, :, lane].T
            state, rows = steps(p.state[:, lane], times[None, :], sample, ca.repmat(ca.DM(values[:, lane]), 1, count))
            signals = rows.full()
            p.state[:, lane] = state.full()[:, -1]
            bad = np.flatnonzero(~(signals[self.regularity] >= SINGULAR))
            if len(bad) and p.failed[lane] < 0:
                p.failed[lane] = p.samples + bad[0]
            with np.errstate(over="ignore", invalid="ignore"):  # of runs that are lost already
                p.squares[:, lane] += np.sum(signals[:, kept:] ** 2, axis=1)
            p.largest[:, lane] = np.maximum(p.largest[:, lane], np.abs(signals[:, kept:]).max(axis=1, initial=0.0))
        p.samples += count


def _kernels(backend: str) -> Callable[[ca.Function, int, int], _Advancing]:
    kinds: dict[str, Callable[[ca.Function, int, int], _Advancing]] = {
        "compiled": Kernel,
        "casadi": InterpretedKernel,
        "auto": Kernel if compiler() is not None else InterpretedKernel,
    }
    if backend not in kinds:
        raise UnknownNameError("backend of a batch", str(backend), kinds)
    return kinds[backend]
