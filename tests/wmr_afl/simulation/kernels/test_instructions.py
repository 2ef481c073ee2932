"""Every instruction that is printed to C, and every summary that a kernel keeps, against NumPy."""

from collections.abc import Callable
from math import isnan

import casadi as ca
import numpy as np
import pytest

from wmr_afl.errors import ShapeError, WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.kernels.block import Block, Watched, aligned
from wmr_afl.simulation.kernels.c_printer import (
    CIRCULAR,
    EXTREMES,
    FUNCTIONS,
    SIGN,
    TEMPLATES,
    hexadecimal,
    instructions,
)
from wmr_afl.simulation.kernels.compiled import Kernel as CompiledKernel
from wmr_afl.simulation.kernels.interpreted import FOLDED, InterpretedKernel

KERNELS = {"compiled": CompiledKernel, "casadi": InterpretedKernel}

# One expression a line: its symbols in CasADi, and the same in NumPy. a and b are of either sign, p is positive, s lies
# within -1 and 1.
LAWS: dict[str, tuple[Callable, Callable]] = {
    "negative": (lambda a, b, p, s: -a, lambda a, b, p, s: -a),
    "sum": (lambda a, b, p, s: a + b, lambda a, b, p, s: a + b),
    "difference": (lambda a, b, p, s: a - b, lambda a, b, p, s: a - b),
    "product": (lambda a, b, p, s: a * b, lambda a, b, p, s: a * b),
    "quotient": (lambda a, b, p, s: a / p, lambda a, b, p, s: a / p),
    "square": (lambda a, b, p, s: a**2, lambda a, b, p, s: a * a),
    "twice": (lambda a, b, p, s: a + a, lambda a, b, p, s: 2.0 * a),
    "inverse": (lambda a, b, p, s: 1.0 / p, lambda a, b, p, s: 1.0 / p),
    "root": (lambda a, b, p, s: ca.sqrt(p), lambda a, b, p, s: np.sqrt(p)),
    "size": (lambda a, b, p, s: ca.fabs(a), lambda a, b, p, s: np.abs(a)),
    "sign": (lambda a, b, p, s: ca.sign(a), lambda a, b, p, s: np.sign(a)),
    "exp": (lambda a, b, p, s: ca.exp(a), lambda a, b, p, s: np.exp(a)),
    "sin": (lambda a, b, p, s: ca.sin(a), lambda a, b, p, s: np.sin(a)),
    "cos": (lambda a, b, p, s: ca.cos(a), lambda a, b, p, s: np.cos(a)),
    "tan": (lambda a, b, p, s: ca.tan(a), lambda a, b, p, s: np.tan(a)),
    "tanh": (lambda a, b, p, s: ca.tanh(a), lambda a, b, p, s: np.tanh(a)),
    "asin": (lambda a, b, p, s: ca.asin(s), lambda a, b, p, s: np.arcsin(s)),
    "acos": (lambda a, b, p, s: ca.acos(s), lambda a, b, p, s: np.arccos(s)),
    "atan": (lambda a, b, p, s: ca.atan(a), lambda a, b, p, s: np.arctan(a)),
    "atan2": (lambda a, b, p, s: ca.atan2(a, b), lambda a, b, p, s: np.arctan2(a, b)),
    "floor": (lambda a, b, p, s: ca.floor(a), lambda a, b, p, s: np.floor(a)),
    "ceil": (lambda a, b, p, s: ca.ceil(a), lambda a, b, p, s: np.ceil(a)),
    "power": (lambda a, b, p, s: ca.power(p, a), lambda a, b, p, s: p**a),
    "power of a number": (lambda a, b, p, s: ca.power(1.7, a), lambda a, b, p, s: 1.7**a),
    "power to a number": (lambda a, b, p, s: ca.power(p, 1.3), lambda a, b, p, s: p**1.3),
    "less": (lambda a, b, p, s: a < b, lambda a, b, p, s: 1.0 * (a < b)),
    "less or equal": (lambda a, b, p, s: a <= b, lambda a, b, p, s: 1.0 * (a <= b)),
    "equal": (lambda a, b, p, s: a == b, lambda a, b, p, s: 1.0 * (a == b)),
    "different": (lambda a, b, p, s: a != b, lambda a, b, p, s: 1.0 * (a != b)),
    "not": (lambda a, b, p, s: ca.logic_not(a), lambda a, b, p, s: 1.0 * (a == 0.0)),
    "and": (lambda a, b, p, s: ca.logic_and(a, b), lambda a, b, p, s: 1.0 * ((a != 0.0) & (b != 0.0))),
    "or": (lambda a, b, p, s: ca.logic_or(a, b), lambda a, b, p, s: 1.0 * ((a != 0.0) | (b != 0.0))),
    "choice": (lambda a, b, p, s: ca.if_else(a, b, p), lambda a, b, p, s: np.where(a != 0.0, b, p)),
    "smaller": (lambda a, b, p, s: ca.fmin(a, b), lambda a, b, p, s: np.fmin(a, b)),
    "larger": (lambda a, b, p, s: ca.fmax(a, b), lambda a, b, p, s: np.fmax(a, b)),
    "larger with a number": (lambda a, b, p, s: ca.fmax(a, 0.5), lambda a, b, p, s: np.fmax(a, 0.5)),
    "divisor shared": (lambda a, b, p, s: b / p + a * (1.0 - s / p), lambda a, b, p, s: b / p + a * (1.0 - s / p)),
    "wide angle": (lambda a, b, p, s: ca.sin(3e8 * p), lambda a, b, p, s: np.sin(3e8 * p)),
}
GIVEN = np.array(  # a, b, p, s: signs, zeros and ties of a and b
    [[1.5, -0.5, 0.7, 0.3], [-0.5, 1.5, 1.9, -0.8], [0.0, 0.0, 0.2, 0.0], [0.0, 2.0, 1.0, 0.9], [2.0, 0.0, 3.1, -0.1],
     [0.75, 0.75, 0.6, 0.5], [-1.0, -1.0, 2.0, 1.0], [-2.25, -3.5, 0.9, -1.0]]
)  # fmt: skip


