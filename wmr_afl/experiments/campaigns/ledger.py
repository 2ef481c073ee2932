"""Finished blocks of a campaign in a folder: each is written whole or not at all, and never computed twice."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import WmrError

Columns = dict[str, NDArray[Any]]  # by name, one row a run
_IDENTITY = "of campaign and block"  # key in every file of a block: fingerprint and number


class Ledger:
    """The finished blocks of the campaign with this fingerprint.

    Raises:
        WmrError: if the folder holds another campaign or cannot be written.
    """

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self.folder, self.fingerprint, self._note = folder, fingerprint, folder / "campaign.json"
        self._guard(lambda: folder.mkdir(parents=True, exist_ok=True))
        if self._note.exists():
            try:
                there = json.loads(self._note.read_text(encoding="utf-8"))["fingerprint"]
            except (OSError, ValueError, KeyError, TypeError):
                raise WmrError(f"{self._note}: is damaged", f"remove {folder}, or name another --out") from None
            if there != fingerprint:
                raise WmrError(
                    f"{folder}: holds another campaign, or the experiment, the model or the code have changed since",
                    "name another --out, or begin anew with --fresh",
                )
        else:
            self._write(self._note, json.dumps({"fingerprint": fingerprint}).encode())

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
        """Write a file beside the target, flush it to the disk, and rename it: the target is never half written."""

        def write() -> None:
            name = self.folder / f".unfinished-{os.getpid()}-{path.name}"
            try:
                with open(name, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(name, path)
            except BaseException:
                name.unlink(missing_ok=True)
                raise

        self._guard(write)

    def _guard(self, act: Callable[[], object]) -> None:
        try:
            act()
        except OSError as error:
            raise WmrError(
                f"{self.folder}: cannot be written ({error.strerror})",
                "make room or name another --out; finished blocks are kept, and the same command goes on from there",
            ) from None


def clear(folder: Path) -> None:
    """Remove the files of a campaign, and nothing else.

    Raises:
        WmrError: if they cannot be removed.
    """
    try:
        for path in [*folder.glob("block_*.npz"), *folder.glob(".unfinished-*"), folder / "campaign.json"]:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise WmrError(f"{error.filename}: cannot be removed ({error.strerror})", "name another --out") from None
