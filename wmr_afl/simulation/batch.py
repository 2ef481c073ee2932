"""Many closed loops that differ in numbers only: one trace serves all, blocks of robots advance in lockstep."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import SimulationError, UnknownNameError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times, trace
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.failures import cause
from wmr_afl.simulation.kernels.block import LANES, Block, Watched
from wmr_afl.simulation.kernels.kernel import KERNELS, Kernel
from wmr_afl.simulation.layout import Layout

Record = Callable[[slice, slice, Floats], None]  # robots, samples, signals (samples, signals, robots)
Causes = list[str]  # of failure, one for each robot of a block, empty if it did not fail
Blocks = Iterable[tuple[slice, Block, Causes]]  # with the place of each among the robots

CHUNK = 1000  # samples of noise or recorded signals at a time, which bounds the memory of a block


@dataclass(frozen=True)
class BatchOptions:
    """How a batch is run."""

    duration: float  # [s]
    since: float = 0.0  # [s], from when errors count
    threads: int = 1
    backend: str = "auto"  # "compiled", "casadi", or "auto"
    progress: Callable[[int], None] = lambda done: None  # called with the number of robots that were done


@dataclass(frozen=True)
class BatchResult:
    """Summaries of N runs; those of a failed run are infinite, except its final state and the time of its failure."""

    rms: Floats  # (N, n-m), of the tracking error since `since`
    largest_error: Floats  # (N, n-m)
    largest_input: Floats  # (N, n_u) [V]
    largest_estimate: Floats  # (N,)
    final_state: Floats  # (N, 2n-m), one step after the last sample
    failure_time: Floats  # (N,) [s], NaN if it did not fail
    failure_cause: NDArray[np.str_]  # (N,), empty if it did not fail

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which runs failed, (N,)."""
        return np.isfinite(self.failure_time)


def advance_all(
    loop: ClosedLoop, ensemble: Ensemble, options: BatchOptions, record: Record | None = None
) -> BatchResult:
    """Run all robots of an ensemble and summarize each run; `record` is given all signals, chunk by chunk.

    Raises:
        UnknownNameError: if there is no such backend.
        SimulationError: if `since` is not a time of the run.
    """
    blocks = []
    for robots, block, causes in advance_blocks(loop, ensemble, options, record):
        options.progress(robots.stop - robots.start)
        blocks.append((robots, block, causes))
    return _summary(blocks, loop, options)


def advance_blocks(
    loop: ClosedLoop, ensemble: Ensemble, options: BatchOptions, record: Record | None = None
) -> Iterator[tuple[slice, Block, Causes]]:
    """Advance all robots; yield each block with its place among the robots, and why those failed that failed.

    Neither the number of threads nor the place of a robot among the others changes a bit of its numbers.

    Raises:
        UnknownNameError: if there is no such backend.
        SimulationError: if `since` is not a time of the run.
    """
    if options.backend not in KERNELS:
        raise UnknownNameError("backend of a batch", str(options.backend), KERNELS)
    if not 0.0 <= options.since <= options.duration:
        problem = f"errors cannot count since {options.since:g} s"
        raise SimulationError(problem, f"a run goes from 0 to {options.duration:g} s")
    kernel = kernel_of(loop, options.backend, record is not None)
    times = sample_times(loop, options.duration)
    clock = loop.clock(times)
    counted_from = int(np.ceil(options.since / loop.sample_time - 1e-9))
    chunk = CHUNK if loop.plant.samples or record is not None else len(times)

    def advance(robots: slice) -> tuple[slice, Block, Causes]:
        count, chosen = robots.stop - robots.start, ensemble.block(robots, kernel.lanes)
        underway = _Underway(loop, kernel, chosen)
        for samples in _chunks(len(times), counted_from, chunk):
            if samples.start == counted_from:
                underway.block.count_from_here()
            rows = underway.advance(clock[samples])
            if record is not None:
                record(robots, samples, rows[:, :, :count])
        failed = underway.block.failed[:count]
        return robots, underway.block, _causes(_Underway(loop, kernel, chosen), failed, times, clock)

    places = (slice(a, min(a + kernel.lanes, ensemble.count)) for a in range(0, ensemble.count, kernel.lanes))
    if options.threads <= 1:
        yield from map(advance, places)
    else:
        with ThreadPoolExecutor(max_workers=options.threads) as pool:
            yield from pool.map(advance, places)


