"""Units of derived quantities, as far as they follow from the declared ones: for docstrings and reports."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction

import sympy as sp
from sympy import Expr, Symbol

from wmr_input import WmrError

from .constants import is_constant

Unit = dict[str, Fraction]  # exponents of base units; radians count as 1


_DERIVED: dict[str, str] = {
    "N": "kg m/s^2",
    "J": "kg m^2/s^2",
    "W": "kg m^2/s^3",
    "Nm": "kg m^2/s^2",
    "Hz": "1/s",
}


_BASE = ("kg", "m", "s", "A", "V")


_ONE = ("1", "rad", "-")


_FAMILIAR = ("N", "N m", "N/V", "N m/V", "N m s")  # written so where they come out


class UnknownUnit(WmrError):
    """The unit does not follow from the declared ones."""


class MixedUnits(UnknownUnit):
    """A sum of quantities of different units: the text names them."""


def parse_unit(text: str) -> Unit:
    """`N m s/rad` -> exponents. What stands behind a stroke is in the denominator; radians count as 1.

    Raises:
        UnknownUnit: If a word is no unit.
    """
    exponents: Unit = {}
    for place, part in enumerate(text.replace("*", " ").replace("(", " ").replace(")", " ").split("/")):
        for word in part.split():
            name, caret, power = word.partition("^")
            if caret and not re.fullmatch(r"-?[0-9]+", power):
                raise UnknownUnit(f"power {power!r} in unit {text!r}")
            exponent = Fraction(power) if caret else Fraction(1)
            exponents = product(exponents, _factor(name), exponent if place == 0 else -exponent)
    return exponents


def _factor(name: str) -> Unit:
    if name in _DERIVED:
        return parse_unit(_DERIVED[name])
    if name in _ONE:
        return {}
    if name in _BASE:
        return {name: Fraction(1)}
    known = ", ".join((*_BASE, "rad", *_DERIVED, "1"))
    raise UnknownUnit(f"unit {name!r}", f"use SI units: {known}")


def format_unit(unit: Unit) -> str:
    """Exponents -> text, numerator first, `1` for a number."""
    for familiar in _FAMILIAR:
        if unit == parse_unit(familiar):
            return familiar
    above = [_power(name, e) for name, e in sorted(unit.items()) if e > 0]
    below = [_power(name, -e) for name, e in sorted(unit.items()) if e < 0]
    denominator = f"/({' '.join(below)})" if len(below) > 1 else f"/{below[0]}" if below else ""
    return (" ".join(above) or "1") + denominator


class Units:
    """The units of symbols, declared or found, and of expressions in them and in named terms."""

    def __init__(self, declared: Mapping[Symbol, Unit], definitions: Mapping[Symbol, Expr] | None = None) -> None:
        self._known, self._definitions = dict(declared), definitions or {}

    def declare(self, symbol: Symbol, unit: Unit) -> None:
        self._known[symbol] = unit

    def text(self, expression: Expr) -> str:
        """The unit as text, `?` where it does not follow."""
        try:
            return format_unit(self.of(expression))
        except UnknownUnit:
            return "?"

    def of(self, expression: Expr) -> Unit:
        """The unit of an expression; numbers fit anything in a sum.

        Raises:
            UnknownUnit: If a symbol has none.
            MixedUnits: If a sum adds different units.
        """
        if expression.is_Symbol:
            if is_constant(expression):
                return {}
            if expression not in self._known:
                if expression not in self._definitions:
                    raise UnknownUnit(expression.name)
                self._known[expression] = self.of(self._definitions[expression])
            return self._known[expression]
        if expression.is_number or isinstance(expression, sp.sin | sp.cos | sp.tan | sp.exp):
            return {}
        if expression.is_Add:
            found = [self.of(term) for term in expression.args if not term.is_number]
            for unit in found:
                if unit != found[0]:
                    raise MixedUnits(f"adds {format_unit(found[0])} to {format_unit(unit)}")
            return found[0]
        if expression.is_Mul:
            whole: Unit = {}
            for factor in expression.args:
                whole = product(whole, self.of(factor), 1)
            return whole
        if expression.is_Pow and expression.exp.is_Rational:
            return product({}, self.of(expression.base), Fraction(expression.exp.p, expression.exp.q))
        if isinstance(expression, sp.Abs):
            return self.of(expression.args[0])
        raise UnknownUnit(str(expression))


def product(first: Unit, second: Unit, exponent: Fraction | int) -> Unit:
    """first * second^exponent."""
    total = dict(first)
    for name, power in second.items():
        total[name] = total.get(name, Fraction(0)) + power * exponent
    return {name: power for name, power in total.items() if power != 0}


def _power(name: str, exponent: Fraction) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"
