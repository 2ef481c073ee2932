"""Many closed loops that differ in numbers only: what each of them came to, and their trajectories on disk."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import SimulationError, UnknownNameError
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times, trace
from wmr_afl.simulation.ensemble import Variation, nominal
from wmr_afl.simulation.kernels.block import Block, Watched
from wmr_afl.simulation.kernels.kernel import KERNELS, Kernel
from wmr_afl.simulation.layout import Layout

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class BatchResult:
    """Summaries of N runs since some time; of a run that failed all but its end are infinite."""

    rms: Numbers  # (N, n-m), of the tracking error since `since`
    largest_error: Numbers  # (N, n-m)
    largest_input: Numbers  # (N, n_u) [V]
    largest_estimate: Numbers  # (N,)
    final_state: Numbers  # (N, 2n-m), where the last sample leads to
    failure_time: Numbers  # (N,) [s], NaN where none

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(N,)"""
        return np.isfinite(self.failure_time)


def rms_of_many(loops: Sequence[ClosedLoop], duration: float) -> Numbers:
    """Root mean square of every loop's tracking error over `duration` [s], (loops, n-m); inf where a run fails.

    Raises: ShapeError, where the loops differ in more than numbers.
    """
    return advance_all(loops[0], nominal(loops), duration).rms


def advance_all(
    loop: ClosedLoop,
    variation: Variation,
    duration: float,
    since: float = 0.0,
    threads: int = 1,
    backend: str = "auto",
    progress: Callable[[int], None] = lambda done: None,
) -> BatchResult:
    """What the robots of a variation come to in `duration` [s]."""
    blocks = advance_blocks(loop, variation, duration, since, threads, backend)
    return summarize(_telling(blocks, progress), loop, duration, since)


Blocks = Iterable[tuple[slice, Block]]


def _telling(blocks: Blocks, progress: Callable[[int], None]) -> Blocks:
    for robots, block in blocks:
        progress(robots.stop - robots.start)
        yield robots, block


def summarize(blocks: Blocks, loop: ClosedLoop, duration: float, since: float) -> BatchResult:
    """Blocks that have come to their end, as one result."""
    kept = [(robots.stop - robots.start, block) for robots, block in blocks]
    outputs, inputs = loop.signals["e"], loop.signals["u"]  # as `watched_signals` orders them
    counted = int(np.count_nonzero(sample_times(loop, duration) >= since - 1e-9 * loop.sample_time))

    def gathered(rows: Callable[[Block], Numbers]) -> Numbers:
        return np.concatenate([rows(block)[..., :count].T for count, block in kept])

    largest = gathered(lambda block: block.largest)

    failed = gathered(lambda block: block.failed)
    lost = np.isfinite(failed)
    return BatchResult(
        rms=np.where(lost[:, None], np.inf, np.sqrt(gathered(lambda block: block.squares) / counted)),
        largest_error=np.where(lost[:, None], np.inf, largest[:, :outputs]),
        largest_input=np.where(lost[:, None], np.inf, largest[:, outputs : outputs + inputs]),
        largest_estimate=np.where(lost, np.inf, largest[:, -1]),
        final_state=gathered(lambda block: block.state[Layout(loop.states).places["x"]]),
        failure_time=np.where(lost, failed, np.nan) * loop.sample_time,
    )


Record = Callable[[slice, slice, Numbers], None]  # robots, samples, signals (samples, signals, robots)


LANES = 64  # robots of a block: their numbers stay in the first cache


CHUNK = 1000  # samples of noise, or of signals that are recorded, in memory at a time


def watched_signals(loop: ClosedLoop) -> Watched:
    """What a batch tells of each run: tracking errors, inputs and estimates."""
    places = {name: tuple(range(place.start, place.stop)) for name, place in loop.signal_layout.places.items()}
    return Watched(
        places["regularity"][0], places["e"], (*((i,) for i in places["e"] + places["u"]), places["theta_hat"])
    )


def advance_blocks(
    loop: ClosedLoop,
    variation: Variation,
    duration: float,
    since: float = 0.0,
    threads: int = 1,
    backend: str = "auto",
    record: Record | None = None,
) -> Iterator[tuple[slice, Block]]:
    """Advances all robots of a variation for `duration` [s], and gives each block with its place among the robots.

    Summaries count from `since` [s]; `record` is given all signals, chunk by chunk. Neither the number of threads nor
    the place of a robot among the others changes a bit of its numbers.
    Raises: UnknownNameError, where there is no such backend; SimulationError, where `since` is no time of the run.
    """
    if backend not in KERNELS:
        raise UnknownNameError("backend of a batch", str(backend), KERNELS)
    if not 0.0 <= since <= duration:
        raise SimulationError(f"errors cannot count since {since:g} s", f"a run goes from 0 to {duration:g} s")
    kernel = kernel_of(loop, backend, record is not None)
    times = sample_times(loop, duration)
    counted_from = int(np.ceil(since / loop.sample_time - 1e-9))
    chunk = CHUNK if loop.plant.noise or record is not None else len(times)

    def advance(robots: slice) -> tuple[slice, Block]:
        chosen = variation.block(robots, kernel.lanes)
        block, held = kernel.start(chosen.states), kernel.prepare(np.ascontiguousarray(chosen.values))
        generators = [chosen.generator(robot) for robot in range(len(chosen.seeds))]
        for samples in _chunks(len(times), counted_from, chunk):
            if samples.start == counted_from:
                block.count_from_here()
            part, noise = times[samples], None
            if loop.plant.noise:
                noise = np.stack([normal_samples(g, len(part), loop.signals["x"]) for g in generators], axis=-1)
            rows = kernel.advance(block, part, noise, held)
            if record is not None:
                record(robots, samples, rows[:, :, : robots.stop - robots.start])
        return robots, block

    places = (slice(a, min(a + kernel.lanes, variation.count)) for a in range(0, variation.count, kernel.lanes))
    if threads <= 1:
        yield from map(advance, places)
    else:
        with ThreadPoolExecutor(max_workers=threads) as pool:
            yield from pool.map(advance, places)


@functools.lru_cache(maxsize=32)
def kernel_of(loop: ClosedLoop, backend: str, logged: bool) -> Kernel:
    """The kernel that runs blocks of robots of this loop."""
    return KERNELS[backend](trace(loop), watched_signals(loop), LANES, logged)


def _chunks(count: int, cut: int, size: int) -> Iterator[slice]:
    """Chunks of samples, with a boundary at `cut`."""
    ends = sorted({*range(0, count, size), min(cut, count), count})
    return (slice(a, b) for a, b in pairwise(ends))
