"""Each part of the control law against its equation, written here once more, at random arguments."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from wmr_afl.controllers import (
    DirectAdaptation,
    Effort,
    GradientAdaptation,
    Knowledge,
    Leakage,
    LeastSquares,
    LinearizingLaw,
    Normalization,
    OuterLoop,
    PassivityLaw,
    Projection,
    RobustTerm,
    TrackingLaw,
)
from wmr_afl.controllers.adaptation import AdaptationTable, relative_gain
from wmr_afl.controllers.dead_zone import DeadZone
from wmr_afl.controllers.groups import Group, groups_of
from wmr_afl.controllers.law import Action
from wmr_afl.controllers.outer_loop import OuterLoopTable, TrackingError, tracking_error
from wmr_afl.controllers.passivity_law import ErrorDynamics
from wmr_afl.controllers.projection import ProjectionTable, relative_bounds
from wmr_afl.controllers.reference import Point, Reference
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.controllers.robust_term import RobustTable
from wmr_afl.controllers.tables import ControllerTable
from wmr_afl.errors import MissingTermError, ShapeError, WmrError
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model, load_model
from wmr_afl.numerics.arrays import CASADI, NUMPY
from wmr_afl.numerics.parts import by_part
from wmr_afl.numerics.rules import Numbers
from wmr_input import InputError
from wmr_input.toml_file import validate

CLOSE = {"rtol": 1e-11, "atol": 1e-11}
NOT_POSITIVE = (0.0, -1.0, float("inf"), float("nan"))
GROUPS = (Group((0,), (0, 1)),)  # one row with two parameters


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.fixture
def model(situation: Situation) -> Model:
    return situation.numpy


def gains_of(random: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """b1 > alpha > 0 and b2 > 0, different for each output."""
    b1 = random.uniform(2.0, 3.0, count)
    return {"b1": b1, "b2": random.uniform(0.5, 1.5, count), "alpha": b1 * random.uniform(0.2, 0.8, count)}


def point_near(model: Model, x: np.ndarray, c: np.ndarray, random: np.random.Generator) -> Point:
    """A reference a little off what the outputs are at x, so that an error of an angle is no whole turn."""
    here = model.output(x[: model.coordinate_count], c)
    off, velocity, acceleration = random.normal(size=(3, len(here)))
    return Point(here + 0.3 * off, velocity, acceleration)


def robust_term(random: np.random.Generator) -> tuple[RobustTerm, SimpleNamespace, SimpleNamespace]:
    """A robust term with random gains, and random states of it."""
    gamma, mu, decay, leakage = random.uniform(0.2, 2.0, 4)
    robust = RobustTerm(gamma, mu, decay, leakage)
    z = SimpleNamespace(a_hat=random.uniform(0.1, 1.0, 2), mu=np.array([mu]))
    return robust, z, SimpleNamespace(**robust.values)


def test_the_tracking_error_is_output_less_reference(model: Model, situation: Situation, random) -> None:
    """e = h(q) - yr and e' = J_h S v - yr'."""
    x, c = situation.x[0], situation.c[0]
    point = point_near(model, x, c, random)
    error = tracking_error(x, c, point, model)
    q, v = x[: model.coordinate_count], x[model.coordinate_count :]
    rate = model.output_jacobian(q, c) @ model.kinematic_matrix(q, situation.p[0]) @ v
    np.testing.assert_allclose(error.e, model.output(q, c) - point.position, **CLOSE)
    np.testing.assert_allclose(error.e_dot, rate - point.velocity, **CLOSE)


@pytest.mark.parametrize("outputs", [1, 2, 3])
def test_the_outer_loop_reads_like_its_equations(outputs: int, random) -> None:
    """eta = yr'' + b1 (yr' - y') + b2 (yr - y) (27) and E1 = e' + alpha e (34), each output by its own gains."""
    gains = gains_of(random, outputs)
    loop = OuterLoop(outputs, **gains)
    e, rate, wanted = random.normal(size=(3, outputs))
    error, k = TrackingError(e, rate), SimpleNamespace(**loop.values)
    expected = wanted - gains["b1"] * rate - gains["b2"] * e
    np.testing.assert_allclose(loop.acceleration(error, Point(e, rate, wanted), k), expected, rtol=1e-14)
    np.testing.assert_allclose(loop.filtered_error(error, k), rate + gains["alpha"] * e, rtol=1e-14)
    assert list(loop.values) == ["b1", "b2", "alpha"]


