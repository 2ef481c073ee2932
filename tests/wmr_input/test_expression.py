"""Expressions are arithmetic over declared names; anything else is refused before it is built."""

import ast
import contextlib
from fractions import Fraction
from math import atan2, isclose, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wmr_input import LONGEST_FORMULA, Algebra, ExpressionError, evaluate
from wmr_input.expression import DEEPEST_FUNCTION, HIGHEST_POWER

EXACT = Algebra(names={"x": Fraction(3), "I": Fraction(7), "E": Fraction(11)}, functions={}, number=Fraction)
FLOAT = Algebra(names={"x": 0.5}, functions={"sin": sin}, number=float)

ATTACKS = [
    "__import__('os').system('true')",
    "x.__class__",
    "().__class__.__bases__[0].__subclasses__()",
    "(lambda: x)()",
    "[x for x in (1,)]",
    "x if x else x",
    "x and x",
    "x < x",
    "x := 3",
    "f'{x}'",
    "'text'",
    "b'x'",
    "x[0]",
    "{x}",
    "*x",
    "sin(x, x)",
    "sin(x=x)",
    "sin",
    "True",
    "None",
    "...",
    "1j",
    "x; x",
    "x = 3",
    "9**9**9**9",
    "x**65",
    "((x**8)**8)**8",
    "x**x",
    "x**0.3",
    "x^2",
    "x @ x",
    "x // x",
    "x % x",
    "~x",
    "not x",
    "1e999999999",
    "9" * 50,
    "(" * 250 + "x" + ")" * 250,
    "-" * 1500 + "x",
    "x+" * 900 + "x" + "+x" * 200,
    "\0",
    "x\0",
    "",
    " ",
    "x +",
    "import os",
    "eval('x')",
    "x.real",
    "\u0445",  # a Cyrillic letter that looks like x
]


@pytest.mark.parametrize("text", ATTACKS)
def test_what_is_not_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate(text, FLOAT)
    assert "\n" not in str(caught.value)


def test_decimals_are_exact() -> None:
    assert evaluate("0.1 + 1e-3*2", EXACT) == Fraction(1, 10) + Fraction(2, 1000)


def test_sympys_names_are_plain_names() -> None:
    assert evaluate("I + E", EXACT) == 18


def test_a_misspelt_name_gets_the_nearest_one() -> None:
    algebra = Algebra(names={"phi": 1.0, "psi_left": 2.0}, functions={}, number=float)
    with pytest.raises(ExpressionError, match="unknown name 'phii'; did you mean 'phi'"):
        evaluate("2*phii", algebra)


def test_division_by_zero_is_a_mistake() -> None:
    with pytest.raises(ExpressionError, match="division by zero"):
        evaluate("1/(x - 3)", EXACT)


def nested(node: ast.expr) -> tuple[int, int]:
    """The highest power and the deepest function in such a text."""
    inside = [nested(child) for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
    power, depth = (max((one[i] for one in inside), default=1 - i) for i in range(2))
    square = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)
    return power * (2 if square else 1), depth + isinstance(node, ast.Call)


@given(
    st.recursive(
        st.sampled_from(["x", "2", "0.25", "3e-1"]),
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from(["+", "-", "*"]), inner).map("({0[0]} {0[1]} {0[2]})".format),
            inner.map("-({})".format),
            inner.map("sin({})".format),
            inner.map("({})**2".format),
        ),
        max_leaves=12,
    )
)
def test_arithmetic_means_what_python_means(text: str) -> None:
    power, depth = nested(ast.parse(text, mode="eval").body)
    if power > HIGHEST_POWER or depth > DEEPEST_FUNCTION:
        with pytest.raises(ExpressionError):
            evaluate(text, FLOAT)
        return
    value = evaluate(text, FLOAT)
    expected = eval(text, {"x": 0.5, "sin": sin})  # noqa: S307 - the text is made here
    assert isclose(value, expected, rel_tol=1e-12, abs_tol=1e-12) or value == expected


@given(st.text(max_size=60))
def test_no_text_ever_gives_anything_but_a_value_or_an_expression_error(text: str) -> None:
    with contextlib.suppress(ExpressionError):
        evaluate(text, EXACT)


def test_functions_of_functions_are_read_three_deep_and_no_deeper() -> None:
    """Derivatives of more explode, and no robot needs them."""
    assert evaluate("sin(sin(sin(x)))", FLOAT) is not None
    with pytest.raises(ExpressionError, match="more than 3 deep"):
        evaluate("sin(sin(sin(sin(x))))", FLOAT)


def test_parentheses_have_a_deepest_level() -> None:
    with pytest.raises(ExpressionError, match="parentheses 41 deep"):
        evaluate("(" * 41 + "x" + ")" * 41, FLOAT)


TWO = Algebra(names={"x": 3.0}, functions={"sin": sin, "atan2": atan2}, number=float)


def test_a_function_of_two_arguments_takes_two() -> None:
    assert evaluate("atan2(x, 4)", TWO) == atan2(3.0, 4.0)
    for text in ("atan2(x)", "atan2(x, 4, 5)", "atan2(x, x=4)", "atan2()"):
        with pytest.raises(ExpressionError, match=r"'atan2' takes two arguments; write atan2\(y, x\)"):
            evaluate(text, TWO)
    with pytest.raises(ExpressionError, match="'sin' takes one argument"):
        evaluate("sin(x, 4)", TWO)


def test_generated_formulas_may_be_a_little_deeper() -> None:
    """An angle that is an arctangent stands under one more sine."""
    assert evaluate("sin(sin(sin(sin(x))))", FLOAT, LONGEST_FORMULA) is not None
    for depth, is_read in ((8, True), (9, False)):
        text = "sin(" * depth + "x" + ")" * depth
        with contextlib.nullcontext() if is_read else pytest.raises(ExpressionError, match="more than 8 deep"):
            evaluate(text, FLOAT, LONGEST_FORMULA)
