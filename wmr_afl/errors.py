"""Run time's part of the exception family; all derive from `WmrError`."""

from collections.abc import Iterable

from wmr_input import InputError, WmrError, nearest

__all__ = [
    "BackendWarning",
    "CompilerError",
    "InputError",
    "MissingTermError",
    "ShapeError",
    "SimulationError",
    "UnknownNameError",
    "WmrError",
]


class ShapeError(WmrError, ValueError):
    """An array has the wrong shape; the text says which is expected."""


class UnknownNameError(WmrError, LookupError):
    """A name is not one of those that there are; the text lists them."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = list(known)
        listed = ", ".join(names) if names else "none"
        near = nearest(str(name), names)
        remedy = f"there is {listed}" if near is None else f"did you mean {near!r}? (there is {listed})"
        super().__init__(f"unknown {kind} {name!r}", remedy)


class MissingTermError(WmrError, AttributeError):
    """A model does not have a term; the text says why."""


class SimulationError(WmrError):
    """A closed loop ended before its time; the text says when and why."""


class CompilerError(WmrError):
    """A closed loop could not be built into machine code; the text says why."""


class BackendWarning(UserWarning):
    """A closed loop runs in another way than it should; the text says why. Its numbers are the same."""
