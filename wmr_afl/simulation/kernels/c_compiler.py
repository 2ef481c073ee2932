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
import warnings
from importlib.util import find_spec
from pathlib import Path

from wmr_afl.errors import BackendWarning, CompilerError

# No -ffast-math, which would drop NaN and reorder sums. A product and a sum may be fused: that rounds once instead of
# twice. Nothing reads errno or floating point exceptions; the compiler has to know it to vectorize loops with
# comparisons. Only loops over robots are to be vectorized: vectors of one robot's numbers make it twice as slow.
FLAGS = (
    *("-O3", "-std=c11", "-fPIC", "-shared", "-w"),
    *("-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-fno-tree-slp-vectorize"),
    *(
        ("-march=native", "-mprefer-vector-width=512")
        if platform.machine().lower() in ("x86_64", "amd64", "i686")
        else ("-mcpu=native",)
    ),
)
ELSE = "run with backend casadi"  # the remedy that always works


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: $CC, cc, or the package ziglang if installed; None if there is none."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        if name and shutil.which(name):
            return (str(shutil.which(name)),)
    zig = find_spec("ziglang")
    if zig is None or not zig.submodule_search_locations:
        return None
    return (str(Path(zig.submodule_search_locations[0]) / "zig"), "cc")


def library(text: str) -> ctypes.CDLL:
    """The library of a C text, from the cache or newly built.

    Raises:
        CompilerError: if there is no compiler, it fails, or the cache cannot be written.
    """
    folder, key = _cache(), _key(text)
    for path in sorted(folder.glob(f"{key}-*.so")):
        if path.is_file() and path.stem.partition("-")[2] == _digest(path.read_bytes()):
            return _loaded(path)
        warnings.warn(f"{path} was damaged; it is built again", BackendWarning, stacklevel=2)
        if path.is_file() or path.is_symlink():
            path.unlink(missing_ok=True)
    return _loaded(_build(text, folder, key))


def _loaded(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        path.unlink(missing_ok=True)
        raise CompilerError(f"{path}: what the compiler made cannot be loaded ({error})", ELSE) from None


def _key(text: str) -> str:
    return _digest("\0".join((text, *FLAGS, *_identity())).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


@functools.cache
def _identity() -> tuple[str, ...]:
    """What machine code depends on besides its text: compiler and processor."""
    command = _needed_compiler()
    try:
        version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False).stdout  # noqa: S603
    except OSError as error:
        raise CompilerError(f"{command[0]} cannot be run ({error.strerror})", ELSE) from None
    try:
        processor = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        processor = platform.processor()
    return (*command, version, platform.machine(), processor)


def _needed_compiler() -> tuple[str, ...]:
    command = compiler()
    if command is None:
        raise CompilerError("no C compiler was found", f"install one, or {ELSE}")
    return command


def _cache() -> Path:
    root = os.environ.get("WMR_AFL_CACHE") or os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "wmr-afl"


def _build(text: str, folder: Path, key: str) -> Path:
    """Build beside the target and rename, so that several processes may build the same library.

    A library's name ends in the digest of its content, so that a damaged one is known before it is loaded.
    """
    command = _needed_compiler()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as place:
            source, built = Path(place) / "kernel.c", Path(place) / "kernel.so"
            source.write_text(text, encoding="utf-8")
            done = subprocess.run(  # noqa: S603
                [*command, *FLAGS, "-o", str(built), str(source), "-lm"], capture_output=True, text=True, check=False
            )
            if done.returncode or not built.exists():
                first = (done.stderr.splitlines() or [f"exit status {done.returncode}, no message"])[0]
                raise CompilerError(f"{command[0]} failed on the closed loop ({first})", ELSE)
            path = folder / f"{key}-{_digest(built.read_bytes())}.so"
            os.replace(built, path)
    except OSError as error:
        raise CompilerError(
            f"{error.filename or folder}: cannot be written ({error.strerror})",
            f"set WMR_AFL_CACHE to a folder, or {ELSE}",
        ) from None
    return path
