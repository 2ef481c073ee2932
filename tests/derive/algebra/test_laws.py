"""Exact algebra against SymPy's own, on expressions that are made for it."""

from fractions import Fraction

import pytest
import sympy as sp

from derive.algebra.attempts import Attempts, reason, shown
from derive.algebra.dual_numbers import Dual, base
from derive.algebra.finite_field import PRIME, NotRepresentable, Point, vanishes
from derive.algebra.formula_text import formula, readable
from derive.algebra.linear_dependence import dependence, fraction_of
from derive.algebra.linear_solve import adjugate_over_determinant, solve_positive_definite
from derive.algebra.named_terms import Terms, is_simple, sorted_symbols
from derive.algebra.separation import NotSeparable, Parameters, Separation
from derive.algebra.trigonometry import factored, normal_form, shortest, without_sums_of_angles
from wmr_input import WmrError

a, b, c, d, L, p1, p2, x, y, s, s2 = sp.symbols("a b c d L p1 p2 x y s s2", real=True)

EQUAL = [
    sp.sin(a) ** 2 + sp.cos(a) ** 2,
    sp.sin(a) * sp.cos(b) - sp.cos(a) * sp.sin(b),
    sp.cos(a) * sp.cos(b) - sp.sin(a) * sp.sin(b),
    sp.sin(a + b) * c + sp.cos(a - b),
    sp.sin(a) ** 3 + sp.cos(a) ** 4,
    sp.tan(a) * sp.cos(a) + sp.sin(a),
    (sp.cos(a) ** 2 + sp.cos(a) * sp.sin(a)) / sp.cos(a),
    sp.sin(2 * a) - 2 * sp.sin(a) * sp.cos(a) * (1 + d),
    sp.sin(a) ** 2 / sp.cos(a) + sp.cos(a),
    c * sp.sin(a) ** 2 + c * sp.cos(a) ** 2 + d,
    a + b * c,
    sp.sin(9 * a) + 1,
]


def at(expression: sp.Expr, seed: int = 0) -> float:
    numbers = {q: 0.3 + 0.17 * k + 0.05 * seed for k, q in enumerate((a, b, c, d, L, p1, p2, x, y, s, s2))}
    return float(sp.sympify(expression).subs(numbers).evalf())


@pytest.mark.parametrize("expression", EQUAL, ids=str)
@pytest.mark.parametrize("form", [normal_form, shortest, factored, without_sums_of_angles])
def test_another_form_of_an_expression_has_its_values(form, expression: sp.Expr) -> None:
    """And is no longer where the shortest is asked for."""
    found = form(expression)
    for seed in range(3):
        assert at(found, seed) == pytest.approx(at(expression, seed), rel=1e-12, abs=1e-12)
    if form is shortest:
        assert sp.count_ops(found) <= sp.count_ops(expression)


