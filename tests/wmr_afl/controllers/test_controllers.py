"""Controllers read like their equations, and refuse gains with which these mean nothing."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from wmr_afl.analysis.stability import error_system
from wmr_afl.controllers import (
    GradientAdaptation,
    Knowledge,
    Leakage,
    LinearizingLaw,
    Normalization,
    OuterLoop,
    Projection,
    TrackingLaw,
)
from wmr_afl.controllers.law import Action
from wmr_afl.controllers.outer_loop import tracking_error, within_half_a_turn
from wmr_afl.controllers.reference import Point, Reference
from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import CASADI, NUMPY
from wmr_afl.numerics.linear_algebra import determinant, least_norm, regularity, solve, solve_positive
from wmr_afl.numerics.parts import Parts, by_part


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_solving_equals_lapack(size: int) -> None:
    random = np.random.default_rng(size)
    matrix, right = random.normal(size=(size, size)), random.normal(size=size)
    np.testing.assert_allclose(solve(matrix, right, NUMPY), np.linalg.solve(matrix, right), rtol=1e-10)
    np.testing.assert_allclose(determinant(matrix.tolist()), np.linalg.det(matrix), rtol=1e-10)


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_a_positive_definite_system_is_solved_in_both_libraries(size: int) -> None:
    random = np.random.default_rng(size)
    rows = random.normal(size=(size + 2, size))
    matrix, rights = rows.T @ rows, random.normal(size=(3, size))
    expected = np.linalg.solve(matrix, rights.T).T
    for found in (
        solve_positive(matrix, rights, NUMPY),
        solve_positive(ca.DM(matrix), list(map(ca.DM, rights)), CASADI),
    ):
        np.testing.assert_allclose([np.ravel(np.array(one)) for one in found], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("rows", "columns"), [(1, 2), (2, 3), (3, 4), (3, 3)])
def test_least_norm_equals_the_pseudo_inverse(rows: int, columns: int) -> None:
    random = np.random.default_rng(rows)
    matrix, right = random.normal(size=(rows, columns)), random.normal(size=rows)
    weights = random.uniform(0.5, 2.0, columns)
    root = np.sqrt(weights)
    expected = np.linalg.pinv(matrix / root) @ right / root
    np.testing.assert_allclose(least_norm(matrix, right, weights, NUMPY), expected, rtol=1e-10)
    symbolic = least_norm(ca.SX(matrix), ca.SX(right), ca.SX(weights), CASADI)
    np.testing.assert_allclose(ca.DM(symbolic).full()[:, 0], expected, rtol=1e-10)


def test_regularity_is_positive_for_what_can_be_inverted_whatever_the_scale_of_rows() -> None:
    rotation, scale = np.array([[0.6, -0.8], [0.8, 0.6]]), np.diag([1e-8, 1e8])
    for regular in (rotation, np.array([[1.0, 0.0], [1.0, 2e-9]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])):
        assert regularity(regular, NUMPY) > 0.0
        assert regularity(scale @ regular, NUMPY) > 0.0
    for singular in ([[1.0, 2.0], [2.0, 4.0]], [[1.0, 0.0], [1.0, 5e-10]], [[0.0, 0.0], [0.0, 0.0]]):
        assert regularity(np.array(singular), NUMPY) <= 0.0
        assert regularity(scale @ np.array(singular), NUMPY) <= 0.0
    assert not regularity(np.array([[np.nan, 0.0], [0.0, 1.0]]), NUMPY) > 0.0


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        ({"b1": 2.0, "b2": 1.0, "alpha": 2.0}, "strictly positive real"),
        ({"b1": 2.0, "b2": 1.0, "alpha": 0.0}, "strictly positive real"),
        ({"b1": 1.0, "b2": 2.0}, "b1 > alpha > 0"),
        ({"b1": 2.0, "b2": -1.0}, "b2 > 0"),
        ({"b1": [2.0, 0.0], "b2": 1.0}, "b1 > 0"),
    ],
)
def test_gains_that_are_not_strictly_positive_real_are_refused(gains: dict, words: str) -> None:
    with pytest.raises(WmrError, match=words):
        OuterLoop(2, **gains)


def test_alpha_is_the_papers_unless_given() -> None:
    np.testing.assert_array_equal(OuterLoop(2, b1=[2.0, 4.0], b2=1.0).alpha, [0.5, 0.25])


@pytest.mark.parametrize("gains", [(2.0, 1.0, None), (3.0, 2.0, 0.1), (3.0, 2.0, 2.9)])
def test_p_and_q_solve_the_lyapunov_equation_of_the_positive_real_lemma(gains) -> None:
    """(36), (41)"""
    system = error_system(OuterLoop(3, *gains))
    np.testing.assert_allclose(system.A.T @ system.P + system.P @ system.A, -system.Q, atol=1e-14)
    np.testing.assert_allclose(system.P @ system.B, system.C.T, atol=1e-14)
    assert np.linalg.eigvalsh(system.P).min() > 0
    assert np.linalg.eigvalsh(system.Q).min() > 0


@pytest.mark.parametrize("gain", [[[1.0, 2.0], [2.0, 1.0]], [[1.0, 1.0], [0.0, 1.0]], [1.0, -1.0], 0.0])
def test_an_adaptation_gain_that_is_not_positive_definite_is_refused(gain) -> None:
    with pytest.raises(WmrError, match="positive definite"):
        GradientAdaptation(2, gain)


def change(adaptation: GradientAdaptation, regressor, error, theta_hat) -> np.ndarray:
    """theta_hat' of (25)."""
    k = by_part(Parts(adaptation.parts).values)
    return adaptation.update(regressor, error, theta_hat, k, NUMPY, 1.0) - theta_hat


