"""What is printed is what was meant: each text is evaluated and compared with SymPy."""

from __future__ import annotations

import math

import pytest
import sympy as sp

from derive.algebra.named_terms import Terms
from derive.codegen.python_code import FUNCTIONS, PythonCode
from derive.codegen.statements import statements

x, y, z = sp.symbols("x y z", real=True)
NUMBERS = {x: 0.61, y: 0.37, z: 1.9}
CALLS = {name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)}
CALLS["sign"] = lambda value: math.copysign(1.0, value)
half = sp.S.Half

EXPRESSIONS = [
    y / x ** (3 * half),
    y / (x + z) ** (5 * half),
    z * (x + y) ** (-3 * half) * y,
    1 / (y * x ** (7 * half)),
    (x * y) ** (-5 * half) / z,
    y / x**3,
    y / sp.Abs(x) ** 3,
    y / sp.sqrt(x),
    sp.atan2(y, x) / sp.atan(z) ** 3,
    sp.asin(x) * sp.acos(y) - sp.tanh(x - y) ** 2,
    sp.sign(x - z) * sp.Abs(x - z),
    -sp.Rational(3, 10**20 + 1) * x + sp.Rational(10**30 + 1, 7),
]


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_printed_arithmetic_has_the_value_of_the_expression(expression: sp.Expr) -> None:
    text = PythonCode({}).doprint(expression)
    value = eval(text, CALLS | {symbol.name: number for symbol, number in NUMBERS.items()})  # noqa: S307
    assert value == pytest.approx(float(expression.subs(NUMBERS)), rel=1e-14)


@pytest.mark.parametrize("inner", [sp.Mul, sp.Add])
@pytest.mark.parametrize("outer", [sp.Mul, sp.Add])
def test_what_is_computed_first_stays_so(outer: type, inner: type) -> None:
    """In brackets, a product in a product, too: another order would round otherwise."""
    text = PythonCode({}).doprint(outer(x, inner(y, z, evaluate=False), evaluate=False))
    assert ("(" in text) == (outer is sp.Mul or inner is sp.Add)


@pytest.mark.parametrize("base", [x, x + y, x * y, sp.sin(x)], ids=str)
@pytest.mark.parametrize("power", [*range(-10, -1), *range(2, 11)])
def test_powers_from_the_third_to_the_eighth_are_products(power: int, base: sp.Expr) -> None:
    """Which take less time than a general power."""
    expression = base**power
    text = PythonCode({}).doprint(expression)
    value = eval(text, CALLS | {symbol.name: number for symbol, number in NUMBERS.items()})  # noqa: S307
    assert value == pytest.approx(float(expression.subs(NUMBERS)), rel=1e-14)
    assert ("**" in text) == (not 3 <= abs(power) <= 8)


@pytest.mark.parametrize(
    "matrix",
    [
        sp.Matrix([[-sp.sin(x + y), 1], [-sp.sin(x + y), 2]]),
        sp.Matrix([[-sp.sin(x), -sp.sin(x)], [sp.cos(y) * z, -sp.cos(y) * z]]),
        sp.Matrix([[-sp.sqrt(x) * y, -sp.sin(x + y) * z], [-sp.sin(x + y) * z, -sp.sqrt(x)]]),
    ],
    ids=["one call, twice its negative", "two equal negatives", "negatives in products"],
)
def test_a_call_that_stands_for_minus_itself_keeps_its_sign(matrix: sp.Matrix) -> None:
    """Both wheels of a crab have -sin(phi + beta) in their row of A."""
    steps = statements(matrix, Terms(), ())
    code = PythonCode(steps.names, steps.inlined, steps.negated)
    values = dict(CALLS) | {symbol.name: number for symbol, number in NUMBERS.items()}
    for symbol, expression in steps.assignments:
        values[steps.names[symbol]] = eval(code.doprint(expression), values)  # noqa: S307
    for place, entry in steps.entries.items():
        value = eval(code.doprint(entry), values)  # noqa: S307
        assert value == pytest.approx(float(matrix[place].subs(NUMBERS)), rel=1e-14)
