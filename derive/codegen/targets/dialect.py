"""What a target language has of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..program import Program
from ..python_code import PythonCode, assigned, unpacked


@dataclass(frozen=True)
class Dialect(ABC):
    """How a program becomes a function's lines. `folder` holds imports.jinja and helpers.jinja.

    The helpers define the decorator `_function(**sizes)`, which makes the printed function what callers see. A
    language that is not Python brings a module.jinja and a printer of its own.
    """

    folder: Path
    file: str
    title: str
    usage: tuple[str, ...]  # lines of the module's docstring
    reserved: tuple[str, ...]  # names that no variable may have
    printer: type[PythonCode] = PythonCode

    def body(self, program: Program) -> list[str]:
        """Lines that read the arguments, compute the terms and return the result."""
        call = program.quantity.call
        if call is not None:
            return [f"return {self.called(call.function)}({', '.join(call.arguments)})"]
        code = self.printer(program.names, program.steps.inlined, program.steps.negated)
        lines = [line for read in program.reads for line in self.unpacking(read.argument.name, read.names)]
        for symbol, expression in program.steps.assignments:
            lines += self.assignment([program.names[symbol]], code.doprint(expression))
        return [*lines, *self.result(program, code)]

    def unpacking(self, argument: str, names: dict[int, str]) -> list[str]:
        """The entries of an argument under their names: index -> name."""
        return unpacked(list(names.values()), [f"{argument}[{index}]" for index in names])

    def assignment(self, targets: list[str], value: str) -> list[str]:
        """`value` under one or more names."""
        return assigned(targets, value)

    def called(self, function: str) -> str:
        """Another function of the module, as it is called from inside one."""
        return function

    @abstractmethod
    def result(self, program: Program, code: PythonCode) -> list[str]:
        """Lines that make the result from its entries and return it; entries that are absent are zero."""


@dataclass(frozen=True)
class FilledResult(Dialect):
    """For arrays whose entries can be set: the helper `_zeros(size, *arguments)` gives `out`, which is filled."""

    def result(self, program: Program, code: PythonCode) -> list[str]:
        """out = _zeros(...), out[i, j] = ..., return out."""
        arguments = ", ".join(argument.name for argument in program.quantity.arguments)
        return [
            f"out = _zeros({program.quantity.size}, {arguments})",
            *(line for targets, value in self._filled(program, code) for line in self.assignment(targets, value)),
            "return out",
        ]

    def _filled(self, program: Program, code: PythonCode) -> Iterator[tuple[list[str], str]]:
        """Equal entries together: their places and value."""
        places: dict[str, list[str]] = {}
        for (i, j), entry in program.steps.entries.items():
            place = f"out[{i}]" if program.quantity.is_vector else f"out[{i}, {j}]"
            places.setdefault(code.doprint(entry), []).append(place)
        return ((targets, value) for value, targets in places.items())
