"""The exception family: every error that a user can cause derives from `WmrError`."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class WmrError(Exception):
    """Base class of every error that this project raises on purpose: the problem and the remedy.

    The two are kept apart, so that a caller can add what it knows, such as the place in a file, without parsing text.
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        super().__init__()
        self.problem, self.remedy = problem, remedy

    def __str__(self) -> str:
        return _in_one_line(f"{self.problem}; {self.remedy}" if self.remedy else self.problem)

    def __reduce__(self) -> tuple[Callable[..., WmrError], tuple[Any, ...]]:
        """Errors of any constructor can be pickled: workers send them to the process that waits for them."""
        return _restored, (type(self), self.__dict__)


def _restored(kind: type[WmrError], content: dict[str, Any]) -> WmrError:
    error = kind.__new__(kind)
    error.__dict__.update(content)
    return error


def _in_one_line(text: str) -> str:
    """Text whose line breaks and control characters, which a name or a path may hold, are written as Python does."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


class InputError(WmrError):
    """A mistake in a file that a person wrote: `file: place: problem; remedy`."""

    def __init__(self, file: str, place: str, problem: str, remedy: str = "") -> None:
        super().__init__(problem, remedy)
        self.file, self.place = file, place

    def __str__(self) -> str:
        return ": ".join(_in_one_line(part) for part in (self.file, self.place, super().__str__()) if part)


class InputErrors(InputError):
    """Several mistakes in one file, one line each."""

    def __init__(self, mistakes: Sequence[InputError]) -> None:
        first = mistakes[0]
        super().__init__(first.file, first.place, first.problem, first.remedy)
        self.mistakes = tuple(mistakes)

    def __str__(self) -> str:
        return "\n".join(str(mistake) for mistake in self.mistakes)


class FieldError(WmrError, ValueError):
    """A value that does not fit its key in a table; raised during validation, which adds the place in the file."""


@contextmanager
def mistakes_at(file: str | Path, place: str) -> Iterator[None]:
    """Turn errors that are raised inside into mistakes at `place` of `file`.

    Raises:
        InputError: if a WmrError is raised inside.
    """
    try:
        yield
    except InputError:
        raise
    except WmrError as error:
        raise InputError(str(file), place, error.problem, error.remedy) from None


def shown(value: Any) -> str:
    """A value in one short line."""
    try:
        text = " ".join(repr(value).split())
    except Exception as error:  # an integer of more digits than Python prints, or what cannot be printed at all
        return "a number of thousands of digits" if isinstance(error, ValueError) else f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def plain(text: str) -> str:
    """Text as it is, or in quotes and shortened if it does not fit into one line."""
    return text if text.isprintable() and len(text) <= 60 else shown(text)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that an unknown one was probably meant to be; None if none is close."""
    names = list(known)
    near = [name for name in names if name.lower() == word.lower()] or difflib.get_close_matches(word, names, n=1)
    return near[0] if near else None


def closest(word: str, known: Iterable[str]) -> str:
    """A remedy for an unknown word: the nearest known one, else the list of all known ones."""
    names = list(known)
    near = nearest(word, names)
    if near is not None:
        return f"did you mean {near!r}?"
    return f"there is {', '.join(names)}" if names else "nothing of this kind is declared"
