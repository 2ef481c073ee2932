"""Text that is written: it means what it was made of, and it is as wide as its lines may be."""

from __future__ import annotations

import ast
import json
import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
import sympy as sp

from derive.algebra.evaluation import NotFinite
from derive.algebra.named_terms import Terms
from derive.codegen import trusted_values
from derive.codegen.json_text import json_text
from derive.codegen.python_code import WIDTH, PythonCode, assigned, unpacked
from derive.codegen.rendering import _docstring, _filled, _literal, _wrapped
from derive.codegen.statements import Statements, _Names, statements
from derive.codegen.trusted_values import _fraction, _lost

LETTERS = "".join(chr(ord("a") + k % 26) for k in range(300))
INDENT = " " * 4


@pytest.mark.parametrize("length", [0, 1, *range(100, 112), 113, 220, 299])
@pytest.mark.parametrize("key", ["", '"name"'])
def test_a_text_that_fits_stands_on_one_line(length: int, key: str) -> None:
    """With its key, a colon, a space and a comma in 120 columns; else in parts that are the text again."""
    value = LETTERS[:length]
    text = _wrapped(value, INDENT, key)
    assert ast.literal_eval(text.strip()) == value
    assert ("\n" in text) == (len(f"{INDENT}{key}: {_literal(value)},") > 120)
    assert all(len(line) <= 120 for line in text.splitlines())
    if "\n" in text:
        first, *parts, last = text.splitlines()
        assert (first, last) == ("(", f"{INDENT})")
        assert all(part.startswith(INDENT * 2) for part in parts)


@pytest.mark.parametrize("value", [3, 1.5, True, ["a"] * 60, {"a": LETTERS}])
def test_what_is_no_text_is_not_broken(value: object) -> None:
    assert _wrapped(value, "") == _literal(value)


@pytest.mark.parametrize("text", ["plain", 'a "b" c', 'a """ b', "back \\ slash", 'both """ \\n "'])
def test_a_text_stands_in_a_docstring(text: str) -> None:
    """As it is where it can."""
    inside = _docstring(text)
    assert ast.literal_eval(f'"""{inside} """') == f"{text} "
    assert (inside == text) == ('"""' not in text and "\\" not in text)


def test_running_text_is_filled() -> None:
    """Words stay whole, hyphens do not break."""
    words = ["a-b", LETTERS[:150], *(LETTERS[:k] for k in range(1, 60))]
    lines = _filled(" ".join(words)).splitlines()
    assert " ".join(lines).split() == words
    assert all(len(line) <= 120 or " " not in line for line in lines)
    assert all(len(line) + 1 + len(later.split()[0]) > 120 for line, later in pairwise(lines))


@pytest.mark.parametrize("count", [1, 4, 30])
def test_json_is_read_back_and_what_fits_stands_on_a_line(count: int) -> None:
    """Lists and tables are broken when they would reach the 120th column."""
    content = {"a": 1, "list": [LETTERS[:7]] * count, "table": {f"k{k}": {"x": [k, None, True]} for k in range(count)}}
    text = json_text(content)
    assert json.loads(text) == content
    assert json_text({"ω": "Grün"}) == '{\n  "ω": "Grün"\n}\n'
    assert text.endswith("}\n")
    assert all(len(line.rstrip(",")) < 120 for line in text.splitlines())
    for length in range(90, 120):
        value = ["x" * length]
        (line, *more) = json_text({"key": value}).splitlines()[1:-1]
        assert bool(more) == (len(f'  "key": {json.dumps(value)}') >= 120)
        assert line.startswith('  "key": [')


a, b, c, d = sp.symbols("a b c d", real=True)
NUMBERS = {"a": 0.31, "b": 0.57, "c": 1.3, "d": -0.7}
AT = dict(zip((a, b, c, d), NUMBERS.values(), strict=True))
SUM = sp.Add(*((k + 2) * sp.sin(a + k) * sp.cos(b - k) for k in range(12)))
LONG = {
    "a sum": SUM,
    "a product of sums": (SUM + 1) * (SUM - c),
    "a product": sp.Mul(*(sp.cos(a + sp.Symbol(f"long_name_{k}")) for k in range(9)), evaluate=False),
    "a function of a sum": sp.exp(-(SUM**2)),
    "a short one": a + b,
}


