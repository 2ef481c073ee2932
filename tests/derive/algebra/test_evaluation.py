"""Values to many digits, and ranks of matrices that no exact field holds."""

from __future__ import annotations

import mpmath
import pytest
import sympy as sp

from derive.algebra.evaluation import FUNCTIONS, Evaluation, NotFinite, rank_in_numbers

x, y, name = sp.symbols("x y name", real=True)
EXACT = {x: sp.Rational(3, 10), y: -sp.Rational(7, 10)}


def at(definitions: dict[sp.Symbol, sp.Expr]) -> Evaluation:
    """To the present number of digits."""
    return Evaluation({s: mpmath.mpf(number.p) / number.q for s, number in EXACT.items()}, definitions)


@pytest.mark.parametrize(
    "expression",
    [
        *(function(x) for function in FUNCTIONS if function is not sp.atan2),
        sp.atan2(y, x),
        x**3 - y**-2 + sp.Rational(1, 3),
        sp.sqrt(x) * x ** sp.Rational(2, 3) / y,
        sp.pi * x + sp.E,
        sp.exp(name) * x + name**2,
    ],
    ids=str,
)
def test_values_are_those_of_sympy(expression: sp.Expr) -> None:
    """To forty digits, through names."""
    definitions = {name: sp.sin(x) * y}
    with mpmath.workdps(50):
        found = at(definitions)(expression)
        expected = expression.xreplace(definitions).xreplace(EXACT).evalf(50)
        assert abs(found - mpmath.mpf(str(expected))) < mpmath.mpf("1e-40")


@pytest.mark.parametrize("expression", [sp.sqrt(y), sp.asin(3 + x), 1 / (x - sp.Rational(3, 10))])
def test_what_has_no_finite_real_value_is_told(expression: sp.Expr) -> None:
    with mpmath.workdps(50), pytest.raises((NotFinite, ZeroDivisionError)):
        at({})(expression)


def test_a_function_without_a_value_is_named() -> None:
    with pytest.raises(NotImplementedError, match="no value of gamma"):
        at({})(sp.gamma(x))


ROOT = sp.sqrt(1 + x**2)


@pytest.mark.parametrize(
    ("matrix", "rank"),
    [
        (sp.Matrix([[ROOT, 1], [1, ROOT]]), 2),
        (sp.Matrix([[ROOT, 1], [1 + x**2, ROOT]]), 1),
        (sp.Matrix([[ROOT * y, y], [name, 0]]), 2),
        (sp.Matrix([[name, name * y], [1, y]]), 1),
        (sp.zeros(2, 2), 0),
        (sp.zeros(0, 2), 0),
        (sp.Matrix([[sp.sin(y) ** 2 + sp.cos(y) ** 2 - 1]]), 0),
        (sp.Matrix([[1, 0], [0, sp.Rational(1, 10**20)]]), 2),
        (sp.Matrix([[sp.sqrt(y - sp.Rational(9, 10)), 0], [0, 1]]), 2),
    ],
    ids=str,
)
def test_a_rank_is_that_almost_everywhere(matrix: sp.Matrix, rank: int) -> None:
    """Where x has its number, and at another place if there is no value at the first."""
    assert rank_in_numbers(matrix, {x: sp.Rational(101, 293)}, {name: x**2 + 1}) == rank


def test_a_matrix_without_a_value_has_no_rank() -> None:
    with pytest.raises(NotFinite):
        rank_in_numbers(sp.Matrix([[sp.sqrt(-1 - y**2)]]), {}, {})
    with pytest.raises(NotFinite):
        rank_in_numbers(sp.Matrix([[1 / (x - 2)]]), {x: sp.S(2)}, {})