def test_a_given_alpha_makes_no_rule_and_a_missing_one_follows() -> None:
    """alpha = b2/b1 for each robot, unless alpha is given."""
    assert OuterLoopTable(b1=2.0, b2=1.0, alpha=0.3).rules() == {}
    b1, b2 = np.array([[2.0, 4.0], [5.0, 8.0]]), np.array([[1.0, 3.0], [1.0, 2.0]])
    numbers = Numbers(OuterLoopTable(b1=2.0, b2=1.0).rules(), {"outer_loop.b1": b1, "outer_loop.b2": b2})
    np.testing.assert_array_equal(numbers["outer_loop.alpha"], [[0.5, 0.75], [0.2, 0.25]])


def test_the_linearizing_law_gives_the_wanted_acceleration_at_least_cost(model, situation, random) -> None:
    """Dhat u = eta - L_f^2 h - L_q L_f h_hat (25), and weights u is orthogonal to what D does not see."""
    x, theta, c = situation.x[0], situation.theta[0], situation.c[0]
    weights = random.uniform(0.2, 5.0, len(model.input_units))
    law = LinearizingLaw(len(weights), weights)
    u, regularity = law.inputs(x, situation.eta[0], theta, c, SimpleNamespace(**law.values), model)
    D = model.decoupling_matrix(x, theta, c)
    wanted = situation.eta[0] - model.lie_f2_h(x, c) - model.lie_q_lie_f_h(x, theta, c)
    np.testing.assert_allclose(D @ u, wanted, rtol=1e-9, atol=1e-9)
    unseen = np.linalg.svd(D)[2][len(D) :]
    np.testing.assert_allclose(unseen @ (weights * u), 0.0, atol=1e-8 * max(1.0, np.abs(weights * u).max()))
    assert regularity > 0.0


def test_without_weights_every_motor_costs_the_same() -> None:
    """The weights are one unless given, also in a law that is built without a linearizing part."""
    np.testing.assert_array_equal(LinearizingLaw(3).values["input_weights"], np.ones(3))
    model = load_model("mecanum")
    p = model.parameters()
    law = TrackingLaw(Knowledge(model, model.known(p), model.base_parameters(p)), OuterLoop(3, 2.0, 1.0))
    np.testing.assert_array_equal(law.values["linearizing.input_weights"], np.ones(4))


@pytest.mark.parametrize(
    "make",
    [
        lambda: LinearizingLaw(2, [1.0, 0.0]),
        lambda: LinearizingLaw(2, -1.0),
        lambda: Leakage(2, [0.1, -1e-9]),
        lambda: Normalization(0.0),
        lambda: Normalization(-1.0),
        lambda: Normalization(float("inf")),
        lambda: Normalization(float("nan")),
        lambda: RobustTerm(gamma=1.0, mu_decay=-1.0),
        lambda: RobustTerm(gamma=1.0, leakage=-1.0),
        lambda: RobustTerm(gamma=-1.0),
        lambda: RobustTerm(gamma=1.0, mu=-1.0),
        lambda: Projection(2, 1.0, 1.0),
        lambda: Effort(2, [1.0, 0.0]),
        lambda: Effort(2, -1.0),
        lambda: Effort(2, 1.0, limit=0.0),
        lambda: Effort(2, 1.0, limit=float("nan")),
        *(lambda rate=rate: ErrorDynamics(rate) for rate in NOT_POSITIVE),
        *(lambda rate=rate: ReferenceModel(2, rate) for rate in NOT_POSITIVE),
        *(lambda gain=gain: DirectAdaptation(GROUPS, gain, [1.0], [1.0, 1.0]) for gain in NOT_POSITIVE),
        *(lambda inertia=inertia: DirectAdaptation(GROUPS, 1.0, [inertia], [1.0, 1.0]) for inertia in NOT_POSITIVE),
        *(lambda spread=spread: LeastSquares(GROUPS, 1, [1.0, 1.0], [1.0, spread]) for spread in NOT_POSITIVE),
        *(
            lambda key=key, number=number: LeastSquares(GROUPS, 1, [1.0, 1.0], [1.0, 1.0], **{key: number})
            for key in ("noise", "filter", "memory")
            for number in NOT_POSITIVE
        ),
    ],
)
def test_a_number_with_which_a_part_means_nothing_is_refused(make) -> None:
    """Weights, rates, gains, noise and spread are positive numbers, leakage is not negative, bounds leave something."""
    with pytest.raises(WmrError, match=r"choose|guess|leave nothing"):
        make()


