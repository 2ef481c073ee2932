"""Exported controllers built for a microcontroller and run in QEMU, without any board."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.exported import STRICT

BOARD = Path(__file__).parents[1] / "examples" / "microcontroller" / "board"
SHIFT = 6  # an instruction lasts 2^6 ns in QEMU, so that a step has less than 10 million
PATIENCE = 300.0  # [s] for anything that is run
PACKAGES = {  # of Debian and Ubuntu, by a program in them
    "arm-none-eabi-gcc": ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi"),
    "qemu-system-arm": ("qemu-system-arm",),
}
SECTIONS = ("-ffunction-sections", "-fdata-sections")  # what is not called is not linked


class EmbeddedError(Exception):
    """What went wrong, in one line."""


@dataclass(frozen=True)
class Core:
    """A processor: what the compiler is told of it, and the machine of QEMU that has it."""

    name: str
    cpu: str
    fpu: str
    machine: str

    @property
    def flags(self) -> tuple[str, ...]:
        return f"-mcpu={self.cpu}", "-mthumb", "-mfloat-abi=hard", f"-mfpu={self.fpu}"


M4F = Core("M4F", "cortex-m4", "fpv4-sp-d16", "mps2-an386")
M7 = Core("M7", "cortex-m7", "fpv5-d16", "mps2-an500")


@dataclass(frozen=True)
class Replay:
    """What a replay has printed."""

    off: float  # by how much voltages and state differ from Python's, relative to the size of each
    bits: str  # digest of all voltages and states


@dataclass(frozen=True)
class Size:
    """What objects take [B]."""

    code: int
    data: int
    bss: int


@dataclass(frozen=True)
class Cost:
    """What a step takes."""

    least: int  # instructions
    mean: int
    most: int
    stack: int  # [B], with all that is called


def missing() -> list[str]:
    """The packages that hold programs which are not there."""
    return [package for program, own in PACKAGES.items() if shutil.which(program) is None for package in own]


def install() -> None:
    """Install what is missing, if that is possible here.

    Raises:
        EmbeddedError: if it is not.
    """
    wanted = missing()
    if not wanted:
        return
    if shutil.which("apt-get") is None or os.geteuid() != 0:
        raise EmbeddedError(f"{' '.join(wanted)} missing; install them, with apt-get on Debian and Ubuntu")
    run("apt-get", "update", "-qq", patience=1800.0)
    run("apt-get", "install", "-y", "-qq", "--no-install-recommends", *wanted, patience=1800.0)
    if missing():
        raise EmbeddedError(f"apt-get has not brought {' '.join(missing())}")


def run(*command: str | Path, folder: Path | None = None, patience: float = PATIENCE, with_errors: bool = False) -> str:
    """Run a command; return what it printed, `with_errors` also what it printed as errors.

    Raises:
        EmbeddedError: if it fails or takes longer than `patience` [s].
    """
    words = [str(word) for word in command]
    try:
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=patience, check=False)
    except subprocess.TimeoutExpired:
        raise EmbeddedError(f"{words[0]} was still running after {patience:g} s") from None
    except OSError as error:
        raise EmbeddedError(f"{words[0]} cannot be run ({error.strerror})") from None
    if done.returncode != 0:
        told = [line.strip() for line in f"{done.stderr}\n{done.stdout}".splitlines() if line.strip()]
        words_of_trouble = ("error", "undefined", "cannot")
        named = [line for line in told if any(word in line.lower() for word in words_of_trouble)]
        wrong = (named or told or ["no output"])[0]
        raise EmbeddedError(f"{words[0]} ended with {done.returncode}: {wrong}")
    return done.stdout + (done.stderr if with_errors else "")


def sources(folder: Path, prefix: str = "controller") -> list[Path]:
    """The C files of an export but its replay."""
    return sorted(folder.glob(f"{prefix}*.c"))


def built_on_host(compiler: str, folder: Path, out: Path, prefix: str = "controller") -> Path:
    """The replay, built without a warning for this machine."""
    program = out / f"replay_{Path(compiler).name}"
    run(compiler, *STRICT, f"-I{folder}", *sources(folder, prefix), folder / "main.c", "-lm", "-o", program)
    return program


def replayed_on_host(compiler: str, folder: Path, out: Path, prefix: str = "controller") -> Replay:
    """What the replay prints on this machine."""
    return _replay(run(built_on_host(compiler, folder, out, prefix), folder / "vectors.txt"))


def cross_objects(core: Core, folder: Path, out: Path, prefix: str = "controller") -> list[Path]:
    """The objects of an export, built without a warning for a core."""
    objects = []
    for source in sources(folder, prefix):
        objects.append(out / f"{source.stem}.o")
        run("arm-none-eabi-gcc", *core.flags, *STRICT, *SECTIONS, "-c", source, "-o", objects[-1])
    return objects


def linked(
    core: Core, program: Path, objects: Sequence[Path], includes: Sequence[Path], out: Path, *flags: str
) -> Path:
    """A program for QEMU's board with this core: printing, files and the exit status go over semihosting."""
    image = out / f"{program.stem}.elf"
    run(
        *("arm-none-eabi-gcc", *core.flags, "-std=gnu99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"),
        *(*SECTIONS, *flags, *(f"-I{folder}" for folder in includes), f"-I{BOARD}", program, BOARD / "startup.c"),
        *(*objects, "--specs=rdimon.specs", "-Wl,--gc-sections", "-T", BOARD / "mps2.ld", "-lm", "-o", image),
    )
    return image


