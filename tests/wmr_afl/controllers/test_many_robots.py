"""What is checked of one robot's numbers is checked of many at once; angles, references, and what cannot be changed."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wmr_afl.controllers import (
    GradientAdaptation,
    Leakage,
    LinearizingLaw,
    Normalization,
    OuterLoop,
    Projection,
    RobustTerm,
)
from wmr_afl.controllers.dead_zone import DeadZone
from wmr_afl.controllers.outer_loop import tracking_error, within_half_a_turn
from wmr_afl.controllers.reference import Point, Reference, ReferenceTable
from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import CASADI, NUMPY
from wmr_afl.numerics.parts import Part
from wmr_afl.plant import Friction, InputLimits, MeasurementNoise
from wmr_input import InputError
from wmr_input.toml_file import validate

EYE = np.eye(2)
# A part, and numbers of robots in rows: the first is good, each of the others breaks one rule.
ROBOTS: dict[str, tuple[Part, dict[str, list[Any]]]] = {
    "outer loop": (
        OuterLoop(2, 2.0, 1.0),
        {
            "b1": [[2, 2], [2, 0], [2, 2], [2, 2], [2, 2], [-1, 2]],
            "b2": [[1, 1], [1, 1], [1, 0], [1, 1], [1, 1], [1, 1]],
            "alpha": [[0.5, 0.5], [0.5, -0.5], [0.5, 0.5], [0.5, 0], [0.5, 2], [-2, 0.5]],
        },
    ),
    "diagonal gain": (GradientAdaptation(2, 1.0), {"Gamma": [[1, 2], [1, 0], [-1, 1]]}),
    "full gain": (
        GradientAdaptation(2, EYE),
        {"Gamma": [EYE + 0.1, [[1, 0.5], [0.4, 1]], [[1, 2], [2, 1]], -EYE, [[0, 0], [0, 1]]]},
    ),
    "leakage": (Leakage(2, 0.1), {"Sigma": [[0, 0.1], [0.1, -0.1]]}),
    "dead zone": (DeadZone(1.0), {"size": [[0.5], [0.0], [-1], [np.inf], [np.nan]]}),
    "normalization": (Normalization(1.0), {"weight": [[0.5], [0.0], [-1], [np.inf], [np.nan]]}),
    "projection": (Projection(2, -1.0, 1.0), {"lower": [[0, 0], [0, 2], [0, 0]], "upper": [[1, 1], [1, 1], [1, 0]]}),
    "lower bounds alone": (Projection(2, lower=-1.0), {"lower": [[0, 0], [0, np.inf]]}),
    "upper bounds alone": (Projection(2, upper=1.0), {"upper": [[0, 0], [0, -np.inf]]}),
    "weights": (LinearizingLaw(2), {"input_weights": [[1, 2], [1, 0], [-1, 1]]}),
    "robust term": (
        RobustTerm(1.0, leakage=0.1),
        {
            "gamma": [[1], [0], [1], [1], [1], [1]],
            "mu_decay": [[1], [1], [-1], [1], [0], [0]],
            "leakage": [[0], [0], [0], [-1], [0], [-1]],
        },
    ),
    "friction": (
        Friction(load_model("type_2_0"), 1.0, 1.0),
        {"viscous": [[0, 1], [0, -1], [0, 0]], "coulomb": [[0, 1], [0, 0], [-1, 0]]},
    ),
    "limits": (InputLimits(2, 1.0), {"volts": [[1, 2], [1, 0], [-1, 1]]}),
    "noise": (MeasurementNoise(2, 1.0), {"deviation": [[0, 1], [0, -1]]}),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_of_many_robots_each_is_judged_by_its_own_numbers(name: str) -> None:
    """Those that break a rule are told, with a problem that is the same as for one robot alone."""
    part, columns = ROBOTS[name]
    k = SimpleNamespace(**{key: np.array(column, dtype=float) for key, column in columns.items()})
    count = len(next(iter(columns.values())))
    wrong = np.zeros(count, dtype=bool)
    with np.errstate(all="ignore"):
        for is_wrong, describe in part.faults(k):
            assert np.shape(is_wrong) == (count,)
            wrong |= is_wrong
            for robot in np.flatnonzero(is_wrong):
                own = SimpleNamespace(**{key: column[robot] for key, column in vars(k).items()})
                problem, remedy = describe(own)
                assert problem
                assert isinstance(remedy, str)
    assert wrong.tolist() == [False] + [True] * (count - 1)


def test_a_part_without_rules_has_no_faults() -> None:
    """And nothing to check."""
    part = Part()
    assert list(part.faults(SimpleNamespace())) == []
    part.check_numbers()


@pytest.mark.parametrize("gain", [[[1.0, 2.0], [1.0]], np.ones((3, 3)), np.ones(3), np.ones((2, 2, 2))])
def test_a_gain_of_another_shape_is_refused(gain: Any) -> None:
    """A number, a diagonal or a square matrix."""
    with pytest.raises(ShapeError):
        GradientAdaptation(2, gain)


@pytest.mark.parametrize(
    "part", [OuterLoop(2, 2.0, 1.0), Leakage(2, 0.1), Reference({"y1": "t"})], ids=lambda p: type(p).__name__
)
def test_what_is_built_cannot_be_changed(part: Any) -> None:
    """What was traced from it would not notice."""
    with pytest.raises(AttributeError, match="is fixed once it is built"):
        part.b1 = 3.0


@pytest.mark.parametrize("arrays", [NUMPY, CASADI])
def test_an_angle_is_taken_the_shorter_way_round(arrays: Any) -> None:
    """From -pi up to pi, whole turns away from what it was; unchanged to the bit if it is there already."""
    for angle in (-3.0, -np.pi, 0.0, 1e-9, 3.1):
        assert float(within_half_a_turn(angle, arrays)) == angle
    for angle in (3.2, 7.0, -3.2, 100.0, -50.0, np.pi):
        found = float(within_half_a_turn(angle, arrays))
        assert -np.pi <= found < np.pi
        turns = (angle - found) / (2.0 * np.pi)
        assert turns == pytest.approx(round(turns), abs=1e-12)
        assert round(turns) != 0


@pytest.mark.parametrize("counts_turns", [True, False])
@pytest.mark.parametrize("library", ["numpy", "casadi"])
def test_an_output_that_is_an_angle_is_compared_modulo_a_turn(counts_turns: bool, library: Any) -> None:
    """Unless the reference counts turns; lengths never are."""
    model = load_model("type_2_1", library)
    units = list(model.output_units.values())
    assert units == ["m", "m", "rad"]
    numpy_model = model.in_library("numpy")
    c = numpy_model.known(numpy_model.parameters())
    x = np.zeros(len(model.state_units))
    x[list(model.state_units).index("phi")] = 0.5
    here = numpy_model.output(x[: model.coordinate_count], c)
    off = np.array([7.0, -8.0, 0.3 + 4.0 * np.pi])
    given = model.arrays.vector(list(here - off)), model.arrays.vector([0.0] * 3), model.arrays.vector([0.0] * 3)
    error = tracking_error(
        model.arrays.vector(list(x)), model.arrays.vector(list(c)), Point(*given, counts_turns), model
    )
    found = np.array(error.e, dtype=float).ravel()
    np.testing.assert_allclose(found, [7.0, -8.0, off[2] if counts_turns else 0.3], atol=1e-12)


def test_a_reference_is_put_in_the_order_of_the_outputs() -> None:
    """Every output has one expression, and no other; turns count as before."""
    reference = Reference({"b": "t", "a": "2"}, counts_turns=True)
    ordered = reference.ordered(["a", "b"])
    assert list(ordered.expressions.items()) == [("a", "2"), ("b", "t")]
    assert ordered.at(3.0).position.tolist() == [2.0, 3.0]
    assert ordered.counts_turns
    assert ordered.at(0.0).counts_turns
    assert ordered.ordered(["a", "b"]) is ordered
    assert not Reference({"a": "t"}).at(0.0).counts_turns
    with pytest.raises(UnknownNameError, match="output 'b'"):
        reference.ordered(["a"])
    with pytest.raises(WmrError, match="output 'c' has no reference"):
        reference.ordered(["a", "b", "c"])


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "no or several"),
        ({"counts_turns": True}, "no or several"),
        ({"line": {"start": [1.0, 2.0], "velocity": [1.0]}}, "2 entries of start, 1 of velocity"),
        ({"circle": {"center": [1.0], "radius": 1.0, "rate": 1.0}}, "center"),
        ({"figure_eight": {"center": [1.0, 1.0, 1.0], "radius": 1.0, "rate": 1.0}}, "center"),
        ({"circle": {"center": [1.0, 1.0], "radius": 0.0, "rate": 1.0}}, "radius"),
        ({"expressions": {"a": "t"}, "line": {"start": [1.0], "velocity": [1.0]}}, "no or several"),
    ],
)
def test_a_trajectory_that_means_nothing_is_refused(table: dict[str, Any], words: str) -> None:
    """One kind, a center in the plane, a positive radius, as many velocities as coordinates."""
    with pytest.raises(InputError, match=words):
        validate(table, ReferenceTable, "file")
    good = {"line": {"start": [1.0], "velocity": [1.0]}, "counts_turns": True}
    assert validate(good, ReferenceTable, "file").counts_turns
