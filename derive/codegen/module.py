"""Quantities -> one Python module. The functions' bodies are the same text for NumPy and CasADi."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from ..algebra.named_terms import Terms
from .metadata import Metadata
from .python_code import WIDTH, PythonCode, wrapped
from .quantities import Argument, Quantity
from .rendering import render
from .statements import Statements, statements

FUNCTIONS = (
    "cos",
    "exp",
    "fabs",
    "pi",
    "sign",
    "sin",
    "sqrt",
    "tan",
)  # what expressions may call, by the same name in both libraries


_HELPERS = ("np", "math", "functools", "SX", "Function", "out")


@dataclass(frozen=True)
class Dialect:
    """What differs between the languages: imports, and how a function is made and its result set aside."""

    file: str
    title: str
    usage: tuple[str, ...]
    imports: str  # templates
    helpers: str


@dataclass(frozen=True)
class PrintedFunction:
    """What the template needs of one function."""

    quantity: Quantity
    docstring: list[str]
    body: list[str]


def print_module(quantities: list[Quantity], terms: Terms, metadata: Metadata, dialect: Dialect) -> str:
    """The text of a module that holds one function for each quantity."""
    module_names = {*(quantity.name for quantity in quantities), *FUNCTIONS, *_HELPERS}
    printed = [_print_function(quantity, terms, module_names) for quantity in quantities]
    used = sorted({name for one in printed for name in FUNCTIONS if any(_uses(line, name) for line in one.body)})
    return render(
        "module.py.jinja",
        functions=printed,
        metadata=metadata,
        used=used,
        symbol_table=_symbol_table(quantities),
        dialect=dialect,
    )


def operation_count(quantity: Quantity, terms: Terms) -> int:
    """Arithmetic operations of the generated function."""
    return statements(quantity.expression, terms, ()).operations


def _uses(line: str, name: str) -> bool:
    return re.search(rf"\b{name}\b", line) is not None


def _print_function(quantity: Quantity, terms: Terms, module_names: set[str]) -> PrintedFunction:
    arguments = [argument.name for argument in quantity.arguments]
    reserved = module_names | set(arguments)
    inputs = {symbol: _free(symbol.name, reserved) for arg in quantity.arguments for symbol in arg.entries}
    steps = statements(quantity.expression, terms, reserved | set(inputs.values()))
    code = PythonCode(inputs)
    size = quantity.size
    body = [
        f"{inputs[symbol]} = {argument.name}[{index}]"
        for argument in quantity.arguments
        for index, symbol in enumerate(argument.entries)
        if symbol in steps.inputs
    ]
    body += [f"{symbol.name} = {code.doprint(expression)}" for symbol, expression in steps.assignments]
    room = "_empty" if len(steps.entries) == len(quantity.expression) else "_zeros"
    body.append(f"out = {room}({size}, {', '.join(arguments)})")
    for (i, j), entry in steps.entries.items():
        body.append(
            f"out[{i}] = {code.doprint(entry)}" if quantity.is_vector else f"out[{i}, {j}] = {code.doprint(entry)}"
        )
    return PrintedFunction(quantity, _docstring(quantity, steps, size), _wrap(body))


def _wrap(lines: Iterable[str]) -> list[str]:
    return [part for line in lines for part in wrapped(line, 4).split("\n")]


def _free(name: str, reserved: set[str]) -> str:
    while name in reserved:
        name += "_"
    reserved.add(name)
    return name


def _docstring(quantity: Quantity, steps: Statements, size: tuple[int, ...]) -> list[str]:
    symbols = ", ".join(quantity.shape)
    lines = [f"{quantity.meaning}; equation {quantity.equation}.", ""]
    lines += [f"{argument.name}: {_described(argument)}" for argument in quantity.arguments]
    numbers = ", ".join(str(number) for number in size)
    comma = "," if len(size) == 1 else ""
    lines.append(f"Returns: shape ({symbols}{comma}) = ({numbers}{comma}); {steps.operations} operations.")
    return [
        part for line in lines for part in (textwrap.wrap(line, WIDTH - 4, subsequent_indent="    ") if line else [""])
    ]


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