@pytest.mark.parametrize(
    ("expression", "form", "expected"),
    [
        (sp.sin(a) ** 2 + sp.cos(a) ** 2, normal_form, sp.S.One),
        (sp.sin(a) ** 3, normal_form, sp.sin(a) - sp.sin(a) * sp.cos(a) ** 2),
        (sp.sin(a) ** 2 + sp.cos(a) ** 2, shortest, sp.S.One),
        (c * sp.sin(a) ** 2 + c * sp.cos(a) ** 2, shortest, c),
        (sp.sin(a) ** 2 / sp.cos(a) + sp.cos(a), shortest, 1 / sp.cos(a)),
        (sp.sin(a) * sp.cos(b) - sp.cos(a) * sp.sin(b), factored, sp.sin(a - b)),
        (sp.sin(a) ** 2 + sp.cos(a) ** 2 - 1, factored, sp.S.Zero),
        (sp.sin(6 * a), without_sums_of_angles, sp.expand_trig(sp.sin(6 * a))),
        (sp.sin(7 * a), without_sums_of_angles, sp.sin(7 * a)),
        (sp.sin(a + b), without_sums_of_angles, sp.sin(a) * sp.cos(b) + sp.sin(b) * sp.cos(a)),
        (a + b, shortest, a + b),
    ],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_identities_are_found(expression: sp.Expr, form, expected: sp.Expr) -> None:
    """The pythagorean one, sums of angles; multiples up to six are resolved, higher ones stay."""
    assert sp.expand(form(expression) - expected) == 0


X = Dual(Fraction(3), Fraction(1))  # x and its derivative by itself, at 3
FUNCTIONS = {
    "sum": (lambda v: v + 2 + v, lambda v: 2 * v + 2),
    "difference": (lambda v: 5 - v - 1, lambda v: 4 - v),
    "negative": (lambda v: -v, lambda v: -v),
    "product": (lambda v: v * v * 2, lambda v: 2 * v**2),
    "number times": (lambda v: 2 * v, lambda v: 2 * v),
    "quotient": (lambda v: v / (v + 1), lambda v: v / (v + 1)),
    "by a number": (lambda v: v / Fraction(4), lambda v: v / 4),
    "of a number": (lambda v: 4 / v, lambda v: 4 / v),
    "power": (lambda v: v**4, lambda v: v**4),
    "power zero": (lambda v: v**0 + v * 0, lambda v: 1 + 0 * v),
    "reciprocal": (lambda v: v.reciprocal(), lambda v: 1 / v),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_dual_number_carries_the_derivative(name: str) -> None:
    """Value and derivative at 3; nested twice, the second derivative."""
    dual, symbolic = FUNCTIONS[name]
    expression = symbolic(x)
    found = dual(X)
    assert (found.real, found.tangent) == (expression.subs(x, 3), sp.diff(expression, x).subs(x, 3))
    nested = dual(Dual(Dual(Fraction(3), Fraction(1)), Dual(Fraction(1), Fraction(0))))
    second = nested.tangent.tangent if isinstance(nested.tangent, Dual) else 0
    assert second == sp.diff(expression, x, 2).subs(x, 3)
    assert base(nested) == expression.subs(x, 3)


def test_a_plain_zero_costs_nothing() -> None:
    """A constant's tangent is no field element."""
    constant = Dual(Fraction(2), 0)
    assert (constant * X).tangent == 2
    assert (constant + constant).tangent == 0
    assert isinstance((constant * constant).tangent, int)
    assert base(5) == 5


def test_roots_and_rotations_carry_derivatives() -> None:
    """sqrt(9)' = 1/6; exp(f x)' = f exp(f x) with the unit in the place of the exponential."""
    root = Dual(Fraction(9), Fraction(1)).square_root(lambda value: Fraction(3))
    assert (root.real, root.tangent) == (3, Fraction(1, 6))
    second = Dual(Dual(Fraction(9), Fraction(1)), Dual(Fraction(1), 0)).square_root(lambda value: Fraction(3))
    assert second.tangent.tangent == sp.diff(sp.sqrt(x), x, 2).subs(x, 9)
    turned = Dual(Fraction(1), Fraction(1)).rotated(Fraction(5), Fraction(2))
    assert (turned.real, turned.tangent) == (5, 10)


def test_linear_systems_are_solved_in_named_terms() -> None:
    """By L D L^T and by the adjugate, whatever is named."""
    matrix = sp.Matrix([[2 + a, b, 1], [b, 3 + c, a], [1, a, 5 + d]])
    right = sp.Matrix([a, b, 1])
    terms = Terms()
    found = solve_positive_definite(matrix, right, ["u", "v", "w"], terms).applyfunc(terms.expand)
    expected = matrix.LUsolve(right)
    for seed in range(2):
        for one, other in zip(found, expected, strict=True):
            assert at(one, seed) == pytest.approx(at(other, seed), rel=1e-10)
    names = {symbol.name for symbol in terms.definitions}
    assert {"u_dot", "v_dot", "w_dot", "pivot_v", "pivot_w", "ratio_v_u", "ratio_w_v"} <= names
    terms = Terms()
    inverse = adjugate_over_determinant(matrix, terms, "determinant").applyfunc(terms.expand)
    assert {symbol.name for symbol in terms.definitions} == {"determinant"}
    whole = inverse * matrix
    for i in range(3):
        for j in range(3):
            assert at(whole[i, j]) == pytest.approx(float(i == j), abs=1e-10)


def test_names_are_given_once_and_derivatives_go_through_them() -> None:
    """The chain rule, in partial derivatives and in rates; what is equal has one name, its negative the same one."""
    terms = Terms(reserved=["first"])
    first = terms.name("first", a * b * c)
    assert first.name == "first_"
    assert terms.name("again", a * b * c) is first
    assert terms.name("negative", -a * b * c) == -first
    assert terms.name("simple", 2 * a) == 2 * a
    second = terms.name("second", first**2 + sp.sin(a) * first + d)
    assert terms.expand(second) == (a * b * c) ** 2 + sp.sin(a) * a * b * c + d
    assert terms.atoms(second) == {a, b, c, d}
    assert list(terms.needed([second])) == [first, second]
    assert terms.needed([d]) == {}
    assert terms.expand(terms.partial(second, a)).equals(sp.diff(terms.expand(second), a))
    assert terms.partial(second, L) == 0
    rates = {a: x, c: y, d: sp.S.One}
    expected = sum(sp.diff(terms.expand(second), q) * rate for q, rate in rates.items())
    assert terms.expand(terms.rate(second, rates)).equals(expected)
    assert terms.resolve(second, lambda symbol: symbol == second) == first**2 + sp.sin(a) * first + d
    assert terms.is_zero(first - a * b * c)
    assert not terms.is_zero(first - a * b)
    assert terms.rank(sp.Matrix([[first, a], [b * first, a * b]])) == 1
    assert terms.rank(sp.Matrix([[first, a], [b, a]])) == 2
    assert terms.rank(sp.Matrix([[x - 1, 0], [0, 1]]), {x: sp.S.One}) == 1
    assert terms.simplified(sp.sin(a) ** 2 + sp.cos(a) ** 2 + b) == 1 + b
    assert sorted_symbols({c, a, b}) == [a, b, c]


SIMPLE = (2 * a, a, sp.S(3), sp.sin(a), a * sp.cos(b), -a * b, sp.atan2(a, b))
NOT_SIMPLE = (a * b * c, a + b, sp.sin(a + b), a**2, 1 / a, sp.atan2(a, b + c), sp.atan2(b * c, a))


@pytest.mark.parametrize(("expression", "expected"), [(one, one in SIMPLE) for one in (*SIMPLE, *NOT_SIMPLE)], ids=str)
def test_what_is_simple_deserves_no_name(expression: sp.Expr, expected: bool) -> None:
    """Numbers, symbols, functions of symbols, and products of two."""
    assert is_simple(expression) is expected


KNOWN = Parameters(frozenset({L}), frozenset({p1, p2}))


@pytest.mark.parametrize(
    "expression",
    [
        p1 * x + L * p2 * sp.sin(y),
        (p1 + p2) * (x + L) ** 2,
        p1 * x / (L * y),
        x / (p1 + p2),
        s * x * p1 + L + p2,
        sp.sqrt(p1) * x,
        3 * x + p1**2 * p2 * x,
        1 / (p1 * x),
        (x * p1 + x * p2) ** -1,
        1 / (p1 * x + p1 * sp.sin(y) + p2 * x + p2 * sp.sin(y)),
        (p1 * sp.sin(y) ** 2 / sp.cos(y) + p1 * sp.cos(y)) ** -2,
        1 / (p1 * x * (x - 1) + p2 * x * (x - 1)),
        (p1 * (1 + sp.sin(y) ** 2) + p2 * sp.sin(y) ** 2 + p2) ** -1 * (p1 * x + p2),
        sp.S.Zero,
    ],
    ids=str,
)
def test_products_of_state_and_parameters_give_the_function_again(expression: sp.Expr) -> None:
    """Each state function is free of uncertain parameters, each parameter function of the state."""
    products = Separation((s, s2), KNOWN, Terms()).products(expression)
    total = sum(((slope or 1) * state * parameter for (slope, state), parameter in products.items()), sp.S.Zero)
    for seed in range(3):
        assert at(total, seed) == pytest.approx(at(expression, seed), rel=1e-12, abs=1e-12)
    for (_, state), parameter in products.items():
        assert state.free_symbols.isdisjoint({p1, p2, s, s2})
        assert parameter.free_symbols <= {p1, p2}


@pytest.mark.parametrize(
    "expression", [1 / (p1 + x), sp.sqrt(p1 + x), s * s2, s**2, 1 / s, sp.sin(s), sp.sin(p1 * x)], ids=str
)
def test_what_is_no_sum_of_products_is_refused(expression: sp.Expr) -> None:
    """Mixtures, and what is not affine in the slopes."""
    with pytest.raises(NotSeparable):
        Separation((s, s2), KNOWN, Terms()).products(expression)


@pytest.mark.parametrize(
    "columns",
    [
        [[x], [y], [x + y]],
        [[x], [L * x]],
        [[x, y], [y, x], [x + L * y, y + L * x]],
        [[sp.sin(x) ** 2], [sp.cos(x) ** 2], [sp.S.One]],
        [[sp.sin(x + y)], [sp.sin(x) * sp.cos(y)], [sp.cos(x) * sp.sin(y)]],
        [[x], [x**2], [x**3]],
        [[x / (1 + L)], [x], [y * sp.Rational(3, 7)], [y]],
    ],
    ids=str,
)
def test_dependent_functions_are_combinations_of_the_basis(columns: list) -> None:
    """With coefficients in known constants; also after every exchange of the basis."""
    found = dependence(columns, frozenset({L}), Terms())
    for one in (found, found.exchanged(lambda coefficient: int(sp.count_ops(coefficient)))):
        assert sorted([*one.independent, *one.combination]) == list(range(len(columns)))
        for j, combination in one.combination.items():
            for row, entry in enumerate(columns[j]):
                total = sum(coefficient * columns[i][row] for i, coefficient in combination.items())
                assert at(total) == pytest.approx(at(entry), rel=1e-10)
                assert at(total, 1) == pytest.approx(at(entry, 1), rel=1e-10)
            assert all(coefficient.free_symbols <= {L} for coefficient in combination.values())


def test_a_basis_is_the_first_functions_of_which_none_follows_from_others() -> None:
    """As many as there are independent ones."""
    found = dependence([[x], [L * x], [y], [x + y], [x**2]], frozenset({L}), Terms())
    assert found.independent == [0, 2, 4]
    assert found.combination == {1: {0: L}, 3: {0: sp.S.One, 2: sp.S.One}}
    cheap = found.exchanged(lambda coefficient: 10 * int(coefficient.has(L)))
    assert cheap.independent == found.independent


def test_small_fractions_are_found_in_the_field() -> None:
    """Of either sign."""
    for number in (sp.S.Zero, sp.S.One, sp.Rational(-3, 7), sp.Rational(1000, 999)):
        residue = int(number.p) * pow(int(number.q), -1, PRIME) % PRIME
        assert fraction_of(residue) == number


@pytest.mark.parametrize(
    ("expression", "is_zero"),
    [
        (sp.sin(a) ** 2 + sp.cos(a) ** 2 - 1, True),
        (sp.sin(a + b) - sp.sin(a) * sp.cos(b) - sp.cos(a) * sp.sin(b), True),
        (sp.sqrt(x) ** 2 - x, True),
        ((x + y) ** 3 - x**3 - 3 * x**2 * y - 3 * x * y**2 - y**3, True),
        (sp.cos(sp.pi / 3) - sp.Rational(1, 2), True),
        (sp.tan(a) * sp.cos(a) - sp.sin(a), True),
        (1 / (x - y) + 1 / (y - x), True),
        (sp.sin(a) - a, False),
        (x - y, False),
        (sp.sin(a) ** 2 - 1, False),
    ],
    ids=str,
)
def test_zero_is_told_from_what_is_not(expression: sp.Expr, is_zero: bool) -> None:
    """By exact values in a finite field."""
    assert vanishes(expression) is is_zero


def test_a_point_is_the_same_for_the_same_seed() -> None:
    """Each symbol has its value by its name; sums and products are those of the field."""
    point, again, other = Point(3), Point(3), Point(4)
    assert point(x) == again(x)
    assert point(x) != other(x)
    assert point(x) != point(y)
    assert point(x * y + 2) == point(x) * point(y) + point(sp.S(2))
    assert point(x / y) * point(y) == point(x)
    assert point(sp.sin(a)) ** 2 + point(sp.cos(a)) ** 2 == point(sp.S.One)
    assert point(sp.Matrix([[x, y], [y, x]]).det()) == point.determinant(sp.Matrix([[x, y], [y, x]]))
    assert Point(0, values={x: Point(0)(sp.S(5))})(x + 1) == Point(0)(sp.S(6))


def test_what_fails_to_inform_is_noted_and_mistakes_are_not() -> None:
    """With a reason of one line."""
    attempts = Attempts()

    def failing() -> int:
        raise ValueError("two\nlines " + "x" * 200)

    assert attempts("good", lambda: 3, 0) == 3
    assert attempts("bad", failing, 7) == 7
    assert list(attempts.missed) == ["bad"]
    assert attempts.missed["bad"].startswith("ValueError: two lines xxx")
    assert len(attempts.missed["bad"]) == len("ValueError: ") + 80
    assert reason(ValueError()) == "ValueError"
    assert reason(NotRepresentable(x)) == "x is not defined at random configurations"
    assert shown("a" * 80) == "a" * 80
    assert shown("a" * 81) == "a" * 77 + "..."

    def mistaken() -> int:
        raise WmrError("a mistake")

    with pytest.raises(WmrError):
        attempts("mistake", mistaken, 0)


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (x / 3 + 1, "x/3 + 1"),
        (sp.Abs(x), "abs(x)"),
        (sp.Rational(2**53, 3) * x, f"{2**53}*x/3"),
        (sp.Rational(10**20, 3) * x, "3.333333333333333e+19*x"),
        (-sp.Rational(10**20, 3) * x, "-3.333333333333333e+19*x"),
    ],
    ids=str,
)
def test_a_formula_holds_no_number_longer_than_a_double(expression: sp.Expr, text: str) -> None:
    """Fractions stay as long as a double holds numerator and denominator."""
    assert formula(expression) == text
    assert readable(expression) == text


def test_a_formula_that_nobody_reads_is_none() -> None:
    """Too many operations, or too deep."""
    deep = x
    for _ in range(31):
        deep = sp.sin(deep)
    assert readable(deep) is None
    assert readable(deep.args[0]) is not None
    assert readable(sp.Add(*(x**k for k in range(3000)))) is None