@functools.lru_cache(maxsize=32)
def kernel_of(loop: ClosedLoop, backend: str, logged: bool) -> Kernel:
    """The kernel that runs blocks of robots of this loop."""
    return KERNELS[backend](trace(loop), watched_signals(loop), LANES, logged)


def watched_signals(loop: ClosedLoop) -> Watched:
    """What is summarized of each run: tracking errors, inputs and estimates."""
    places = {name: tuple(range(place.start, place.stop)) for name, place in loop.signal_layout.places.items()}
    sized = (*((entry,) for entry in places["e"] + places["u"]), places["theta_hat"])
    return Watched(places["regularity"][0], loop.checked, places["e"], sized)


class _Underway:
    """A block of robots on its way, with the streams of their noise."""

    def __init__(self, loop: ClosedLoop, kernel: Kernel, robots: Ensemble) -> None:
        self.loop, self.robots, self._kernel = loop, robots, kernel
        self.block, self._held = kernel.start(robots.states), kernel.prepare(np.ascontiguousarray(robots.values))
        self._generators = [robots.generator(robot) for robot in range(len(robots.seeds))]

    def advance(self, clock: Floats) -> Floats:
        """The signals at all rows of `clock`, (T, signals, robots), if the kernel logs them."""
        noise, size = None, self.loop.plant.samples
        if size:
            noise = np.stack([normal_samples(one, len(clock), size) for one in self._generators], axis=-1)
        return self._kernel.advance(self.block, clock, noise, self._held)


def _causes(again: _Underway, failed: Floats, times: Floats, clock: Floats) -> Causes:
    """Why robots failed, for their first samples that were not sound: the block runs again up to the last of these."""
    causes = [""] * len(failed)
    for sample in sorted({int(sample) for sample in failed[np.isfinite(failed)]}):
        if sample > again.block.samples:
            again.advance(clock[again.block.samples : sample])
        for robot in np.flatnonzero(failed == sample):
            causes[robot] = _cause(again, int(robot), sample, float(times[sample]), clock[sample])
    return causes


def _cause(there: _Underway, robot: int, sample: int, t: float, clock: Floats) -> str:
    loop, values = there.loop, there.robots.values[:, robot]
    noise = np.zeros(loop.plant.samples)
    if loop.plant.samples:
        noise = normal_samples(there.robots.generator(robot), sample + 1, loop.plant.samples)[-1]
    row = trace(loop)(there.block.state[:, robot], clock, noise, values)[1].full()[:, 0]
    return cause(loop, t, loop.signal_layout.unpack(row), Layout(loop.values).unpack(values))


def _chunks(count: int, cut: int, size: int) -> Iterator[slice]:
    """Chunks of samples, with a boundary at `cut`."""
    ends = sorted({*range(0, count, size), min(cut, count), count})
    return (slice(a, b) for a, b in pairwise(ends))


def _summary(blocks: Blocks, loop: ClosedLoop, options: BatchOptions) -> BatchResult:
    """Finished blocks as one result."""
    kept = [(robots.stop - robots.start, block) for robots, block, _ in blocks]
    outputs, inputs = loop.signals["e"], loop.signals["u"]  # as `watched_signals` orders them
    times = sample_times(loop, options.duration)
    counted = int(np.count_nonzero(times >= options.since - 1e-9 * loop.sample_time))

    def gathered(rows: Callable[[Block], Floats]) -> Floats:
        return np.concatenate([rows(block)[..., :count].T for count, block in kept])

    largest, failed = gathered(lambda block: block.largest), gathered(lambda block: block.failed)
    lost = np.isfinite(failed)
    return BatchResult(
        rms=np.where(lost[:, None], np.inf, np.sqrt(gathered(lambda block: block.squares) / counted)),
        largest_error=np.where(lost[:, None], np.inf, largest[:, :outputs]),
        largest_input=np.where(lost[:, None], np.inf, largest[:, outputs : outputs + inputs]),
        largest_estimate=np.where(lost, np.inf, largest[:, -1]),
        final_state=gathered(lambda block: block.state[Layout(loop.states).places["x"]]),
        failure_time=np.where(lost, failed, np.nan) * loop.sample_time,
        failure_cause=np.array([why for _, _, causes in blocks for why in causes]),
    )
