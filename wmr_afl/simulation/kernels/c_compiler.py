"""C text -> shared library, by the system's compiler, cached by the content of text, compiler and processor."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shlex
import shutil
import signal
import stat
import subprocess
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

from platformdirs import user_cache_path

from wmr_afl.errors import BackendWarning, CompilerError
from wmr_input.whole_files import MARK, remove_abandoned

# No -ffast-math, which would drop NaN and reorder sums. A product and a sum may be fused: that rounds once instead of
# twice. Nothing reads errno or floating point exceptions; the compiler has to know it to vectorize loops with
# comparisons. Only loops over robots are to be vectorized: vectors of one robot's numbers make it twice as slow.
# Partial redundancy elimination carries values from step to step, after which longer loops over robots are no longer
# vectorized.
FLAGS = (
    *("-O3", "-std=c11", "-fPIC", "-shared", "-w"),
    *("-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-fno-tree-slp-vectorize", "-fno-tree-pre"),
    *(
        ("-march=native", "-mprefer-vector-width=512")
        if platform.machine().lower() in ("x86_64", "amd64", "i686")
        else ("-mcpu=native",)
    ),
)
# For other processors of the same kind, and with the same bits on each of them.
PORTABLE = ("-O2", "-std=c99", "-fPIC", "-shared", "-w", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno")
UNFUSED = ("-ffp-contract=off",)  # overrides the flag before
ELSE = "run with backend casadi"  # the remedy that always works
PATIENCE = 60.0  # [s] for the compiler; the largest loops of the benchmarks take 5 s
UNUSED = 90 * 24 * 3600.0  # [s] after which a library is removed from the cache
ROOM = 500_000_000  # bytes of libraries that are kept; one has 20 to 200 thousand


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The command of a C compiler: $CC, cc, or the package ziglang if installed; None if there is none.

    $CC may hold options or a wrapper, as in `gcc -m64` and `ccache gcc`.
    """
    given = os.environ.get("CC", "")
    for command in ([given], _words(given), ["cc"], ["gcc"], ["clang"]):
        found = shutil.which(command[0]) if command and command[0] else None
        if found:
            return (found, *command[1:])
    zig = find_spec("ziglang")
    if zig is None or not zig.submodule_search_locations:
        return None
    return (str(Path(zig.submodule_search_locations[0]) / "zig"), "cc")


def compiler_version() -> str:
    """What numbers depend on besides the text of a loop: version and options of the compiler.

    Raises:
        CompilerError: if there is no compiler, or it cannot be run.
    """
    command, version, *_ = _identity()
    name = (version.splitlines() or [""])[0].partition(" ")[2] or version  # without the name it was called by
    return " ".join((name, *command.split("\0")[1:], *FLAGS))


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command, posix=os.name == "posix")
    except ValueError:  # an open quotation
        return []


def library(text: str, is_fused: bool = True) -> ctypes.CDLL:
    """The library of a C text, from the cache or newly built.

    A product and a sum may be fused, unless the same bits are wanted of every processor.

    Raises:
        CompilerError: if there is no compiler, it fails, or the cache cannot be written.
    """
    flags = (*FLAGS, *(() if is_fused else UNFUSED))
    folder, key = _cache(), _key(text, flags)
    for path in sorted(folder.glob(f"{key}-*.so")):
        if path.is_file() and path.stem.partition("-")[2] == _digest(path.read_bytes()):
            with suppress(OSError):
                os.utime(path)  # when it was last used
            return _loaded(path)
        warnings.warn(f"{path} was damaged; it is built again", BackendWarning, stacklevel=2)
        if path.is_file() or path.is_symlink():
            path.unlink(missing_ok=True)
    return _loaded(_build(text, folder, key, flags))


def portable_library(sources: Mapping[str, str]) -> bytes:
    """A shared library of C99, file by file, for every processor of this kind; the same bytes every time.

    Raises:
        CompilerError: if there is no compiler, or it fails.
    """
    command = _needed_compiler()
    with tempfile.TemporaryDirectory(prefix="wmr-afl-") as place:
        for name, text in sources.items():
            Path(place, name).write_text(text, encoding="utf-8")
        files = [name for name in sources if name.endswith(".c")]
        try:
            done = _output([*command, *PORTABLE, "-o", "built", *files, "-lm"], place)
        except OSError as error:
            raise CompilerError(f"{command[0]} cannot be run ({error.strerror})", ELSE) from None
        built = Path(place, "built")
        if done.returncode or not built.exists():
            raise CompilerError(f"{command[0]} failed ({_first_line(done)})", ELSE)
        return built.read_bytes()


