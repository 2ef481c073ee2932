"""Units of derived quantities, as far as they follow from the declared ones: for docstrings and reports."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import sympy as sp
from sympy import Expr, Symbol

Unit = dict[str, Fraction]  # exponents of base units; radians count as 1

_DERIVED: dict[str, str] = {"N": "kg m/s^2", "J": "kg m^2/s^2", "W": "kg m^2/s^3", "Nm": "kg m^2/s^2", "Hz": "1/s"}
_ONE = ("1", "rad", "", "-")
_FAMILIAR = ("N", "N m", "N/V", "N m/V")  # written so where they come out


class UnknownUnit(Exception):
    """The unit does not follow from the declared ones."""


def parse_unit(text: str) -> Unit:
    """`N m s/rad` -> exponents. What stands behind a stroke is in the denominator."""
    exponents: Unit = {}
    for place, part in enumerate(text.replace("*", " ").replace("(", " ").replace(")", " ").split("/")):
        for word in part.split():
            name, _, power = word.partition("^")
            exponent = Fraction(power) if power.lstrip("-").isdigit() else Fraction(1)
            factor = parse_unit(_DERIVED[name]) if name in _DERIVED else {} if name in _ONE else {name: Fraction(1)}
            exponents = _product(exponents, factor, exponent if place == 0 else -exponent)
    return exponents


def format_unit(unit: Unit) -> str:
    """Exponents -> text, numerator first, `1` for a number."""
    for familiar in _FAMILIAR:
        if unit == parse_unit(familiar):
            return familiar
    above = [_power(name, e) for name, e in sorted(unit.items()) if e > 0]
    below = [_power(name, -e) for name, e in sorted(unit.items()) if e < 0]
    denominator = f"/({' '.join(below)})" if len(below) > 1 else f"/{below[0]}" if below else ""
    return (" ".join(above) or "1") + denominator


def unit_of(expression: Expr, units: Mapping[Symbol, Unit]) -> Unit:
    """The unit of an expression; numbers fit anything in a sum.

    Raises: UnknownUnit, where a symbol has none or a sum has two.
    """
    if expression.is_Symbol:
        if expression not in units:
            raise UnknownUnit(expression.name)
        return units[expression]
    if expression.is_Add:
        found = [unit_of(term, units) for term in expression.args if not term.is_number]
        if any(unit != found[0] for unit in found):
            raise UnknownUnit(str(expression))
        return found[0] if found else {}
    if expression.is_Mul:
        product: Unit = {}
        for factor in expression.args:
            product = _product(product, unit_of(factor, units), Fraction(1))
        return product
    if expression.is_Pow and expression.exp.is_Rational:
        return _product({}, unit_of(expression.base, units), Fraction(expression.exp.p, expression.exp.q))
    if expression.is_number or isinstance(expression, sp.Function):
        return {}
    raise UnknownUnit(str(expression))


def unit_text(expression: Expr, units: Mapping[Symbol, Unit]) -> str:
    """The unit as text, `?` where it does not follow."""
    try:
        return format_unit(unit_of(expression, units))
    except UnknownUnit:
        return "?"


def _product(first: Unit, second: Unit, exponent: Fraction) -> Unit:
    total = dict(first)
    for name, power in second.items():
        total[name] = total.get(name, Fraction(0)) + power * exponent
    return {name: power for name, power in total.items() if power != 0}


def _power(name: str, exponent: Fraction) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"