def step_of(where: str) -> ca.Function:
    """A step whose signals are all laws, of numbers of the state, of the robot, of time, or of state and robot mixed.

    The state goes on as it is; the last signal is the regularity, one.
    """
    state, values, t = ca.SX.sym("z", 4), ca.SX.sym("k", 4), ca.SX.sym("t")
    of_time = [t + GIVEN[0, i] for i in range(4)]
    a, b, p, s = {
        "state": state[:4], "robot": values[:4], "time": ca.vertcat(*of_time),
        "state and robot": ca.vertcat(state[0], values[1], state[2], values[3]),
        "robot and state": ca.vertcat(values[0], state[1], values[2], state[3]),
    }[where].elements()  # fmt: skip
    found = [symbolic(a, b, p, s) for symbolic, _ in LAWS.values()]
    signals = ca.vertcat(*found, 1.0)
    return ca.Function("step", [state, t, ca.SX(0, 1), values], [state, signals])


def expected(where: str, lanes: int, t: float) -> Floats:
    """The laws in NumPy, (laws, lanes)."""
    given = GIVEN[:lanes].T if where != "time" else np.repeat((t + GIVEN[0])[:, None], lanes, axis=1)
    with np.errstate(all="ignore"):
        return np.array([np.broadcast_to(numeric(*given), lanes) for _, numeric in LAWS.values()])


@pytest.mark.parametrize("where", ["state", "robot", "time", "state and robot", "robot and state"])
@pytest.mark.parametrize("lanes", [1, 8])
def test_every_instruction_computes_in_machine_code_what_numpy_computes(where: str, lanes: int) -> None:
    """Whatever its operands depend on, and so wherever in the text it stands."""
    kernel = CompiledKernel(step_of(where), Watched(regularity=len(LAWS)), lanes, logged=True)
    given = np.ascontiguousarray(GIVEN[:lanes].T)
    t = 0.0 if where != "time" else 0.125
    block = kernel.start(given)
    rows = kernel.advance(block, np.array([t]), None, kernel.prepare(given))
    for name, found, wanted in zip(LAWS, rows[0], expected(where, lanes, t), strict=False):
        np.testing.assert_allclose(found, wanted, rtol=4e-15, atol=4e-16, err_msg=name)
    np.testing.assert_array_equal(block.state, given)


