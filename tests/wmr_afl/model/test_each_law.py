"""Each law holds for a model as it was derived, and is broken by what it forbids: one entry, one sign, one column."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from wmr_afl.model.laws import LAWS, Law, Situation
from wmr_afl.model.laws.law import CLOSE, condition, relative, times, transposed

Floats = np.ndarray
Change = Callable[..., Floats]  # (value, *arguments) -> what is given instead


def more(value: Floats, *arguments: Floats) -> Floats:
    """A little more in every entry."""
    return value * (1.0 + 1e-6) + 1e-8


def entry(*place: int, by: float = 1e-6) -> Change:
    """A little more in one entry."""

    def changed(value: Floats, *arguments: Floats) -> Floats:
        found = np.array(value)
        found[(..., *place)] += by
        return found

    return changed


def column(of: int, by: float) -> Change:
    """The last column as a multiple of another one."""

    def changed(value: Floats, *arguments: Floats) -> Floats:
        found = np.array(value)
        found[..., -1] = by * found[..., of]
        return found

    return changed


def row_again(value: Floats, *arguments: Floats) -> Floats:
    """The first row once more, in the place of the last."""
    found = np.array(value)
    found[..., -1, :] = found[..., 0, :]
    return found


def skew_damping(value: Floats, x: Floats, p: Floats) -> Floats:
    """Damping that is not symmetric."""
    return value + np.array([[0.0, 1e-3], [-1e-3, 0.0]])


def driving(value: Floats, x: Floats, p: Floats) -> Floats:
    """Damping that drives the robot."""
    return value - 1e4 * np.eye(value.shape[-1])


def growing(value: Floats, x: Floats, p: Floats) -> Floats:
    """A symmetric share of Cbar that grows with v."""
    return value + 1e-3 * x[..., -1, None, None] * np.eye(value.shape[-1])


def nothing_known(value: Floats, *arguments: Floats) -> Floats:
    return np.full_like(value, np.nan)


def law_of(name: str) -> Law:
    (found,) = [law for law in LAWS if law.name == name]
    return found


# Law -> robot, term that is changed in NumPy, and how.
BROKEN: list[tuple[str, str, str, Change]] = [
    ("constraints hold", "type_2_0", "constraint_matrix", entry(0, 2)),
    ("constraints hold", "type_1_1", "kinematic_matrix", entry(0, 0)),
    ("full rank", "type_2_0", "kinematic_matrix", column(0, 2.0)),
    ("full rank", "type_2_0", "kinematic_matrix", column(0, 0.0)),
    ("full rank", "type_1_1", "constraint_matrix", row_again),
    ("kinematics", "type_2_0", "kinematic_matrix", more),
    ("kinematics", "type_2_0", "state_derivative", entry(0)),
    ("symmetric inertia", "type_2_0", "inertia_matrix", entry(0, 1, by=1e-4)),
    ("positive inertia", "type_2_0", "inertia_matrix", lambda value, *_: -value),
    ("positive inertia", "type_2_0", "inertia_matrix", lambda value, *_: 0.0 * value),
    ("full rank", "type_2_0", "kinematic_matrix", lambda value, *_: 0.0 * value),
    ("positive inertia", "type_2_0", "inertia_matrix", lambda value, *_: value * [[1.0, 0.0], [0.0, 0.0]]),
    ("positive inertia", "type_2_0", "inertia_matrix", lambda value, *_: value * [[1.0, 0.0], [0.0, -1.0]]),
    ("skew symmetry", "type_2_0", "coriolis_matrix", growing),
    ("dissipation", "type_2_0", "coriolis_matrix", skew_damping),
    ("dissipation", "type_2_0", "coriolis_matrix", driving),
    ("power balance", "type_2_0", "state_derivative", entry(3, by=1e-4)),
    ("power balance", "type_2_0", "input_matrix", more),
    ("power balance", "type_2_0", "inertia_matrix", more),
    ("virtual power", "type_2_0", "input_matrix", more),
    ("virtual power", "type_2_0", "coriolis_matrix", entry(0, 0, by=1e-3)),
    ("no slip", "type_2_0", "slip_matrix", entry(0, 2)),
    ("no slip", "type_1_1", "slip_matrix", entry(4, 3)),
    ("no slip", "mecanum", "kinematic_matrix", more),
    ("no slip", "mecanum", "actuator_rates_matrix", more),
    ("speeds of slip", "type_2_0", "slip_matrix", entry(0, 2)),
    ("speeds of slip", "type_1_1", "slip_matrix", entry(4, 3)),
    ("speeds of slip", "mecanum", "slip_matrix", more),
    ("constraint forces", "type_2_0", "constraint_forces", more),
    ("constraint forces", "tractor_3_trailers", "constraint_forces", entry(2, by=1e-4)),
    ("constraint forces", "type_1_2", "constraint_matrix", entry(0, 0, by=1e-4)),
    ("rolling forces", "mecanum", "rolling_forces", more),
    ("rolling forces", "type_2_1", "rolling_forces", entry(1, by=1e-4)),
    ("output Jacobian", "type_2_0", "output_jacobian", more),
    ("output rate", "type_2_0", "output_rate", more),
    ("output rate", "type_2_0", "output_jacobian", more),
    ("drift of the kinematics", "type_2_0", "lie_f2_h", more),
    ("output acceleration", "type_2_0", "lie_f2_h", more),
    ("output acceleration", "type_2_0", "lie_q_lie_f_h", more),
    ("output acceleration", "type_2_0", "decoupling_matrix", more),
    ("decoupling matrix", "mecanum", "decoupling_matrix", more),
    ("exact cancellation", "mecanum", "decoupling_matrix", more),
    ("exact cancellation", "type_2_0", "lie_f2_h", more),
    ("exact cancellation", "type_2_0", "lie_q_lie_f_h", more),
    ("known parameters", "type_2_0", "decoupling_matrix", more),
    ("known parameters", "type_2_0", "lie_q_lie_f_h", more),
    ("known parameters", "type_2_0", "inertia_matrix", more),
    ("determinant", "type_2_0", "decoupling_matrix", more),
    ("determinant", "mecanum", "decoupling_matrix", more),
    ("determinant", "type_1_1", "decoupling_matrix", more),
    ("regressor", "type_2_0", "regressor", more),
    ("minimal base parameters", "type_2_0", "regressor", column(0, 2.0)),
    ("minimal base parameters", "type_2_0", "regressor", column(0, 0.0)),
    ("minimal base parameters", "type_2_0", "regressor", nothing_known),
    ("inverse regressor", "type_1_1", "inverse_regressor", lambda value, *_: value * 1.0001),
    ("inverse regressor", "type_1_1", "inverse_base_parameters", lambda value, *_: value * 1.0001),
    ("minimal inverse parameters", "type_1_1", "inverse_regressor", column(0, 3.0)),
    ("motor factors", "mecanum", "allocation", more),
    ("passivity regressor", "type_2_0", "passivity_regressor", more),
    ("passivity regressor", "type_2_0", "passivity_parameters", lambda value, *_: value * 1.0001),
    ("momentum", "type_1_1", "rest_regressor", more),
    ("momentum", "tractor_trailer", "rest_regressor", more),
    ("minimal passivity parameters", "type_2_0", "passivity_regressor", column(0, 2.0)),
    ("groups", "type_2_0", "passivity_regressor", entry(0, 3)),
    ("effort", "mecanum", "effort_regressor", more),
    ("effort", "type_2_0_uneven", "effort_regressor", more),
    ("effort", "type_2_0_uneven", "effort_parameters", lambda value, *_: value * 1.0001),
    ("effort", "type_2_0_uneven", "gain_ratios", lambda value, *_: value * 1.0001),
    ("effort map", "type_2_1", "effort_map", entry(0, 1)),
    ("effort map", "type_2_0_uneven", "gain_ratios", lambda value, *_: value * np.array([1.0, 1.0001])),
    ("minimal effort parameters", "mecanum", "effort_regressor", column(0, 2.0)),
    ("minimal effort parameters", "type_2_0_uneven", "effort_regressor", column(0, 0.0)),
    ("output map", "type_2_0", "output_map", more),
    ("output map", "type_2_0", "output_map_rate", more),
    ("output map rate", "type_2_0", "output_map_rate", more),
    ("trusted values", "type_2_0", "output", more),
    ("libraries agree", "type_2_0", "lie_f2_h", more),
    ("Jacobians", "type_2_0", "state_jacobian", more),
    ("Jacobians", "type_2_0", "input_jacobian", more),
    ("differences", "type_2_0", "state_jacobian", more),
    ("differences", "type_2_0", "input_jacobian", more),
]


@pytest.mark.parametrize(
    ("name", "robot", "term", "change"), BROKEN, ids=lambda one: one if isinstance(one, str) else ""
)
def test_a_law_is_broken_by_what_it_forbids(name: str, robot: str, term: str, change: Change) -> None:
    """And holds without the change."""
    law, situation = law_of(name), Situation(robot, count=6)
    assert law.applies(situation.numpy)
    assert law.deviation(situation) <= law.tolerance
    assert is_broken(law, robot, term, change)


def is_broken(law: Law, robot: str, term: str, change: Change) -> bool:
    """Whether a law notices that a term is changed."""
    situation = Situation(robot, count=6)  # nothing of which is computed yet
    truth: Any = getattr(situation.numpy, term)
    setattr(situation.numpy, term, lambda *arguments: change(truth(*arguments), *arguments))
    with np.errstate(all="ignore"):
        return not law.deviation(situation) <= law.tolerance


@pytest.mark.parametrize(("name", "robot", "term"), sorted({one[:3] for one in BROKEN}))
def test_no_law_holds_for_what_is_no_number(name: str, robot: str, term: str) -> None:
    """NaN is never the smaller one of two deviations."""
    assert is_broken(law_of(name), robot, term, nothing_known)


def slightly(value: Floats, *arguments: Floats) -> Floats:
    """Another ninth digit in one entry."""
    found = np.array(value)
    found[(..., 0, -1) if found.ndim > 2 else (..., -1)] += 5e-9 * max(1.0, np.abs(found).max())
    return found


def slightly_growing(value: Floats, x: Floats, p: Floats) -> Floats:
    return value + 1e-5 * growing(0.0 * value, x, p)


CLOSE_LAWS = {one[0]: one for one in reversed(BROKEN) if law_of(one[0]).tolerance > 0.0}


@pytest.mark.parametrize("name", CLOSE_LAWS)
def test_a_law_sees_the_ninth_digit(name: str) -> None:
    """Seven where differences are taken."""
    _, robot, term, _ = CLOSE_LAWS[name]
    change = slightly_growing if name == "skew symmetry" else slightly
    if name in ("differences", "speeds of slip", "effort map"):
        change = entry(0, 0, by=1e-7)
    assert is_broken(law_of(name), robot, term, change)


@pytest.mark.parametrize(
    ("name", "term", "margin"), [("full rank", "kinematic_matrix", 1e-6), ("positive inertia", "inertia_matrix", 1e-9)]
)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_matrix_is_regular_by_a_margin(name: str, term: str, margin: float, share: float) -> None:
    """Of its least singular value or eigenvalue to its largest one, whatever the scale."""

    def nearly_singular(value: Floats, *arguments: Floats) -> Floats:
        found = np.zeros(value.shape)
        found[..., 0, 0], found[..., 1, 1] = 1e3, 1e3 * share * margin
        return found

    assert is_broken(law_of(name), "type_2_0", term, nearly_singular) == (share < 1.0)


def batched(shape: Callable[[Floats], bool]) -> Change:
    """Something else where the first argument has such a shape."""

    def changed(value: Floats, first: Floats, *rest: Floats) -> Floats:
        return value + 1e-3 if shape(np.asarray(first)) else value

    return changed


@pytest.mark.parametrize(
    "change",
    [
        batched(lambda q: q.ndim == 1),
        batched(lambda q: q.ndim == 3 and q.shape[:2] == (2, 2)),
        batched(lambda q: q.ndim == 3 and q.shape[1] == 1),
        lambda value, first, *rest: value[..., :-1] if value.size == 0 else value,
    ],
)
def test_batches_of_every_shape_are_compared_with_single_calls(change: Change) -> None:
    """One state, a square of states, empty ones, and arguments that are spread over each other."""
    situation = Situation("type_2_0", count=6)
    truth = situation.numpy.output
    situation.numpy.output = lambda *arguments: change(truth(*arguments), *arguments)
    assert not law_of("batches agree").deviation(situation) <= law_of("batches agree").tolerance


def test_every_law_is_broken_once() -> None:
    """None is left out."""
    tried = {one[0] for one in BROKEN}
    elsewhere = {"batches agree", "stops of joints"}  # the latter beside robots that have some
    assert tried | elsewhere == {law.name for law in LAWS}


@pytest.mark.parametrize("name", [law.name for law in LAWS])
def test_a_law_says_to_which_models_it_applies(name: str) -> None:
    """Those with the terms that it speaks of."""
    forward, inverse = Situation("type_2_0", count=2).numpy, Situation("type_1_1", count=2).numpy
    expected = {
        "regressor": (True, False), "minimal base parameters": (True, False),
        "inverse regressor": (forward.has("inverse_regressor"), True),
        "minimal inverse parameters": (forward.has("inverse_regressor"), True),
        "stops of joints": (False, False),
    }.get(name, (True, True))  # fmt: skip
    assert (law_of(name).applies(forward), law_of(name).applies(inverse)) == expected


def test_a_situation_is_a_batch_around_the_defaults(situation: Situation) -> None:
    """As many regular states as are asked for, parameters within 30 %, base parameters and constants that follow."""
    model, count = situation.numpy, len(situation.x)
    assert count == 20
    np.testing.assert_array_equal(situation.x, np.hstack([situation.q, situation.v]))
    assert np.all(np.abs(situation.p - model.parameters()) <= 0.3 * np.abs(model.parameters()) + 1e-15)
    np.testing.assert_array_equal(situation.c, model.known(situation.p))
    np.testing.assert_array_equal(situation.theta, model.base_parameters(situation.p))
    shapes = {name: value.shape[0] for name, value in situation.arguments.items()}
    assert set(shapes.values()) == {count}
    assert len(Situation(model.name, count=3).x) == 3
    again, other = Situation(model.name, count=3), Situation(model.name, count=3, seed=1)
    np.testing.assert_array_equal(again.x, Situation(model.name, count=3).x)
    assert np.all(again.v != other.v)
    q, n = situation.q, model.coordinate_count
    units = list(model.state_units.values())[:n]
    assert np.all(np.abs(q) <= [1.2 if unit == "rad" else 3.0 for unit in units])
    conditions = condition(model.kinematic_matrix(q, model.parameters()))
    assert np.all(np.isfinite(conditions))
    assert CLOSE > 1.0


def test_derivatives_along_a_direction_are_those_of_the_term() -> None:
    """Of vectors and of matrices, by any argument; a Jacobian has a column for each entry."""
    situation, step = Situation("type_1_1", count=3), 1e-6
    rates = np.random.default_rng(0).normal(size=situation.q.shape)
    for term, given in (("output", (situation.c,)), ("inertia_matrix", (situation.p,))):
        function = getattr(situation.numpy, term)
        ahead, behind = (function(situation.q + sign * step * rates, *given) for sign in (1.0, -1.0))
        found = situation.along(term, rates, "q")
        np.testing.assert_allclose(found.reshape(ahead.shape), (ahead - behind) / (2.0 * step), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        situation.jacobian("output", "q"), situation.numpy.output_jacobian(situation.q, situation.c), atol=1e-12
    )
    assert isinstance(situation.function("output"), ca.Function)


def test_deviations_are_relative_to_the_largest_entry_or_to_one() -> None:
    """Shapes must agree; what is empty does not deviate."""
    assert relative([1.0, 2.0], [1.0, 2.5]) == 0.2
    assert relative([0.1, 0.2], [0.1, 0.3]) == pytest.approx(0.1)
    assert relative([10.0, -8.0], [10.0, -4.0]) == pytest.approx(0.4)
    assert relative(np.zeros((0, 3)), np.zeros((0, 3))) == 0.0
    with pytest.raises(ValueError, match="differ"):
        relative([1.0], [1.0, 2.0])
    matrices, vectors = np.arange(12.0).reshape(2, 2, 3), np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(times(matrices, vectors), [m @ v for m, v in zip(matrices, vectors, strict=True)])
    np.testing.assert_array_equal(transposed(matrices)[1], matrices[1].T)
    found = condition(np.array([np.diag([4.0, 2.0]), np.diag([1.0, 0.0]), [[np.nan, 0.0], [0.0, 1.0]]]))
    np.testing.assert_array_equal(found, [2.0, np.inf, np.inf])
