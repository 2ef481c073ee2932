"""Expressions mean what they say, at every edge of what is read; what is too large is refused at once."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

import pytest

from wmr_input import Algebra, ExpressionError, evaluate
from wmr_input.expression import (
    DEEPEST_FUNCTION,
    DEEPEST_PARENTHESIS,
    HIGHEST_EXPONENT,
    HIGHEST_POWER,
    LONGEST_NUMBER,
    LONGEST_TEXT,
)

EXACT = Algebra(
    names={"x": Fraction(3), "y": Fraction(5)},
    functions={"double": lambda v: 2 * v, "half": lambda v: v / 2, "atan2": lambda v, w: 10 * v + w},
    number=Fraction,
)


class Power:
    """An algebra of powers of x: its only element is an exponent."""

    def __init__(self, exponent: Fraction) -> None:
        self.exponent = exponent

    def __pow__(self, exponent: Fraction) -> "Power":
        return Power(self.exponent * exponent)


POWERS = Algebra(names={"x": Power(Fraction(1))}, functions={}, number=lambda fraction: fraction)


@contextmanager
def at_once() -> Iterator[None]:
    """Fail instead of hanging."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("takes seconds"))
    signal.alarm(10)
    try:
        yield
    finally:
        signal.alarm(0)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("x + y", 8),
        ("x - y", -2),
        ("x*y", 15),
        ("x/y", Fraction(3, 5)),
        ("-x", -3),
        ("+x", 3),
        ("--x", 3),
        ("x - y - x", -5),
        ("x/y/x", Fraction(1, 5)),
        ("x + y*x", 18),
        ("(x + y)*x", 24),
        ("-x**2", -9),
        ("(-x)**2", 9),
        ("2**3", 8),
        ("x**-2", Fraction(1, 9)),
        ("x**(-2)", Fraction(1, 9)),
        ("x**--2", 9),
        ("x**0", 1),
        ("x**(4/2)", 9),
        ("x**(-4/2)", Fraction(1, 9)),
        ("double(x) - half(y)", Fraction(7, 2)),
        ("atan2(x, y) + atan2(y, double(x))", 91),
        ("1_000 + 0x10", 1016),
        ("2.5e-3*4", Fraction(1, 100)),
        ("1e3", 1000),
        (".5", Fraction(1, 2)),
        ("  x  ", 3),
    ],
)
def test_arithmetic_is_exact_and_binds_as_in_python(text: str, value: Fraction) -> None:
    """Signs, quotients, powers and functions; negative exponents divide."""
    assert evaluate(text, EXACT) == value


@pytest.mark.parametrize(
    ("text", "exponent"),
    [
        ("x**2", 2),
        ("x**0.5", Fraction(1, 2)),
        ("x**(1/2)", Fraction(1, 2)),
        ("x**-0.5", Fraction(-1, 2)),
        ("x**1.5", Fraction(3, 2)),
        ("x**(3/2)", Fraction(3, 2)),
        ("x**(-3/2)", Fraction(-3, 2)),
        ("(x**2)**8", 16),
        ("((x**2)**2)**4", 16),
        ("(x**-2)**8", -16),
        ("x**16", 16),
        ("x**-16", -16),
        ("(x**0.5)**16", 8),
    ],
)
def test_exponents_are_whole_or_half_and_nested_ones_multiply(text: str, exponent: Fraction) -> None:
    """Up to sixteen in all, of either sign."""
    assert evaluate(text, POWERS).exponent == exponent


@pytest.mark.parametrize(
    "text",
    [
        "x**17",
        "x**-17",
        "(x**4)**5",
        "(x**-4)**5",
        "((x**4)**4)**4",
        "((x**2)**3)**3",
        "x**0.3",
        "x**0.25",
        "x**0.1",
        "x**(1/0)",
        "x**x",
        "x**(1 + 1)",
        "x**sin",
        "x**(2*3)",
        "x**'a'",
        "(x**4)**-5",
        "x**16.5",
        "x**2**1",
        "2**17",
        "(x + (x*x**4)**4)**2",
    ],
)
def test_powers_that_are_too_high_or_odd_are_refused(text: str) -> None:
    """Also where they are spread over several levels, by sums and products."""
    with at_once(), pytest.raises(ExpressionError):
        evaluate(text, EXACT)


def test_thirds_are_no_literal_but_a_quotient_may_be_one() -> None:
    """0.3 and 1/3 as numbers are fine; only literal exponents are whole or half."""
    assert evaluate("1/3", EXACT) == Fraction(1, 3)
    assert evaluate("0.3", EXACT) == Fraction(3, 10)
    with pytest.raises(ExpressionError, match="exponents are small whole or half numbers"):
        evaluate("x**0.3", EXACT)


@pytest.mark.parametrize(
    "text", ["1e-99999999", "1e99999999", "1E-99999999", "x + 1e-999999999", "2.5e+99999999", "x**1e-99999999"]
)
def test_huge_exponents_of_either_sign_cost_nothing(text: str) -> None:
    """Neither a hang nor gigabytes."""
    with at_once(), pytest.raises(ExpressionError):
        evaluate(text, EXACT)