def in_qemu(core: Core, image: Path, *arguments: str, folder: Path, patience: float = PATIENCE) -> str:
    """Run a program on QEMU's board; return what it printed. Its clock counts instructions, not the host's time."""
    told = "".join(f",arg={argument}" for argument in (image.stem, *arguments))
    return run(
        *("qemu-system-arm", "-M", core.machine, "-icount", f"shift={SHIFT},sleep=off", "-nographic"),
        *("-monitor", "none", "-serial", "null", "-semihosting-config", f"enable=on,target=native{told}"),
        *("-kernel", image.resolve()),
        folder=folder,
        patience=patience,
    )


def replayed_on_core(core: Core, folder: Path, out: Path, prefix: str = "controller") -> tuple[Replay, Size, Cost]:
    """What the replay prints on a core, the size of the controller's object, and what a step costs."""
    objects = cross_objects(core, folder, out, prefix)
    image = linked(core, folder / "main.c", objects, [folder], out, "-DMEASURE", f"-DSHIFT={SHIFT}")
    printed = in_qemu(core, image, "vectors.txt", folder=folder)
    return _replay(printed), size(out / f"{prefix}.o"), cost_told(printed)


def cost_told(printed: str) -> Cost:
    """What `board/measure.h` has printed.

    Raises:
        EmbeddedError: if it has not measured what it says.
    """
    pattern = r"least (\d+), mean (\d+), most (\d+); stack (\d+); 1000 are told to be (\d+)"
    *cost, thousand = map(int, _found(pattern, printed))
    if abs(thousand - 1000) > 30:  # calling and reading the timer counts, too
        raise EmbeddedError(f"QEMU's clock does not count instructions: 1000 are told to be {thousand}")
    return Cost(*cost)


def size(compiled: Path) -> Size:
    """What an object takes."""
    text, data, bss = run("arm-none-eabi-size", compiled).splitlines()[1].split()[:3]
    return Size(int(text), int(data), int(bss))


def _replay(printed: str) -> Replay:
    off, bits = _found(r"within (\S+) of Python's, bits ([0-9a-f]{8})", printed)
    return Replay(float(off), bits)


def _found(pattern: str, printed: str) -> tuple[str, ...]:
    found = re.search(pattern, printed)
    if found is None:
        raise EmbeddedError(f"the program has printed {printed.strip()[:80]!r}")
    return found.groups()