def _first_line(done: subprocess.CompletedProcess[str]) -> str:
    """What a command that failed says first."""
    return (done.stderr.splitlines() or [f"exit status {done.returncode}, no message"])[0]


def _loaded(path: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        path.unlink(missing_ok=True)
        raise CompilerError(f"{path}: what the compiler made cannot be loaded ({error})", ELSE) from None


def _key(text: str, flags: Sequence[str]) -> str:
    return _digest("\0".join((text, *flags, *_identity())).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


@functools.cache
def _identity() -> tuple[str, ...]:
    """What machine code depends on besides its text: compiler and processor."""
    command = _needed_compiler()
    try:
        version = _output([*command, "--version"]).stdout
    except OSError as error:
        raise CompilerError(f"{command[0]} cannot be run ({error.strerror})", ELSE) from None
    try:
        processor = next(line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("flags"))
    except (OSError, StopIteration):
        processor = platform.processor()
    return ("\0".join(command), version, platform.machine(), processor)


def _needed_compiler() -> tuple[str, ...]:
    command = compiler()
    if command is None:
        raise CompilerError("no C compiler was found", f"install one, or {ELSE}")
    return command


def _cache() -> Path:
    """The folder of the cache, made if needed; one of this process alone if others could have written into it."""
    given = os.environ.get("WMR_AFL_CACHE")
    folder = Path(given, "wmr-afl") if given else user_cache_path("wmr-afl", appauthor=False)
    with suppress(OSError):  # `_build` reports it
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    danger = _danger(folder)
    if danger is None:
        return folder
    warnings.warn(
        f"{folder} {danger}; machine code is built again in every process until that changes (chmod 700, or set "
        f"WMR_AFL_CACHE to a folder of your own)",
        BackendWarning,
        stacklevel=2,
    )
    return _own_folder()


def _danger(folder: Path) -> str | None:
    """Why code in this folder may be another user's; None if it cannot."""
    if os.name != "posix" or not folder.is_dir():
        return None
    for found in (folder.lstat(), folder.stat()):
        if found.st_uid != os.getuid():
            return "belongs to another user"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return "can be written by other users"
    return None


@functools.cache
def _own_folder() -> Path:
    """A folder that only this process uses, removed at its end."""
    _OWN.append(tempfile.TemporaryDirectory(prefix="wmr-afl-"))
    return Path(_OWN[-1].name)


_OWN: list[tempfile.TemporaryDirectory[str]] = []


def _prune(folder: Path) -> None:
    """Remove what killed processes left, libraries that were not used for long, and the oldest ones beyond the room."""
    remove_abandoned(folder)
    with suppress(OSError):
        found = sorted(((path.stat(), path) for path in folder.glob("*.so")), key=lambda one: -one[0].st_mtime)
        kept = 0
        for file, path in found:
            kept += file.st_size
            if kept > ROOM or time.time() - file.st_mtime > UNUSED:
                path.unlink(missing_ok=True)


def _output(command: Sequence[str], folder: str | None = None) -> subprocess.CompletedProcess[str]:
    """What a command prints; it and all that it has started are stopped if it takes too long.

    Raises:
        CompilerError: if it takes too long.
        OSError: if it cannot be started.
    """
    process = subprocess.Popen(  # noqa: S603
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace",
        cwd=folder, start_new_session=True,
    )  # fmt: skip
    try:
        output, errors = process.communicate(timeout=PATIENCE)
    except BaseException as error:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL) if os.name == "posix" else process.kill()
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            raise CompilerError(f"{command[0]} did not end within {PATIENCE:g} s", ELSE) from None
        raise
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


def _build(text: str, folder: Path, key: str, flags: Sequence[str]) -> Path:
    """Build beside the target and rename, so that several processes may build the same library.

    A library's name ends in the digest of its content, so that a damaged one is known before it is loaded.
    """
    command = _needed_compiler()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _prune(folder)
        with tempfile.TemporaryDirectory(prefix=MARK, dir=folder) as place:
            source, built = Path(place) / "kernel.c", Path(place) / "kernel.so"
            source.write_text(text, encoding="utf-8")
            done = _output([*command, *flags, "-o", str(built), str(source), "-lm"])
            if done.returncode or not built.exists():
                raise CompilerError(f"{command[0]} failed on the closed loop ({_first_line(done)})", ELSE)
            path = folder / f"{key}-{_digest(built.read_bytes())}.so"
            os.replace(built, path)
    except OSError as error:
        raise CompilerError(
            f"{error.filename or folder}: cannot be written ({error.strerror})",
            f"set WMR_AFL_CACHE to a folder, or {ELSE}",
        ) from None
    return path
