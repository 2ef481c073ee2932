"""Angles that are written as decimals make no algebra harder and stay exact to a double's last digit."""

from __future__ import annotations

from math import cos, sin

import pytest
import sympy as sp

from derive.algebra.constants import Constants, near_fractions_of_pi
from derive.algebra.formula_text import formula, readable
from wmr_afl.numerics.formulas import numpy_value

a, x = sp.symbols("a x", real=True)


@pytest.mark.parametrize("angle", ["2.094395", "0.5", "1e-3", "3.7", "1.5707963", "6.25"])
def test_a_decimal_has_fractions_on_the_unit_circle(angle: str) -> None:
    constants = Constants()
    c, s = (constants.exact(constants.inside_functions(function(sp.Rational(angle)))) for function in (sp.cos, sp.sin))
    assert c.is_Rational
    assert c**2 + s**2 == 1
    assert float(c) == pytest.approx(cos(float(angle)), abs=4e-16)
    assert float(s) == pytest.approx(sin(float(angle)), abs=4e-16)


def test_decimals_that_are_multiples_of_each_other_keep_their_identities() -> None:
    constants = Constants()
    one, two, three = (constants.inside_functions(sp.cos(sp.Rational(n, 10))) for n in (7, 14, 21))
    assert constants.exact(two - 2 * one**2 + 1) == 0
    assert constants.exact(three - 4 * one**3 + 3 * one) == 0


def test_sums_with_other_angles_are_resolved() -> None:
    constants = Constants()
    resolved = constants.exact(constants.inside_functions(sp.sin(a + sp.Rational("0.3")) + sp.tan(x)))
    assert sp.N(resolved.subs({a: 0.2, x: 0.1}) - sp.sin(0.5) - sp.tan(0.1)) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("function", [sp.sin, sp.cos, sp.tan])
@pytest.mark.parametrize("times", [-3, -2, -1, 1, 2, 3])
def test_an_angle_is_turned_by_a_decimal_as_often_as_it_is_written(times: int, function: sp.Function) -> None:
    """To either side of a sum of others."""
    constants = Constants()
    resolved = constants.exact(function(a + x + times * constants.in_angle(sp.Rational("0.3"))))
    assert resolved.free_symbols == {a, x}
    assert float(resolved.subs({a: 0.2, x: 0.1})) == pytest.approx(float(function(0.3 + 0.3 * times)), abs=1e-15)


def test_fractions_of_pi_stay_as_they_are() -> None:
    constants = Constants()
    assert constants.in_angle(a + sp.pi / 4) == a + sp.pi / 4
    assert constants.values == {}


def test_a_decimal_close_to_a_fraction_of_pi_is_recognized() -> None:
    constants = Constants()
    for text in ("1.5708", "0.785398", "0.5"):
        constants.in_angle(sp.Rational(text))
    found = {symbol.name: value for symbol, value in near_fractions_of_pi(constants.values, 1e-3).items()}
    assert found == {"1.5708": sp.pi / 2, "0.785398": sp.pi / 4}


def test_numbers_that_no_double_holds_are_printed_as_decimals_and_read_back() -> None:
    huge = sp.Integer(10) ** 200 + 1
    expression = (huge * a + 3 * huge * x) / (huge * 7 + a * sp.Integer(10) ** 190)
    text = formula(expression)
    value = numpy_value(text, {"a": 0.3, "x": 0.7})
    assert value == pytest.approx(float(expression.subs({a: sp.Rational(3, 10), x: sp.Rational(7, 10)})), rel=1e-14)


def test_a_formula_too_long_or_too_deep_is_not_told() -> None:
    deep = a
    for k in range(60):
        deep = sp.sin(x) * (deep + k) + x
    assert readable(a * x + 1) == "a*x + 1"
    assert readable(deep) is None
    assert readable(sp.Add(*(sp.Symbol(f"s{k}") * a**k for k in range(3000)))) is None


@pytest.mark.parametrize("denominator", [7, 11, 49, 121])
def test_fractions_of_pi_that_are_no_usual_ones_are_constants(denominator: int) -> None:
    """Their values are those fractions, and their sines and cosines are exact to a double's last digit."""
    constants = Constants()
    for numerator in (-3, 2, 5):
        angle = sp.pi * numerator / denominator
        symbol = constants.in_angle(angle)
        assert symbol.free_symbols <= constants.values.keys()
        assert symbol.xreplace(constants.values) == angle
    for numerator in (-3, 2, 5):
        angle = sp.pi * numerator / denominator
        for function in (sp.sin, sp.cos, sp.tan):
            found = constants.exact(constants.inside_functions(function(angle)))
            assert found.is_Rational
            assert float(found) == pytest.approx(float(function(angle)), rel=4e-16)


@pytest.mark.parametrize("decimals", [("0.7", "1.4"), ("0.3", "0.5"), ("0.2", "1.1")])
def test_ratios_of_decimals_keep_their_identities(decimals: tuple[str, str]) -> None:
    """cos(x + y) and sin(x - y) of any two of them, in whichever order they are read."""
    for order in (decimals, decimals[::-1]):
        constants, identities = Constants(), []
        read = constants.inside_functions
        for x in map(sp.Rational, order):
            for y in map(sp.Rational, order):
                c1, s1, c2, s2 = map(read, (sp.cos(x), sp.sin(x), sp.cos(y), sp.sin(y)))
                identities += [read(sp.cos(x + y)) - c1 * c2 + s1 * s2, read(sp.sin(x - y)) - s1 * c2 + c1 * s2]
        assert set(map(constants.exact, identities)) == {0}


@pytest.mark.parametrize(
    "angles", [("0.7", sp.pi * 2 / 7), ("0.7", "0.7000001"), ("1.1", "0.3333333", sp.pi / 11)], ids=str
)
def test_angles_without_a_simple_ratio_have_each_its_own_sine_and_cosine(angles: tuple) -> None:
    """Whichever is read first; each to a double's last digit, and together on the unit circle."""
    for order in (angles, angles[::-1]):
        constants = Constants()
        numbers = [sp.sympify(one, rational=True) for one in order]
        read = [(constants.inside_functions(sp.cos(x)), constants.inside_functions(sp.sin(x))) for x in numbers]
        for x, (cosine, sine) in zip(numbers, read, strict=True):
            c, s = constants.exact(cosine), constants.exact(sine)
            assert (float(c), float(s)) == pytest.approx((float(sp.cos(x)), float(sp.sin(x))), rel=4e-16)
            assert c**2 + s**2 == 1
