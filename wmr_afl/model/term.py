"""A generated function with checked arguments: a wrong shape gives one line of text, no broadcast and no traceback."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from casadi import DM, MX, SX, Function

from wmr_afl.errors import ShapeError
from wmr_afl.numerics.arguments import real_numbers
from wmr_afl.numerics.arrays import Array, Floats

Entries = Mapping[str, Sequence[str]]  # argument -> names of its entries, in order

SAME_SHAPE = "give batches of one shape"  # the remedy where those of several arguments differ


class _Documentation:
    """What `help` shows of a term, written only if it is asked for; of the class, what the class says."""

    def __init__(self, of_class: str) -> None:
        self.of_class = of_class

    def __get__(self, term: Term | None, kind: type[Term]) -> str:
        return self.of_class if term is None else _documentation(term._entries, term._meaning)


class Term:
    """One of a model's functions, called as the generated one: in the order of its arguments, or by their names."""

    def __init__(
        self, model: str, name: str, function: Callable[..., Array], entries: Entries, meaning: Mapping[str, Any]
    ) -> None:
        """`model` and `name` are for messages; `meaning` is what model.json says of the function."""
        self._model, self.name, self._function, self._entries = model, name, function, entries
        self._meaning, self._takes_columns = meaning, isinstance(function, Function)

    def __repr__(self) -> str:
        return f"<{self._model}.{self.name}({', '.join(self._entries)})>"

    def __call__(self, *arguments: Array, **named: Array) -> Array:
        """The term's value.

        Raises:
            ShapeError: if an argument has the wrong shape, or there are too few or too many.
        """
        if named or len(arguments) != len(self._entries):
            arguments = self._in_order(arguments, named)
        if self._takes_columns:  # CasADi would broadcast or transpose a wrong shape
            return self._function(*self._each(checked_column, arguments))
        try:
            return self._function(*arguments)
        except (ValueError, TypeError):
            pass  # looked at only now: most calls are right
        arrays = self._each(checked_vector, arguments)
        try:
            return self._function(*arrays)
        except ValueError:
            given = zip(self._entries, arrays, strict=True)
            shapes = ", ".join(f"{argument} has shape {value.shape}" for argument, value in given)
            problem = f"batches of {self._model}.{self.name} do not fit each other: {shapes}"
            raise ShapeError(problem, SAME_SHAPE) from None

    def _each(self, check: Callable[..., Array], arguments: Sequence[Array]) -> list[Array]:
        given = zip(self._entries.items(), arguments, strict=True)
        return [check(argument, self._model, value, names) for (argument, names), value in given]

    def _in_order(self, arguments: Sequence[Array], named: Mapping[str, Array]) -> tuple[Array, ...]:
        given = {**dict(zip(self._entries, arguments, strict=False)), **named}
        if given.keys() != self._entries.keys() or len(arguments) + len(named) != len(self._entries):
            wanted = ", ".join(self._entries)
            raise ShapeError(f"{self._model}.{self.name} takes {wanted}", f"given were {len(arguments) + len(named)}")
        return tuple(given[argument] for argument in self._entries)


Term.__doc__ = _Documentation(str(Term.__doc__))  # type: ignore[assignment]


def checked_vector(argument: str, model: str, value: Array, names: Sequence[str]) -> Floats:
    """`value` as an array of numbers (..., len(names)).

    Raises:
        ShapeError: if it is not one.
    """
    expected = f"expected (..., {len(names)}): {', '.join(names) or 'nothing'}"
    array = real_numbers(argument, value, expected)
    if array.ndim == 0 or array.shape[-1] != len(names):
        raise ShapeError(f"{argument} of {model} has shape {array.shape}", expected)
    return array


def checked_column(argument: str, model: str, value: Array, names: Sequence[str]) -> Array:
    """`value` as a column (len(names), 1), of numbers or of symbols.

    Raises:
        ShapeError: if it is not one.
    """
    if not isinstance(value, SX | MX | DM):
        value = checked_vector(argument, model, value, names)
    if tuple(value.shape) not in ((len(names),), (len(names), 1)):
        raise ShapeError(f"{argument} of {model} has shape {tuple(value.shape)}", f"expected ({len(names)}, 1)")
    return value


def _documentation(entries: Entries, meaning: Mapping[str, Any]) -> str:
    """What `help` shows."""
    symbols, numbers = (", ".join(str(size) for size in meaning[key]) for key in ("shape", "size"))
    lines = [f"{meaning['meaning']}; equation {meaning['equation']}.", ""]
    lines += [f"{argument} (..., {len(names)}): {', '.join(names) or 'nothing'}" for argument, names in entries.items()]
    lines += [f"Returns: (..., {symbols}) = (..., {numbers})"]
    return "\n".join(textwrap.fill(line, 110, subsequent_indent="    ") if line else "" for line in lines)