@pytest.mark.parametrize("name", LONG)
@pytest.mark.parametrize("targets", [["x"], ["first", "second_name"]])
def test_a_value_is_assigned_in_lines_of_the_usual_width(name: str, targets: list[str]) -> None:
    """It is the same value; nothing is broken that fits, and no line is wider."""
    expression = LONG[name]
    text = PythonCode({}).doprint(expression)
    lines = assigned(targets, text)
    whole = " = ".join([*targets, text])
    assert (len(lines) == 1) == (len(whole) <= WIDTH)
    assert all(len(line) <= WIDTH for line in lines)
    values = {f: getattr(math, f) for f in ("sin", "cos", "exp")} | NUMBERS | {f"long_name_{k}": 0.1 for k in range(9)}
    exec("\n".join(lines), values)  # noqa: S102
    expected = eval(text, values)  # noqa: S307
    assert [values[target] for target in targets] == [expected] * len(targets)
    if len(lines) > 1:
        assert (lines[0], lines[-1]) == (" = ".join([*targets, "("]), ")")
        assert all(line.startswith(INDENT) for line in lines[1:-1])
    if name == "a sum":
        assert all(line.startswith((f"{INDENT}+ ", f"{INDENT}- ")) for line in lines[2:-1])


@pytest.mark.parametrize("count", [1, 8, 12, 40])
@pytest.mark.parametrize("width", [1, 12])
def test_values_are_unpacked_in_lines_of_the_usual_width(count: int, width: int) -> None:
    names = [f"{'n' * width}{k}" for k in range(count)]
    lines = unpacked(names, [f"p[{k}]" for k in range(count)])
    assert all(len(line) <= WIDTH for line in lines)
    values: dict[str, object] = {"p": list(range(count))}
    exec("\n".join(lines), values)  # noqa: S102
    assert [values[name] for name in names] == list(range(count))
    assert (len(lines) == 1) == (len(f"{', '.join(names)} = {', '.join(f'p[{k}]' for k in range(count))}") <= WIDTH)


def computed(steps: Statements) -> dict[tuple[int, int], float]:
    """The entries, step by step as printed."""
    code = PythonCode(steps.names, steps.inlined, steps.negated)
    values = {f: getattr(math, f) for f in ("sin", "cos", "exp", "sqrt", "tan")} | NUMBERS
    for symbol, expression in steps.assignments:
        assert steps.names[symbol] not in values  # each is assigned once
        values[steps.names[symbol]] = eval(code.doprint(expression), values)  # noqa: S307
    return {place: eval(code.doprint(entry), values) for place, entry in steps.entries.items()}  # noqa: S307


def named(terms: Terms) -> sp.Matrix:
    """A matrix of named terms."""
    one = terms.name("one", sp.sin(a) * b + c)
    two = terms.name("two", one**2 + sp.cos(a + b))
    three = terms.name("three", -(sp.sin(a) * b + c) * d)
    return sp.Matrix([[one, two], [-two, three * one], [two * three, sp.cos(a + b)]])


MATRICES = {
    "nothing in common": sp.Matrix([[a, b * c], [0, 1]]),
    "a sum twice": sp.Matrix([[(a + b) * c, (a + b) * d], [a + b, 0]]),
    "a negative": sp.Matrix([[a * b + c, -a * b - c], [sp.sin(a * b + c), d * (-a * b - c)]]),
    "squares": sp.Matrix([[c**2 * a, c**2 / b], [1 / c**2, 1 / (b * c)]]),
    "calls": sp.Matrix([[sp.sin(a) * sp.cos(b), sp.sin(a) ** 2], [sp.sin(2 * a), sp.exp(-a) / sp.exp(b)]]),
    "calls of calls": sp.Matrix([[sp.sin(sp.cos(a) + b), sp.sqrt(sp.cos(a) + c)], [sp.tan(a / 2), -sp.cos(a)]]),
    "roots of negatives": sp.Matrix([[sp.sqrt(a - d), -sp.sqrt(a - d) * b], [(a - d) ** 2, d - a]]),
}


