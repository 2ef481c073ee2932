"""What is told of a determinant: factors that can vanish, and a denominator apart if it is long."""

from __future__ import annotations

import pytest
import sympy as sp

from derive.control.decoupling_determinant import DENOMINATOR, Determinant

L, q, s, theta1, theta2 = sp.symbols("L q s theta1 theta2", real=True)
DECIMAL = sp.Symbol("0.25", real=True)


def of_length(operations: int) -> sp.Expr:
    """A sum of so many operations."""
    whole = sp.Add(*(sp.Symbol(f"t{k}", real=True) for k in range(operations + 1)))
    assert sp.count_ops(whole) == operations
    return whole


@pytest.mark.parametrize(
    ("operations", "stands_apart"), [(10, False), (25, False), (26, True), (100, True), (101, True)]
)
def test_a_long_denominator_stands_apart(operations: int, stands_apart: bool) -> None:
    """The product with it in its place is the determinant."""
    denominator = of_length(operations)
    told = Determinant(True, L, theta1 / denominator, sp.S.One)
    assert (told.denominator is not None) == stands_apart
    assert (DENOMINATOR in told.product.free_symbols) == stands_apart
    assert sp.simplify(told.product.xreplace({DENOMINATOR: denominator}) - told.whole) == 0
    assert told.is_long == (operations > 100)
    assert told.text == ("L*theta1/Delta" if stands_apart else f"L*theta1/({denominator})")
    assert told.denominator_text == (str(denominator) if stands_apart else None)


def test_with_more_motors_than_outputs_the_output_map_counts_twice() -> None:
    """det(D D^T) = det(E)^2 det(G G^T)."""
    assert Determinant(False, L * sp.cos(q), theta1, sp.S.One).whole == L**2 * sp.cos(q) ** 2 * theta1
    assert Determinant(True, L * sp.cos(q), theta1, sp.S.One).whole == L * sp.cos(q) * theta1


@pytest.mark.parametrize(
    ("output_map", "gain", "actuation", "expected"),
    [
        (L * sp.cos(q), theta1, sp.S.One, ["L", "theta1", "cos(q)"]),
        (2 * L * sp.cos(q) ** 3, theta1**2 / theta2, sp.cos(q), ["L", "theta1", "cos(q)"]),
        (sp.S(3), 1 / theta1, sp.sin(s), ["sin(s)"]),
        (DECIMAL * L, sp.exp(q) * theta1, sp.S.One, ["L", "theta1"]),
        (sp.S.One, (theta1 + theta2) * theta1, sp.S.One, ["theta1", "theta1 + theta2"]),
        (DECIMAL + L, sp.S.One, sp.sin(q + DECIMAL), ["0.25 + L", "sin(0.25 + q)"]),
    ],
    ids=str,
)
def test_factors_that_can_vanish_are_named_once(
    output_map: sp.Expr, gain: sp.Expr, actuation: sp.Expr, expected: list
) -> None:
    """Numbers, decimals and exponentials cannot; powers and denominators add nothing."""
    told = Determinant(True, output_map, gain, actuation)
    assert sorted(told.singular_where) == sorted(f"{one} = 0" for one in expected)
    assert not told.is_singular_elsewhere


def test_a_factor_that_nobody_reads_is_not_named() -> None:
    """It is nested too deeply."""
    deep = q
    for _ in range(40):
        deep = sp.sin(deep)
    told = Determinant(True, L, deep + theta1, sp.S.One)
    assert told.singular_where == ["L = 0"]
    assert told.is_singular_elsewhere
    assert told.text is None
