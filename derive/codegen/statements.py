"""Matrix of expressions -> assignments: named terms first, what several of them share in terms of its own."""

from __future__ import annotations

import keyword
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import Terms, sorted_symbols

_SHORT = 60  # letters of an expression that is returned without a name
_SHORT_CALL = 24  # letters of a function call that is used without a name
_LONG_NAME = 30  # letters of a product's name


@dataclass(frozen=True)
class Statements:
    """`assignments`: symbol := expression, each before its first use; `entries`: what the function returns.

    What is printed for a symbol: its name in `names`, minus that name if it is `negated`, the call if it is `inlined`.
    """

    assignments: list[tuple[Symbol, Expr]]
    entries: dict[tuple[int, int], Expr]  # the nonzero ones
    names: dict[Symbol, str]
    inlined: dict[Symbol, Expr]
    negated: frozenset[Symbol]

    @cached_property
    def operations(self) -> int:
        """Arithmetic operations and function calls of one evaluation; equal entries are computed once."""
        printed = {s: Symbol(name, real=True) for s, name in self.names.items()} | self.inlined
        printed = {s: -value if s in self.negated else value for s, value in printed.items()}
        entries = {entry.xreplace(printed) for entry in self.entries.values()}
        definitions = [expression.xreplace(printed) for _, expression in self.assignments]
        return int(sum(sp.count_ops(expression) for expression in (*definitions, *entries)))

    @property
    def inputs(self) -> set[Symbol]:
        """Symbols that are used but neither assigned nor inlined."""
        every = [expression for _, expression in self.assignments]
        every += [*self.entries.values(), *self.inlined.values()]
        used: set[Symbol] = set().union(*(expression.free_symbols for expression in every))
        return used - self.names.keys() - self.inlined.keys()


def statements(matrix: Matrix, terms: Terms, reserved: Iterable[str]) -> Statements:
    """How to compute `matrix`; new names avoid `reserved`."""
    return _Draft(matrix, terms, reserved).shortened()