def test_numbers_at_the_edge_of_what_means_something_are_taken() -> None:
    """Leakage may be zero, mu may stay if a_hat leaks, and a_hat need not leak if mu decays."""
    assert Leakage(2, 0.0).sigma.tolist() == [0.0, 0.0]
    assert RobustTerm(gamma=1.0, mu_decay=0.0, leakage=0.1).gains["mu_decay"] == 0.0
    assert RobustTerm(gamma=1.0, mu_decay=0.1, leakage=0.0).gains["leakage"] == 0.0
    usual = RobustTable(gamma=2.0)
    assert (usual.mu, usual.mu_decay, usual.leakage) == (1.0, 1.0, 0.0)
    assert RobustTerm(gamma=2.0).gains == {"gamma": 2.0, "mu_decay": 1.0, "leakage": 0.0}
    assert RobustTerm(gamma=2.0).start_mu.tolist() == [1.0]


@pytest.mark.parametrize("outputs", [2, 3])
def test_the_robust_term_reads_like_its_equations(outputs: int, random) -> None:
    """vR (71) with rho (70), a_hat' (73) with leakage inside gamma, mu' (72) integrated exactly."""
    robust, z, k = robust_term(random)
    v, E1 = random.normal(size=(2, outputs))
    gains, step = robust.gains, 0.03
    rho = np.array([np.linalg.norm(v), 1.0]) @ z.a_hat
    expected = -2.0 * rho**2 * E1 / (2.0 * rho * np.linalg.norm(E1) + z.mu[0])
    np.testing.assert_allclose(robust.acceleration(v, E1, z, NUMPY), expected, rtol=1e-13)
    growth = np.array([np.linalg.norm(v), 1.0]) * np.linalg.norm(E1) - gains["leakage"] * z.a_hat
    after = robust.update(v, E1, z, k, NUMPY, step)
    np.testing.assert_allclose(after["a_hat"], z.a_hat + step * gains["gamma"] * growth, rtol=1e-13)
    np.testing.assert_allclose(after["mu"], z.mu * np.exp(-gains["mu_decay"] * step), rtol=1e-14)
    assert set(after) == set(robust.states)
    np.testing.assert_array_equal(robust.states["a_hat"], [0.0, 0.0])
    np.testing.assert_array_equal(robust.states["mu"], z.mu)


def test_the_robust_term_is_zero_on_the_reference_once_mu_has_decayed() -> None:
    """0/0 does not arise, in either library."""
    robust = RobustTerm(1.0)
    z = SimpleNamespace(a_hat=np.ones(2), mu=np.zeros(1))
    np.testing.assert_array_equal(robust.acceleration(np.ones(2), np.zeros(2), z, NUMPY), [0.0, 0.0])
    symbolic = SimpleNamespace(a_hat=ca.DM([1.0, 1.0]), mu=ca.DM([0.0]))
    assert robust.acceleration(ca.DM([1.0, 1.0]), ca.DM([0.0, 0.0]), symbolic, CASADI).full().tolist() == [[0.0], [0.0]]


def adaptation_of(random: np.random.Generator, count: int, dense: bool) -> GradientAdaptation:
    """Every modification at once, and a gain that is a full matrix or a diagonal."""
    root = random.normal(size=(count, count))
    gain = root @ root.T + np.eye(count) if dense else random.uniform(0.5, 2.0, count)
    table = AdaptationTable(gain=1.0, normalization=0.7, leakage=random.uniform(0.1, 0.5, count).tolist())
    modifications = table.modifications([f"theta{i}" for i in range(count)])
    return GradientAdaptation(count, gain, modifications, Projection(count, -1e3, 1e3))


@pytest.mark.parametrize("dense", [True, False])
def test_the_estimates_follow_the_gradient_then_normalization_then_leakage(dense: bool, random) -> None:
    """theta_hat' = Gamma (W^T E1/(1 + n |W|^2) - Sigma theta_hat) (25), (51), Remark 5: leakage is not normalized."""
    W, E1, theta = random.normal(size=(2, 4)), random.normal(size=2), random.normal(size=4)
    one = adaptation_of(random, 4, dense)
    k = by_part({f"{part.name}.{name}": value for part in one.parts for name, value in part.values.items()})
    sigma = next(part.sigma for part in one.modifications if isinstance(part, Leakage))
    gain = one.gain if dense else np.diag(one.gain)
    rate = gain @ (W.T @ E1 / (1.0 + 0.7 * np.sum(W**2)) - sigma * theta)
    np.testing.assert_allclose(one.update(W, E1, theta, k, NUMPY, 0.1), theta + 0.1 * rate, rtol=1e-13)


