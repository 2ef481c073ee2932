"""The proof that a function is linear in no base parameters, for functions of which it is known."""

from __future__ import annotations

import pytest
import sympy as sp

from derive.algebra.named_terms import Terms
from derive.algebra.separation import MixedValues, NotSeparable, Parameters, Separation
from derive.control.nonlinearity import obstacle

L, p1, p2, x, y = sp.symbols("L p1 p2 x y", real=True)
PARAMETERS = Parameters(frozenset({L}), frozenset({p1, p2}))


@pytest.mark.parametrize(
    ("factor", "function", "is_mixed", "is_full"),
    [
        (1 / (p1 + p2 * sp.cos(x)), [y / (p1 + p2 * sp.cos(x)), y], True, True),
        (1 / (p1 + p2 * sp.cos(x)), [y * sp.sin(x), (p1**2 - p2**2 * sp.cos(x) ** 2) / (p1 + p2 * sp.cos(x))], True,
         False),
        (1 / ((p1 + p2) * sp.cos(x)), [y / ((p1 + p2) * sp.cos(x))], False, False),
        (sp.exp(p1 * x), [sp.exp(p1 * x) * y], True, True),
        (p1 * x + p2 * y, [p1 * x + p2 * y], True, False),
        (L * p1, [L * p1 * x], False, False),
    ],
    ids=["a denominator", "one that cancels", "one that is a product", "a function", "a sum", "a product"],
)  # fmt: skip
def test_only_a_factor_that_mixes_and_does_not_cancel_is_a_proof(
    factor: sp.Expr, function: list, is_mixed: bool, is_full: bool
) -> None:
    """Of a sum of few products the values at twenty states and parameter sets have a small rank."""
    found = obstacle(factor, sp.Matrix(function), PARAMETERS, Terms())
    assert found.factor == factor
    assert found.is_mixed is is_mixed
    assert (found.rank == found.samples) is is_full
    assert found.is_proof is (is_mixed and is_full)
    assert found.samples == 20
    if not is_full:
        assert found.rank in (1, 2)


def test_it_is_the_reason_for_which_a_function_is_not_taken_apart() -> None:
    """What Separation names is mixed."""
    function = y / (p1 + p2 * sp.cos(x))
    with pytest.raises(NotSeparable) as caught:
        Separation((), PARAMETERS, Terms()).products(function)
    assert obstacle(caught.value.factor, sp.Matrix([function]), PARAMETERS, Terms()).is_proof


def test_roots_of_state_and_parameters_together_show_nothing() -> None:
    """They exist at half of all pairs only, so not at twenty times twenty of them."""
    found = obstacle(sp.sqrt(p1 + x), sp.Matrix([sp.sqrt(p1 + x)]), PARAMETERS, Terms())
    assert (found.is_mixed, found.rank, found.is_proof) == (False, 0, False)


def test_a_table_holds_values_at_states_and_parameters() -> None:
    """A row a state, a column a set of parameters; known constants are the same in all of them."""
    table = MixedValues(L * x + p1, PARAMETERS, Terms()).table(3)
    assert len({row[0] - row[1] for row in table}) == 1  # p1 at two sets
    assert len({table[0][k] - table[1][k] for k in range(3)}) == 1  # L x at two states
    known = MixedValues(L, PARAMETERS, Terms()).table(3)
    assert len({value for row in known for value in row}) == 1
    assert len({value for row in table for value in row}) == 9