def test_a_diagonal_gain_means_the_diagonal_matrix() -> None:
    regressor, error = np.array([[1.0, 2.0, 3.0], [0.5, 0.0, -1.0]]), np.array([0.3, -0.2])
    diagonal, matrix = GradientAdaptation(3, [1.0, 2.0, 3.0]), GradientAdaptation(3, np.diag([1.0, 2.0, 3.0]))
    rates = [change(one, regressor, error, np.ones(3)) for one in (diagonal, matrix)]
    np.testing.assert_allclose(rates[0], np.array([1.0, 2.0, 3.0]) * (regressor.T @ error))
    np.testing.assert_allclose(rates[1], rates[0])


@pytest.mark.parametrize(
    "make",
    [
        lambda: GradientAdaptation(3, [1.0, 2.0]),
        lambda: OuterLoop(2, b1=[1.0, 2.0, 3.0], b2=1.0),
        lambda: OuterLoop(2, b1=float("inf"), b2=1.0),
        lambda: LinearizingLaw(2, [1.0, 2.0, 3.0]),
    ],
)
def test_gains_of_a_wrong_size_are_refused(make) -> None:
    with pytest.raises(ShapeError, match="expected"):
        make()


def test_bounds_must_leave_something() -> None:
    with pytest.raises(WmrError, match="lower < upper"):
        Projection(2, lower=1.0, upper=[2.0, 1.0])


def test_projection_moves_only_what_is_outside() -> None:
    projection = Projection(3, lower=[0.1, -np.inf, 0.0], upper=[np.inf, 1.0, 2.0])
    projected = projection.project(np.array([-5.0, -5.0, 5.0]), SimpleNamespace(**projection.values), NUMPY)
    np.testing.assert_array_equal(projected, [0.1, -5.0, 2.0])


def test_the_estimate_must_fit_the_model(situation: Situation) -> None:
    model = situation.numpy
    with pytest.raises(ShapeError, match="estimate"):
        Knowledge(model, model.known(model.parameters()), [1.0])


def test_normalized_adaptation_is_the_gradient_over_one_plus_the_regressors_square() -> None:
    """Remark 5, and with it the rate stays bounded however large the regressor."""
    regressor, error = np.array([[1.0, 2.0, 3.0], [0.5, 0.0, -1.0]]), np.array([0.3, -0.2])
    one = GradientAdaptation(3, 2.0, [Normalization(0.7)])
    expected = 2.0 * regressor.T @ error / (1.0 + 0.7 * np.sum(regressor**2))
    np.testing.assert_allclose(change(one, regressor, error, np.zeros(3)), expected, rtol=1e-14)
    sizes = [np.linalg.norm(change(one, 10.0**n * regressor, error, np.zeros(3))) for n in range(12)]
    assert max(sizes) < 1.0


