"""S in numbers: where a choice of pseudo-velocities blows up, and how large the parts are that coordinates turn."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import sympy as sp

from derive.description.resolve import read_robot
from derive.description.robot import Robot
from derive.mechanics.constraints import constraint_rows
from derive.mechanics.numeric_motion import Poles, matrix_values
from derive.mechanics.over_constraint import _distance, _length
from derive.mechanics.pseudo_velocities import _candidates
from tests.derive.descriptions import part, robot, steered, wheel

CAR = robot(wheel("rear"), steered("fork", ("a", "0"), "beta"), wheel("front", "fork"), angles=("beta",))
TWO = robot(wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))


def described(text: str) -> Robot:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        return read_robot(path)


def poles(text: str, chosen: str) -> tuple[bool, int, int]:
    """At zero, along joints, at quarter turns."""
    one = described(text)
    candidates = _candidates(one)
    return Poles(one, constraint_rows(one), candidates)([sp.Symbol(name, real=True) for name in chosen.split()])


def test_velocities_blow_up_where_they_vanish_for_every_motion() -> None:
    """The rear axle stands still while the front wheel is across; nothing turns while it is straight."""
    assert poles(TWO, "body_forward body_turning") == (False, 0, 0)
    assert poles(CAR, "fork_forward beta_rate") == (False, 0, 0)
    assert poles(CAR, "body_forward beta_rate") == (False, 1, 2)
    at_zero, _, quarters = poles(CAR, "body_turning beta_rate")
    assert (at_zero, quarters) == (True, 0)


def test_a_matrix_has_its_values_at_every_place() -> None:
    """Constants, too."""
    x, y = sp.symbols("x y", real=True)
    places = np.array([[0.1, 0.2], [0.3, -0.4], [1.0, 2.0]])
    found = matrix_values(sp.Matrix([[x * y, 2], [sp.sin(x), 0]]), [x, y], places)
    expected = [[[a * b, 2.0], [np.sin(a), 0.0]] for a, b in places]
    np.testing.assert_allclose(found, expected)


TRAILER = part("frames", name="trailer", parent="body", at=["-a", "0"], angle="g")
SECOND = part("frames", name="second", parent="trailer", at=["-L", "0.05"], angle="h")


@pytest.mark.parametrize(
    ("parts", "lengths"),
    [
        ((wheel("w"),), [1.0, 1.0, 1.0, 1.0, 1.0]),
        ((wheel("w", at=("-a", "b")),), [1.0, 1.0, 0.3, 1.0, 1.0]),
        ((wheel("w", at=("b", "-a")), TRAILER), [1.0, 1.0, 0.3, 1.0, 1.0]),
        ((TRAILER, SECOND), [1.0, 1.0, 0.4, 0.4, 1.0]),
        ((TRAILER, SECOND, wheel("w", "second", ("0", "-2*L"))), [1.0, 1.0, 0.8, 0.8, 0.8]),
        ((TRAILER, SECOND, wheel("w", "trailer", ("-e", "e"))), [1.0, 1.0, 0.4, 0.4, 1.0]),
    ],
)
def test_a_length_is_that_of_the_largest_offset_in_what_a_coordinate_turns(parts: tuple, lengths: list) -> None:
    """Joints further out are turned as well; where there is no offset it is a metre."""
    one = described(robot(*parts, angles=("g", "h")))
    assert [_length(one, index) for index in range(5)] == pytest.approx(lengths)


def test_the_distance_of_a_row_is_that_from_the_span_of_others() -> None:
    """Of its own length, the largest at any place, with the row it resembles most."""
    values = np.array([
        [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [3.0, 0.1, 4.0], [5.0, 0.0, 0.0]],
        [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 8.0, 6.0], [5.0, 0.0, 0.0]],
    ])  # fmt: skip
    assert _distance(values, [0, 1], 3)[0] == pytest.approx(0.0, abs=1e-12)
    size, partner = _distance(values[:1], [0, 1], 2)
    assert (size, partner) == (pytest.approx(4.0 / np.linalg.norm([3.0, 0.1, 4.0])), 0)
    size, partner = _distance(values[1:], [0, 1], 2)
    assert (size, partner) == (pytest.approx(0.6), 1)
    assert _distance(values, [0, 1], 2)[0] == pytest.approx(4.0 / np.linalg.norm([3.0, 0.1, 4.0]))
    assert _distance(values, [], 2) == (1.0, 2)
