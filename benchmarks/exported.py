"""Exported folders as shared libraries, called from Python."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np

from wmr_afl import Controller
from wmr_afl.controllers.outer_loop import tracking_error
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
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


def tracked(loop: ClosedLoop, law: Law | None, samples: int) -> Floats:
    """The errors (T, n-m) of a loop's robot, in double precision, under exported C or under Python's own law."""
    model, values, state = loop.model.in_library("numpy"), by_part(loop.values), dict(loop.plant.states)
    sampled, errors = onboard(loop), []
    controller = Controller(loop.model, loop.law, sampled.reference, loop.sample_time, list(sampled.drive))
    for k in range(samples):
        t = k * loop.sample_time
        now = loop.reference.at(t)
        seen, setpoint = np.asarray(state["x"]), (now.position, now.velocity, now.acceleration)
        if law is None:
            u = controller.update(t, seen, setpoint)
        else:
            picked = seen if loop.law.measurement is None else loop.law.measurement.picked(seen)
            status = law.step(loop.sample_time, picked, np.concatenate(setpoint))
            if status:
                raise RuntimeError(f"sample {k}: status {status}")
            u = law.u.astype(float)
        errors.append(tracking_error(seen, values.c, now, model).e)
        state |= loop.plant.update(t, u, by_part(state), values, model, loop.sample_time)
    return np.array(errors)


def fuzzed(folder: Path, count: int) -> list[int]:
    """How often each status came in `count` steps of an exported folder with any bits, under sanitizers.

    Raises:
        RuntimeError: if voltages were not finite, or a refusal changed a bit of the state.
    """
    (folder / "main.c").write_text(FUZZ)
    program = built(folder, [*(flag for flag in SANITIZED if flag != "-Werror"), f"-DCOUNT={count}"], "fuzz")
    done = subprocess.run([program], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{folder}: {done.stdout}{done.stderr}")
    return [int(one) for one in done.stdout.split()]


FUZZ = """
#include "controller.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
static uint64_t seed = 88172645463325252u;
static uint64_t any(void) { seed ^= seed << 13; seed ^= seed >> 7; seed ^= seed << 17; return seed; }
static controller_real bits(void)
{
    controller_real value;
    const uint64_t some = any();
    memcpy(&value, &some, sizeof value);
    return (any() % 3u == 0u) ? (controller_real)((any() & 1u) != 0u ? NAN : INFINITY) : value;
}
static controller_real usual(void) { return (controller_real)((double)(any() % 2001u) / 1000.0 - 1.0); }
int main(void)
{
    long wrong = 0, count[10] = { 0 };
    controller_state s;
    controller_init(&s);
    for (long i = 0; i < COUNT; i++) {
        controller_state before;
        controller_setpoint r;
        controller_diagnostics d;
        controller_real x[CONTROLLER_X], u[CONTROLLER_U], dt = (controller_real)CONTROLLER_SAMPLE_TIME;
        controller_real *const given = (controller_real *)&r;
        if (any() % 50u == 0u)
            controller_init(&s);
        for (int j = 0; j < CONTROLLER_X; j++) x[j] = usual();
        for (int j = 0; j < 3 * CONTROLLER_Y; j++) given[j] = usual();
        switch (any() % 7u) {
        case 0: x[any() % CONTROLLER_X] = bits(); break;
        case 1: given[any() % (3 * CONTROLLER_Y)] = bits(); break;
        case 2: dt = bits(); break;
        case 3: s.z[any() % CONTROLLER_Z] = bits(); break;
        case 4: for (int j = 0; j < CONTROLLER_X; j++) x[j] = bits(); break;
        case 5: dt *= (controller_real)(any() % 20u); break;
        default: break;
        }
        before = s;
        const controller_status status = controller_step(&s, dt, x, &r, u, (any() & 1u) != 0u ? &d : NULL);
        count[status]++;
        for (int j = 0; j < CONTROLLER_U; j++)
            wrong += !isfinite(u[j]) || (status != CONTROLLER_OK && !(u[j] == 0));
        if (status != CONTROLLER_OK)
            wrong += memcmp(&s, &before, sizeof s) != 0;
        else
            for (int j = 0; j < CONTROLLER_Z; j++) wrong += !isfinite(s.z[j]) && isfinite(before.z[j]);
        if (status == CONTROLLER_BAD_STATE) controller_init(&s);
    }
    for (int j = 0; j < 8; j++) printf("%ld ", count[j]);
    return wrong != 0;
}
"""
