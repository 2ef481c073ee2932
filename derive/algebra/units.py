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


_BASE = ("kg", "m", "s", "A")


_DERIVED: dict[str, str] = {
    "N": "kg m/s^2",
    "J": "kg m^2/s^2",
    "W": "kg m^2/s^3",
    "V": "kg m^2/(s^3 A)",
    "Ohm": "kg m^2/(s^3 A^2)",
    "Nm": "kg m^2/s^2",
    "Hz": "1/s",
}


_ONE = ("1", "rad", "-")


_REFUSED = {  # what people write besides SI units: the unit to write, and the factor
    "mm": ("m", "0.001"),
    "cm": ("m", "0.01"),
    "km": ("m", "1000"),
    "g": ("kg", "0.001"),
    "deg": ("rad", "pi/180"),
    "rpm": ("rad/s", "pi/30"),
    "ms": ("s", "0.001"),
    "min": ("s", "60"),
    "h": ("s", "3600"),
    "mV": ("V", "0.001"),
    "mA": ("A", "0.001"),
    "kN": ("N", "1000"),
    "kW": ("W", "1000"),
    "kOhm": ("Ohm", "1000"),
    "mOhm": ("Ohm", "0.001"),
    "in": ("m", "0.0254"),
    "lb": ("kg", "0.45359237"),
}


_FAMILIAR = ("N", "N m", "N/V", "N m/V", "N m s", "Ohm")  # written so where they come out


class UnknownUnit(WmrError):
    """The unit does not follow from the declared ones."""


class MixedUnits(UnknownUnit):
    """A sum of quantities of different units: the text names them."""


def parse_unit(text: str) -> Unit:
    """`N m s/rad` or `kg*m**2/(s^2 A)` -> exponents.

    What stands behind a stroke up to the next one, or in the parentheses behind it, is in the denominator; radians
    count as 1.

    Raises:
        UnknownUnit: If a word is no unit, or the text is no product of powers.
    """
    words = [word for word in re.findall(r"\*\*|[()/*^]|[^\s()/*^]+", text) if word != "*"]
    return _Words(["^" if word == "**" else word for word in words], text).whole()


class _Words:
    """The words of one unit, read from left to right."""

    def __init__(self, words: list[str], text: str) -> None:
        self._words, self._text = words, text

    def whole(self) -> Unit:
        unit = self._product()
        if self._words:
            raise UnknownUnit(f"{self._words[0]!r} in unit {self._text!r}")
        return unit

    def _product(self) -> Unit:
        unit: Unit = {}
        sign = 1
        while self._words and self._words[0] != ")":
            if self._words[0] == "/":
                self._words.pop(0)
                sign = -1
                continue
            unit = product(unit, self._factor(), sign)
        return unit

    def _factor(self) -> Unit:
        word = self._words.pop(0)
        if word == "(":
            unit = self._product()
            if not self._words:
                raise UnknownUnit(f"a parenthesis that is not closed in unit {self._text!r}")
            self._words.pop(0)
        elif word == "^":
            raise UnknownUnit(f"a power of nothing in unit {self._text!r}")
        else:
            unit = _named(word)
        if self._words and self._words[0] == "^":
            self._words.pop(0)
            unit = product({}, unit, self._power())
        return unit

    def _power(self) -> Fraction:
        power = self._words.pop(0) if self._words else ""
        if not re.fullmatch(r"-?[0-9]{1,3}", power):
            raise UnknownUnit(f"power {power!r} in unit {self._text!r}")
        return Fraction(power)


def _named(name: str) -> Unit:
    if name in _DERIVED:
        return parse_unit(_DERIVED[name])
    if name in _ONE:
        return {}
    if name in _BASE:
        return {name: Fraction(1)}
    if name in _REFUSED:
        unit, factor = _REFUSED[name]
        raise UnknownUnit(f"unit {name!r}", f"write {unit!r} and the value times {factor}")
    known = ", ".join((*_BASE, "rad", *_DERIVED, "1"))
    raise UnknownUnit(f"unit {name!r}", f"use SI units: {known}")


def format_unit(unit: Unit) -> str:
    """Exponents -> text, numerator first, `1` for a number; volts instead of amperes if they take no more units."""
    for familiar in _FAMILIAR:
        if unit == parse_unit(familiar):
            return familiar
    amperes = unit.get("A", Fraction(0))
    volts = product(product(unit, {"A": Fraction(1)}, -amperes), parse_unit("W"), amperes)  # A = W/V
    volts = {**volts, "V": -amperes} if amperes else volts
    return _written(min((volts, unit), key=len))


def _written(unit: Unit) -> str:
    above = [_power(name, e) for name, e in sorted(unit.items()) if e > 0]
    below = [_power(name, -e) for name, e in sorted(unit.items()) if e < 0]
    denominator = f"/({' '.join(below)})" if len(below) > 1 else f"/{below[0]}" if below else ""
    return (" ".join(above) or "1") + denominator


_WITHOUT_UNIT = (sp.sin, sp.cos, sp.tan, sp.exp, sp.asin, sp.acos, sp.atan, sp.atan2, sp.tanh, sp.sign)


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
        if expression.is_number or isinstance(expression, _WITHOUT_UNIT):
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