def test_errors_within_the_dead_zone_teach_nothing(random) -> None:
    """Beyond it the estimates move as without; leakage acts in it, too, for it comes after."""
    W, theta = random.normal(size=(2, 3)), random.normal(size=3)
    for setting in ({}, {"leakage": 0.2}):
        table = AdaptationTable(gain=1.0, dead_zone=0.5, **setting)
        modifications = table.modifications(["theta1", "theta2", "theta3"])
        free = GradientAdaptation(3, 1.0, [part for part in modifications if not isinstance(part, DeadZone)])
        one = GradientAdaptation(3, 1.0, modifications)
        k = by_part({f"{part.name}.{name}": value for part in one.parts for name, value in part.values.items()})
        for E1, counts in (([0.3, 0.39], 0.0), ([0.3, 0.41], 1.0), ([-0.6, 0.0], 1.0)):
            expected = free.update(W, counts * np.array(E1), theta, k, NUMPY, 0.1)
            np.testing.assert_array_equal(one.update(W, np.array(E1), theta, k, NUMPY, 0.1), expected)


def test_the_projection_acts_on_the_estimate_after_its_step(random) -> None:
    """theta_hat is the nearest one within the bounds, whichever bound there is."""
    W, E1 = np.eye(2), np.array([10.0, -10.0])
    for bounds, expected in (
        ({"lower": -1.0}, [10.0, -1.0]),
        ({"upper": 2.0}, [2.0, -10.0]),
        ({"lower": [-np.inf, -3.0], "upper": [4.0, np.inf]}, [4.0, -3.0]),
        ({}, [10.0, -10.0]),
    ):
        projection = Projection(2, **bounds)
        one = GradientAdaptation(2, 1.0, projection=projection)
        k = by_part({f"{part.name}.{name}": value for part in one.parts for name, value in part.values.items()})
        np.testing.assert_array_equal(one.update(W, E1, np.zeros(2), k, NUMPY, 1.0), expected)
        assert set(projection.values) == set(bounds)


def test_a_first_estimate_may_lie_on_a_bound_but_not_beyond() -> None:
    """lower <= theta_hat(0) <= upper, each end included."""
    bounds = Projection(2, [1.0, 1.0], [2.0, 2.0])
    bounds.check(np.array([1.0, 2.0]), ["a", "b"])
    for wrong in ([0.999, 1.5], [1.5, 2.001]):
        with pytest.raises(WmrError, match=r"the first estimate of [ab]"):
            bounds.check(np.array(wrong), ["a", "b"])


def test_what_is_relative_to_the_first_estimate_is_so_for_negative_ones_and_for_batches() -> None:
    """Gamma_i = g theta_i^2 and theta -+ share |theta|, which stays an interval if theta is negative."""
    theta = np.array([[2.0, -3.0], [1.0, 0.5]])
    np.testing.assert_array_equal(relative_gain(theta, 0.5), [[2.0, 4.5], [0.5, 0.125]])
    lower, upper = relative_bounds(theta, 0.5)
    np.testing.assert_array_equal(lower, [[1.0, -4.5], [0.5, 0.25]])
    np.testing.assert_array_equal(upper, [[3.0, -1.5], [1.5, 0.75]])
    numbers = Numbers(
        {**ProjectionTable(relative=0.5).rules(), **AdaptationTable(relative_gain=0.5).rules()}, {"theta_hat": theta}
    )
    np.testing.assert_array_equal(numbers["projection.lower"], lower)
    np.testing.assert_array_equal(numbers["projection.upper"], upper)
    np.testing.assert_array_equal(numbers["adaptation.Gamma"], relative_gain(theta, 0.5))
    assert ProjectionTable(lower=0.1).rules() == {}
    assert AdaptationTable(gain=1.0).rules() == {}