@pytest.mark.parametrize("name", MATRICES)
def test_statements_compute_the_matrix(name: str) -> None:
    """Each entry that is not zero, from the arguments alone, with no more operations than entry by entry."""
    matrix = MATRICES[name]
    steps = statements(matrix, Terms(), ("reserved",))
    found = computed(steps)
    assert found.keys() == {(i, j) for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0}
    for place, value in found.items():
        assert value == pytest.approx(float(matrix[place].subs(AT)), rel=1e-13)
    assert steps.inputs <= matrix.free_symbols
    assert steps.operations <= sum(sp.count_ops(entry) for entry in set(matrix))


def test_named_terms_keep_their_names() -> None:
    """What is reserved is no name; every name of a statement is assigned once, before it is used."""
    terms = Terms()
    matrix = named(terms)
    steps = statements(matrix, terms, ("sin_a", "term_1"))
    for place, value in computed(steps).items():
        assert value == pytest.approx(float(terms.expand(matrix[place]).subs(AT)), rel=1e-13)
    assert {"one", "two"} <= set(steps.names.values())
    assert {"sin_a", "term_1"}.isdisjoint(steps.names.values())
    assert steps.inputs == {a, b, c, d}


@pytest.mark.parametrize("sign", [1, -1])
def test_a_product_and_its_negative_are_computed_once(sign: int) -> None:
    """Under the name of the one that has a name; its sign stands where it is printed."""
    terms = Terms()
    product = a * b * sp.sin(c) * d
    one = terms.name("one", sign * product)
    matrix = sp.Matrix([[one, product + a], [one * c, sp.exp(c) - product], [-one, 2 - product]])
    steps = statements(matrix, terms, ())
    assert [steps.names[symbol] for symbol, _ in steps.assignments if "term" in steps.names[symbol]] == []
    for place, value in computed(steps).items():
        assert value == pytest.approx(float(terms.expand(matrix[place]).subs(AT)), rel=1e-13)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("is_shared", [False, True])
def test_entries_that_are_printed_alike_are_computed_once(sign: int, is_shared: bool) -> None:
    """A call that stands in both needs no line of its own, though one of them has it as a name, or as minus a name."""
    terms = Terms()
    value = a * b * d * sp.exp(d) if is_shared else sp.sin(a + b)
    name = terms.name("name", sign * value)
    more = [sp.exp(value)] if is_shared else []
    steps = statements(sp.Matrix([[name + sp.cos(c), sp.cos(c) + sign * value, *more]]), terms, ())
    assert sum(expression.has(sp.cos) for _, expression in steps.assignments) == 0
    assert len(steps.assignments) == len(more)
    number = float(value.subs(AT))
    expected = [math.cos(1.3) + sign * number] * 2 + [math.exp(number)] * len(more)
    assert list(computed(steps).values()) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("power", [2, 3, 5, -1, -3])
