"""Matrix of expressions -> assignments: named terms first, what several of them share in terms of its own."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import Terms, sorted_symbols


@dataclass(frozen=True)
class Statements:
    """`assignments`: symbol := expression, each before its first use; `entries`: what the function returns."""

    assignments: list[tuple[Symbol, Expr]]
    entries: dict[tuple[int, int], Expr]  # the nonzero ones

    @property
    def operations(self) -> int:
        """Arithmetic operations and function calls of one evaluation."""
        every = [expression for _, expression in self.assignments] + list(self.entries.values())
        return int(sum(sp.count_ops(expression) for expression in every))

    @property
    def inputs(self) -> set[Symbol]:
        """Symbols that are used but not assigned."""
        every = [expression for _, expression in self.assignments] + list(self.entries.values())
        used = set().union(*(expression.free_symbols for expression in every))
        return used - {symbol for symbol, _ in self.assignments}


def statements(matrix: Matrix, terms: Terms, reserved: Iterable[str]) -> Statements:
    """How to compute `matrix`; new names avoid `reserved`."""
    places = [(i, j) for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0]
    named = terms.needed([matrix[place] for place in places])
    expressions = [*named.values(), *(matrix[place] for place in places)]
    names = _Names([*reserved, *(symbol.name for symbol in named)])
    functions = {f: names.of_function(f) for f in _functions(expressions)}
    expressions = [expression.xreplace(functions) for expression in expressions]
    shared, reduced = sp.cse(expressions, symbols=(sp.Dummy() for _ in count()), order="canonical", list=True)
    definitions: dict[Symbol, Expr] = {symbol: function for function, symbol in functions.items()}
    definitions |= dict(shared)
    definitions |= dict(zip(named, reduced, strict=False))
    entries = dict(zip(places, reduced[len(named) :], strict=True))
    adopted = {value: name for name, value in definitions.items() if name in named and isinstance(value, sp.Dummy)}
    for dummy, name in adopted.items():  # a shared term that already has a name keeps that one
        definitions[name] = definitions.pop(dummy)
    definitions = {symbol: expression.xreplace(adopted) for symbol, expression in definitions.items()}
    entries = {place: entry.xreplace(adopted) for place, entry in entries.items()}
    ordered = list(_ordered(entries.values(), definitions))
    renamed = {s: names.of_term(definitions[s], number) for number, s in enumerate(_dummies(ordered), 1)}
    return Statements(
        [(renamed.get(symbol, symbol), definitions[symbol].xreplace(renamed)) for symbol in ordered],
        {place: entry.xreplace(renamed) for place, entry in entries.items()},
    )


def _functions(expressions: Sequence[Expr]) -> list[Expr]:
    """Distinct function calls, inner ones first, in a fixed order."""
    found = set().union(*(expression.atoms(sp.Function) for expression in expressions)) if expressions else set()
    return sorted(found, key=lambda f: (sp.count_ops(f), sp.default_sort_key(f)))


def _ordered(wanted: Iterable[Expr], definitions: dict[Symbol, Expr]) -> Iterator[Symbol]:
    """The definitions that `wanted` rests on, each after those it uses."""
    done: set[Symbol] = set()

    def visit(expression: Expr) -> Iterator[Symbol]:
        for symbol in sorted(expression.free_symbols & definitions.keys(), key=position.__getitem__):
            if symbol not in done:
                done.add(symbol)
                yield from visit(definitions[symbol])
                yield symbol

    position = {symbol: index for index, symbol in enumerate(definitions)}
    for expression in wanted:
        yield from visit(expression)


def _dummies(symbols: Iterable[Symbol]) -> list[Symbol]:
    return [symbol for symbol in symbols if isinstance(symbol, sp.Dummy)]


class _Names:
    """Readable names for what a printer introduces."""

    def __init__(self, reserved: Iterable[str]) -> None:
        self._taken = set(reserved)

    def fresh(self, text: str) -> Symbol:
        while text in self._taken or keyword.iskeyword(text):
            text += "_"
        self._taken.add(text)
        return Symbol(text, real=True)

    def of_function(self, function: Expr) -> Symbol:
        """cos(phi + beta) -> cos_phi_beta."""
        words = []
        for term in sp.Add.make_args(function.args[0]):
            factor, rest = term.as_coeff_Mul()
            words += ["minus"] if factor.is_negative else []
            words += [str(abs(factor)).replace("/", "_")] if abs(factor) != 1 else []
            words += [s.name for s in sorted_symbols(rest.free_symbols)] or [str(rest)]
        text = "_".join([function.func.__name__, *words])
        return self.fresh(text if text.isidentifier() and len(text) <= 40 else f"{function.func.__name__}_1")

    def of_term(self, expression: Expr, number: int) -> Symbol:
        """r**2 -> r_squared; others are numbered."""
        if expression.is_Pow and expression.base.is_Symbol and not isinstance(expression.base, sp.Dummy):
            power = {2: "squared", 3: "cubed", -1: "inverse"}.get(expression.exp)
            if power:
                return self.fresh(f"{expression.base.name}_{power}")
        return self.fresh(f"term_{number}")
