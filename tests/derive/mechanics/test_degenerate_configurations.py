"""Where the rank of A drops: each place that is told makes it drop, and known ones are told."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import sympy as sp

from derive.description.resolve import read_robot
from derive.mechanics.constraints import constraint_rows
from derive.mechanics.degenerate_configurations import Conditions, _common_zeros, _zeros, degenerate_configurations
from tests.derive.descriptions import robot, steered, wheel

q, s = sp.symbols("q s", real=True)
a, b, L = sp.symbols("a b L", real=True, positive=True)
BOTH = frozenset({q, s})


@pytest.mark.parametrize("function", [sp.sin, sp.cos])
@pytest.mark.parametrize(
    ("angle", "count"),
    [
        (q, 2),
        (-q, 2),
        (q + sp.pi / 3, 2),
        (a / b - q, 2),
        (q - 2 * s, 2),
        (2 * q + 1, 4),
        (q / 2 - sp.pi / 5, 1),
        (-3 * q + a / b, 6),
        (q * a / b + 1, 2),
        (1 - q * a / b, 2),
    ],
    ids=str,
)
def test_a_factor_vanishes_at_its_zeros(function: type, angle: sp.Expr, count: int) -> None:
    """All that lie within a turn where the slope is a number; two of them where it is a ratio of parameters."""
    factor = next(one for one in sp.Mul.make_args(function(angle)) if not one.is_number)  # sin(-q) is -sin(q)
    places = list(_zeros(factor, BOTH))
    assert len(places) == count
    values = set()
    for place in places:
        (coordinate,) = place
        assert coordinate in BOTH
        assert sp.simplify(function(angle).xreplace(place)) == 0
        values.add(place[coordinate].xreplace({a: sp.S.One, b: sp.S(2), s: sp.S.Zero}))
    assert len(values) == count


def test_what_is_no_sine_and_has_no_coordinate_is_not_solved() -> None:
    assert list(_zeros(q - 1, BOTH)) == []
    assert list(_zeros(sp.tan(q), BOTH)) == []
    assert list(_zeros(sp.sin(a), BOTH)) == []
    assert list(_zeros(sp.sin(q * s), BOTH)) == []


@pytest.mark.parametrize(
    ("expressions", "expected"),
    [
        ([sp.cos(q) * a], [{sp.cos(q)}]),
        ([sp.cos(q) * sp.sin(s)], [{sp.cos(q)}, {sp.sin(s)}]),
        ([sp.cos(q), sp.cos(s) * b], [{sp.cos(q), sp.cos(s)}]),
        ([sp.cos(q), sp.sin(q)], []),
        ([sp.cos(q), sp.sin(2 * q)], [{sp.cos(q)}]),
        ([sp.cos(q), a], []),
        ([], [set()]),
        ([a * q + b], [{a * q + b}]),
    ],
)
def test_expressions_vanish_together_at_their_common_zeros(expressions: list, expected: list[set]) -> None:
    """One factor of each; a number or a parameter never vanishes."""
    found = {frozenset(conditions) for conditions, _ in _common_zeros(expressions, BOTH)}
    assert found == set(map(frozenset, expected))
    for conditions, place in _common_zeros(expressions, BOTH):
        for one in (*conditions, *expressions) if place is not None else ():
            assert sp.simplify(one.xreplace(place)) == 0


def degenerate(text: str) -> tuple[tuple[Conditions, ...] | None, sp.Matrix]:
    """The conditions, and all rows of A at the default parameters."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        described = read_robot(path)
    constraints = constraint_rows(described)
    rates = [described.rate(one) for one in described.coordinates]
    rows = sp.Matrix([[form.get(rate, 0) for rate in rates] for form in constraints.rows.values()])
    return degenerate_configurations(described, constraints), rows.xreplace(described.numbers)


def steering(*angles: str) -> str:
    """Wheels ahead of, and behind, the middle, each turned by an angle."""
    places = ("a", "-a", "2*a")
    frames = [steered(f"f{k}", (at, "0"), angle) for k, (at, angle) in enumerate(zip(places, angles, strict=False))]
    wheels = [wheel(f"w{k}", f"f{k}") for k in range(len(angles))]
    return robot(*frames, *wheels, angles=("g", "h"))


CASES = {
    "two free angles": (("g", "h"), ["cos(g), cos(h)"]),
    "opposite angles": (("g", "-g"), ["cos(g)"]),
    "the same angle": (("g", "g"), ["cos(g)"]),
    "another angle": (("g", "g + pi/2"), []),
    "half the angle": (("g", "g/2"), []),
    "a third of the angle": (("g", "g/3"), []),  # three quarters of a turn are more than half a one
    "a fixed angle": (("g", "0"), []),
    "a fixed wheel across": (("g", "pi/2"), ["cos(g)"]),
    "one wheel": (("g",), []),
}


@pytest.mark.parametrize("case", CASES)
def test_two_wheels_on_a_line_are_degenerate_where_both_axles_lie_along_it(case: str) -> None:
    """There the rank of A is one, and elsewhere two; numbers say so, too."""
    angles, expected = CASES[case]
    conditions, rows = degenerate(steering(*angles))
    assert conditions is not None
    assert [", ".join(map(str, one)) for one in conditions] == expected
    g, h = (sp.Symbol(name, real=True) for name in "gh")
    x, y, phi = (sp.Symbol(name, real=True) for name in ("x", "y", "phi"))
    somewhere = {x: 0.1, y: 0.2, phi: 0.3}
    for place in ({g: 0.4, h: 0.7}, {g: -1.1, h: 2.2}):
        numbers = np.array(rows.xreplace(somewhere | place).evalf().tolist(), dtype=float)
        assert np.linalg.matrix_rank(numbers, tol=1e-9) == len(angles)
    for one in conditions:
        quarter = sp.solve(one[0], g)[0]
        numbers = np.array(rows.xreplace(somewhere | {g: quarter, h: sp.pi / 2}).evalf().tolist(), dtype=float)
        assert np.linalg.matrix_rank(numbers, tol=1e-9) == len(angles) - 1
