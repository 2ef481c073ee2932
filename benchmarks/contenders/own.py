"""This project's own backends, through its public calls."""

from __future__ import annotations

from collections.abc import Callable

import wmr_afl
from benchmarks.contenders.work import Summary, Work
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate


def one(work: Work, backend: str = "compiled") -> Callable[[], Run]:
    """A run of the assembled loop, the same loop every time."""
    loop, duration = work.loop, work.experiment.simulation.duration

    def run() -> Run:
        return simulate(loop, duration, backend=backend)

    return run


def many(work: Work, backend: str = "compiled", threads: int = 1) -> Callable[[], Summary]:
    """A batch, with all that the call does."""

    def run() -> Summary:
        batch = wmr_afl.run_batch(
            work.file, work.controller, work.parameters, work.start, backend=backend, threads=threads
        )
        return Summary(batch.final_state, batch.rms)

    return run