@pytest.mark.parametrize("value", [a * b + c, a * b * c * sp.sin(d)], ids=["sum", "product"])
@pytest.mark.parametrize("is_raised_inside", [False, True])
def test_a_power_of_a_negative_keeps_its_sign(power: int, value: sp.Expr, is_raised_inside: bool) -> None:
    """Whether the one or its negative has the name, and which of them is raised."""
    terms = Terms()
    one, two = terms.name("one", -value), terms.name("two", value)
    raised = (two + 1) ** power + one if is_raised_inside else one**power + d
    matrix = sp.Matrix([[raised, two + d, sp.cos(two), one * d, value + 2]])
    expected = [float(terms.expand(entry).subs(AT)) for entry in matrix]
    assert list(computed(statements(matrix, terms, ())).values()) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("product", "name"),
    [
        (a * b, "a_times_b"),
        (a / b, "a_over_b"),
        (a**2 * b, "a_squared_times_b"),
        (a / b**2, "a_over_b_squared"),
        (1 / a**2, "a_squared_inverse"),
        (a * b / c, None),
        (a / (b * c), None),
        (1 / (a * b), None),
        (a * b * c, None),
        (a * b**4, None),
        (2 * a * b, None),
        (a * sp.Symbol(24 * "n", real=True), None),
        (a * sp.Symbol(22 * "n", real=True), f"a_times_{22 * 'n'}"),
    ],
    ids=str,
)
def test_a_simple_product_says_what_it_is_and_others_are_numbered(product: sp.Expr, name: str | None) -> None:
    """Of two factors at most, in a short name; from one on, in the order of the lines."""
    steps = statements(sp.Matrix([[product + d, (product + b) ** 2, (a - c) ** 5 + d, (a - c) * d]]), Terms(), ())
    names = [steps.names[symbol] for symbol, _ in steps.assignments]
    numbered = [one for one in names if one.startswith("term_")]
    assert numbered == [f"term_{k}" for k in range(1, len(numbered) + 1)]
    if name is None:
        assert "term_1" in names
        assert not [one for one in names if "_times_" in one or "_over_" in one]
    else:
        assert name in names


@pytest.mark.parametrize("length", [10, 23, 24, 25, 59, 60, 61, 120])
def test_what_is_short_and_used_once_has_no_name(length: int) -> None:
    """A sum that is returned, of less than 60 letters, and a call in it, of less than 24."""
    terms, long = Terms(), [sp.Symbol(count * "n") for count in (length - 8, length - 5)]
    alone, call = terms.name("alone", a + b + long[0]), sp.sin(long[1])
    assert len(str(terms.definitions[alone])) == len(str(call)) == length
    returned, summed, twice = (
        statements(sp.Matrix([row]), terms, ()) for row in ([alone], [call + c], [alone, -alone])
    )
    assert (returned.assignments == []) == (length < 60)
    assert (summed.assignments == []) == (length < 24)
    assert twice.assignments != []


@pytest.mark.parametrize("power", [1, 2, 3, 8, 9, -1, -2, -3, sp.S.Half, 3 * sp.S.Half], ids=str)
def test_a_call_is_computed_once_however_often_its_power_repeats_it(power: sp.Expr) -> None:
    steps = statements(sp.Matrix([[sp.sin(a) ** power + c]]), Terms(), ())
    code = PythonCode(steps.names, steps.inlined, steps.negated)
    text = [code.doprint(one) for one in (*(expression for _, expression in steps.assignments), steps.entries[0, 0])]
    assert sum(line.count("sin(") for line in text) == 1


def test_numbered_terms_are_added_in_the_order_of_their_lines() -> None:
    """As long as their numbers have one digit each."""
    powers = [(a + k) ** 4 for k in range(1, 10)]
    steps = statements(sp.Matrix([[*(power * d for power in powers), sum(powers)]]), Terms(), ())
    names = [f"term_{k}" for k in range(1, 10)]
    assert [steps.names[symbol] for symbol, _ in steps.assignments] == names
    assert PythonCode(steps.names, steps.inlined, steps.negated).doprint(steps.entries[0, 9]) == " + ".join(names)


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (sp.sin(a), "sin_a"),
        (sp.cos(a + b), "cos_a_b"),
        (sp.cos(a - b), "cos_a_minus_b"),
        (sp.exp(-a / 2 + c * d), "exp_minus_1_2_a_c_d"),
        (sp.exp(3 * a), "exp_3_a"),
        (sp.sin(a + sp.pi / 3), "sin_a_1_3_pi"),
        (sp.cos(sp.Add(*(sp.Symbol(f"a_long_name_{k}") for k in range(5)))), "cos_1"),
    ],
    ids=str,
)
def test_a_function_call_is_named_as_it_is_read(function: sp.Expr, expected: str) -> None:
    """But for a name that is taken, which gets a stroke, and one that is too long."""
    parts = {frozenset(expected.split("_"))}
    found = _Names([]).of_function(function).name
    assert {frozenset(found.split("_"))} == parts
    assert found.isidentifier()
    assert _Names([found]).of_function(function).name == f"{found}_"
    assert _Names([found, f"{found}_"]).of_function(function).name == f"{found}__"


