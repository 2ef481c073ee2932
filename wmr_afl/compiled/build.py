"""C text -> shared library, by the system's compiler, cached by the content of text, compiler and processor."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

from wmr_afl.errors import WmrError

# No -ffast-math, which would drop NaN and reorder sums. A product and a sum may be fused, which rounds once instead of
# twice. Nobody looks at errno or at floating point exceptions; without saying so, loops with comparisons are not
# vectorized. Only loops over robots shall be: vectors made of one robot's numbers make it twice as slow.
FLAGS = (
    *("-O3", "-march=native", "-mprefer-vector-width=512", "-std=c11", "-fPIC", "-shared", "-w"),
    *("-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-fno-tree-slp-vectorize"),
)


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: $CC, cc, or the package ziglang if installed; None where there is none."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        if name and shutil.which(name):
            return (str(shutil.which(name)),)
    try:
        import ziglang  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        return None
    return (str(Path(ziglang.__file__).parent / "zig"), "cc")


def library(text: str) -> ctypes.CDLL:
    """The library of a C text, from the cache or newly built.

    Raises: WmrError, where there is no compiler or it fails.
    """
    path = place(text)
    if not path.exists():
        _build(text, path)
    return ctypes.CDLL(str(path))


def place(text: str) -> Path:
    """Where the library of a text stands in the user's cache."""
    key = "\0".join((text, *FLAGS, *_identity()))
    return _cache() / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.so"


@functools.cache
def _identity() -> tuple[str, ...]:
    """What machine code depends on besides its text: compiler and processor."""
    command = compiler()
    if command is None:
        raise WmrError("no C compiler was found; install one, or run with backend casadi")
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False).stdout  # noqa: S603
    try:
        processor = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        processor = platform.processor()
    return (*command, version, platform.machine(), processor)


def _cache() -> Path:
    root = os.environ.get("WMR_AFL_CACHE") or os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "wmr-afl"


def _build(text: str, path: Path) -> None:
    """Builds beside the target and moves it there at once, so that several processes may build the same."""
    command = compiler()
    if command is None:
        raise WmrError("no C compiler was found; install one, or run with backend casadi")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            source, built = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
            source.write_text(text, encoding="utf-8")
            done = subprocess.run(  # noqa: S603
                [*command, *FLAGS, "-o", str(built), str(source), "-lm"], capture_output=True, text=True, check=False
            )
            if done.returncode:
                first = (done.stderr.splitlines() or ["no message"])[0]
                raise WmrError(f"{command[0]} failed on the closed loop ({first}); run with backend casadi")
            os.replace(built, path)
    except OSError as error:
        raise WmrError(f"{path.parent}: cannot be written ({error.strerror}); set WMR_AFL_CACHE to a folder") from None
