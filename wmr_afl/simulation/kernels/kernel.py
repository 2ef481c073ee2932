"""What every kernel does, and the kernels by the name of their backend."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Protocol

import casadi as ca

from wmr_afl.errors import BackendWarning, CompilerError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.kernels.block import Block, Watched
from wmr_afl.simulation.kernels.compiled import Kernel as CompiledKernel
from wmr_afl.simulation.kernels.interpreted import InterpretedKernel


class Kernel(Protocol):
    """Advances a block of robots: `start`, `prepare` once, then `advance` as often as wanted."""

    lanes: int

    def start(self, state: Floats) -> Block: ...
    def prepare(self, values: Floats) -> Floats: ...
    def advance(self, block: Block, clock: Floats, noise: Floats | None, held: Floats) -> Floats: ...


MakeKernel = Callable[[ca.Function, Watched, int, bool], Kernel]  # of step, watched signals, lanes, logged


def compiled_if_possible(step: ca.Function, watched: Watched, lanes: int, logged: bool) -> Kernel:
    """Machine code; without a compiler that works, the virtual machine and a BackendWarning."""
    try:
        return CompiledKernel(step, watched, lanes, logged)
    except CompilerError as error:
        warnings.warn(f"{error.problem}; running on CasADi's virtual machine, slowly", BackendWarning, stacklevel=2)
        return InterpretedKernel(step, watched, lanes, logged)


KERNELS: Mapping[str, MakeKernel] = {
    "compiled": CompiledKernel,
    "casadi": InterpretedKernel,
    "auto": compiled_if_possible,
}
