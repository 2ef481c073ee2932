"""A CasADi function bound to arrays: called with nothing, it reads and writes them in place and allocates nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]


def bind(function: ca.Function, arguments: Sequence[Numbers], results: Sequence[Numbers]) -> Callable[[], None]:
    """A call that evaluates `function` from the arrays `arguments` into the arrays `results`, contiguous doubles."""
    buffer, run = function.buffer()
    for place, array in enumerate(arguments):
        buffer.set_arg(place, memoryview(array))  # type: ignore[arg-type, call-arg]
    for place, array in enumerate(results):
        buffer.set_res(place, memoryview(array))  # type: ignore[arg-type, call-arg]

    def call(buffer: ca.FunctionBuffer = buffer) -> None:  # which must live as long as the call
        run()

    return call
