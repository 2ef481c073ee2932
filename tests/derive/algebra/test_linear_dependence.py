"""Coefficients of combinations: at rational states, of roots that exist at some draws only, and in any order."""

from __future__ import annotations

import pytest
import sympy as sp

from derive.algebra.finite_field import NotRepresentable, Point
from derive.algebra.linear_dependence import NotCombined, _parts, _RationalState, dependence
from derive.algebra.named_terms import Terms

a, b, c, L, x, y = sp.symbols("a b c L x y", real=True)
KNOWN = frozenset({c, L})


@pytest.mark.parametrize("draw", range(2))
@pytest.mark.parametrize(
    "identity",
    [
        *(sp.cos(n * a) - sp.chebyshevt(n, sp.cos(a)) for n in (2, 3, 7, 8, 11)),
        *(sp.sin(n * a) - sp.sin(a) * sp.chebyshevu(n - 1, sp.cos(a)) for n in (7, 10)),
        sp.sin(-9 * a) + sp.sin(8 * a) * sp.cos(a) + sp.cos(8 * a) * sp.sin(a),
        sp.sin(a / 2) ** 2 - (1 - sp.cos(a)) / 2,
        sp.cos(a / 3) ** 3 - (sp.cos(a) + 3 * sp.cos(a / 3)) / 4,
        sp.sin(a / 2) * sp.cos(a / 3) - (sp.sin(5 * a / 6) + sp.sin(a / 6)) / 2,
        sp.tan(7 * a) * sp.cos(7 * a) - sp.sin(7 * a),
        sp.cos(7 * a + b) - sp.cos(7 * a) * sp.cos(b) + sp.sin(7 * a) * sp.sin(b),
    ],
    ids=str,
)
def test_identities_hold_at_rational_states(identity: sp.Expr, draw: int) -> None:
    """Multiples and parts of an angle share a rational unit, so that each sine and cosine is rational, too."""
    value = _RationalState(draw, KNOWN, _parts([identity], KNOWN))
    assert value(identity) == 0
    for function in identity.atoms(sp.sin, sp.cos):
        assert value(function).is_Rational
        assert 0 < abs(value(function)) < 1


def test_known_constants_stay_at_rational_states() -> None:
    """An angle is turned by them; other symbols are numbers, other ones at each draw."""
    first, second = (_RationalState(draw, KNOWN, _parts([sp.cos(a + c)], KNOWN)) for draw in range(2))
    assert first(L * x + c).free_symbols == {L, c}
    assert first(x).is_Rational
    assert first(x) != second(x)
    assert first(x) != first(y)
    turned = first(sp.cos(a + c)) - first(sp.cos(a)) * sp.cos(c) + first(sp.sin(a)) * sp.sin(c)
    assert sp.expand(turned) == 0


def has_root(expression: sp.Expr) -> bool:
    """Whether the root exists where constants that grow are looked at."""
    try:
        Point(-1)(sp.sqrt(expression))
    except NotRepresentable:
        return False
    return True


ROOTS = [next(L**2 + n for n in range(1, 99) if has_root(L**2 + n) is exists) for exists in (True, False)]


@pytest.mark.parametrize("inside", ROOTS, ids=["a root at once", "a root at other draws only"])
def test_multiples_of_roots_of_constants_and_states_are_found(inside: sp.Expr) -> None:
    """Numbers are coefficients wherever the functions exist at all."""
    root = sp.sqrt(inside) * sp.sqrt(x)
    found = dependence([[root], [root * y], [3 * root - root * y / 7]], frozenset({L}), Terms())
    assert found.combination == {2: {0: sp.S(3), 1: -sp.Rational(1, 7)}}


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ([[x], [L**2 * x / c]], {1: {0: L**2 / c}}),
        ([[x, y], [-2 * x / (3 * L), -2 * y / (3 * L)]], {1: {0: -2 / (3 * L)}}),
        ([[x], [y], [(L + c) * x + y / (1 + L)]], {2: {0: L + c, 1: 1 / (1 + L)}}),
        ([[sp.sin(7 * a)], [sp.cos(7 * a)], [sp.sin(7 * a + c)]], {2: {0: sp.cos(c), 1: sp.sin(c)}}),
    ],
    ids=["powers", "a fraction times powers", "sums and quotients", "a high multiple turned"],
)
def test_coefficients_are_those_that_the_functions_were_made_with(columns: list, expected: dict) -> None:
    """Read off as constants grow, or solved for."""
    found = dependence(columns, KNOWN, Terms())
    assert found.combination.keys() == expected.keys()
    for j, combination in expected.items():
        assert found.combination[j].keys() == combination.keys()
        for i, coefficient in combination.items():
            assert sp.simplify(found.combination[j][i] - coefficient) == 0


def test_a_sum_of_constants_under_a_root_of_the_state_is_given_up() -> None:
    """Not answered wrongly."""
    root = sp.sqrt(x + L)
    with pytest.raises(NotCombined):
        dependence([[root], [root * (1 + L)]], frozenset({L}), Terms())


@pytest.mark.parametrize("power", [L, 1 / L, L**2, 1 / L**2, sp.S.One], ids=str)
@pytest.mark.parametrize("fraction", [sp.S.One, sp.Rational(-3, 7), sp.Integer(12)], ids=str)
def test_fractions_of_powers_of_a_constant_are_read_off_beside_roots_of_the_state(
    fraction: sp.Expr, power: sp.Expr
) -> None:
    """For which states at rational numbers tell nothing; a fraction that is none of few digits is given up."""
    root = sp.sqrt(x**2 + 3)
    found = dependence([[root], [root * y], [fraction * power * root + 5 * root * y / L]], frozenset({L}), Terms())
    assert found.independent == [0, 1]
    assert found.combination == {2: {0: fraction * power, 1: 5 / L}}
    with pytest.raises(NotCombined):
        dependence([[root], [root * y], [sp.sqrt(2) * power * root + root * y / L]], frozenset({L}), Terms())
