"""Names and numbers as the report and model.json show them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import sympy as sp

from derive.algebra.formula_text import TOO_LONG
from derive.codegen.derivation_report import _name, _Tex
from derive.codegen.findings import _obstacle, _straight_line, findings
from derive.control.decoupling_determinant import Determinant
from derive.control.internal_dynamics import StraightLine
from derive.control.nonlinearity import Obstacle
from derive.derivation import Derivation
from tests.derive.descriptions import AHEAD, derivation_of, motor, robot, wheel

a, b, L, phi = (sp.Symbol(name, real=True) for name in ("a", "b", "L", "phi"))
AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), motor("left"), motor("right"))


@pytest.fixture
def small() -> Derivation:
    return derivation_of(robot(*AXLE, outputs=AHEAD))


@pytest.mark.parametrize(
    ("name", "tex"),
    [
        ("m", "m"),
        ("m_C", "m_{C}"),
        ("beta", r"\beta"),
        ("beta1", r"\beta_{1}"),
        ("beta1_dot", r"\dot{\beta_{1}}"),
        ("phi_2", r"\phi_{2}"),
        ("theta12_max", r"\theta_{12,max}"),
        ("Omega", r"\Omega"),
        ("x_dot", r"\dot{x}"),
        ("trailer_1_turning_v", r"\mathrm{trailer\_1\_turning\_v}"),
        ("speed", r"\mathrm{speed}"),
        ("kt", r"\mathrm{kt}"),
        ("K1", "K_{1}"),
        ("0.25", "0.25"),
        ("0.2*pi", r"0.2 \pi"),
    ],
)
def test_a_name_is_set_as_a_person_would_set_it(name: str, tex: str) -> None:
    """Greek letters, indices and dots; words stand upright."""
    assert _name(name) == tex


def test_a_long_formula_is_shown_in_named_terms_and_a_short_one_is_not(small: Derivation) -> None:
    """The names that are left open are listed with what they stand for."""
    terms = small.terms
    short = terms.name("short_one", a + b * L)
    long = terms.name("long_one", sp.Add(*(sp.sin(phi + k) * (a + k) for k in range(30))))
    tex = _Tex(small)
    assert tex(short) == tex.plain(a + b * L)
    assert tex(sp.Matrix([[short, 0]])) == tex.plain(sp.Matrix([[a + b * L, 0]]))
    assert tex.named_terms() == []
    assert tex(long * short) == tex.plain(long * short)
    assert dict(tex.named_terms()) == {
        _name("long_one"): tex.plain(terms.definitions[long]), _name("short_one"): tex.plain(a + b * L),
    }  # fmt: skip
    assert tex.expanded(short * 2) == tex.plain(sp.factor_terms(2 * (a + b * L)))
    assert tex.denominator(a / (b + L)) == tex.plain(b + L)
    assert tex.column([a, "beta1"]) == r"\begin{bmatrix}a & \beta_{1}\end{bmatrix}^T"
    assert tex.name(phi) == tex.name("phi") == r"\phi"


def test_eigenvalues_are_real_numbers_or_pairs_of_parts() -> None:
    """To twelve digits; parts that are rounding are left out."""
    values = (-1 / 3 + 0j, complex(-0.5, 2 / 3), complex(2.0, 1e-13))
    line = StraightLine(sp.Matrix([1, 0]), sp.Matrix([[-1 / L, a], [0, b]]), (-1 / L,), values)
    told = _straight_line(line)
    assert told["eigenvalues_at_defaults"] == [-0.333333333333, [-0.5, 0.666666666667], 2.0]
    assert (told["pseudo_velocities"], told["eigenvalues"]) == (["1", "0"], ["-1/L"])
    assert told["matrix"] == [["-1/L", "a"], ["0", "b"]]
    assert (told["forward"], told["backward"]) == ("unstable", "unstable")


def test_the_denominator_of_an_obstacle_is_told(small: Derivation) -> None:
    """A short one in the user's symbols."""
    named = small.terms.name("product_of_all", a * b * L + phi)
    told = _obstacle(small, Obstacle(1 / named, True, 20, 20))
    assert told == {
        "denominator": "L*a*b + phi", "mixes_state_and_parameters": True, "rank_of_values": 20,
        "states_and_parameter_sets": 20, "is_proof": True,
    }  # fmt: skip
    long = small.terms.name("far_too_long", sp.Add(*(sp.sin(phi + k) * (a + k) for k in range(31))))
    assert _obstacle(small, Obstacle(a / long, False, 20, 20))["denominator"] == "far_too_long"
    for mixed, rank, proof in ((True, 19, False), (False, 20, False), (True, 20, True)):
        assert Obstacle(1 / named, mixed, rank, 20).is_proof is proof