@pytest.mark.parametrize(
    ("expression", "expected"),
    [(a**2, "a_squared"), (a**3, "a_cubed"), (1 / a, "a_inverse"), (a**4, "term_7"), (a * b, "term_7")],
    ids=str,
)
def test_a_power_of_a_symbol_is_named_and_other_terms_are_numbered(expression: sp.Expr, expected: str) -> None:
    assert _Names([]).of_term(expression, 7).name == expected
    assert _Names(["lambda", expected]).of_term(expression, 7).name == f"{expected}_"
    assert _Names([]).fresh("lambda").name == "lambda_"


def test_no_two_names_are_the_same() -> None:
    """Also those of calls that are too long for a name of their own."""
    names = _Names(["a"])
    assert [names.fresh("a").name for _ in range(3)] == ["a_", "a__", "a___"]
    long = [sp.cos(sp.Add(*(sp.Symbol(f"a_long_name_{k}") for k in range(n)))) for n in (5, 6, 7)]
    assert [names.of_function(call).name for call in long] == ["cos_1", "cos_1_", "cos_1__"]
    assert [names.of_term(b**2, 1).name for _ in range(2)] == ["b_squared", "b_squared_"]


@pytest.mark.parametrize(
    ("expected", "found", "lost"),
    [
        ([1.0, 2.0], [1.0, 2.0], 0.0),
        ([1.0, 2.0], [1.0, 2.5], 0.25),
        ([1.0, -2.0], [1.5, -2.0], 0.5),
        ([[1.0, 4.0], [2.0, 2.0]], [[1.0, 4.0], [2.0, 1.0]], 0.5),
        ([1e6, 1e-12], [1e6, 2e-12], 0.0),
        ([], [], 0.0),
    ],
)
def test_what_rounding_costs_is_told_of_the_worst_entry(expected: list, found: list, lost: float) -> None:
    """Relative to that entry, but for a rounding of the largest one."""
    with mpmath.workprec(53):
        assert float(_lost({"f": expected}, {"f": found})) == pytest.approx(lost, abs=1e-14)
        assert float(_lost({"g": [1.0], "f": expected}, {"g": [1.0], "f": found})) == pytest.approx(lost, abs=1e-14)


@pytest.mark.parametrize(
    ("losses", "chosen", "count"),
    [
        ([1e-14, 0.0], 0, 1),
        ([0.5, 0.1, 1e-14, 0.0], 2, 3),
        ([0.5, None, 0.1, 0.1, *[0.2] * 36], 2, 40),
        ([None, 2e-13, 0.0], 1, 2),
        ([*[None] * 39, 0.9], 39, 40),
    ],
)
def test_the_first_arguments_are_taken_at_which_doubles_agree(
    losses: list[float | None], chosen: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the best of forty; where a function has no value they are passed over."""
    tried: list[int] = []

    def at(derivation: None, functions: list, attempt: int) -> dict:
        lost = losses[attempt]
        is_double = mpmath.mp.prec == 53
        if not is_double:
            tried.append(attempt)
        if lost is None:
            raise NotFinite(a)
        return {"attempt": attempt, "values": {"f": [1.0 + (lost if is_double else 0.0)]}}

    monkeypatch.setattr(trusted_values, "_at", at)
    assert trusted_values.trusted_values(None, [])["attempt"] == chosen  # type: ignore[arg-type]
    assert tried == list(range(count))


def test_arguments_are_well_spread() -> None:
    """In [0, 1), different for neighbours, for vectors and for attempts."""
    numbers = np.array([[[float(_fraction(p, i, k)) for k in range(8)] for i in range(20)] for p in range(10)])
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    for axis in range(3):
        steps = np.abs(np.diff(numbers, axis=axis))
        assert np.minimum(steps, 1.0 - steps).min() > 0.1
    assert all(len(set(vector[:, 0])) == 20 for vector in numbers)
