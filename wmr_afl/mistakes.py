"""Mistakes in a user's file: told where they stand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wmr_afl.errors import InputError, WmrError


@contextmanager
def mistakes_at(file: Path, place: str) -> Iterator[None]:
    """Errors inside are mistakes at `place` of `file`."""
    try:
        yield
    except InputError:
        raise
    except WmrError as error:
        problem, _, remedy = str(error).partition("; ")
        raise InputError(str(file), place, problem, remedy) from None