@pytest.mark.parametrize("count", [60, 61])
def test_sixty_operations_can_be_read_and_one_more_cannot(count: int, small: Derivation) -> None:
    """Then the name of the term stands there."""
    whole = sp.Add(*(sp.Symbol(f"t{k}", real=True) for k in range(count + 1)))
    assert sp.count_ops(whole) == count
    named, tex = small.terms.name(f"sum_of_{count}", whole), _Tex(small)
    shown = whole if count == 60 else named
    assert tex(named) == tex.plain(shown)
    assert [name for name, _ in tex.named_terms()] == ([] if count == 60 else [_name(named.name)])
    assert _obstacle(small, Obstacle(1 / named, True, 20, 20))["denominator"] == str(shown)


def test_what_no_brackets_tell_is_not_guessed(small: Derivation) -> None:
    """Growth and degree are those of nothing, and control is not claimed."""
    found = findings(replace(small, mobility=replace(small.mobility, growth=None)))
    assert (found["growth_vector"], found["degree_of_nonholonomy"], found["controllable"]) == ([], 0, False)


@pytest.mark.parametrize("depth", [1, 40], ids=["readable", "too deep"])
@pytest.mark.parametrize("count", [2, 40], ids=["short", "long"])
def test_a_denominator_stands_beside_the_determinant_that_names_it_and_nowhere_else(
    depth: int, count: int, small: Derivation
) -> None:
    """A long one of a determinant that can be read: with it in its place the text is the determinant."""
    numerator, denominator = phi, sp.Add(*(sp.Symbol(f"theta{k}", real=True) for k in range(count)))
    for _ in range(depth):
        numerator = sp.sin(numerator)
    assert small.control is not None
    determinant = Determinant(True, L, numerator / denominator, sp.S.One)
    found = findings(replace(small, control=replace(small.control, determinant=determinant)))
    told, beside = found["det_decoupling_matrix"], found["det_denominator"]
    assert ("Delta" in told) == (beside is not None) == (count > 2 and depth == 1)
    assert (told == TOO_LONG) == ("det_decoupling_matrix" in found.get("not_found_out", {})) == (depth > 1)
    if depth == 1:
        names = {symbol.name: symbol for symbol in (L, *numerator.free_symbols, *denominator.free_symbols)}
        value = sp.sympify(told, locals=names | ({"Delta": sp.sympify(beside, locals=names)} if beside else {}))
        assert sp.simplify(value - determinant.whole) == 0


def test_findings_of_a_small_robot_are_what_is_known_of_it(small: Derivation) -> None:
    """A pair of wheels with a look-ahead point."""
    found = findings(small)
    assert (found["degree_of_mobility"], found["degree_of_steerability"], found["type"]) == (2, 0, "(2,0)")
    assert (found["growth_vector"], found["degree_of_nonholonomy"], found["controllable"]) == ([2, 3], 2, True)
    assert found["constraint_rows"] == ["wheel 'left' does not slip sideways"]
    assert found["dropped_rows"] == ["wheel 'right' does not slip sideways"]
    assert found["holonomic_rows"] == found["degenerate_configurations"] == found["kinematic_singularities"] == []
    assert found["pseudo_velocities"]["body_turning"] == "phi_dot"
    assert found["relative_degree"] == {"y1": 2, "y2": 2}
    assert found["determinant_of"] == "D"
    assert found["singular_where"] == ["L = 0", *(f"{theta} = 0" for theta in found["determinant_parameters"])]
    assert found["internal_coordinates"] == ["phi"]
    assert found["internal_dynamics"] == [["-sin(phi)/L", "cos(phi)/L"]]
    assert found["straight_line"]["forward"] == "stable"
    assert "not_found_out" not in found
    alone = findings(derivation_of(robot(*AXLE)))
    assert not {"relative_degree", "determinant_of", "straight_line"} & alone.keys()
