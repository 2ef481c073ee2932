"""Expressions as text that people read and that `wmr_input` reads back."""

from __future__ import annotations

import sympy as sp
from sympy import Expr

TOO_LONG = "too long to be read"  # what stands in the place of such a formula
_LONGEST_TEXT = 20_000  # characters; longer formulas are read by nobody
_DEEPEST = 30  # parentheses; `wmr_input` reads a few more
_MOST_OPERATIONS = 4000  # above which a text is not even tried
_LONGEST = 2**53  # numerators and denominators beyond are printed as decimals, to a double's last digit


def formula(expression: Expr) -> str:
    """`expression` as text, in which no number is longer than a double."""
    return str(with_decimals(expression)).replace("Abs(", "abs(")


def readable(expression: Expr) -> str | None:
    """`expression` as text; None if it is longer or deeper than people and `wmr_input` read."""
    if sp.count_ops(expression) > _MOST_OPERATIONS:
        return None
    text = formula(expression)
    return text if len(text) <= _LONGEST_TEXT and _depth(text) <= _DEEPEST else None


def _depth(text: str) -> int:
    deepest = depth = 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        deepest = max(deepest, depth)
    return deepest


def with_decimals(expression: Expr) -> Expr:
    """`expression` with fractions that a double does not hold as symbols that are called as their decimals.

    Sums of huge numbers are divided by the largest first, which cancels over quotients and products.
    """
    if not any(map(_is_long, expression.atoms(sp.Rational))):
        return expression
    scale, rest = _scaled(expression)
    return _decimal(scale) * rest.xreplace({n: _decimal(n) for n in rest.atoms(sp.Rational) if _is_long(n)})


def _is_long(number: sp.Rational) -> bool:
    return bool(max(abs(number.p), number.q) > _LONGEST)


def _scaled(expression: Expr) -> tuple[sp.Rational, Expr]:
    """A number and a rest whose product is `expression`; the sums of the rest have ordinary numbers."""
    if expression.is_Rational:
        return expression, sp.S.One
    if not any(map(_is_long, expression.atoms(sp.Rational))):
        return sp.S.One, expression
    if expression.is_Add:
        parts = [_scaled(term) for term in expression.args]
        scale = max((abs(number) for number, _ in parts), default=sp.S.One)
        return scale, sp.Add(*(_times(number / scale, rest) for number, rest in parts))
    if expression.is_Mul:
        parts = [_scaled(factor) for factor in expression.args]
        return sp.Mul(*(number for number, _ in parts)), sp.Mul(*(rest for _, rest in parts))
    if expression.is_Pow and expression.exp.is_Integer:
        number, rest = _scaled(expression.base)
        return number**expression.exp, rest**expression.exp
    return sp.S.One, expression.func(*(with_decimals(argument) for argument in expression.args))


def _times(number: sp.Rational, rest: Expr) -> Expr:
    return number * rest if not _is_long(number) else _decimal(number) * rest


def _decimal(number: sp.Rational) -> Expr:
    """A number that a double does not hold as a symbol, other ones as they are."""
    if not _is_long(number):
        return number
    symbol = sp.Symbol(repr(float(abs(number))), real=True)
    return -symbol if number < 0 else symbol
