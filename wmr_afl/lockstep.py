"""Blocks of robots that differ in numbers only: one trace serves all, each block advances in lockstep."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.block import Block, Watched
from wmr_afl.closed_loop import ClosedLoop, sample_times
from wmr_afl.errors import SimulationError, UnknownNameError
from wmr_afl.kernels import KERNELS, Kernel
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.tracing import trace
from wmr_afl.variation import Variation

Numbers = NDArray[np.float64]
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
        raise SimulationError(f"errors cannot count since {since:g} s; a run goes from 0 to {duration:g} s")
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
