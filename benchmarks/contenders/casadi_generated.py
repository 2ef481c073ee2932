"""CasADi's own generated C: the traced step, compiled with a loop around it, which was the fastest way to use it.

Its `mapaccum` or `fold` generated as a whole took 2 to 10 times as long per step, its map over robots no less.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from benchmarks.contenders.work import LOGGED, Numbers, Summary, Work, places
from wmr_afl.simulation.closed_loop import trace
from wmr_afl.simulation.kernels.c_compiler import library


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot."""
    run_one = _library(work, LOGGED).run
    start, values, times = work.states()[0], work.values()[0], work.times
    width = sum(work.loop.signals[name] for name in LOGGED)

    def run() -> Numbers:
        state, rows = start.copy(), np.empty((len(times), width))
        _call(run_one, [len(times)], [times, state, values, rows])
        return rows

    return run


def many(work: Work) -> Callable[[], Summary]:
    """Robot after robot."""
    run_all = _library(work, ["e"]).run_all
    starts, values, times, errors = work.states(), work.values(), work.times, work.loop.signals["e"]
    plant = len(work.loop.states["x"])

    def run() -> Summary:
        states, squares = starts.copy(), np.empty((work.robots, errors))
        _call(run_all, [work.robots, len(times)], [times, states, values, squares])
        return Summary(states[:, :plant], np.sqrt(squares))

    return run


def _library(work: Work, logged: Sequence[str]) -> ctypes.CDLL:
    """The loop around the generated step, whose rows hold the `logged` signals."""
    step, place = trace(work.loop), places(work)
    z, t, k = ca.SX.sym("z", step.size1_in(0)), ca.SX.sym("t"), ca.SX.sym("k", step.size1_in(3))
    following, signals = step(z, t, ca.SX.zeros(step.size1_in(2)), k)
    row = ca.vertcat(*(signals[place[name]] for name in logged))
    traced = ca.Function("traced", [z, t, k], ca.cse([ca.densify(following), ca.densify(row)]))
    generator = ca.CodeGenerator("traced.c")
    generator.add(traced)
    before = list(logged)[: list(logged).index("e")]
    sizes = {
        "STATES": z.size1(),
        "VALUES": k.size1(),
        "ROW": row.size1(),
        "ERRORS": work.loop.signals["e"],
        "FIRST_ERROR": sum(work.loop.signals[name] for name in before),
        "ARGUMENTS": max(3, traced.sz_arg()),
        "RESULTS": max(2, traced.sz_res()),
        "INTEGERS": max(1, traced.sz_iw()),
        "REALS": max(1, traced.sz_w()),
    }
    defines = "".join(f"#define {name} {size}\n" for name, size in sizes.items())
    around = Path(__file__).with_name("casadi_loop.c").read_text(encoding="utf-8")
    return library(generator.dump() + defines + around)


def _call(function: Callable[..., object], counts: list[int], arrays: list[np.ndarray]) -> None:
    function.restype = None
    function(*map(ctypes.c_long, counts), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