def test_leakage_by_name_is_zero_where_no_name_stands() -> None:
    """A table names what leaks, a number holds for all."""
    names = ["theta1", "theta2", "theta3"]
    assert Leakage.from_setting({"theta2": 0.3}, names).sigma.tolist() == [0.0, 0.3, 0.0]
    assert Leakage.from_setting(0.2, names).sigma.tolist() == [0.2, 0.2, 0.2]
    assert Leakage.from_setting([0.1, 0.2, 0.3], names).sigma.tolist() == [0.1, 0.2, 0.3]
    assert Normalization.from_setting(0.4, names).weight.tolist() == [0.4]


@pytest.mark.parametrize(
    ("table", "given", "words"),
    [
        (AdaptationTable, {}, "names no or two gains"),
        (AdaptationTable, {"gain": 1.0, "relative_gain": 1.0}, "names no or two gains"),
        (AdaptationTable, {"gain": 1.0, "normalization": 0.0}, "normalization"),
        (AdaptationTable, {"gain": 1.0, "dead_zone": 0.0}, "dead_zone"),
        (ProjectionTable, {"relative": 0.5, "lower": 0.1}, "relative and absolute"),
        (ProjectionTable, {"relative": 0.5, "upper": 0.1}, "relative and absolute"),
        (RobustTable, {"gamma": 0.0}, "gamma"),
    ],
)
def test_a_table_of_a_controller_that_means_nothing_is_refused(table: type, given: dict, words: str) -> None:
    """Each key has one meaning, and those that exclude each other are refused together."""
    with pytest.raises(InputError, match=words):
        validate(given, table, "file")