@pytest.mark.parametrize("sign", ["", "+", "-"])
def test_decimal_exponents_end_at_thirty(sign: str) -> None:
    """The last that is read, and the first that is not; a hexadecimal e is a digit."""
    assert evaluate(f"1e{sign}{HIGHEST_EXPONENT}", EXACT) == Fraction(10) ** int(f"{sign}{HIGHEST_EXPONENT}")
    with pytest.raises(ExpressionError, match="out of range"):
        evaluate(f"1e{sign}{HIGHEST_EXPONENT + 1}", EXACT)
    assert evaluate("0x1e99", EXACT) == 0x1E99


def test_numbers_end_at_forty_characters() -> None:
    """The last length that is read, and the first that is not."""
    assert evaluate("9" * LONGEST_NUMBER, EXACT) == int("9" * LONGEST_NUMBER)
    with pytest.raises(ExpressionError, match="out of range"):
        evaluate("9" * (LONGEST_NUMBER + 1), EXACT)


def test_functions_stand_side_by_side_as_often_as_wanted() -> None:
    """Only functions in functions are counted, three deep; also after one that was deep."""
    assert evaluate(" + ".join(["double(x)"] * 10), EXACT) == 60
    assert evaluate("double(double(double(x))) + double(double(half(x)))", EXACT) == 30
    assert evaluate("double(double(x) + double(double(y)))", EXACT) == 52
    deep = "double(" * (DEEPEST_FUNCTION + 1) + "x" + ")" * (DEEPEST_FUNCTION + 1)
    for text in (deep, f"half(x) + {deep}", f"double(double(x) + {deep[7:-1]})"):
        with pytest.raises(ExpressionError, match="more than 3 deep"):
            evaluate(text, EXACT)


def test_texts_end_at_their_longest_length() -> None:
    """2000 characters, or what the caller allows for generated formulas."""
    longest = "x" + "+x" * ((LONGEST_TEXT - 1) // 2)
    exactly = longest + " " * (LONGEST_TEXT - len(longest))
    assert len(exactly) == LONGEST_TEXT
    with pytest.raises(ExpressionError, match=r"is not an expression|expression of"):
        evaluate(exactly + " ", EXACT)
    short = "x" + " " * (LONGEST_TEXT - 1)
    assert evaluate(short, EXACT) == 3
    with pytest.raises(
        ExpressionError, match=f"expression of {LONGEST_TEXT + 1} characters; use at most {LONGEST_TEXT}"
    ):
        evaluate(short + " ", EXACT)
    assert evaluate(short + " " * 5000, EXACT, longest=LONGEST_TEXT + 5000) == 3
    with pytest.raises(ExpressionError, match="use at most 10"):
        evaluate("x + y + 1.5", EXACT, longest=10)


def test_parentheses_end_at_forty() -> None:
    """Of every kind, the deepest level that is read and the first that is not; side by side they do not count."""
    at = DEEPEST_PARENTHESIS
    assert evaluate("(" * at + "x" + ")" * at, EXACT) == 3
    assert evaluate("+".join(["(x)"] * (at + 5)), EXACT) == 3 * (at + 5)
    for opened, closed in ("()", "[]", "{}"):
        with pytest.raises(ExpressionError, match=f"parentheses {at + 1} deep; use at most {at}"):
            evaluate(opened * (at + 1) + "x" + closed * (at + 1), EXACT)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x^2", r"'\^' in 'x\^2'; write powers with \*\*"),
        ("double(x, y)", r"function 'double' takes one argument; write double\(...\)"),
        ("double()", "takes one argument"),
        ("atan2(x)", r"function 'atan2' takes two arguments; write atan2\(y, x\)"),
        ("atan2(x, y, x)", "takes two arguments"),
        ("atan2(x, x=y)", "takes two arguments"),
        ("double(x=x)", "takes one argument"),
        ("double", r"function 'double' without an argument; write double\(...\)"),
        ("triple(x)", "unknown function 'triple'"),
        ("dubble(x)", "did you mean 'double'"),
        ("dubble(x, x)", "did you mean 'double'"),
        ("z", "unknown name 'z'"),
        ("True", "'True' is not a number"),
        ("1j", "'1j' is not a number"),
        ("'a'", "is not a number"),
        ("x < y", "'x < y' is not arithmetic; only numbers, declared names, .* and atan2, double, half are read"),
        ("1/0", "division by zero in '1/0'; remove it"),
        ("x +", "is not an expression"),
        ("x % y", "is not arithmetic"),
        ("not x", "is not arithmetic"),
        ("~x", "is not arithmetic"),
    ],
)
def test_what_is_refused_says_why(text: str, words: str) -> None:
    """Problem and remedy, and the text where it stands."""
    with pytest.raises(ExpressionError, match=words):
        evaluate(text, EXACT)


def test_long_texts_are_shown_shortened() -> None:
    """Sixty characters at most."""
    for text in ("x" * 60, "x" * 61):
        with pytest.raises(ExpressionError) as caught:
            evaluate(f"{text} $", EXACT)
        assert repr(f"{text} $"[:57] + "...") in str(caught.value)
    with pytest.raises(ExpressionError) as caught:
        evaluate("x" * 58 + " $", EXACT)
    assert repr("x" * 58 + " $") in str(caught.value)


def test_the_highest_power_is_a_product() -> None:
    """Any split of sixteen over levels is read, and any of more is not."""
    for first in range(1, HIGHEST_POWER + 1):
        for second in range(1, HIGHEST_POWER + 1):
            text = f"(x**{first})**{second}"
            if first * second <= HIGHEST_POWER:
                assert evaluate(text, POWERS).exponent == first * second
            else:
                with pytest.raises(ExpressionError):
                    evaluate(text, POWERS)