class _Draft:
    """Assignments as named terms and common subexpressions give them, and how they are made fewer.

    Symbols keep their own names in every expression, and only what is printed for them changes: their own names decide
    the order of summands and factors, so that each shortening leaves the result the same to the last bit.
    """

    def __init__(self, matrix: Matrix, terms: Terms, reserved: Iterable[str]) -> None:
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
        self.definitions = {renamed.get(s, s): definitions[s].xreplace(renamed) for s in ordered}
        self.entries = {place: entry.xreplace(renamed) for place, entry in entries.items()}
        self.functions = set(functions.values())
        self.numbered = {symbol for symbol in renamed.values() if symbol.name.startswith("term_")}
        self.replaced: dict[Symbol, tuple[int, Symbol]] = {}  # a symbol that is another one, or minus it
        self.inlined: dict[Symbol, Expr] = {}
        self._reserved = {*reserved, *(s.name for s in self.definitions if s not in self.numbered)}

    def shortened(self) -> Statements:
        """What is left to be printed."""
        self._replace_aliases()
        self._replace_negatives()
        self._return_at_once()
        self._inline_calls()
        return self._statements()

    def _statements(self) -> Statements:
        names = self._names()
        roots = {symbol: self._root(symbol) for symbol in (*names, *self.inlined, *self.replaced)}
        return Statements(
            list(self.definitions.items()),
            self.entries,
            {symbol: names[root] for symbol, (_, root) in roots.items() if root in names},
            {symbol: self.inlined[root] for symbol, (_, root) in roots.items() if root in self.inlined},
            frozenset(symbol for symbol, (sign, _) in roots.items() if sign < 0),
        )

    def _root(self, symbol: Symbol) -> tuple[int, Symbol]:
        """What is printed for `symbol`: a sign and a symbol that is assigned or read."""
        sign = 1
        while symbol in self.replaced:
            factor, symbol = self.replaced[symbol]
            sign *= factor
        return sign, symbol

    def _printed(self, expression: Expr) -> Expr:
        return expression.xreplace({s: sign * root for s in self.replaced for sign, root in [self._root(s)]})

    def _uses(self) -> Counter[Symbol]:
        """How often each symbol is printed; equal entries are printed once."""
        entries = {self._printed(entry): entry for entry in self.entries.values()}
        uses: Counter[Symbol] = Counter()
        for expression in (*self.definitions.values(), *entries.values()):
            for part in sp.preorder_traversal(expression):
                if part.is_Symbol:
                    uses[self._root(part)[1]] += 1
                elif part.is_Pow and part.exp not in (2, -1, sp.S.Half):  # printed as a product
                    uses.update(self._root(symbol)[1] for symbol in part.free_symbols)
        return uses

    def _replace_aliases(self) -> None:
        """b := a needs no line: b is printed as a."""
        for symbol, expression in list(self.definitions.items()):
            if expression in self.definitions:
                del self.definitions[symbol]
                self.replaced[symbol] = 1, expression

    def _replace_negatives(self) -> None:
        """b := -a needs no line: b is printed as -a; or a as -b, if a has but a number for its name."""
        raised = {
            self._root(power.base)[1]
            for expression in (*self.definitions.values(), *self.entries.values())
            for power in expression.atoms(sp.Pow)
            if power.base.is_Symbol
        }
        operations = self._statements().operations
        for symbol, expression in list(self.definitions.items()):
            sign, other = self._root(-expression)
            if other not in self.definitions or sign < 0 or not raised.isdisjoint({symbol, other}):
                continue
            kept = self.definitions, dict(self.replaced)
            if other in self.numbered and symbol not in self.numbered:
                if not self.definitions[other].is_Mul or self.definitions[other].has(sp.Add):
                    continue
                renamed = {symbol if s == other else s: e for s, e in self.definitions.items() if s != symbol}
                self.definitions = renamed | {symbol: -self.definitions[other]}
                self.replaced[other] = -1, symbol
            else:
                self.definitions = {s: e for s, e in self.definitions.items() if s != symbol}
                self.replaced[symbol] = -1, other
            if (fewer := self._statements().operations) <= operations:
                operations = fewer
            else:
                self.definitions, self.replaced = kept

    def _return_at_once(self) -> None:
        """Short expressions that are but entries of the result need no name."""
        uses = self._uses()
        for place, entry in self.entries.items():
            sign, root = self._root(entry)
            if sign > 0 and uses[root] == 1 and len(str(self.definitions.get(root, ""))) in range(1, _SHORT):
                self.entries[place] = self.definitions[root]
        returned = set(self.entries.values())
        self.definitions = {s: e for s, e in self.definitions.items() if uses[s] > 1 or e not in returned}

    def _inline_calls(self) -> None:
        """Function calls that are used once need no name."""
        uses = self._uses()
        for symbol in [s for s in self.definitions if s in self.functions]:
            if uses[symbol] == 1 and len(str(self.definitions[symbol])) < _SHORT_CALL:
                self.inlined[symbol] = self.definitions.pop(symbol)

    def _names(self) -> dict[Symbol, str]:
        """What is printed for each assigned symbol: simple products say what they are, others get a number."""
        names: dict[Symbol, str] = {}
        fresh = _Names(self._reserved)
        number = count(1)
        for symbol, expression in self.definitions.items():
            if symbol in self.numbered:
                names[symbol] = fresh.fresh(self._product(expression, names) or f"term_{next(number)}").name
            else:
                names[symbol] = symbol.name
        return names

    def _product(self, expression: Expr, names: Mapping[Symbol, str]) -> str | None:
        """b*r -> b_times_r, b/r -> b_over_r, 1/r**2 -> r_squared_inverse; None if it is not as simple."""
        above: list[str] = []
        below: list[str] = []
        for factor in expression.as_ordered_factors():
            base, exponent = factor.as_base_exp()
            sign, root = self._root(base)
            if sign < 0 or not root.is_Symbol or exponent not in (1, -1, 2, -2) or root in self.inlined:
                return None
            inverted, power = self.definitions.get(root, root).as_base_exp()
            if exponent > 0 and power == -1 and inverted.is_Symbol:
                root, exponent = inverted, -exponent
            name = names.get(root, root.name) + ("_squared" if abs(exponent) == 2 else "")
            if name.startswith("term_"):
                return None
            (above if exponent > 0 else below).append(name)
        if len(above) + len(below) > 2 or len(below) > 1:
            return None
        name = "_over_".join(["_times_".join(above), *below]) if above else f"{below[0]}_inverse"
        return name if len(name) <= _LONG_NAME else None


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
        text = "_".join([function.func.__name__, *words]).replace(".", "_").replace("*", "_")
        return self.fresh(text if text.isidentifier() and len(text) <= 40 else f"{function.func.__name__}_1")

    def of_term(self, expression: Expr, number: int) -> Symbol:
        """r**2 -> r_squared; others are numbered."""
        if expression.is_Pow and expression.base.is_Symbol and not isinstance(expression.base, sp.Dummy):
            power = {2: "squared", 3: "cubed", -1: "inverse"}.get(expression.exp)
            if power:
                return self.fresh(f"{expression.base.name}_{power}")
        return self.fresh(f"term_{number}")
