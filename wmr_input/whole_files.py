"""Files and folders that are written whole or not at all: beside their place, then renamed into it.

Whatever happens at whatever moment, a full disk, an error or a kill, the old content stands there or the new one. A
symbolic link at the place itself is replaced and never written through: what it names stays as it is.
"""

from __future__ import annotations

import ctypes
import errno
import os
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

ABANDONED = 24 * 3600.0  # [s]; what has lain unfinished for longer belongs to a process that was killed
MARK = ".unfinished-"  # begins the name of everything that is being written
_HERE, _LINUX_EXCHANGE, _MACOS_SWAP = -100, 2, 2  # AT_FDCWD, RENAME_EXCHANGE, RENAME_SWAP


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file; text as UTF-8, its newlines as they are.

    Raises:
        OSError: if it cannot be written; what was there stays.
    """
    with replacing(path) as beside:
        beside.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield an empty file with the same ending that is to be filled; afterwards it takes the place of `path`.

    Raises:
        OSError: if it cannot be written; what was there stays.
    """
    beside = begin(path)
    try:
        yield beside
        finish(beside, path)
    except BaseException:
        discard(beside)
        raise


def begin(path: Path) -> Path:
    """An empty file beside `path`, with the same ending, for who cannot use `replacing`.

    Raises:
        OSError: if it cannot be made, or `path` is a folder.
    """
    if path.is_dir() and not path.is_symlink():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    beside = _beside(path)
    os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, _mode(path)))
    return beside


def finish(beside: Path, path: Path) -> None:
    """Let a file that was begun take the place of `path`, once its content is on the disk.

    Raises:
        OSError: if it cannot.
    """
    with open(beside, "rb+") as file:
        os.fsync(file.fileno())
    os.replace(beside, path)


def discard(beside: Path) -> None:
    """Remove a file or folder that was begun; nothing if it has taken its place."""
    with suppress(OSError):
        if beside.is_dir() and not beside.is_symlink():
            shutil.rmtree(beside)
        else:
            beside.unlink(missing_ok=True)


def write_folder(folder: Path, files: Mapping[str, str] | Mapping[str, str | bytes]) -> None:
    """Write a folder of files, all of them at once.

    What else lies in it stays, except what Python has compiled there.

    Raises:
        OSError: if it cannot be written; what was there stays.
    """
    with renewing(folder, without=(*files, "__pycache__")) as beside:
        for name, content in files.items():
            write_whole(beside / name, content)


@contextmanager
def renewing(folder: Path, without: Iterable[str] = ()) -> Iterator[Path]:
    """Yield a folder that holds what lies in `folder`, `without` some names; afterwards it takes its place at once.

    Files in it may be replaced, added and removed, but not written into: they are those of the old folder under second
    names. If the system cannot exchange two folders, files are replaced one by one, so that only then a kill may leave
    some of them old.

    Raises:
        OSError: if it cannot be written; what was there stays.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    if os.path.lexists(folder) and not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    remove_abandoned(folder.parent)
    beside = _beside(folder)
    beside.mkdir()
    try:
        if folder.is_dir() and not folder.is_symlink():
            shutil.copymode(folder, beside)
            _keep(folder, beside, without)
        yield beside
        _take_place(beside, folder)
    finally:
        discard(beside)


def remove_abandoned(folder: Path) -> None:
    """Remove what killed processes have left unfinished in a folder."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if is_unfinished(entry.name) and time.time() - entry.stat(follow_symlinks=False).st_mtime > ABANDONED:
                discard(Path(entry.path))


def is_unfinished(name: str) -> bool:
    """Whether this is the name of a file or folder that has not taken its place."""
    return name.startswith(MARK)


def _beside(path: Path) -> Path:
    """A name of its own in the same folder, so that renaming is one step of the file system."""
    return path.with_name(f"{MARK}{secrets.token_hex(6)}-{path.stem[:60]}{path.suffix}")


def _mode(path: Path) -> int:
    """The mode of the file that is replaced, else the usual one."""
    try:
        there = path.lstat().st_mode
    except OSError:
        return 0o666
    return stat.S_IMODE(there) | stat.S_IWUSR if stat.S_ISREG(there) else 0o666


def _keep(folder: Path, beside: Path, without: Iterable[str]) -> None:
    """Give what lies in the old folder a second name in the new one."""
    for there in folder.iterdir():
        if there.name in without:
            continue
        if there.is_dir() and not there.is_symlink():
            shutil.copytree(there, beside / there.name, symlinks=True, copy_function=_second_name)
        else:
            _second_name(str(there), str(beside / there.name))


def _second_name(there: str, here: str) -> None:
    try:
        os.link(there, here, follow_symlinks=False)
    except (OSError, NotImplementedError):  # a file system without hard links
        shutil.copy2(there, here, follow_symlinks=False)


def _take_place(beside: Path, folder: Path) -> None:
    """Let the new folder take the place of the old one, which is `beside` afterwards."""
    if not os.path.lexists(folder):
        beside.rename(folder)
    elif not _exchange(beside, folder):
        if folder.is_symlink():
            folder.unlink()
            beside.rename(folder)
        else:
            _replace_one_by_one(beside, folder)


def _replace_one_by_one(beside: Path, folder: Path) -> None:
    """As an exchange, for systems that have none."""
    kept = {path.name for path in beside.iterdir()}
    for path in beside.iterdir():
        if not (folder / path.name).is_dir():  # a folder in it was copied and is the same
            os.replace(path, folder / path.name)
    for path in folder.iterdir():
        if path.name not in kept:
            discard(path)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names in one step; False if the system or the file system cannot."""
    call = _exchange_call()
    return call is not None and call(os.fsencode(one), os.fsencode(other)) == 0


def _exchange_call() -> Callable[[bytes, bytes], int] | None:
    """The system's call that exchanges two names; None if it has none."""
    if os.name != "posix":
        return None
    library = ctypes.CDLL(None)
    if hasattr(library, "renameat2"):  # Linux
        return lambda one, other: int(library.renameat2(_HERE, one, _HERE, other, _LINUX_EXCHANGE))
    if hasattr(library, "renamex_np"):  # macOS
        return lambda one, other: int(library.renamex_np(one, other, _MACOS_SWAP))
    return None
