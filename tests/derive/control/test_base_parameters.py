"""Base parameters of functions that are made to have a choice between several."""

import numpy as np
import pytest
import sympy as sp

from derive.algebra.named_terms import Terms
from derive.algebra.separation import Parameters
from derive.control.base_parameters import LinearMap, linear_map

L, p1, p2, p3, x, y, s = sp.symbols("L p1 p2 p3 x y s")
NUMBERS = {L: 0.5, p1: 2.0, p2: 3.0, p3: 5.0}


def parametrized(*function: sp.Expr) -> LinearMap:
    """The minimal map, L known and the other parameters not; affine in s."""
    parameters = Parameters(frozenset({L}), frozenset({p1, p2, p3}))
    return linear_map(sp.Matrix(function), (s,), parameters, Terms(), lambda e: float(e.xreplace(NUMBERS)))


FUNCTIONS = {
    "nothing in common": ((p1 * x + p2 * y,), 2),
    "a common state": ((p1 * x + p2 * x,), 1),
    "a common state but for a known length": ((p1 * L * x + p2 * x,), 1),
    "the same, the other way round": ((p1 * x + p2 * L * x,), 1),
    "two rows": ((p1 * L * x + p2 * x, p1 * L * y + p2 * y), 1),
    "two rows that differ": ((p1 * L * x + p2 * x, p1 * L * y - p2 * y), 2),
    "a slope": ((p1 * x + p2 * x * s,), 2),
    "a parameter that follows from others": ((p1 * x + p2 * y + (p1 + p2) * x * y,), 2),
    "a negative parameter": ((-p1 * x - p3 * y * s,), 2),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_as_few_base_parameters_as_can_be_give_the_function_again(name: str) -> None:
    """F = (drift + slope s) theta(p), none of them negative, and none that could be left out."""
    function, count = FUNCTIONS[name]
    found = parametrized(*function)
    assert len(found.base_parameters) == count
    again = found.regressor((s,)) * sp.Matrix(found.base_parameters)
    assert (again - sp.Matrix(function)).applyfunc(sp.expand) == sp.zeros(len(function), 1)
    random = np.random.default_rng(0)
    rows = [
        found.regressor((s,)).xreplace(dict(zip((x, y, s, L), random.normal(size=4), strict=True))) for _ in range(9)
    ]
    assert np.linalg.matrix_rank(np.array(sp.Matrix.vstack(*rows).tolist(), dtype=float)) == count
    assert all(float(theta.xreplace(NUMBERS)) > 0.0 for theta in found.base_parameters)


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ((p1 * L * x + p2 * x,), L * p1 + p2),
        ((p1 * x + p2 * L * x,), p1 + L * p2),
        ((p1 * L**2 * x + p2 * x + p3 * L * x,), L**2 * p1 + p2 + L * p3),
        ((p1 * L * x + p2 * x, p1 * L * y + p2 * y), L * p1 + p2),
        ((p1 * x + p2 * x / L,), L * p1 + p2),
    ],
)
def test_base_parameters_join_without_division_by_a_length_that_may_be_zero(function: tuple, expected: sp.Expr) -> None:
    """The column that is kept is the one in which the others are multiples, not quotients."""
    (theta,) = parametrized(*function).base_parameters
    assert sp.expand(theta - expected) == 0


def test_base_parameters_are_sums_rather_than_differences_where_there_is_a_choice() -> None:
    """Columns x, y and x - y: of the bases only {y, x - y} has no negative coefficient in x."""
    found = parametrized(p1 * x + p2 * y + p3 * (x - y)).base_parameters
    assert set(map(sp.expand, found)) == {p1 + p2, p1 + p3}
