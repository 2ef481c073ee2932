"""Exported folders as shared libraries, called from Python."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.c_source import Source
from wmr_afl.onboard.export import onboard
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.kernels.c_compiler import compiler

WARNINGS = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wdouble-promotion", "-Wshadow"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes"),
)
STRICT = [*WARNINGS, "-O2", "-ffp-contract=off", "-fno-math-errno"]
SANITIZED = [*WARNINGS, "-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def built(folder: Path, flags: list[str], out: str, *more: str) -> Path:
    """All C files of a folder, compiled and linked."""
    files = sorted(str(path) for path in folder.glob("*.c"))
    command = compiler()
    assert command is not None
    subprocess.run([*command, *flags, *files, *more, "-o", str(folder / out), "-lm"], check=True, cwd=folder)
    return folder / out


class Law:
    """The C of a loop's controller, sample by sample."""

    def __init__(self, loop: ClosedLoop, folder: Path, is_single: bool) -> None:
        source = Source(onboard(loop), is_single=is_single)
        folder.mkdir()
        (folder / "controller.h").write_text(source.header())
        (folder / "controller.c").write_text(source.code())
        self.library = ctypes.CDLL(str(built(folder, [*STRICT, "-shared", "-fPIC"], "law.so")))
        self.type = np.dtype(np.float32 if is_single else np.float64)
        real = ctypes.c_float if is_single else ctypes.c_double
        self.library.controller_step.argtypes = [ctypes.c_void_p, real, *[ctypes.c_void_p] * 4]
        self.sampled = source.sampled
        self.room = np.zeros(2 * self.sampled.states.size, self.type)
        self.library.controller_init(ctypes.c_void_p(self.room.ctypes.data))
        self.u = np.zeros(self.sampled.signals["u"], self.type)

    @property
    def state(self) -> Floats:
        """The states as doubles."""
        return self.room[: self.sampled.states.size].astype(float)

    def step(self, dt: float, x: Floats, setpoint: Floats) -> int:
        """One sample; u is in `u`."""
        x, setpoint = x.astype(self.type), setpoint.astype(self.type)
        return int(
            self.library.controller_step(
                self.room.ctypes.data, dt, x.ctypes.data, setpoint.ctypes.data, self.u.ctypes.data, None
            )
        )
