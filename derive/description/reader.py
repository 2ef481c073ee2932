"""Text over declared names -> SymPy, exactly: decimals become rationals, names such as I or E stay plain symbols."""

from collections.abc import Mapping
from fractions import Fraction

import sympy as sp
from sympy import Expr, Symbol

from wmr_input import Algebra, ExpressionError, InputError, evaluate

from ..algebra.constants import Constants
from .tables import FUNCTION_NAMES

_FUNCTIONS = {name: getattr(sp, {"abs": "Abs"}.get(name, name)) for name in FUNCTION_NAMES}


class Reader:
    """Reads the expressions of one file; a mistake is reported with the place where the text stands."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.constants = Constants()  # angles that are written as decimals
        self.kinks_allowed: frozenset[Symbol] = frozenset()  # what abs and sign may be taken of: parameters

    def mistake(self, place: str, problem: str, remedy: str = "") -> InputError:
        return InputError(self.file, place, problem, remedy)

    def expression(self, text: str, names: Mapping[str, Expr], place: str, hint: str = "") -> Expr:
        """`text` as SymPy expression over `names` and pi; `hint` says what this place may contain."""
        algebra = Algebra(
            names={"pi": sp.pi, **names},
            functions=_FUNCTIONS,
            number=lambda fraction: sp.Rational(fraction.numerator, fraction.denominator),
        )
        try:
            value = sp.sympify(evaluate(text, algebra))
        except ExpressionError as error:
            raise self.mistake(place, error.problem, error.remedy + (f" ({hint})" if hint else "")) from None
        if value.has(sp.zoo, sp.nan, sp.oo, -sp.oo, sp.I):
            raise self.mistake(place, f"{text!r} is not a finite real number", "remove the division by zero or root")
        if any(len(str(part)) > 80 for number in value.atoms(sp.Rational) for part in (number.p, number.q)):
            raise self.mistake(place, f"{text[:60]!r} holds constants out of range", "use numbers of usual size")
        if any(not part.free_symbols <= self.kinks_allowed for part in value.atoms(sp.Abs)):
            problem = f"{text!r} is an absolute value, which has a kink"
            raise self.mistake(place, problem, "write it without one, or of parameters only")
        if any(not part.free_symbols <= self.kinks_allowed for part in value.atoms(sp.sign)):
            raise self.mistake(place, f"{text!r} has a sign that jumps", "take signs of parameters only")
        return self.constants.inside_functions(value)


def symbol(name: str) -> Symbol:
    """The symbol of a declared name; all quantities are real."""
    return Symbol(name, real=True)


def rational(value: float) -> sp.Rational:
    """A decimal number as its author wrote it: 0.1 becomes 1/10."""
    fraction = Fraction(repr(value))
    return sp.Rational(fraction.numerator, fraction.denominator)
