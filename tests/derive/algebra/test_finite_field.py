"""Exact evaluation knows every identity that the derivation relies on."""

from collections.abc import Callable

import pytest
import sympy as sp

from derive.algebra.dual_numbers import Dual
from derive.algebra.finite_field import FIELD, NotRepresentable, Point, usable, vanishes
from derive.algebra.linear_dependence import dependence
from derive.algebra.named_terms import Terms

a, b, x, c = sp.symbols("a b x c", real=True)
PART = sp.Rational("0.37") * a


@pytest.mark.parametrize(
    "identity",
    [
        sp.sin(a) ** 2 + sp.cos(a) ** 2 - 1,
        sp.cos(a + b) - sp.cos(a) * sp.cos(b) + sp.sin(a) * sp.sin(b),
        sp.sin(2 * a) - 2 * sp.sin(a) * sp.cos(a),
        sp.sin(a / 2) ** 2 - (1 - sp.cos(a)) / 2,
        sp.tan(a) * sp.cos(a) - sp.sin(a),
        sp.cos(a + sp.pi / 6) - (sp.sqrt(3) * sp.cos(a) - sp.sin(a)) / 2,
        sp.sqrt(x**2 + 1) ** 4 - (x**2 + 1) ** 2,
        sp.sqrt(23 * 37) - sp.sqrt(23) * sp.sqrt(37),
        sp.sqrt(3 * 32771**2 * 32789) - 32771 * sp.sqrt(3 * 32789),  # which SymPy does not see
        sp.sqrt(sp.Rational(5, 32771**2 * 32789)) - sp.sqrt(5 * 32789) / (32771 * 32789),
        sp.cos(PART + a) - sp.cos(a) * sp.cos(PART) + sp.sin(a) * sp.sin(PART),
        sp.cos(a / 17 + a) - sp.cos(a) * sp.cos(a / 17) + sp.sin(a) * sp.sin(a / 17),
        sp.sin(a + sp.atan(x)) - (sp.sin(a) + x * sp.cos(a)) / sp.sqrt(1 + x**2),
        sp.cos(a + sp.atan2(x, c)) - (c * sp.cos(a) - x * sp.sin(a)) / sp.sqrt(x**2 + c**2),
        sp.cos(a + sp.asin(x)) - sp.cos(a) * sp.sqrt(1 - x**2) + x * sp.sin(a),
        sp.sin(a - sp.acos(x)) - x * sp.sin(a) + sp.cos(a) * sp.sqrt(1 - x**2),
        sp.tanh(2 * x) - 2 * sp.tanh(x) / (1 + sp.tanh(x) ** 2),
        sp.sign(x) * sp.Abs(x) - x,
        sp.Abs(x) ** 2 - x**2,
        *(
            sp.cos(a + angle) - sp.cos(a) * sp.cos(angle) + sp.sin(a) * sp.sin(angle)
            for n in (3, 4, 5, 7, 8, 12)
            for angle in (sp.pi / n, 3 * sp.pi / n)
        ),
    ],
    ids=str,
)
def test_identities_vanish(identity: sp.Expr) -> None:
    assert vanishes(identity)
    assert not vanishes(identity + sp.Rational(1, 10**12))


@pytest.mark.parametrize("expression", [x, sp.sin(a) + sp.cos(a), sp.exp(x) - 1, a * x - 1, sp.sin(a) - sp.sin(b)])
def test_what_is_not_zero_does_not_vanish(expression: sp.Expr) -> None:
    assert not vanishes(expression)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("root", "base"),
    [
        (sp.sqrt(x**2 + 2 * x + 1), x + 1),
        (sp.sqrt(x**2 - 2 * x * c + c**2), x - c),
        (sp.sqrt(1 - sp.sin(a) ** 2), sp.cos(a)),
        (sp.Abs(sp.sin(b)), sp.sin(b)),
    ],
    ids=str,
)
def test_the_root_of_a_square_is_neither_its_base_nor_minus_that(root: sp.Expr, base: sp.Expr, sign: int) -> None:
    """It is one of the two at every point, so that one of these differences is zero at some of them."""
    assert not vanishes(root - sign * base)
    assert vanishes(root**2 - base**2)


def test_division_by_zero_has_no_value() -> None:
    with pytest.raises(NotRepresentable):
        Point(0)(1 / (sp.sin(a) ** 2 + sp.cos(a) ** 2 - 1))


def test_dependence_finds_coefficients_in_known_constants() -> None:
    """sin(a + c) is a combination of sin a and cos a, with coefficients that depend on c."""
    found = dependence([[sp.sin(a)], [sp.cos(a)], [sp.sin(a + c)]], frozenset({c}), Terms())
    assert found.independent == [0, 1]
    for index, expected in ((0, sp.cos(c)), (1, sp.sin(c))):
        assert vanishes(found.combination[2][index] - expected)


def test_terms_differentiate_through_names() -> None:
    terms = Terms()
    u = terms.name("u", sp.sin(a) * x)
    v = terms.name("v", u**2 + a)
    assert vanishes(terms.partial(v, a) - sp.diff(terms.expand(v), a), terms.definitions)
    rate = terms.rate(v, {a: x, x: a * b})
    assert vanishes(rate - sp.diff(terms.expand(v), a) * x - sp.diff(terms.expand(v), x) * a * b, terms.definitions)


@pytest.mark.parametrize("function", [sp.atan, sp.asin, sp.acos, sp.tanh, sp.exp, lambda f: sp.atan2(f, c)])
def test_dual_numbers_carry_the_derivatives_of_every_function(function: Callable[[sp.Expr], sp.Expr]) -> None:
    """Lie brackets go through functions without algebraic identities, too."""
    expression = function(x**2 + c) * x

    def both(seed: int) -> tuple[object, object]:
        point = Point(seed)
        along = Point(seed, values={x: Dual(point(x), FIELD(1))})(expression)
        return along.tangent, point(sp.diff(expression, x))

    (tangent, derivative), *_ = usable(both, 1, 100)
    assert tangent == derivative


def test_what_follows_from_others_is_found_for_any_ratio_of_angles() -> None:
    """sin(beta) is no combination of the sines of its parts; with their products it is one."""
    half = [[sp.sin(a / 2) * sp.cos(a / 2)], [sp.cos(a / 2) ** 2], [sp.sin(a)], [c * sp.cos(a) + c]]
    found = dependence(half, frozenset({c}), Terms())
    assert found.combination == {2: {0: 2}, 3: {1: 2 * c}}
