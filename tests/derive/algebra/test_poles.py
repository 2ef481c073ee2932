"""Which divisors leave a pole, for functions whose poles are known."""

from __future__ import annotations

import pytest
import sympy as sp

from derive.algebra.named_terms import Terms
from derive.algebra.poles import leaves_a_pole

x, y, p, L = sp.symbols("x y p L", real=True)
ONE = {p: sp.S.One, L: sp.S.One}


@pytest.mark.parametrize(
    ("divisor", "function", "expected"),
    [
        (sp.cos(x), sp.tan(x), True),
        (sp.cos(x), 1 / sp.cos(x) ** 2, True),
        (sp.cos(x), sp.sqrt(sp.cos(x) ** 2 + 1), False),
        (sp.cos(x), 1 / (2 + sp.cos(x)), False),
        (2 + sp.cos(x), 1 / (2 + sp.cos(x)), False),
        (sp.sin(x), 1 / sp.sqrt(1 - sp.cos(x)), True),
        (sp.sin(x), sp.sin(x) / x, True),
        (sp.tan(x), sp.cos(x), False),
        (sp.cos(x) - sp.cos(y), 1 / (sp.cos(x) - sp.cos(y)), True),
        (x - 3, 1 / (x - 3), True),
        (x - 4, 1 / (x - 4), False),
    ],
    ids=str,
)
def test_a_divisor_leaves_a_pole_if_the_function_has_none_or_a_huge_value_there(
    divisor: sp.Expr, function: sp.Expr, expected: bool
) -> None:
    """Angles all around, lengths up to three metres; what is written as a quotient is none where it divides by zero."""
    assert leaves_a_pole(divisor, [function], (x, y), ONE, Terms()) is expected
    assert leaves_a_pole(divisor, [y, function], (x, y), ONE, Terms()) is expected


@pytest.mark.parametrize(
    ("divisor", "expected"),
    [
        (p * sp.cos(x) - sp.Rational(5, 4), True),
        (p * sp.cos(x) + sp.Rational(5, 4), True),
        (L * sp.cos(x) - 3, True),
        (p * sp.cos(x) - 5, False),
        (p + sp.Rational(1, 10) + sp.cos(x) / 2, True),
        (p + 1 + sp.cos(x), False),
        (p - 1, False),
    ],
    ids=str,
)
@pytest.mark.parametrize("size", [sp.S.One, sp.Integer(20), sp.Rational(1, 50)], ids=str)
def test_parameters_are_taken_larger_and_smaller_than_their_numbers(
    divisor: sp.Expr, expected: bool, size: sp.Expr
) -> None:
    """Up to four times, and down to a quarter, in whatever unit: a divisor may vanish for those only."""
    numbers, divisor = {p: size, L: size}, divisor.xreplace({p: p / size, L: L / size})
    assert leaves_a_pole(divisor, [1 / divisor], (x, y), numbers, Terms()) is expected


def test_poles_are_seen_through_names() -> None:
    terms = Terms()
    divisor = terms.name("divisor", sp.cos(x) * p + sp.sin(x))
    quotient = terms.name("quotient", y / divisor + 1)
    assert leaves_a_pole(divisor, [quotient * y], (x, y), ONE, terms)
    assert not leaves_a_pole(divisor, [divisor * y], (x, y), ONE, terms)
