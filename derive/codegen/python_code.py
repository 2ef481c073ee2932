"""SymPy expressions as Python arithmetic that NumPy arrays and CasADi symbols both evaluate."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Mapping

import sympy as sp
from sympy import Expr, Symbol
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.str import StrPrinter

from ..algebra.formula_text import with_decimals

WIDTH = 116  # columns of a line inside a function
_INDENT = " " * 4

FUNCTIONS = (  # what expressions may call, by these names
    "acos", "asin", "atan", "atan2", "cos", "exp", "fabs", "pi", "sign", "sin", "sqrt", "tan", "tanh",
)  # fmt: skip


class PythonCode(StrPrinter):  # type: ignore[misc]
    """Prints with `names` for symbols; functions stand bare, as `from numpy import cos` makes them available.

    The symbols' own names decide the order of factors and summands, and with it the rounding. `inlined` symbols stand
    for function calls, `negated` ones for minus what their name says; these are neither raised to powers nor arguments.
    """

    def __init__(
        self,
        names: Mapping[Symbol, str],
        inlined: Mapping[Symbol, Expr] | None = None,
        negated: Collection[Symbol] = (),
    ) -> None:
        super().__init__()
        self._names, self._inlined, self._negated = names, inlined or {}, negated

    def doprint(self, expr: Expr) -> str:
        return str(super().doprint(with_decimals(sp.sympify(expr))))

    def _print_Symbol(self, expr: Symbol) -> str:
        return f"-{self._unsigned(expr)}" if expr in self._negated else self._unsigned(expr)

    def _unsigned(self, symbol: Symbol) -> str:
        """What is printed for a symbol, but for its sign."""
        return self._print(self._inlined[symbol]) if symbol in self._inlined else self._names.get(symbol, symbol.name)

    def parenthesize(self, item: Expr, level: int, strict: bool = False) -> str:
        if item in self._negated:  # a factor: _print_Mul puts the sign in front of the product
            return self._unsigned(item)
        return super().parenthesize(item, level, strict)

    def _print_Mul(self, expr: sp.Mul) -> str:
        text = super()._print_Mul(expr)
        if sum(factor in self._negated for factor in expr.args) % 2 == 0:
            return text
        return text[1:] if text.startswith("-") else f"-{text}"

    def _print_Rational(self, expr: sp.Rational) -> str:
        return f"{expr.p}/{expr.q}"

    def _print_Pow(self, expr: sp.Pow, rational: bool = False) -> str:
        base, exponent = expr.args
        if exponent == sp.S.Half:
            return f"sqrt({self._print(base)})"
        if exponent.is_Integer and -8 <= exponent <= -3:
            return f"1/{self._print(base**-exponent)}"  # which stands in parentheses
        if exponent.is_negative:
            return f"1/{self.parenthesize(sp.Pow(base, -exponent), PRECEDENCE['Pow'], strict=False)}"
        if exponent.is_Integer and 3 <= exponent <= 8:  # a general power costs ten products
            factor = self.parenthesize(base, PRECEDENCE["Pow"], strict=False)
            return "(" + "*".join([factor] * int(exponent)) + ")"
        if exponent.is_Rational and exponent.q == 2 and exponent > 0:
            whole = self.parenthesize(base ** (exponent - sp.S.Half), PRECEDENCE["Mul"], strict=False)
            return f"({whole}*sqrt({self._print(base)}))"  # in parentheses: it may stand behind a stroke
        return super()._print_Pow(expr)

    def _print_Exp1(self, expr: sp.Expr) -> str:
        return "exp(1)"

    def _print_Abs(self, expr: sp.Expr) -> str:
        return f"fabs({self._print(expr.args[0])})"

    def _print_Pi(self, expr: sp.Expr) -> str:
        return "pi"


def assigned(targets: list[str], value: str) -> list[str]:
    """`value` assigned to `targets`, a long one broken before + and -, the outermost ones if that is enough."""
    line = " = ".join([*targets, value])
    if len(line) <= WIDTH:
        return [line]
    lines = [""]
    for piece in _pieces(value, WIDTH - len(_INDENT)):
        longer = f"{lines[-1]} {piece}".lstrip()
        if len(_INDENT) + len(longer) <= WIDTH or not lines[-1]:
            lines[-1] = longer
        else:
            lines.append(piece)
    return [" = ".join([*targets, "("]), *(_INDENT + each for each in lines), ")"]


def unpacked(names: list[str], values: list[str]) -> list[str]:
    """`values` assigned to `names` in one statement, broken after commas."""
    left, right = ", ".join(names), ", ".join(values)
    if len(f"{left} = {right}") <= WIDTH:
        return [f"{left} = {right}"]
    if len(left) + 4 <= WIDTH:
        return [f"{left} = (", *_filled(right), ")"]
    return ["(", *_filled(f"{left},"), ") = (", *_filled(right), ")"]


def _filled(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=_INDENT, subsequent_indent=_INDENT, break_long_words=False)


def _pieces(value: str, width: int) -> list[str]:
    """`value` split at its spaces before + and -, as deep inside parentheses as it takes to stay within `width`.

    Products that are still too long are split before their last * that fits.
    """
    for deepest in range(value.count("(") + 1):
        depth, start, pieces = 0, 0, []
        for position, letter in enumerate(value):
            depth += (letter == "(") - (letter == ")")
            if depth <= deepest and value[position : position + 3] in (" + ", " - "):
                pieces.append(value[start:position])
                start = position + 1
        pieces.append(value[start:])
        if max(map(len, pieces)) <= width:
            return pieces
    return [part for piece in pieces for part in _factors(piece, width)]


def _factors(piece: str, width: int) -> list[str]:
    if len(piece) <= width:
        return [piece]
    stars = [match.start() for match in re.finditer(r"(?<!\*)\*(?!\*)", piece)]
    end = max((position for position in stars if 0 < position <= width), default=len(piece))
    return [piece[:end], *_factors(piece[end:], width)] if end < len(piece) else [piece]
