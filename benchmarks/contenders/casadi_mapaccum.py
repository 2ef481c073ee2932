"""CasADi's virtual machine, called bare: the traced step mapped over the samples by `mapaccum`.

The values are handed on from sample to sample with the state, which is faster than repeating them for every sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from benchmarks.contenders.work import LOGGED, Numbers, Summary, Work, places
from wmr_afl.simulation.closed_loop import trace


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot."""
    steps, start, times = _steps(work, LOGGED), _start(work)[0], work.times[None, :]

    def run() -> Numbers:
        return steps(start, times)[1].full().T

    return run


def many(work: Work) -> Callable[[], Summary]:
    """Robot after robot."""
    steps, starts, times = _steps(work, ["e"]), _start(work), work.times[None, :]
    plant, errors = len(work.loop.states["x"]), work.loop.signals["e"]

    def run() -> Summary:
        final, rms = np.empty((len(starts), plant)), np.empty((len(starts), errors))
        for i, start in enumerate(starts):
            after, rows = steps(start, times)
            final[i] = after[:plant, -1].full()[:, 0]
            rms[i] = np.sqrt(np.mean(rows.full() ** 2, axis=1))
        return Summary(final, rms)

    return run


def _start(work: Work) -> Numbers:
    return np.hstack([work.states(), work.values()])


def _steps(work: Work, logged: Sequence[str]) -> ca.Function:
    """([state, values], times) -> (state and values after each sample, `logged` signals of each sample)."""
    step, place = trace(work.loop), places(work)
    z, t, k = ca.SX.sym("z", step.size1_in(0)), ca.SX.sym("t"), ca.SX.sym("k", step.size1_in(3))
    following, signals = step(z, t, ca.SX.zeros(step.size1_in(2)), k)
    row = ca.vertcat(*(signals[place[name]] for name in logged))
    single = ca.Function("single", [ca.vertcat(z, k), t], ca.cse([ca.vertcat(following, k), ca.densify(row)]))
    return single.mapaccum("steps", len(work.times))
