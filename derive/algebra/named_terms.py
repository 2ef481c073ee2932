"""Named terms: a derivation kept as a list of small definitions instead of ever larger expressions.

A body velocity of the third trailer is used a dozen times: in the kinetic energy, in its rate, in every Jacobian.
It gets a name once, derivatives follow by the chain rule through the names, and the generated code shows the
same names. Expressions therefore grow with the number of frames, not with the depth of the tree.
"""

from collections.abc import Callable, Iterable, Mapping

import sympy as sp
from sympy import Expr, Matrix, Symbol

from .finite_field import TRIED_POINTS, Point, usable, vanishes
from .trigonometry import shortest


def sorted_symbols(symbols: Iterable[Symbol]) -> list[Symbol]:
    """By name: sets of symbols change their order with the hash seed."""
    return sorted(symbols, key=lambda symbol: symbol.name)


class Terms:
    """An ordered table of definitions `symbol := expression in earlier symbols`."""

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self.definitions: dict[Symbol, Expr] = {}
        self._names = set(reserved)
        self._known: dict[Expr, Symbol] = {}
        self._derivatives: dict[tuple[Symbol, str], Expr] = {}

    def name(self, text: str, expression: Expr) -> Expr:
        """`expression` under the name `text`, or itself where it is too simple to deserve one."""
        if is_simple(expression):
            return expression
        if expression not in self._known:
            sign = -1 if expression.could_extract_minus_sign() else 1
            if sign * expression in self._known:
                return sign * self._known[sign * expression]
            symbol = self.fresh(text)
            self.definitions[symbol] = expression
            self._known[expression] = symbol
        return self._known[expression]

    def fresh(self, text: str) -> Symbol:
        """A new symbol, called `text` if that is free."""
        while text in self._names:
            text += "_"
        self._names.add(text)
        return Symbol(text, real=True)

    def simplified(self, expression: Expr) -> Expr:
        """A short form, without symbols that only seem to matter: sin(a)^2 + cos(a)^2 has no a."""
        if not expression.has(sp.Add):
            return expression
        for symbol in sorted_symbols(set().union(*(f.free_symbols for f in expression.atoms(sp.Function)), set())):
            without = expression.xreplace({symbol: sp.S.Zero})
            if not without.has(sp.zoo, sp.nan) and self.is_zero(expression - without):
                expression = without
        return shortest(expression)

    def is_zero(self, expression: Expr) -> bool:
        """Whether `expression` vanishes identically, decided by exact evaluation."""
        return vanishes(expression, self.definitions)

    def rank(self, matrix: Matrix, numbers: Mapping[Symbol, Expr] | None = None) -> int:
        """The rank of `matrix` at almost every point, or at almost every point where symbols have given `numbers`.

        Raises:
            NotRepresentable: If it has no value anywhere.
        """

        def rank(seed: int) -> int:
            values = {symbol: Point(seed)(number) for symbol, number in (numbers or {}).items()}
            return Point(seed, self.definitions, values).rank(matrix)

        return int(next(usable(rank, 1, TRIED_POINTS)))

    def needed(self, expressions: Iterable[Expr]) -> dict[Symbol, Expr]:
        """The definitions that `expressions` rest on, in order of definition."""
        wanted: set[Symbol] = set()
        open_symbols = [symbol for expression in expressions for symbol in expression.free_symbols]
        while open_symbols:
            symbol = open_symbols.pop()
            if symbol in self.definitions and symbol not in wanted:
                wanted.add(symbol)
                open_symbols.extend(self.definitions[symbol].free_symbols)
        return {symbol: expression for symbol, expression in self.definitions.items() if symbol in wanted}

    def expand(self, expression: Expr) -> Expr:
        """`expression` with every name replaced by what it stands for."""
        values: dict[Expr, Expr] = {}
        for symbol, definition in self.needed([expression]).items():
            values[symbol] = definition.xreplace(values)
        return expression.xreplace(values)

    def resolve(self, expression: Expr, unwanted: Callable[[Symbol], bool]) -> Expr:
        """`expression` with the names for which `unwanted` holds replaced, again and again, by their definitions."""
        while True:
            resolved = {
                s: self.definitions[s] for s in expression.free_symbols & self.definitions.keys() if unwanted(s)
            }
            if not resolved:
                return expression
            expression = expression.xreplace(resolved)

    def atoms(self, expression: Expr) -> set[Symbol]:
        """The undefined symbols that `expression` rests on."""
        symbols = set(expression.free_symbols)
        for definition in self.needed([expression]).values():
            symbols |= definition.free_symbols
        return symbols - self.definitions.keys()

    def partial(self, expression: Expr, variable: Symbol) -> Expr:
        """d expression / d variable, by the chain rule through the names."""
        return self._derivative(expression, f"by_{variable.name}", {variable: sp.S.One}.get)

    def rate(self, expression: Expr, rates: Mapping[Symbol, Expr]) -> Expr:
        """The rate of change of `expression` where each symbol changes at `rates[symbol]`."""
        return self._derivative(expression, "dot", rates.get)

    def _derivative(self, expression: Expr, suffix: str, direction: Callable[[Symbol], Expr | None]) -> Expr:
        total = sp.S.Zero
        for symbol in sorted_symbols(expression.free_symbols):
            if symbol in self.definitions:
                change = self._derivative_of_term(symbol, suffix, direction)
            else:
                change = direction(symbol) or sp.S.Zero
            if change != 0:
                total += sp.diff(expression, symbol) * change
        return total

    def _derivative_of_term(self, symbol: Symbol, suffix: str, direction: Callable[[Symbol], Expr | None]) -> Expr:
        key = (symbol, suffix)
        if key not in self._derivatives:
            change = self._derivative(self.definitions[symbol], suffix, direction)
            self._derivatives[key] = self.name(f"{symbol.name}_{suffix}", change)
        return self._derivatives[key]


def is_simple(expression: Expr) -> bool:
    """A number, a symbol, a function of a symbol, or a number times one or two of these."""
    _, rest = expression.as_coeff_Mul()
    factors = sp.Mul.make_args(rest)
    return len(factors) <= 2 and all(_is_elementary(factor) for factor in factors)


def _is_elementary(factor: Expr) -> bool:
    return not factor.args or (isinstance(factor, sp.Function) and not any(part.args for part in factor.args))
