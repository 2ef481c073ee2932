"""SymPy expressions as Python arithmetic that NumPy arrays and CasADi symbols both evaluate."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.str import StrPrinter

WIDTH = 116  # columns of a line


class PythonCode(StrPrinter):  # type: ignore[misc]
    """Prints with `names` for symbols; functions stand bare, as `from numpy import cos` makes them available."""

    def __init__(self, names: Mapping[sp.Symbol, str]) -> None:
        super().__init__()
        self._names = names

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self._names.get(expr, expr.name)

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
            return f"({self._print(base ** (exponent - sp.S.Half))})*sqrt({self._print(base)})"
        return super()._print_Pow(expr, rational=False)

    def _print_Exp1(self, expr: sp.Expr) -> str:
        return "exp(1)"

    def _print_Abs(self, expr: sp.Expr) -> str:
        return f"fabs({self._print(expr.args[0])})"

    def _print_Pi(self, expr: sp.Expr) -> str:
        return "pi"


def wrapped(line: str, indent: int) -> str:
    """A long assignment, broken before + and -, the outermost ones where that is enough."""
    head, separator, body = line.partition(" = ")
    if len(line) + indent <= WIDTH or not separator:
        return line
    inner = " " * (indent + 4)
    lines, current = [], ""
    for piece in _pieces(body, WIDTH - len(inner)):
        if current and len(inner) + len(current) + 1 + len(piece) > WIDTH:
            lines.append(current)
            current = piece
        else:
            current = f"{current} {piece}" if current else piece
    lines.append(current)
    joined = f"\n{inner}".join(lines)
    return f"{head} = (\n{inner}{joined}\n{' ' * indent})"


def _pieces(body: str, width: int) -> list[str]:
    """`body` split at its spaces before + and -, as deep inside parentheses as it takes to stay within `width`."""
    for deepest in range(body.count("(") + 1):
        depth, start, pieces = 0, 0, []
        for position, letter in enumerate(body):
            depth += (letter == "(") - (letter == ")")
            if depth <= deepest and body[position : position + 3] in (" + ", " - "):
                pieces.append(body[start:position])
                start = position + 1
        pieces.append(body[start:])
        if max(map(len, pieces)) <= width:
            break
    return pieces