def test_every_instruction_that_is_printed_is_tried() -> None:
    """Those that CasADi makes of symbols; assignments it makes of none."""
    tried = {one.operation for where in ("state", "robot") for one in instructions(step_of(where))}
    assert {*TEMPLATES, *FUNCTIONS, *SIGN, *EXTREMES, *CIRCULAR} - tried <= {ca.OP_ASSIGN, ca.OP_LOG}


def test_a_logarithm_of_a_state_is_compiled() -> None:
    """As every other instruction is."""
    z = ca.SX.sym("z")
    step = ca.Function("step", [z, ca.SX.sym("t"), ca.SX(0, 1), ca.SX(0, 1)], [z, ca.vertcat(ca.log(z), 1.0)])
    kernel = CompiledKernel(step, Watched(regularity=1), logged=True)
    rows = kernel.advance(kernel.start(np.full((1, 1), 2.5)), np.zeros(1), None, kernel.prepare(np.zeros((0, 1))))
    np.testing.assert_allclose(rows[0, 0, 0], np.log(2.5), rtol=1e-15)


def test_what_is_not_printed_is_refused_with_what_helps() -> None:
    """Not silently left out."""
    z = ca.SX.sym("z")
    step = ca.Function("step", [z, ca.SX.sym("t"), ca.SX(0, 1), ca.SX(0, 1)], [z, ca.vertcat(ca.erf(z), 1.0)])
    with pytest.raises(WmrError, match="run it with backend casadi"):
        CompiledKernel(step, Watched(regularity=1))


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, -1.5, 1e-300, 0.1, float("inf"), -float("inf"), float("nan")])
def test_a_literal_is_read_back_to_the_same_bits(value: float) -> None:
    """Hexadecimal, with its sign; infinities and NaN by their names in C."""
    text = hexadecimal(value).strip("()")
    names = {"NAN": float("nan"), "INFINITY": float("inf"), "-INFINITY": -float("inf")}
    back = names[text] if text in names else float.fromhex(text)
    assert isnan(back) if isnan(value) else np.float64(back).tobytes() == np.float64(value).tobytes()


@pytest.mark.parametrize("operation", ["fmin", "fmax"])
@pytest.mark.parametrize("lanes", [1, 2])
def test_of_a_number_and_none_the_larger_and_the_smaller_are_none(operation: str, lanes: int) -> None:
    """As NumPy's minimum and maximum: what is not a number is not hidden, on whichever side it stands."""
    z, k = ca.SX.sym("z", 2), ca.SX.sym("k", 1)
    value = getattr(ca, operation)
    signals = ca.vertcat(value(z[0], z[1]), value(k, z[0]), value(z[1], k), 1.0)
    step = ca.Function("step", [z, ca.SX.sym("t"), ca.SX(0, 1), k], [z, signals])
    kernel = CompiledKernel(step, Watched(regularity=3), lanes, logged=True)
    for a, b, c in ((np.nan, 2.0, 1.0), (2.0, np.nan, 3.0), (1.0, 2.0, 1.5)):
        state, held = np.tile([[a], [b]], lanes), kernel.prepare(np.full((1, lanes), c))
        rows = kernel.advance(kernel.start(state), np.zeros(1), None, held)[0, :3, 0]
        of = {"fmin": np.minimum, "fmax": np.maximum}[operation]
        np.testing.assert_array_equal(rows, [of(a, b), of(c, a), of(b, c)])


def counter() -> ca.Function:
    """z' = z + k + sample + t; signals z, -2 z, t and a regularity that is positive while |z| < 10."""
    z, t, sample, k = (ca.SX.sym(name) for name in ("z", "t", "sample", "k"))
    signals = ca.vertcat(z, -2.0 * z, t, 10.0 - ca.fabs(z))
    return ca.Function("step", [z, t, sample, k], [z + k + sample + t, signals])


def run_by_hand(start: float, k: float, times: Floats, noise: Floats) -> tuple[Floats, float]:
    """The signals (T, 4) of the counter, and its state after the last sample."""
    z, rows = start, []
    for t, sample in zip(times, noise, strict=True):
        rows.append([z, -2.0 * z, t, 10.0 - abs(z)])
        z = z + k + sample + t
    return np.array(rows), z