@pytest.mark.parametrize("is_robust", [True, False])
def test_the_whole_law_is_its_parts_put_together(model, situation, random, is_robust: bool) -> None:
    """Dhat u = eta + vR - L_f^2 h - L_q L_f h_hat (25), (74), for every robot."""
    x, c, theta = situation.x[1], situation.c[1], situation.theta[2]
    outer = OuterLoop(len(model.output_units), **gains_of(random, len(model.output_units)))
    robust, states, _ = robust_term(random)
    law = TrackingLaw(Knowledge(model, c, theta), outer, robust=robust if is_robust else None)
    z = SimpleNamespace(theta_hat=theta, robust=states)
    point = point_near(model, x, c, random)
    action = law.act(x, point, z, by_part(law.values), model, 0.01)
    error, k = tracking_error(x, c, point, model), SimpleNamespace(**outer.values)
    E1, v = outer.filtered_error(error, k), x[model.coordinate_count :]
    eta = outer.acceleration(error, point, k) + (robust.acceleration(v, E1, states, NUMPY) if is_robust else 0.0)
    gives = model.decoupling_matrix(x, theta, c) @ action.input
    gives += model.lie_f2_h(x, c) + model.lie_q_lie_f_h(x, theta, c)
    np.testing.assert_allclose(gives, eta, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(action.memory["filtered_error"], E1, rtol=1e-14)
    assert action.regularity > 0.0


@pytest.mark.parametrize("is_adaptive", [True, False])
def test_the_law_updates_its_states_as_its_parts_do(model, situation, random, is_adaptive: bool) -> None:
    """theta_hat by (25), or frozen; a_hat and mu by (72), (73)."""
    if is_adaptive and not model.has("regressor"):
        pytest.skip(f"{model.name} has no regressor")
    x, c, theta, u = situation.x[1], situation.c[1], situation.theta[2], situation.u[3]
    count, outputs = len(theta), len(model.output_units)
    robust, states, k_robust = robust_term(random)
    adaptation = adaptation_of(random, count, True) if is_adaptive else None
    law = TrackingLaw(Knowledge(model, c, theta), OuterLoop(outputs, 2.0, 1.0), None, adaptation, robust)
    E1, z = random.normal(size=outputs), SimpleNamespace(theta_hat=theta, robust=states)
    k = by_part(law.values)
    after = law.update(x, Action(u, np.ones(1), {"filtered_error": E1}), 0.5 * u, z, k, model, 0.01)
    v = x[model.coordinate_count :]
    for name, value in robust.update(v, E1, states, k_robust, NUMPY, 0.01).items():
        np.testing.assert_allclose(after[f"robust.{name}"], value, rtol=1e-14)
    expected = theta
    if adaptation is not None:
        expected = adaptation.update(model.regressor(x, u, c), E1, theta, k, NUMPY, 0.01)
    np.testing.assert_allclose(after["theta_hat"], expected, rtol=1e-14)
    assert set(after) == set(law.states)


@pytest.mark.parametrize("is_running", [True, False])
def test_the_passivity_law_gives_what_the_estimated_robot_needs(model, situation, random, is_running: bool) -> None:
    """R u = Y(x, v_r, a, c) pi_hat with v_r, s and a as the law says, yd behind a reference model; for every robot."""
    x, c, pi_hat = situation.x[1], situation.c[1], model.passivity_parameters(situation.p[2])
    n, rate, r, step = model.coordinate_count, 2.0, 3.0, 0.02
    law = PassivityLaw(Knowledge(model, c, pi_hat, "passivity_parameters"), rate, r)
    z, k, point = by_part(law.states), by_part(law.values), point_near(model, x, c, random)
    e, e_dot = model.output(x[:n], c) - point.position, model.output_rate(x, c) - point.velocity
    d, d_dot = e, e_dot  # at the first sample yd is where the robot is
    if is_running:
        before, rate_before = 0.1 * random.normal(size=(2, len(e)))
        z.reference_model.distance, z.reference_model.distance_rate = before, rate_before
        z.reference_model.is_running = np.ones(1)
        moved = rate_before + r * before
        d = (before + moved * step) * np.exp(-r * step)
        d_dot = (rate_before - r * moved * step) * np.exp(-r * step)
    yd_dot, yd_ddot = point.velocity + d_dot, point.acceleration - 2.0 * r * d_dot - r**2 * d
    E, E_rate = model.output_map(x[:n], c), model.output_map_rate(x, c)
    v_r = np.linalg.solve(E, yd_dot - rate * (e - d))
    a = np.linalg.solve(E, yd_ddot - rate * (e_dot - d_dot) - E_rate @ v_r) - rate * (x[n:] - v_r)
    action = law.act(x, point, z, k, model, step)
    needed = model.passivity_regressor(x, v_r, a, c) @ pi_hat
    np.testing.assert_allclose(model.allocation(x[:n], c) @ action.input, needed, rtol=1e-8, atol=1e-8)
    assert action.regularity > 0.0
    after = law.update(x, action, action.input, z, k, model, step)
    assert set(after) == set(law.states)
    np.testing.assert_allclose(after["theta_hat"], pi_hat, rtol=1e-14)
    np.testing.assert_allclose(after["reference_model.distance"], d, **CLOSE)
    np.testing.assert_allclose(after["reference_model.distance_rate"], d_dot, **CLOSE)
    assert after["reference_model.is_running"] == 1.0


@pytest.mark.parametrize("memory", [0.5, 20.0])
def test_without_data_least_squares_forget_towards_the_prior(memory: float) -> None:
    """pi_hat -= dt/T P P0^-1 (pi_hat - pi_0) and P += dt/T (P - P P0^-1 P); one equation then moves nothing."""
    model, step = load_model("type_2_0"), 0.01
    groups, count = groups_of(model), len(model.units_of("passivity_parameters"))
    prior, spread = np.linspace(1.0, 2.0, count), np.linspace(0.5, 1.5, count)
    part = LeastSquares(groups, len(model.input_units), prior, spread, memory=memory)
    k, c, z = SimpleNamespace(**part.values), model.known(model.parameters()), SimpleNamespace(**part.states)
    z.covariance = part.groups.packed_diagonals(0.3 * spread**2)
    pi_hat, following = part.learn(np.zeros(5), prior + 3.0, z, k, c, model, step)
    np.testing.assert_allclose(pi_hat, prior + 3.0 - 3.0 * step / memory * 0.3, rtol=1e-12)
    expected = part.groups.packed_diagonals((0.3 + step / memory * (0.3 - 0.3**2)) * spread**2)
    np.testing.assert_allclose(following["covariance"], expected, rtol=1e-12)


def test_direct_adaptation_moves_against_the_error_group_by_group(random) -> None:
    """pi_hat -= dt kappa lambda N0/m P0 Y_^T s with m the largest Y P0 Y^T so far; by P in the place of P0 if given."""
    groups = (Group((1,), (2, 0)), Group((0,), (1,)))
    Y = np.array([[0.0, 0.7, 0.0], [0.4, 0.0, -0.6]])
    gain, rate, step, inertia, spread = 7.0, 3.0, 0.02, np.array([0.5, 2.0]), np.array([0.9, 1.1, 1.4])
    part = DirectAdaptation(groups, gain, inertia, spread)
    k, pi, s = SimpleNamespace(**part.values), random.normal(size=3), random.normal(size=2)
    z = SimpleNamespace(**part.update(Y, 1.0, SimpleNamespace(**part.states), k, NUMPY))
    largest = np.array([Y[1] @ (spread**2 * Y[1]), Y[0] @ (spread**2 * Y[0])])
    np.testing.assert_allclose(z.largest, largest, rtol=1e-14)
    gamma = gain * rate * inertia / largest
    own_gain = np.array([gamma[0], gamma[1], gamma[0]])
    expected = pi - step * own_gain * spread**2 * (Y.T @ s)
    np.testing.assert_allclose(part.learn(pi, s, rate, None, z, k, NUMPY, step), expected, rtol=1e-12)
    blocks = [[[2.0, 0.5], [0.5, 1.0]], [[3.0]]]  # in the order of the groups: parameters 2 and 0, then 1
    P = np.array([[1.0, 0.0, 0.5], [0.0, 3.0, 0.0], [0.5, 0.0, 2.0]])
    expected = pi - step * own_gain * (P @ (Y.T @ s))
    np.testing.assert_allclose(part.learn(pi, s, rate, blocks, z, k, NUMPY, step), expected, rtol=1e-12)
    z.is_running = np.zeros(1)
    np.testing.assert_array_equal(part.learn(pi, s, rate, blocks, z, k, NUMPY, step), pi)


def test_a_law_without_a_forward_form_cannot_adapt(model: Model) -> None:
    """Adaptation needs a regressor."""
    p, outputs = model.parameters(), len(model.output_units)
    knowledge = Knowledge(model, model.known(p), model.base_parameters(p))
    adaptation = GradientAdaptation(len(knowledge.theta_hat), 1.0)
    if model.has("regressor"):
        assert TrackingLaw(knowledge, OuterLoop(outputs, 2.0, 1.0), adaptation=adaptation).adaptation is adaptation
        return
    with pytest.raises(MissingTermError, match="cannot be adapted"):
        TrackingLaw(knowledge, OuterLoop(outputs, 2.0, 1.0), adaptation=adaptation)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_estimate_that_is_not_finite_is_refused(wrong: float) -> None:
    """theta_hat(0) are numbers."""
    model = load_model("type_2_0")
    theta = model.base_parameters(model.parameters())
    theta[3] = wrong
    with pytest.raises(ShapeError, match="finite"):
        Knowledge(model, model.known(model.parameters()), theta)


def test_what_the_controller_takes_for_true_follows_from_its_table(model: Model, situation: Situation) -> None:
    """c are the known constants of p; theta_hat(0) is theta(p), theta of a guess, or what is given."""
    p = situation.p[:3]
    exact = Numbers(ControllerTable().rules(model), {"p": p})
    np.testing.assert_array_equal(exact["c"], model.known(p))
    np.testing.assert_array_equal(exact["theta_hat"], model.base_parameters(p))
    uncertain = next(name for name in model.parameter_units if name not in model.known_units)
    value = 1.5 * float(p[0, list(model.parameter_units).index(uncertain)])
    guessed = Numbers(ControllerTable(guess={uncertain: value}).rules(model), {"p": p})
    np.testing.assert_array_equal(guessed["theta_hat"], model.base_parameters(model.replaced(p, {uncertain: value})))
    names = list(model.base_parameter_units)
    given = ControllerTable(estimate={name: 1.0 + i for i, name in enumerate(names)})
    np.testing.assert_array_equal(Numbers(given.rules(model), {"p": p})["theta_hat"], 1.0 + np.arange(len(names)))


def test_rules_of_all_tables_of_a_controller_are_gathered() -> None:
    """A controller's numbers follow by the rules of its outer loop, its adaptation and its projection."""
    table = ControllerTable(
        outer_loop=OuterLoopTable(b1=2.0, b2=1.0),
        adaptation=AdaptationTable(relative_gain=1.0),
        projection=ProjectionTable(relative=0.5),
    )
    names = {"c", "theta_hat", "outer_loop.alpha", "adaptation.Gamma", "projection.lower", "projection.upper"}
    assert set(table.rules(load_model("type_2_0"))) == names


def test_a_reference_over_no_times_has_no_rows() -> None:
    """(0, outputs) each."""
    assert [part.shape for part in Reference({"y1": "t", "y2": "1"}).over([])] == [(0, 2)] * 3
