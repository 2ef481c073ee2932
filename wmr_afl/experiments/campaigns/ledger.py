"""Finished blocks of a campaign in a folder: each is written whole or not at all, and never computed twice."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from wmr_afl.errors import WmrError
from wmr_afl.experiments.campaigns.identity import Identity, difference
from wmr_input.whole_files import is_unfinished, remove_abandoned, write_whole

Columns = dict[str, NDArray[Any]]  # by name, one row a run
_IDENTITY = "of campaign and block"  # key in every file of a block: fingerprint and number
_NOTE, _LOCK = "campaign.json", ".lock"
_SUMMARIES = ("summary.json", "errors.png", "errors.svg", "success.png", "success.svg")  # of finished campaigns


class Ledger:
    """The finished blocks of the campaign with this fingerprint.

    Raises:
        WmrError: if the folder holds another campaign or cannot be written.
    """

    def __init__(self, folder: Path, fingerprint: str, identity: Identity | None = None) -> None:
        """`identity`: what the fingerprint covers besides the experiment, kept to tell what has changed."""
        self.folder, self.fingerprint, self._note = folder, fingerprint, folder / _NOTE
        _guard(folder, lambda: folder.mkdir(parents=True, exist_ok=True))
        remove_abandoned(folder)
        if self._note.exists():
            self._check(identity or {})
        else:
            self._write(self._note, json.dumps({"fingerprint": fingerprint, "identity": {**(identity or {})}}).encode())

    def _check(self, here: Identity) -> None:
        """Check that the folder's campaign is this one."""
        try:
            content = json.loads(self._note.read_text(encoding="utf-8"))
            there, identity = content["fingerprint"], content.get("identity", {})
            changed = difference({str(what): str(which) for what, which in identity.items()}, here)
        except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
            raise WmrError(f"{self._note}: is damaged", f"remove {self.folder}, or name another --out") from None
        if there != self.fingerprint:
            found = f" (here is {changed})" if changed else ""
            raise WmrError(
                f"{self.folder}: holds another campaign, or the experiment, the model or the code have changed "
                f"since{found}",
                "name another --out, or begin anew with --fresh",
            )

    def read(self, block: int, count: int) -> Columns | None:
        """A block's first `count` runs; None if they are not finished or the file is damaged."""
        try:
            with np.load(io.BytesIO(self._place(block).read_bytes()), allow_pickle=False) as file:
                columns = {name: file[name] for name in file.files}
            if str(columns.pop(_IDENTITY)) != f"{self.fingerprint}:{block}":
                return None
        except Exception:  # a damaged file may raise anything
            return None
        enough = bool(columns) and all(len(column) >= count for column in columns.values())
        return {name: column[:count] for name, column in columns.items()} if enough else None

    def write(self, block: int, columns: Columns) -> None:
        """Keep a finished block.

        Raises:
            WmrError: if the folder cannot be written, for example if the disk is full.
        """
        content = io.BytesIO()
        identity = np.array(f"{self.fingerprint}:{block}")
        np.savez(content, **columns, **{_IDENTITY: identity})  # type: ignore[arg-type]
        self._write(self._place(block), content.getvalue())

    def _place(self, block: int) -> Path:
        return self.folder / f"block_{block:06d}.npz"

    def _write(self, path: Path, content: bytes) -> None:
        """Write a file whole or not at all."""
        _guard(self.folder, lambda: write_whole(path, content))


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes out of a campaign's folder; the lock of a process that has died counts for nothing.

    Raises:
        WmrError: if another process has the lock, or the folder cannot be written.
    """
    lock = FileLock(folder / _LOCK, timeout=0)

    def acquire() -> None:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire()
        except Timeout:
            problem = f"{folder}: another process runs a campaign in this folder"
            raise WmrError(problem, "wait until it ends, or name another --out") from None
        except NotImplementedError:  # a file system without locks, on which two processes lose time and no number
            pass

    _guard(folder, acquire)
    try:
        yield
    finally:
        lock.release()


def clear(folder: Path) -> None:
    """Remove the files of a campaign, and nothing else.

    Raises:
        WmrError: if they cannot be removed.
    """
    try:
        for path in folder.iterdir() if folder.is_dir() else ():
            is_block = path.name.startswith("block_") and path.suffix == ".npz"
            if is_block or is_unfinished(path.name) or path.name in (_NOTE, *_SUMMARIES):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise WmrError(f"{error.filename}: cannot be removed ({error.strerror})", "name another --out") from None


def _guard(folder: Path, act: Callable[[], object]) -> None:
    try:
        act()
    except OSError as error:
        raise WmrError(
            f"{folder}: cannot be written ({error.strerror})",
            "make room or name another --out; finished blocks are kept, and the same command goes on from there",
        ) from None
