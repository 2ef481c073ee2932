"""A kernel on CasADi's virtual machine, one robot at a time: for machines without a C compiler."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.kernels.block import Block, Watched

FOLDED = 1000  # samples; folding fewer steps into one function costs more than it saves


class InterpretedKernel:
    """`step` (state, clock, sample, values) -> (next, signals), called like a `compiled.Kernel`, robot by robot."""

    lanes = 1

    def __init__(self, step: ca.Function, watched: Watched, lanes: int = 1, logged: bool = False) -> None:
        self.watched, self._logged = watched, logged
        self._counting = counting(step, watched, logged)
        self._folded = functools.lru_cache(maxsize=4)(self._counting.fold)  # by number of steps; building one is slow

    def start(self, state: Floats) -> Block:
        """A block at its start, from state (states, 1)."""
        return Block(np.asarray(state, dtype=float), self.watched)

    def prepare(self, values: Floats) -> Floats:
        """The values (values, 1) as they are."""
        return values

    def advance(self, block: Block, clock: Floats, noise: Floats | None, held: Floats) -> Floats:
        """Advance `block` by all rows of `clock`; return the signals (T, signals, 1), none of them if not logged."""
        samples = np.zeros((len(clock), 0)) if noise is None else noise[:, :, 0]
        inputs = np.column_stack([clock, block.samples + np.arange(len(clock), dtype=float), samples])
        given = np.concatenate([block.rows, held])[:, 0]
        if self._logged or len(clock) < FOLDED:
            given, signals = self._one_by_one(given, inputs)
        else:
            given, signals = self._folded(len(clock))(given, inputs.T).full()[:, 0], np.empty((len(clock), 0))
        block.rows[:, 0] = given[: len(block.rows)]
        block.samples += len(clock)
        return signals[:, :, None]

    def _one_by_one(self, given: Floats, inputs: Floats) -> tuple[Floats, Floats]:
        """`given` after all `inputs`, and the signals (T, signals); the loop allocates no array."""
        now, following = given.copy(), given.copy()
        given_now, logged = np.zeros(self._counting.size1_in(1)), self._counting.n_out() > 1
        signals = np.zeros(self._counting.size1_out(1) if logged else 0)
        run = bind(self._counting, (now, given_now), (following, signals) if logged else (following,))
        rows = np.empty((len(inputs), len(signals)))
        for i in range(len(inputs)):
            given_now[:] = inputs[i]
            run()
            now[:] = following
            rows[i] = signals
        return now, rows


def counting(step: ca.Function, watched: Watched, logged: bool) -> ca.Function:
    """([rows of a Block; values], [clock; number of the sample; sample]) -> the same a step later, signals if logged.

    The values are carried from step to step with the state, which CasADi maps faster than repeating them.
    """
    states, noisy = step.size1_in(0), any(step.jac_sparsity(result, 2).nnz() for result in range(2))
    kept, values = ca.SX.sym("kept", states + watched.rows), ca.SX.sym("values", step.size1_in(3))
    clock, number = ca.SX.sym("clock", step.size1_in(1)), ca.SX.sym("number")
    sample = ca.SX.sym("sample", step.size1_in(2) if noisy else 0)
    following, signals = step(kept[:states], clock, sample if noisy else ca.SX.zeros(step.size1_in(2)), values)
    squares = [kept[states + i] + signals[place] ** 2 for i, place in enumerate(watched.squared)]
    largest = []
    for i, group in enumerate(watched.sized):
        size = kept[states + len(squares) + i]
        for place in group:
            size = ca.if_else(ca.fabs(signals[place]) > size, ca.fabs(signals[place]), size)  # NaN never counts
        largest.append(size)
    whole = ca.sum1(signals[list(watched.checked)]) if watched.checked else ca.SX(0.0)
    is_sound = ca.logic_and(signals[watched.regularity] > 0.0, ca.fabs(whole) < ca.inf)  # x - x is zero to CasADi
    failed = ca.if_else(is_sound, kept[-1], ca.fmin(number, kept[-1]))
    after = ca.vertcat(following, *squares, *largest, failed, values)
    outputs = ca.cse([after, signals] if logged else [after])
    return ca.Function("counting", [ca.vertcat(kept, values), ca.vertcat(clock, number, sample)], outputs)


def bind(function: ca.Function, arguments: Sequence[Floats], results: Sequence[Floats]) -> Callable[[], None]:
    """A call that evaluates `function` from the arrays `arguments` into the arrays `results`, contiguous doubles."""
    buffer, run = function.buffer()
    for place, array in enumerate(arguments):
        buffer.set_arg(place, memoryview(array))  # type: ignore[arg-type, call-arg]
    for place, array in enumerate(results):
        buffer.set_res(place, memoryview(array))  # type: ignore[arg-type, call-arg]

    def call(buffer: ca.FunctionBuffer = buffer) -> None:  # the default keeps the buffer alive as long as the call
        run()

    return call
