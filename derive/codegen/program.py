"""A quantity as a program for any target language: what is read, computed and returned, under which names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sympy import Symbol

from ..algebra.named_terms import Terms
from .arguments import Argument
from .quantities import Quantity
from .statements import Statements, statements


@dataclass(frozen=True)
class Read:
    """The entries of an argument that a program uses: index -> name."""

    argument: Argument
    names: dict[int, str]


@dataclass(frozen=True)
class Program:
    """How a quantity is computed."""

    quantity: Quantity
    reads: list[Read]
    steps: Statements
    names: dict[Symbol, str]  # of what is read and of what is computed


def program(quantity: Quantity, terms: Terms, reserved: Iterable[str] = ()) -> Program:
    """The program of one quantity; its names avoid `reserved`."""
    taken = {*reserved, *(argument.name for argument in quantity.arguments)}
    inputs = {symbol: _free(symbol.name, taken) for argument in quantity.arguments for symbol in argument.entries}
    steps = statements(quantity.expression, terms, taken)
    reads = [
        Read(argument, {index: inputs[s] for index, s in enumerate(argument.entries) if s in steps.inputs})
        for argument in quantity.arguments
    ]
    return Program(quantity, [read for read in reads if read.names], steps, inputs | steps.names)


def _free(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name
