"""Programs -> one module of a target language."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from ..algebra.named_terms import Terms
from .arguments import Argument
from .metadata import Metadata
from .program import Program, program
from .python_code import FUNCTIONS, WIDTH
from .quantities import Quantity
from .rendering import render
from .targets.dialect import Dialect


@dataclass(frozen=True)
class PrintedFunction:
    """What the template needs of one function."""

    quantity: Quantity
    docstring: list[str]
    body: list[str]


def print_module(programs: list[Program], metadata: Metadata, dialect: Dialect) -> str:
    """The text of a module that holds one function for each program."""
    printed = [PrintedFunction(one.quantity, _docstring(one), dialect.body(one)) for one in programs]
    called = {word for one in printed for line in one.body for word in re.findall(r"\w+", line)}
    return render(
        "module.jinja",
        dialect.folder,
        functions=printed,
        metadata=metadata,
        used=[name for name in FUNCTIONS if name in called],
        symbol_table=_symbol_table([one.quantity for one in programs]),
        dialect=dialect,
    )


def operation_count(quantity: Quantity, terms: Terms) -> int:
    """Arithmetic operations of the generated function."""
    return program(quantity, terms).steps.operations


def _docstring(one: Program) -> list[str]:
    quantity, operations = one.quantity, one.steps.operations
    shape, size = (_tuple(map(str, entries)) for entries in (quantity.shape, quantity.size))
    plural = "" if operations == 1 else "s"
    lines = [
        f"{quantity.meaning}; {_reference(quantity.equation)}.",
        "",
        *(f"{argument.name}: {_described(argument)}" for argument in quantity.arguments),
        f"Returns: shape {shape} = {size}; {operations} operation{plural}.",
        *(["The function that it calls gives the same here."] if quantity.call else []),
    ]
    return [part for line in lines for part in (textwrap.wrap(line, WIDTH, subsequent_indent="    ") if line else [""])]


def _tuple(entries: Iterable[str]) -> str:
    listed = list(entries)
    return f"({listed[0]},)" if len(listed) == 1 else f"({', '.join(listed)})"


def _reference(equation: str) -> str:
    """(2) -> equation (2); words stay as they are."""
    if not equation.startswith("("):
        return equation
    return f"equations {equation}" if ", (" in equation else f"equation {equation}"


def _described(argument: Argument) -> str:
    return f"{argument.meaning}, ({len(argument.entries)},)"


def _symbol_table(quantities: list[Quantity]) -> list[str]:
    """One line for each argument: its entries with units."""
    table: dict[str, str] = {}
    for quantity in quantities:
        for argument in quantity.arguments:
            entries = ", ".join(f"{s.name} [{u}]" for s, u in zip(argument.entries, argument.units, strict=True))
            table[argument.name] = f"{argument.name}: {argument.meaning}: {entries or 'none'}"
    return [part for line in table.values() for part in textwrap.wrap(line, WIDTH, subsequent_indent="    ")]
