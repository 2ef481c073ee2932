"""A traced step as a compiled kernel that advances one robot, or a block of robots in lockstep."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from wmr_afl.errors import ShapeError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.kernels.block import Block, Watched, aligned
from wmr_afl.simulation.kernels.c_compiler import library
from wmr_afl.simulation.kernels.c_printer import Argument, Depends, Program, print_step

_ENVIRONMENT = Environment(  # C, not HTML
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701
)
_NOISE = 2  # index of the step's argument that may be left out if nothing reads it


class Kernel:
    """`step` (state, clock, sample, values) -> (next, signals), compiled for `lanes` robots at a time.

    Raises:
        CompilerError: if it cannot be built.
        WmrError: if the step has an operation that is not printed.
    """

    def __init__(self, step: ca.Function, watched: Watched, lanes: int = 1, logged: bool = False) -> None:
        self.lanes, self.watched = lanes, watched
        self.signals = step.size1_out(1) if logged else 0
        text, self._held, self._reads_noise = kernel_text(step, watched, lanes, logged)
        self._prepare, self._advance, self._advance_bare = _functions(text)

    def start(self, state: Floats) -> Block:
        """A block at its start, from state (states, lanes)."""
        return Block(np.asarray(state, dtype=float), self.watched)

    def prepare(self, values: Floats) -> Floats:
        """What no step changes, from values (values, lanes): to be given to every `advance` of these robots."""
        held = aligned((self._held, self.lanes))
        self._prepare(_pointer(np.ascontiguousarray(values, dtype=float)), _pointer(held))
        return held

    def advance(self, block: Block, clock: Floats, noise: Floats | None, held: Floats) -> Floats:
        """Advance `block` by all rows of `clock`; return the signals (T, signals, lanes), none of them if not logged.

        `clock` (T, numbers), or (T,) if it holds times [s] alone.

        `noise`: (T, samples, lanes), contiguous, or None if the step reads none.

        Raises:
            ShapeError: if the step reads noise and none is given.
        """
        if noise is None and self._reads_noise:
            raise ShapeError("this loop measures with noise", "give its samples")
        rows = np.empty((len(clock), self.signals, self.lanes))
        self._advance(
            len(clock), block.samples, _pointer(np.ascontiguousarray(clock)), _pointer(noise), _pointer(held),
            _pointer(block.rows), _pointer(rows),
        )  # fmt: skip
        block.samples += len(clock)
        return rows

    def bound(self, block: Block, clock: Floats, noise: Floats, held: Floats, rows: Floats) -> Callable[[], None]:
        """A call that advances `block` by one sample from these arrays into `rows`, and allocates nothing.

        The arrays must outlive the call.
        """
        pointers = (ctypes.c_void_p(_pointer(array)) for array in (clock, noise, held, block.rows, rows))
        return functools.partial(self._advance_bare, ctypes.c_size_t(1), ctypes.c_size_t(0), *pointers)


def kernel_text(step: ca.Function, watched: Watched, lanes: int, logged: bool) -> tuple[str, int, bool]:
    """The kernel's C text, the same for the same step; how many numbers it holds a robot; whether it reads noise."""
    program = print_loop(step, lanes)
    reads_noise = _NOISE in program.reads
    text = _ENVIRONMENT.get_template("kernel.c.jinja").render(
        lanes=lanes,
        program=program,
        states=step.size1_in(0),
        clock=step.size1_in(1),
        kept=step.size1_in(0) + watched.rows,
        noise=step.size1_in(_NOISE) if reads_noise else 0,
        signals=program.results[1],
        squared=watched.squared,
        sized=watched.sized,
        regularity=watched.regularity,
        checked=[program.results[1][entry] for entry in watched.checked],
        logged=logged,
    )
    return text, len(program.held), reads_noise


def print_loop(step: ca.Function, lanes: int) -> Program:
    """The step's lines of C, its arguments as the kernel's arrays."""
    lane = f"[{{i}} * {lanes} + l]"
    arguments = (
        Argument(f"kept{lane}", Depends.BOTH),
        Argument("now[{i}]", Depends.TIME),
        Argument(f"noise{lane}", Depends.BOTH),
        Argument(f"k{lane}", Depends.ROBOT),
    )
    return print_step(step, arguments, alone=lanes == 1)


@functools.lru_cache(maxsize=256)
def _functions(text: str) -> tuple[Callable[..., None], Callable[..., None], Callable[..., None]]:
    """`prepare`, `advance`, and `advance` without conversion of its arguments, which costs as much as a small step.

    Pointers are passed as numbers; NumPy owns the memory.
    """
    built = library(text)
    size, pointer = ctypes.c_size_t, ctypes.c_void_p
    built.prepare.argtypes, built.prepare.restype = [pointer, pointer], None
    built.advance.argtypes, built.advance.restype = [size, size, *[pointer] * 5], None
    bare = built["advance"]
    bare.restype = None
    return built.prepare, built.advance, bare


def _pointer(array: Floats | None) -> int | None:
    if array is None:
        return None
    if not (array.flags.c_contiguous and array.dtype == np.float64):
        raise ShapeError("a compiled kernel takes contiguous arrays of doubles", "give np.ascontiguousarray(...)")
    return array.ctypes.data
