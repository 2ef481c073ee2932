"""The exception family: every error that a user can cause derives from `WmrError`."""

import difflib
from collections.abc import Iterable


class WmrError(Exception):
    """Base of every error this project raises on purpose. Its text says where, what, and what would be right."""


class InputError(WmrError):
    """A mistake in a file that a person wrote.

    Its text has one line a mistake: `file: place: problem; remedy`.
    """

    def __init__(self, file: str, place: str, problem: str, remedy: str = "") -> None:
        where = ": ".join(part for part in (file, place) if part)
        super().__init__(f"{where}: {problem}" + (f"; {remedy}" if remedy else ""))

    @classmethod
    def together(cls, mistakes: list["InputError"]) -> "InputError":
        """One error out of several, a line each."""
        if len(mistakes) == 1:
            return mistakes[0]
        error = cls.__new__(cls)
        Exception.__init__(error, "\n".join(str(mistake) for mistake in mistakes))
        return error


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that an unknown one was probably meant to be."""
    names = list(known)
    near = [name for name in names if name.lower() == word.lower()] or difflib.get_close_matches(word, names, n=1)
    return near[0] if near else None


def closest(word: str, known: Iterable[str]) -> str:
    """A remedy for an unknown word: the nearest known one, otherwise the list of what there is."""
    names = list(known)
    near = nearest(word, names)
    if near is not None:
        return f"did you mean {near!r}?"
    return f"there is {', '.join(names)}" if names else "nothing of this kind is declared"