WATCHED = Watched(regularity=3, squared=(0, 2), sized=((0,), (1, 2)))


@pytest.mark.parametrize("backend", KERNELS)
@pytest.mark.parametrize("logged", [True, False])
def test_summaries_are_those_of_the_signals(backend: str, logged: bool) -> None:
    """Sums of squares and largest sizes of groups, from where they are counted; the samples go on over calls."""
    count = 70 + FOLDED  # so that steps are taken one by one and folded, too
    times, noise = 0.1 * np.arange(count), np.random.default_rng(0).normal(size=count) * 0.1
    kernel = KERNELS[backend](counter(), WATCHED, 1, logged)
    block, held = kernel.start(np.array([[0.3]])), kernel.prepare(np.array([[-7.45]]))
    whole, end = run_by_hand(0.3, -7.45, times, noise)
    seen = []
    for part in (slice(0, 3), slice(3, 70), slice(70, count)):
        if part.start == 3:
            block.count_from_here()
        seen.append(kernel.advance(block, times[part], np.ascontiguousarray(noise[part, None, None]), held))
    counted = whole[3:]
    np.testing.assert_allclose(block.squares[:, 0], [np.sum(counted[:, i] ** 2) for i in (0, 2)], rtol=1e-12)
    largest = [np.abs(counted[:, 0]).max(), np.abs(counted[:, 1:3]).max()]
    np.testing.assert_allclose(block.largest[:, 0], largest, rtol=1e-12)
    np.testing.assert_allclose(block.state[0, 0], end, rtol=1e-12, atol=1e-12)
    assert block.samples == count
    if logged:
        np.testing.assert_allclose(np.concatenate(seen)[:, :, 0], whole, rtol=1e-12, atol=1e-12)
    else:
        assert np.concatenate(seen).shape == (count, 0, 1)


@pytest.mark.parametrize("backend", KERNELS)
@pytest.mark.parametrize("logged", [True, False])
def test_a_failure_is_the_first_sample_that_is_not_regular(backend: str, logged: bool) -> None:
    """Also if later samples are regular again, if later ones fail as well, and over several calls."""
    z, t, k = (ca.SX.sym(name) for name in ("z", "t", "k"))
    regularity = ca.if_else(ca.logic_or(t == 5.0, ca.logic_or(t == 80.0, t == 120.0)), k, 1.0)
    step = ca.Function("step", [z, t, ca.SX(0, 1), k], [z, ca.vertcat(z, regularity)])
    times = np.arange(140.0)
    for value, expected_failure in ((0.0, 5.0), (-1.0, 5.0), (np.nan, 5.0), (1e-300, np.inf)):
        kernel = KERNELS[backend](step, Watched(regularity=1), 1, logged)
        block, held = kernel.start(np.zeros((1, 1))), kernel.prepare(np.array([[value]]))
        for part in (times[:3], times[3:70], times[70:]):
            kernel.advance(block, part, None, held)
        assert block.failed[0] == expected_failure
        block.count_from_here()
        assert block.failed[0] == expected_failure


@pytest.mark.parametrize("backend", KERNELS)
@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_failure_is_the_first_sample_at_which_a_checked_signal_is_not_finite(
    place: int, wrong: float, backend: str
) -> None:
    """Whichever of the checked ones it is; one that is not checked may be anything."""
    z, t, k = (ca.SX.sym(name) for name in ("z", "t", "k"))
    signals = [z, z, z, 1.0]
    signals[place] = ca.if_else(ca.logic_or(t == 3.0, t == 5.0), k, z)
    step = ca.Function("step", [z, t, ca.SX(0, 1), k], [z, ca.vertcat(*signals)])
    kernel = KERNELS[backend](step, Watched(regularity=3, checked=(0, 2)))
    block = kernel.start(np.ones((1, 1)))
    kernel.advance(block, np.arange(8.0), None, kernel.prepare(np.array([[wrong]])))
    assert block.failed[0] == (np.inf if place == 1 else 3.0)


