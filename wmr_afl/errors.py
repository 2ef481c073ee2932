"""The runtime's errors, which all derive from `WmrError`, and its warning."""

from collections.abc import Iterable

from wmr_input import InputError, WmrError, nearest

__all__ = [
    "ArgumentError",
    "BackendWarning",
    "CompilerError",
    "InputError",
    "MissingTermError",
    "ShapeError",
    "SimulationError",
    "UnknownNameError",
    "WmrError",
]


class ArgumentError(WmrError, TypeError):
    """An argument is of a wrong kind; the text says which is expected."""


class ShapeError(WmrError, ValueError):
    """An array has the wrong shape; the text says which is expected."""


class UnknownNameError(WmrError, LookupError):
    """A name is unknown; the text lists the known ones."""

    def __init__(self, kind: str, name: str, known: Iterable[str], hint: str = "") -> None:
        """`hint`: what else may have been meant."""
        self.hint = hint
        names, shown = list(known), str(name) if len(str(name)) <= 60 else f"{str(name)[:57]}..."
        listed = ", ".join(names) if names else "none"
        near = nearest(str(name), names)
        meant = hint or (f"did you mean {near!r}?" if near is not None else "")
        super().__init__(f"unknown {kind} {shown!r}", f"{meant} (there is {listed})" if meant else f"there is {listed}")


class MissingTermError(WmrError, AttributeError):
    """A model does not have a term; the text says why."""


class SimulationError(WmrError):
    """A closed loop cannot be run, or it failed; the text says why, and when."""


class CompilerError(WmrError):
    """A closed loop could not be built into machine code; the text says why."""


class BackendWarning(UserWarning):
    """Work goes on in another way than asked for; the text says why. The numbers are the same."""
