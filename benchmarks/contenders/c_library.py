"""The C texts beside this file, built as the project builds its own, and called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.contenders.study_1 import ERRORS, PLANT, SIGNALS, STATES, numbers
from benchmarks.contenders.work import Numbers, Summary, Work
from wmr_afl.simulation.kernels.c_compiler import library


def one(work: Work, *files: str, width: int = 1) -> Callable[[], Numbers]:
    """The `run` of files that make one text, for the first robot; `width` becomes WIDTH."""
    function = _library(files, width).run
    function.restype = ctypes.c_long
    parameters, start, count = numbers(work)[0], work.states()[0], len(work.times)

    def run() -> Numbers:
        state, rows = start.copy(), np.empty((count, SIGNALS))
        if function(_address(parameters), ctypes.c_size_t(count), _address(state), _address(rows)) != -1:
            raise ArithmeticError("the run was lost")
        return rows

    return run


def many(work: Work, *files: str, width: int = 1) -> Callable[[], Summary]:
    """Their `run_all`, for all robots."""
    function = _library(files, width).run_all
    function.restype = None
    parameters, starts, count, robots = numbers(work), work.states(), len(work.times), work.robots
    assert starts.shape[1] == STATES

    def run() -> Summary:
        states, squares, failed = starts.copy(), np.empty((robots, ERRORS)), np.empty(robots, dtype=ctypes.c_long)
        function(
            ctypes.c_size_t(robots), _address(parameters), ctypes.c_size_t(count), _address(states), _address(squares),
            _address(failed),
        )  # fmt: skip
        if np.any(failed != -1):
            raise ArithmeticError("a run was lost")
        return Summary(states[:, :PLANT], np.sqrt(squares))

    return run


def _library(files: Sequence[str], width: int) -> ctypes.CDLL:
    texts = (Path(__file__).with_name(file).read_text(encoding="utf-8") for file in files)
    return library("\n".join([f"#define WIDTH {width}", *texts]))


def _address(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