@pytest.mark.parametrize("backend", KERNELS)
def test_a_size_that_is_no_number_never_counts(backend: str) -> None:
    """The largest one is kept."""
    z, t = ca.SX.sym("z"), ca.SX.sym("t")
    signals = ca.vertcat(ca.if_else(t == 1.0, z / 0.0 * 0.0, 3.0 - t), 1.0)
    step = ca.Function("step", [z, t, ca.SX(0, 1), ca.SX(0, 1)], [z, signals])
    kernel = KERNELS[backend](step, Watched(regularity=1, sized=((0,),)), 1)
    block = kernel.start(np.ones((1, 1)))
    kernel.advance(block, np.array([0.0, 1.0, 2.0]), None, kernel.prepare(np.zeros((0, 1))))
    assert block.largest[0, 0] == 3.0


def test_a_kernel_that_reads_noise_wants_it() -> None:
    """No null pointer is followed."""
    kernel = CompiledKernel(counter(), WATCHED)
    block, held = kernel.start(np.zeros((1, 1))), kernel.prepare(np.zeros((1, 1)))
    with pytest.raises(ShapeError, match="noise"):
        kernel.advance(block, np.zeros(1), None, held)


@pytest.mark.parametrize("lanes", [1, 64])
def test_wide_angles_are_reduced_as_exactly_as_narrow_ones(lanes: int) -> None:
    """In the lanes where they are wide, and in no other: these keep every bit; over more steps than one look takes."""
    z, t, k = ca.SX.sym("z"), ca.SX.sym("t"), ca.SX.sym("k")
    signals = ca.vertcat(ca.sin(z), ca.cos(z), ca.sin(1e7 * t), 1.0)
    step = ca.Function("step", [z, t, ca.SX(0, 1), k], [z + k, signals])
    kernel = CompiledKernel(step, Watched(regularity=3, squared=(0,)), lanes, logged=True)
    rates = np.where(np.arange(lanes) % 3 == 0, 3.3e6, 0.01)[None, :]
    times = np.arange(150.0)
    block = kernel.start(np.zeros((1, lanes)))
    rows = kernel.advance(block, times, None, kernel.prepare(rates))
    angles = np.cumsum(np.vstack([np.zeros((1, lanes)), np.repeat(rates, 150, axis=0)]), axis=0)
    np.testing.assert_allclose(rows[:, 0], np.sin(angles[:-1]), atol=4e-16, rtol=1e-15)
    np.testing.assert_allclose(rows[:, 1], np.cos(angles[:-1]), atol=4e-16, rtol=1e-15)
    np.testing.assert_allclose(rows[:, 2], np.repeat(np.sin(1e7 * times)[:, None], lanes, axis=1), atol=4e-16)
    np.testing.assert_array_equal(block.state[0], angles[-1])
    np.testing.assert_allclose(block.squares[0], np.sum(np.sin(angles[:-1]) ** 2, axis=0), rtol=1e-13)


def test_a_block_holds_what_it_is_given_then_zeros_and_no_failure() -> None:
    """States, sums, sizes and the first failure, one row each, in memory one after the other."""
    block = Block(np.arange(6.0).reshape(2, 3), Watched(regularity=0, squared=(0, 1), sized=((0,), (1,), (0, 1))))
    assert WATCHED.rows == 5
    assert (block.rows.shape, block.squares.shape, block.largest.shape) == ((8, 3), (2, 3), (3, 3))
    np.testing.assert_array_equal(block.state, [[0, 1, 2], [3, 4, 5]])
    assert np.all(block.failed == np.inf)
    assert not block.squares.any()
    assert not block.largest.any()
    block.squares[:], block.largest[:] = 1.0, 2.0
    np.testing.assert_array_equal(block.rows[2:7].sum(axis=1), [3.0, 3.0, 6.0, 6.0, 6.0])
    block.failed[1] = 4.0
    block.count_from_here()
    np.testing.assert_array_equal(block.rows, [[0, 1, 2], [3, 4, 5], *[[0, 0, 0]] * 5, [np.inf, 4, np.inf]])
    for shape in ((3, 5), (1, 1), (64, 7), (2, 9)):
        room = aligned(shape)
        assert room.shape == shape
        assert room.ctypes.data % 64 == 0
        assert room.flags.c_contiguous
