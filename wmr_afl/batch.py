"""Many closed loops that differ in numbers only: what each of them came to, and their trajectories on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.block import Block
from wmr_afl.closed_loop import ClosedLoop, Layout, sample_times
from wmr_afl.loading import load_experiment
from wmr_afl.lockstep import advance_blocks
from wmr_afl.trajectories import recording
from wmr_afl.variation import Variation, nominal, vary

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
    trajectories: str | Path | None = None,
    scale: Mapping[str, ArrayLike] | None = None,
) -> BatchResult:
    """Runs one controller of an experiment (the first unless named) for many robots that differ in numbers.

    `parameters`, `start`: physical parameters and states by name, (N,) each; the controller knows the known constants
    of each robot, and exact or guessed estimates follow. `values`: gains of the loop by name (b1, Gamma ...), (N, ...);
    `scale`: factors (N,) on parameters or gains by name;
    `seeds` (N,) of the measurement noise. Errors count since `since` [s]. `backend`: "compiled", "casadi", or "auto".
    `trajectories`: an HDF5 file that takes all samples of all runs, chunk by chunk, whatever their number.
    Raises: InputError, UnknownNameError; ShapeError, where the numbers of robots differ; WmrError.
    """
    loaded = load_experiment(experiment)
    name, duration = loaded.name(controller), loaded.told.simulation.duration
    loop = loaded.loops[name]
    variation = vary(loaded.told, loop, name, parameters or {}, start or {}, values or {}, seeds, scale)
    if trajectories is None:
        return advance_all(loop, variation, duration, since, threads, backend, progress)
    with recording(Path(trajectories), loop, sample_times(loop, duration), variation.count) as record:
        blocks = advance_blocks(loop, variation, duration, since, threads, backend, record)
        return summarize(_telling(blocks, progress), loop, duration, since)


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
