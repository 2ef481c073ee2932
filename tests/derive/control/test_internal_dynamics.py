"""What the outputs leave free, against the equation that it obeys, for small robots."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from derive.control import internal_dynamics
from derive.control.internal_dynamics import StraightLine
from derive.derivation import Derivation
from tests.derive.descriptions import AHEAD, derivation_of, motor, part, robot, wheel

TWO = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), motor("left"), motor("right"))
CASTER = (part("frames", name="arm", parent="body", at=["a", "0"], angle="g"), wheel("w", "arm", ("-e", "0")))
ASIDE = {"y1": "x + L*cos(phi) - a*sin(phi)", "y2": "y + L*sin(phi) + a*cos(phi)"}
FREE = {
    "the heading": (robot(*TWO, outputs=AHEAD), ["phi"]),
    "the heading, seen from beside": (robot(*TWO, outputs=ASIDE), ["phi"]),
    "two angles": (robot(*TWO, *CASTER, angles=("g",), outputs=AHEAD), ["phi", "g"]),
    "a position": (robot(*TWO, outputs={"y1": "x + L*cos(phi)", "y2": "phi"}), ["y"]),
    "the heading, where y is declared first": (
        robot(*TWO, outputs=AHEAD).replace('x = "m"\ny = "m"\n', 'y = "m"\nx = "m"\n'),
        ["phi"],
    ),
}


@pytest.fixture(params=FREE)
def made(request: pytest.FixtureRequest) -> tuple[Derivation, list[str]]:
    text, free = FREE[request.param]
    return derivation_of(text), free


def test_its_linearization_is_that_of_its_equation(made: tuple[Derivation, list[str]]) -> None:
    """d/dz of S_z E^-1 yr' with yr' = E v of the straight line; no equation depends on what the outputs hold."""
    derivation, free = made
    assert derivation.missed == {}
    assert derivation.control is not None
    internal, terms = derivation.control.internal, derivation.terms
    assert [z.name for z in internal.free] == free
    assert internal.equation is not None
    line = internal.straight_line
    assert line is not None
    place = dict.fromkeys(derivation.kinematics.q, sp.S.Zero)
    rows = [derivation.kinematics.q.index(z) for z in internal.free]
    kinematic = derivation.kinematics.kinematic_matrix.applyfunc(terms.expand)
    output_map = derivation.control.linearization.output_map.applyfunc(terms.expand)
    product = internal.equation * output_map - kinematic.extract(rows, list(range(kinematic.cols)))
    assert all(terms.is_zero(entry) for entry in product)
    ahead = (kinematic * line.pseudo_velocities).xreplace(place)
    along_x = [int(q.name == "x") for q in derivation.kinematics.q]
    assert ahead.applyfunc(sp.simplify) == sp.Matrix(along_x)  # and nothing turns
    wanted = (output_map * line.pseudo_velocities).xreplace(place)
    expected = (internal.equation * wanted).jacobian(internal.free).xreplace(place)
    assert (line.matrix - expected).applyfunc(sp.simplify).is_zero_matrix
    numbers = np.array(line.matrix.xreplace(derivation.robot.numbers).tolist(), dtype=float)
    np.testing.assert_allclose(np.sort_complex(line.values), np.sort_complex(np.linalg.eigvals(numbers)), rtol=1e-12)
    symbolic = [complex(one.xreplace(derivation.robot.numbers)) for one in line.eigenvalues]
    np.testing.assert_allclose(np.sort_complex(symbolic), np.sort_complex(line.values), rtol=1e-12)


@pytest.mark.parametrize("position", ['["x", "y + a"]', '["x + a", "y"]', '["x - a*sin(phi)", "y + a*cos(phi)"]'])
def test_no_straight_line_is_told_of_a_root_whose_place_is_no_coordinate(position: str) -> None:
    """Nor is it something that was not found out."""
    derivation = derivation_of(robot(*TWO, outputs=AHEAD).replace('["x", "y"]', position))
    assert derivation.control is not None
    assert derivation.control.internal.free
    assert derivation.control.internal.straight_line is None
    assert derivation.missed == {}


@pytest.mark.parametrize("y2", ["L*phi + y**2/L", "L*phi + L*sqrt(y/L)", "L*phi**2 + y"])
def test_no_straight_line_is_told_where_the_outputs_are_no_chart_on_it(y2: str) -> None:
    """They do not see y there, or their rates are not defined, or the heading is not seen."""
    derivation = derivation_of(robot(*TWO, outputs={"y1": "x + L*cos(phi)", "y2": y2}))
    assert derivation.control is not None
    assert derivation.control.internal.straight_line is None
    assert derivation.missed == {}


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ([[-1, -2], [2, -1]], [-1 - 2j, -1 + 2j]),
        ([[0, -3], [3, 0]], [-3j, 3j]),
        ([[2, 1, 0], [0, 2, 1], [0, 0, 2]], [2, 2, 2]),
        ([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [0, 0, 0]),
        ([[-2, 1], [4, -2]], [-4, 0]),
        ([[1, 0], [0, sp.Rational(1, 10**9)]], [1e-9, 1]),
    ],
)
def test_eigenvalues_in_numbers_are_sorted_and_hold_nothing_that_rounding_left(matrix: list, expected: list) -> None:
    """A part that is zero is zero; a small one that is none stays."""
    found = internal_dynamics._values(sp.Matrix(matrix))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert [(one.real == 0.0, one.imag == 0.0) for one in found] == [
        (complex(one).real == 0.0, complex(one).imag == 0.0) for one in expected
    ]
    assert list(found) == sorted(found, key=lambda one: (one.real, one.imag))


@pytest.mark.parametrize(
    ("values", "forward", "backward"),
    [
        ((-1e-6, -2.0), "stable", "unstable"),
        ((-1e-8,), "stable", "unstable"),
        ((1e-6, -1.0), "unstable", "unstable"),
        ((1e-8,), "unstable", "stable"),
        ((-1e-10, -1.0), "not decided by the linearization", "unstable"),
        ((1e-10,), "not decided by the linearization", "not decided by the linearization"),
    ],
)
def test_a_small_real_part_decides_if_it_is_more_than_rounding(values: tuple, forward: str, backward: str) -> None:
    line = StraightLine(sp.zeros(1), sp.zeros(1), (), tuple(map(complex, values)))
    assert (line.forward, line.backward) == (forward, backward)