def test_leakage_pulls_each_estimate_by_its_own_rate() -> None:
    """(51) with a diagonal Sigma."""
    one = GradientAdaptation(2, [2.0, 3.0], [Leakage(2, [0.1, 0.2])])
    rate = change(one, np.zeros((2, 2)), np.zeros(2), np.array([5.0, -7.0]))
    np.testing.assert_allclose(rate, [-2.0 * 0.1 * 5.0, 3.0 * 0.2 * 7.0], rtol=1e-14)


@pytest.mark.parametrize("sees_applied", [False, True])
def test_adaptation_sees_the_commanded_or_the_applied_input(sees_applied: bool) -> None:
    """theta_hat' = Gamma W^T E1 with W at the one or the other, which saturation makes differ."""
    model = load_model("type_2_0")
    p = model.parameters()
    adaptation = GradientAdaptation(6, 1.0, sees_applied=sees_applied)
    knowledge = Knowledge(model, model.known(p), model.base_parameters(p))
    law = TrackingLaw(knowledge, OuterLoop(2, 2.0, 1.0), adaptation=adaptation)
    z, k = by_part(law.states), by_part(law.values)
    x = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    action = Action(np.array([9.0, -4.0]), np.array(1.0), {"filtered_error": np.array([0.3, -0.2])})
    applied = np.array([2.0, -1.0])
    found = law.update(x, action, applied, z, k, model, 0.1)["theta_hat"]
    regressor = model.regressor(x, applied if sees_applied else action.input, knowledge.known)
    np.testing.assert_allclose(
        found, knowledge.theta_hat + 0.1 * regressor.T @ action.memory["filtered_error"], rtol=1e-12
    )


def test_an_angle_is_compared_modulo_a_turn_and_other_outputs_are_not(robot: str) -> None:
    """The same pose with a heading that is turns apart asks for the same motion; a reference may count turns."""
    s = Situation(robot, count=5)
    outputs = [index for index, unit in enumerate(s.numpy.output_units.values()) if unit == "rad"]
    for x, c in zip(s.x, s.c, strict=True):
        y = np.asarray(s.numpy.output(x[: s.numpy.coordinate_count], c))
        for shift in (-4.0 * np.pi, 0.0, 2.0 * np.pi):
            position = y - 0.1
            position[outputs] += shift
            zero = np.zeros_like(y)
            error = tracking_error(x, c, Point(position, zero, zero), s.numpy).e
            np.testing.assert_allclose(error, 0.1, atol=1e-12)
            counted = tracking_error(x, c, Point(position, zero, zero, counts_turns=True), s.numpy).e
            np.testing.assert_allclose(counted[outputs], 0.1 - shift, atol=1e-12)


def test_the_shorter_way_round_is_taken_from_either_side() -> None:
    angles = np.array([-np.pi, -3.0, 0.0, 3.0, 3.14159, 4.0, -4.0, 100.0])
    found = within_half_a_turn(angles, NUMPY)
    np.testing.assert_array_equal(found[:5], angles[:5])  # to the bit
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles), atol=1e-12)
    assert np.all(np.abs(found) <= np.pi)


def test_a_reference_names_every_output_once_in_any_order() -> None:
    model = load_model("type_2_0")
    plain, turned = Reference({"y1": "t", "y2": "2*t"}), Reference({"y2": "2*t", "y1": "t"})
    np.testing.assert_array_equal(turned.ordered(list(model.output_units)).at(3.0).position, plain.at(3.0).position)
    with pytest.raises(UnknownNameError, match="unknown output 'lat'"):
        Reference({"lat": "t", "lon": "t"}).ordered(list(model.output_units))
    with pytest.raises(WmrError, match="output 'y2' has no reference; add y2"):
        Reference({"y1": "t"}).ordered(list(model.output_units))


def test_what_is_built_cannot_be_changed() -> None:
    """What was traced from it, and others that share it, would not notice."""
    loop = load_experiment("study_1").loops["AFL"]
    for one, name in (
        (loop.law, "adaptation"), (loop.law.outer_loop, "b1"), (loop.law.knowledge, "theta_hat"), (loop.plant, "start"),
        (loop.reference, "expressions"),
    ):  # fmt: skip
        with pytest.raises(AttributeError, match="is fixed once it is built"):
            setattr(one, name, getattr(one, name))
    for array in (*loop.values.values(), *loop.states.values()):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0
