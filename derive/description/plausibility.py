"""Does an expression mean what its place takes? Its unit, and its value at the default parameters."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp
from sympy import Expr, Symbol

from ..algebra.units import MixedUnits, Units, UnknownUnit, format_unit, parse_unit
from .reader import Reader


class Plausibility:
    """Checks expressions of one description; a mistake is reported with its place."""

    def __init__(self, reader: Reader, units: Mapping[str, dict[Symbol, str]], defaults: Mapping[Symbol, Expr]) -> None:
        self.reader, self.defaults = reader, defaults
        declared = {}
        for table, symbols in units.items():
            for symbol, text in symbols.items():
                try:
                    declared[symbol] = parse_unit(text)
                except UnknownUnit as error:
                    place = f"[{table}] {symbol.name}"
                    raise reader.mistake(
                        place, f"unknown {error.problem}", error.remedy or "write it as kg m^2/s"
                    ) from None
        self.units = Units(declared)

    def has_unit(self, expression: Expr, unit: str, place: str) -> None:
        """Fail with InputError if the expression has another unit; numbers have any."""
        try:
            found = self.units.of(expression)
        except MixedUnits as error:
            raise self.reader.mistake(place, str(error), "mind the units") from None
        except UnknownUnit:
            return
        if not expression.is_number and found != parse_unit(unit):
            problem = f"has the unit {format_unit(found)}"
            raise self.reader.mistake(place, problem, f"this place takes {unit}")

    def has_one_unit(self, expression: Expr, place: str) -> None:
        """Fail with InputError if a sum adds different units."""
        try:
            self.units.of(expression)
        except MixedUnits as error:
            raise self.reader.mistake(place, str(error), "mind the units") from None
        except UnknownUnit:
            return

    @property
    def numbers(self) -> dict[Symbol, Expr]:
        """The values of parameters, by default, and of constants."""
        return dict(self.defaults) | self.reader.constants.values

    def is_positive(self, expression: Expr, place: str) -> None:
        """Fail with InputError if the value at the default parameters is zero or negative."""
        value = self.value(expression, place)
        if value <= 0:
            problem = f"is {value:g} with the default parameters"
            raise self.reader.mistake(place, problem, "it must be positive")

    def is_not_negative(self, expression: Expr, place: str) -> None:
        """Fail with InputError if the value at the default parameters is negative."""
        value = self.value(expression, place)
        if value < 0:
            problem = f"is {value:g} with the default parameters"
            raise self.reader.mistake(place, problem, "it must not be negative")

    def value(self, expression: Expr, place: str) -> float:
        """The value at the default parameters.

        Raises:
            InputError: If it is not a finite real number.
        """
        value = sp.sympify(expression.xreplace(self.numbers)).evalf(20)
        if not (value.is_Float or value.is_Rational) or not value.is_finite:
            zeros = [symbol.name for symbol, number in self.defaults.items() if number == 0]
            hint = f"; {', '.join(zeros)} may not be zero" if zeros else ""
            raise self.reader.mistake(place, f"has no finite value with the default parameters{hint}", "change them")
        return float(value)
