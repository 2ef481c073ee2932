"""Angles that are written as decimals: sines and cosines in fractions, so that algebra stays as easy as without them.

Over sin(2.094395) computer algebra finds no identity and may never end. So a decimal in an angle is read as a symbol,
called as the number is written, and its sine and cosine are fractions on the unit circle, exact to the last digit of a
double. Decimals that are simple multiples of each other keep the identities of these multiples.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from math import gcd

import mpmath
import sympy as sp
from sympy import Expr, Symbol

_EXACT = 120  # pi times a fraction with a denominator that divides this stays as it is
_RATIOS = 24  # numerators and denominators of ratios whose identities are kept
_ERROR = Fraction(1, 10**18)  # of tan(angle/2): also a multiple is exact to a double's last digit
_ANGULAR = (sp.sin, sp.cos, sp.tan)

Unit = tuple[Expr, Expr]  # cosine and sine of an angle


class Constants:
    """The constants of one description: `values` by symbol."""

    def __init__(self) -> None:
        self.values: dict[Symbol, Expr] = {}

    def inside_functions(self, expression: Expr) -> Expr:
        """`expression` with the decimals in arguments of sin, cos and tan as constants."""
        return expression.replace(
            lambda part: isinstance(part, _ANGULAR), lambda part: part.func(self.in_angle(part.args[0]))
        )

    def in_angle(self, angle: Expr) -> Expr:
        """An angle with what it adds as a decimal as a constant."""
        return sp.Add(*(self._term(term) for term in sp.Add.make_args(sp.expand(angle))))

    def _term(self, term: Expr) -> Expr:
        factor, rest = term.as_coeff_Mul()
        if factor == 0 or rest not in (sp.S.One, sp.pi) or (rest == sp.pi and _EXACT % factor.q == 0):
            return term
        size = repr(float(abs(factor)))
        symbol = Symbol(size if rest == 1 else f"{size}*pi", real=True)
        self.values[symbol] = abs(factor) * rest
        return symbol if factor > 0 else -symbol

    def exact(self, expression: Expr) -> Expr:
        """`expression` with the sines and cosines of constants as fractions, sums of angles resolved for it."""
        if expression.free_symbols.isdisjoint(self.values):
            return expression
        return expression.replace(lambda part: isinstance(part, _ANGULAR), self._resolved)

    def _resolved(self, function: Expr) -> Expr:
        angle = function.args[0]
        c, s, rest = sp.S.One, sp.S.Zero, sp.S.Zero
        for term in sp.Add.make_args(angle):
            factor, symbol = term.as_coeff_Mul()
            if symbol in self._units and factor.is_Integer:
                c, s = _product((c, s), _power(self._units[symbol], int(factor)))
            else:
                rest += term
        if rest == angle:
            return function
        cosine, sine = _product((c, s), (sp.cos(rest), sp.sin(rest)))
        return {sp.cos: cosine, sp.sin: sine, sp.tan: sine / cosine}[function.func]

    @cached_property
    def _units(self) -> dict[Symbol, Unit]:
        """The unit of each constant; all must have been read."""
        units: dict[Symbol, Unit] = {}
        left = dict(self.values)
        while left:
            first = next(iter(left.values()))
            ratios = {symbol: value / first for symbol, value in left.items()}
            group = {s: Fraction(int(r.p), int(r.q)) for s, r in ratios.items() if _is_simple(r)}
            divisor = Fraction(
                gcd(*(r.numerator * (_common(group) // r.denominator) for r in group.values())), _common(group)
            )
            part = _unit(first * sp.Rational(divisor.numerator, divisor.denominator))
            units |= {symbol: _power(part, int(ratio / divisor)) for symbol, ratio in group.items()}
            left = {symbol: value for symbol, value in left.items() if symbol not in group}
        return units


def _is_simple(ratio: Expr) -> bool:
    return bool(ratio.is_Rational and max(ratio.p, ratio.q) <= _RATIOS)


def _common(group: Mapping[Symbol, Fraction]) -> int:
    common = 1
    for ratio in group.values():
        common = common * ratio.denominator // gcd(common, ratio.denominator)
    return common


def _unit(angle: Expr) -> Unit:
    """Fractions on the unit circle next to cos(angle), sin(angle)."""
    with mpmath.workdps(60):
        half = mpmath.tan(angle._to_mpmath(mpmath.mp.prec) / 2)
        exact = Fraction(int(mpmath.nint(half * mpmath.mpf(10) ** 40)), 10**40)
    near, largest = Fraction(0), 10**8
    while abs(near - exact) > _ERROR:
        near, largest = exact.limit_denominator(largest), 2 * largest
    t = sp.Rational(near.numerator, near.denominator)
    return (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)


def _product(first: Unit, second: Unit) -> Unit:
    (a, b), (c, d) = first, second
    return a * c - b * d, a * d + b * c


def _power(unit: Unit, times: int) -> Unit:
    result: Unit = (sp.S.One, sp.S.Zero)
    for _ in range(abs(times)):
        result = _product(result, unit)
    return result if times >= 0 else (result[0], -result[1])


def is_constant(symbol: Symbol) -> bool:
    """Whether a symbol stands for a number; declared names begin with a letter."""
    return bool(symbol.name[:1].isdigit())


def near_fractions_of_pi(values: Mapping[Symbol, Expr], tolerance: float) -> dict[Symbol, Expr]:
    """Constants that are a fraction of pi but for less than `tolerance` [rad], each with this fraction."""
    found: dict[Symbol, Expr] = {}
    for symbol, value in values.items():
        for denominator in (5, 8, 12):  # and the parts of 12
            steps = round(float((value / sp.pi).evalf(20)) * denominator)
            if steps and abs(float((value - steps * sp.pi / denominator).evalf(20))) < tolerance:
                found[symbol] = steps * sp.pi / denominator
    return found
