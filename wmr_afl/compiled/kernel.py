"""A traced step as a compiled kernel that advances one robot, or a block of robots in lockstep."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from wmr_afl.compiled.build import library
from wmr_afl.compiled.printer import print_step
from wmr_afl.errors import ShapeError
from wmr_afl.linear_algebra import SINGULAR

Numbers = NDArray[np.float64]
_ENVIRONMENT = Environment(  # C, not HTML
    loader=PackageLoader("wmr_afl", "compiled"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701
)


@dataclass
class Progressed:
    """What a block of robots has come to; grows with every call of `advance`."""

    state: Numbers  # (states, lanes)
    squares: Numbers  # (signals, lanes), sums
    largest: Numbers  # (signals, lanes), of the sizes
    failed: Numbers  # (lanes,), first sample that was singular or not finite, -1 where none was
    samples: int = 0  # so far

    @classmethod
    def at_start(cls, state: Numbers, signals: int) -> Progressed:
        state = np.array(state, dtype=float, order="C")
        lanes = state.shape[1]
        return cls(state, np.zeros((signals, lanes)), np.zeros((signals, lanes)), np.full(lanes, -1.0))


class Kernel:
    """`step` (state, t, sample, values) -> (next, signals), compiled for `lanes` robots at a time.

    `regularity`: the signal whose fall below `SINGULAR` is a failure.
    Raises: WmrError, where it cannot be built.
    """

    def __init__(self, step: ca.Function, regularity: int, lanes: int = 1) -> None:
        self.lanes, self.signals = lanes, step.size1_out(1)
        self._advance = _function(kernel_text(step, regularity, lanes))

    def advance(
        self,
        progressed: Progressed,
        times: Numbers,
        noise: Numbers | None,
        values: Numbers,
        since: int = 0,
        log: bool = False,
    ) -> Numbers:
        """Advances `progressed` by all `times` (T,); gives the signals (T, signals, lanes) where `log`.

        noise (T, samples, lanes) or none; values (values, lanes); both contiguous. Squares and sizes count from sample
        `since` on.
        """
        rows = np.empty((len(times) if log else 0, self.signals, self.lanes))
        p = progressed
        self._advance(
            len(times), p.samples, _pointer(np.ascontiguousarray(times)), _pointer(p.state), _pointer(noise),
            _pointer(values), _pointer(rows if log else None), since,
            _pointer(p.squares), _pointer(p.largest), _pointer(p.failed),
        )  # fmt: skip
        p.samples += len(times)
        return rows


def kernel_text(step: ca.Function, regularity: int, lanes: int) -> str:
    """The kernel's C text: the same for the same step."""
    lane = f"[{{i}} * {lanes} + l]"
    arguments, results = [f"z{lane}", "t", f"sample{lane}", f"k{lane}"], [f"next{lane}", f"signals{lane}"]
    return _ENVIRONMENT.get_template("kernel.c.jinja").render(
        lanes=lanes,
        program=print_step(step, arguments, results, shared=1),
        states=step.size1_in(0),
        samples=step.size1_in(2),
        signals=step.size1_out(1),
        regularity=regularity,
        singular=SINGULAR,
    )


@functools.lru_cache(maxsize=256)
def _function(text: str) -> Callable[..., None]:
    function = library(text).advance
    size, pointer = ctypes.c_size_t, ctypes.c_void_p
    function.argtypes = [size, size, *[pointer] * 5, size, pointer, pointer, pointer]
    function.restype = None
    return function


def _pointer(array: Numbers | None) -> int | None:
    if array is None:
        return None
    if not (array.flags.c_contiguous and array.dtype == np.float64):
        raise ShapeError("a compiled kernel takes contiguous arrays of doubles")
    return array.ctypes.data
