"""What a compiled kernel does, by CasADi's virtual machine, robot after robot: for machines without a C compiler."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wmr_afl.block import Block, Watched
from wmr_afl.bound_function import bind
from wmr_afl.linear_algebra import SINGULAR

Numbers = NDArray[np.float64]


class InterpretedKernel:
    """`step` (state, t, sample, values) -> (next, signals), called like a `compiled.kernel.Kernel`."""

    def __init__(self, step: ca.Function, watched: Watched, lanes: int = 1, logged: bool = False) -> None:
        self.lanes, self.watched = lanes, watched
        self._step, self._logged = step, logged

    def start(self, state: Numbers) -> Block:
        """At the start, state (states, lanes)."""
        return Block(np.asarray(state, dtype=float), self.watched)

    def prepare(self, values: Numbers) -> Numbers:
        """The values (values, lanes) as they are."""
        return values

    def advance(self, block: Block, times: Numbers, noise: Numbers | None, held: Numbers) -> Numbers:
        """Advances `block` by all `times` (T,); gives the signals (T, signals, lanes) where they are logged."""
        watched, squared, sized = self.watched, list(self.watched.squared), list(self.watched.sized)
        logged = np.empty((len(times), self._step.size1_out(1) if self._logged else 0, self.lanes))
        for lane in range(self.lanes):
            sample = None if noise is None else noise[:, :, lane]
            block.state[:, lane], rows = self._steps(block.state[:, lane], times, sample, held[:, lane])
            bad = np.flatnonzero(~(rows[:, watched.regularity] >= SINGULAR))
            if len(bad) and block.failed[lane] < 0:
                block.failed[lane] = block.samples + bad[0]
            with np.errstate(over="ignore", invalid="ignore"):  # of runs that are lost already
                block.squares[:, lane] += np.sum(rows[:, squared] ** 2, axis=0)
                sizes = np.fmax.reduce(np.abs(rows[:, sized]), axis=0, initial=0.0)
            block.largest[:, lane] = np.fmax(block.largest[:, lane], sizes)
            if self._logged:
                logged[:, :, lane] = rows
        block.samples += len(times)
        return logged

    def _steps(self, state: Numbers, times: Numbers, noise: Numbers | None, values: Numbers) -> tuple[Numbers, Numbers]:
        """The state after all `times`, and the signals (T, signals); no array is made on the way."""
        now, t, sample, k = state.copy(), np.zeros(1), np.zeros(self._step.size1_in(2)), values.copy()
        following, signals = np.zeros_like(now), np.zeros(self._step.size1_out(1))
        run = bind(self._step, (now, t, sample, k), (following, signals))
        rows = np.empty((len(times), len(signals)))
        for i in range(len(times)):
            t[0] = times[i]
            if noise is not None:
                sample[:] = noise[i]
            run()
            now[:] = following
            rows[i] = signals
        return now, rows
