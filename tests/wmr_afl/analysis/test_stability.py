"""Stability in numbers, against the same computed from the definitions; excitation of regressors that are known."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wmr_afl.analysis.excitation import (
    WEAKEST,
    estimate_error,
    excitation,
    left_open,
    listed,
    sentence,
    undetermined,
)
from wmr_afl.analysis.metrics import SETTLED, metrics
from wmr_afl.analysis.stability import (
    ErrorSystem,
    error_system,
    lyapunov_function,
    robust_lyapunov_function,
    ultimate_bound,
)
from wmr_afl.controllers import GradientAdaptation, Leakage, Normalization, OuterLoop
from wmr_afl.errors import SimulationError, WmrError
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Failure, Run

GAINS = [(2.0, 1.0, None), (3.0, 2.0, 0.1), (3.0, 2.0, 2.9), ([2.0, 5.0], [1.0, 4.0], [0.5, 2.0])]


@pytest.fixture(params=GAINS, ids=str)
def outer_loop(request: pytest.FixtureRequest) -> OuterLoop:
    return OuterLoop(2, *request.param)


def test_the_error_system_is_that_of_the_outer_loop(outer_loop: OuterLoop) -> None:
    """X' = A X + B W theta~, X = [e_1, e_1', ...], is e'' = -b1 e' - b2 e + W theta~; E1 = C X is e' + alpha e."""
    system, random = error_system(outer_loop), np.random.default_rng(0)
    e, rate, push = random.normal(size=(3, 2))
    X = np.column_stack([e, rate]).ravel()
    expected = np.column_stack([rate, -outer_loop.b1 * rate - outer_loop.b2 * e + push]).ravel()
    np.testing.assert_allclose(system.A @ X + system.B @ push, expected, rtol=1e-14)
    np.testing.assert_allclose(system.C @ X, rate + outer_loop.alpha * e, rtol=1e-14)


def lyapunov_solution(system: ErrorSystem) -> Floats:
    """P of A^T P + P A = -Q, by Kronecker products."""
    eye = np.eye(len(system.A))
    whole = np.kron(system.A.T, eye) + np.kron(eye, system.A.T)
    return np.linalg.solve(whole, -system.Q.ravel()).reshape(system.A.shape)


def test_p_is_the_solution_for_q_and_both_are_positive_definite(outer_loop: OuterLoop) -> None:
    """(41), and P B = C^T; Q = diag(2 alpha b2, 2 (b1 - alpha)) for every output."""
    system = error_system(outer_loop)
    np.testing.assert_allclose(system.P, lyapunov_solution(system), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(system.P @ system.B, system.C.T, rtol=1e-14)
    b1, b2, alpha = outer_loop.b1, outer_loop.b2, outer_loop.alpha
    np.testing.assert_allclose(np.diag(system.Q), np.column_stack([2 * alpha * b2, 2 * (b1 - alpha)]).ravel())
    assert np.count_nonzero(system.Q) == 4
    assert np.linalg.eigvalsh(system.P).min() > 0.0


@pytest.mark.parametrize("dense", [True, False])
def test_the_lyapunov_function_is_the_sum_of_its_squares(outer_loop: OuterLoop, dense: bool) -> None:
    """V = X^T P X + theta~^T Gamma^-1 theta~ (43), at one time and at many."""
    random, system = np.random.default_rng(1), error_system(outer_loop)
    gain = np.array([[2.0, 0.5], [0.5, 1.0]]) if dense else np.array([2.0, 0.25])
    inverse = np.linalg.inv(gain) if dense else np.diag(1.0 / gain)
    e, rate, theta = random.normal(size=(3, 5, 2))
    found = lyapunov_function(e, rate, theta, system, GradientAdaptation(2, gain))
    for k in range(5):
        X = np.array([e[k, 0], rate[k, 0], e[k, 1], rate[k, 1]])
        expected = X @ system.P @ X + theta[k] @ inverse @ theta[k]
        np.testing.assert_allclose(found[k], expected, rtol=1e-13)
        one = lyapunov_function(e[k], rate[k], theta[k], system, GradientAdaptation(2, gain))
        np.testing.assert_allclose(one, expected, rtol=1e-13)


def test_the_robust_lyapunov_function_adds_the_bounds_error_and_mu() -> None:
    """V1 = V + a~^T a~ / gamma + mu / k_mu (75), at many times."""
    V, error, mu = np.array([1.0, 2.0]), np.array([[3.0, 4.0], [1.0, 0.0]]), np.array([0.6, 0.3])
    found = robust_lyapunov_function(V, error, mu, gamma=0.5, mu_decay=2.0)
    np.testing.assert_allclose(found, [1.0 + 50.0 + 0.3, 2.0 + 2.0 + 0.15], rtol=1e-15)


def paper_bound(
    system: ErrorSystem, gain: Floats, sigma: Floats, theta: Floats, size: float, k: float
) -> tuple[float, float, float]:
    """(54)-(65) step by step: s1, s2 (58), kappa (61), rho, and the bounds of |X| and |theta~| (65)."""
    m_q = min(np.linalg.eigvalsh(system.Q))
    s1, s2 = 0.5 * m_q, 2.0 * sigma.min() * (1.0 - 1.0 / (2.0 * k**2))
    largest_c = np.sqrt(max(np.linalg.eigvalsh(system.C @ system.C.T)))
    rho = sigma.max() ** 2 / sigma.min() * k**2 * np.sum(theta**2) + 2.0 / m_q * largest_c**2 * size**2
    p, inverse = np.linalg.eigvalsh(system.P), 1.0 / np.linalg.eigvalsh(gain)
    kappa = min(s1 / p.max(), s2 / inverse.max())
    return np.sqrt(rho / (kappa * p.min())), np.sqrt(rho / (kappa * inverse.min())), kappa


@pytest.mark.parametrize("k", [0.8, 1.0, 3.0])
@pytest.mark.parametrize("disturbance", [0.0, 0.7])
@pytest.mark.parametrize("gain", [np.array([2.0, 0.25]), np.array([[2.0, 0.5], [0.5, 1.0]])], ids=["list", "matrix"])
def test_the_ultimate_bound_is_the_papers(outer_loop: OuterLoop, k: float, disturbance: float, gain: Floats) -> None:
    """(58), (61), (65), whether the errors or the estimates decay more slowly."""
    system, theta = error_system(outer_loop), np.array([1.5, -2.0])
    for sigma in (np.array([0.02, 0.05]), np.array([2.0, 3.0])):
        adaptation = GradientAdaptation(2, gain, [Normalization(1.0), Leakage(2, sigma)])
        found = ultimate_bound(system, adaptation, theta, disturbance, k)
        matrix = gain if gain.ndim == 2 else np.diag(gain)
        expected = paper_bound(system, matrix, sigma, theta, disturbance, k)
        np.testing.assert_allclose([found.error, found.estimate_error, found.rate], expected, rtol=1e-12)


def test_k_is_one_unless_given_and_larger_than_the_root_of_a_half() -> None:
    """Otherwise nothing decays."""
    system, adaptation = error_system(OuterLoop(2, 2.0, 1.0)), GradientAdaptation(2, 1.0, [Leakage(2, 0.1)])
    usual = ultimate_bound(system, adaptation, [1.0, 1.0], 0.1)
    assert usual == ultimate_bound(system, adaptation, [1.0, 1.0], 0.1, 1.0)
    for k in (0.5, np.sqrt(0.5)):
        with pytest.raises(WmrError, match=r"k > sqrt\(1/2\)"):
            ultimate_bound(system, adaptation, [1.0, 1.0], 0.1, k)
    for weak in (GradientAdaptation(2, 1.0), GradientAdaptation(2, 1.0, [Leakage(2, [0.1, 0.0])])):
        with pytest.raises(WmrError, match="leakage"):
            ultimate_bound(system, weak, [1.0, 1.0], 0.1)


def test_no_disturbed_error_system_leaves_the_bound() -> None:
    """(60)-(65) integrated with the worst constant disturbance: V ends below what the bound says."""
    outer_loop, sigma = OuterLoop(1, 2.0, 1.0), 0.3
    system = error_system(outer_loop)
    adaptation = GradientAdaptation(1, 2.0, [Leakage(1, sigma)])
    theta, push = np.array([1.5]), 0.4
    bound = ultimate_bound(system, adaptation, theta, push)
    X, error, step = np.array([5.0, 0.0]), np.array([3.0]), 1e-3
    for i in range(20_000):
        W = np.array([[np.sin(0.7e-3 * i)]])
        E1 = system.C @ X
        rate = system.A @ X + system.B @ (W @ error + push * np.sign(E1))
        error_rate = -2.0 * (W.T @ E1 + sigma * (error - theta))
        X, error = X + step * rate, error + step * error_rate
    assert np.linalg.norm(X) < bound.error
    assert np.linalg.norm(error) < bound.estimate_error


def run_with(regressor: Floats, step: float, names: tuple[str, ...], **changed: Any) -> Run:
    """A run of a model whose regressor is known at every sample, (T, outputs, n_theta)."""
    count = len(regressor)

    def of_state(state: Floats, u: Floats, known: Floats) -> Floats:
        return regressor[np.round(state[:, 0]).astype(int)] * u[:, :1, None]

    units = dict.fromkeys(names, "1")
    model: Any = SimpleNamespace(regressor=of_state, units_of=lambda estimated: units, base_parameters=np.ones_like)
    model.in_library = lambda library: model if library == "numpy" else None
    arrays = {
        "time": step * np.arange(count), "state": np.arange(float(count))[:, None], "input": np.ones((count, 1)),
        "command": np.full((count, 1), 9.0), "error": np.zeros((count, 1)), "reference": np.zeros((count, 1)),
        "estimate": np.zeros((count, len(names))),
    }  # fmt: skip
    return Run("AFL", model, parameters=np.ones(1), known=np.ones(1), **{**arrays, **changed})


def rotating(step: float, seconds: float) -> Floats:
    """W = [2 cos t, 3 sin t]: over whole turns the integral of W^T W is pi diag(4, 9) a turn."""
    t = step * np.arange(round(seconds / step) + 1)
    return np.stack([2.0 * np.cos(t), 3.0 * np.sin(t)], axis=-1)[:, None, :]


@pytest.mark.parametrize("step", [2.0 * np.pi / 100.0, 2.0 * np.pi / 400.0])
def test_excitation_is_the_integral_of_the_regressors_square_over_each_window(step: float) -> None:
    """(47): alpha and beta are its eigenvalues, W in units of the base parameters; windows overlap by half."""
    turn = 2.0 * np.pi
    run = run_with(rotating(step, 4.0 * turn), step, ("a", "b"))
    found = excitation(run, np.array([1.0, -0.5]), window=turn)
    per_turn = np.pi * np.array([4.0, 9.0 * 0.25])
    np.testing.assert_allclose(found.level, np.full(len(found.level), per_turn.min()), rtol=1e-2)
    np.testing.assert_allclose(found.highest, np.full(len(found.level), per_turn.max()), rtol=1e-2)
    np.testing.assert_allclose(found.starts, 0.5 * turn * np.arange(7), atol=1e-9)
    assert (found.window, found.names) == (turn, ("a", "b"))
    assert found.is_persistent
    np.testing.assert_allclose(found.directions, [1.0, 1.0])
    assert found.excited == ("a", "b")
    later = excitation(run, np.array([1.0, 1.0]), window=turn, since=turn)
    np.testing.assert_allclose(later.starts, turn + 0.5 * turn * np.arange(5), atol=2.0 * step)


@pytest.mark.parametrize("samples", [10, 14, 15, 19])
def test_every_window_ends_within_the_run(samples: int) -> None:
    """Windows of ten samples, half a window apart, as many as have all of their samples."""
    run = run_with(np.ones((samples, 1, 1)), 0.1, ("a",))
    found = excitation(run, np.ones(1), window=0.9 if samples < 11 else 1.0)
    length = 9 if samples < 11 else 10
    np.testing.assert_allclose(found.starts, 0.1 * np.arange(0, samples - length + 1, length // 2), atol=1e-12)
    np.testing.assert_allclose(found.level, 0.1 * length, rtol=1e-12)


def test_a_window_without_excitation_is_enough_to_break_persistence() -> None:
    """Every window must excite, though the whole run determines everything."""
    step = 2.0 * np.pi / 100.0
    regressor = rotating(step, 6.0 * 2.0 * np.pi)
    regressor[:, :, 1] *= (np.arange(len(regressor)) < 250)[:, None]
    found = excitation(run_with(regressor, step, ("a", "b")), np.ones(2), window=2.0 * np.pi)
    assert found.level.max() > 1.0
    assert found.level.min() < WEAKEST
    assert not found.is_persistent
    assert found.excited == ("a", "b")


def test_a_parameter_that_acts_like_another_is_not_determined_by_itself() -> None:
    """Each of two with the same column has half a share of its axis, a third one has its whole."""
    t = np.linspace(0.0, 20.0, 2001)
    column, other = np.sin(t), np.cos(2.0 * t)
    regressor = np.stack([column, column, other], axis=-1)[:, None, :]
    found = excitation(run_with(regressor, t[1], ("a", "b", "c")), np.ones(3), window=5.0)
    np.testing.assert_allclose(found.directions, [0.5, 0.5, 1.0], atol=1e-9)
    assert found.excited == ("c",)
    assert not found.is_persistent


def test_excitation_counts_the_input_that_was_applied() -> None:
    """W is linear in u: half the voltage, a quarter of the integral."""
    step = 2.0 * np.pi / 100.0
    regressor = rotating(step, 2.0 * 2.0 * np.pi)
    full, half = (
        excitation(run_with(regressor, step, ("a", "b"), input=np.full((len(regressor), 1), u)), np.ones(2), 6.0)
        for u in (1.0, 0.5)
    )
    np.testing.assert_allclose(half.level, 0.25 * full.level, rtol=1e-12)


def test_a_run_shorter_than_a_window_excites_nothing_that_could_be_said() -> None:
    """It is refused; a run as long as the window is not."""
    regressor = rotating(0.5, 10.0)
    run = run_with(regressor, 0.5, ("a", "b"))
    assert len(excitation(run, np.ones(2), window=10.0).starts) == 1
    for window, since in ((10.5, 0.0), (10.0, 0.5), (0.1, 10.0), (1.0, 50.0)):
        with pytest.raises(SimulationError, match="holds no window"):
            excitation(run, np.ones(2), window, since)


def test_what_deviations_leave_open_is_undetermined() -> None:
    """By the deviation that is left of the first one; without deviations by the share that (47) determines."""
    run = run_with(np.zeros((3, 1, 2)), 1.0, ("a", "b"), deviation=np.array([[2.0, 4.0], [1.5, 3.0], [1.02, 1.98]]))
    assert run.undetermined == undetermined(run) == ("a",)
    assert run_with(np.zeros((3, 1, 2)), 1.0, ("a", "b")).undetermined is None
    t = np.linspace(0.0, 20.0, 2001)
    regressor = np.stack([np.sin(t), np.sin(t), np.cos(2.0 * t)], axis=-1)[:, None, :]
    assert undetermined(run_with(regressor, t[1], ("a", "b", "c"))) == ("a", "b")


def test_parameters_that_act_in_undetermined_ones_only_are_left_open() -> None:
    """m acts elsewhere, c is known, and d is no parameter of its own; the sentence names what the guess stands for."""
    formulas = {"pi1": "m*r/K", "pi2": "I*r/K + c", "pi3": "m*d**2/K"}
    model: Any = SimpleNamespace(
        formulas_of=lambda estimated: formulas, parameter_units=dict.fromkeys("mIrcdK", "1"), known_units={"c": "1"},
        units_of=lambda estimated: dict.fromkeys(formulas, "1"),
    )  # fmt: skip
    assert left_open(model, "passivity_parameters", ("pi2",)) == ("I",)
    assert left_open(model, "passivity_parameters", ("pi2", "pi3")) == ("I", "d")
    assert left_open(model, "passivity_parameters", ()) == ()
    run = run_with(np.zeros((2, 1, 3)), 1.0, ("pi1", "pi2", "pi3"), deviation=np.array([[1.0, 1, 1], [0.1, 0.9, 1.0]]))
    vars(run.model).update(vars(model))
    told = "pi2 = I*r/K + c and pi3 = m*d**2/K: undetermined by this reference, the guess stands"
    assert sentence(run) == f"{told}; of I and d nothing is learned"
    assert sentence(replace(run, deviation=np.array([[1.0, 1, 1], [0.1, 0.1, 0.1]]))) == ""
    t = np.linspace(0.0, 20.0, 2001)
    regressor = np.stack([np.sin(t), np.cos(t), 0.0 * t], axis=-1)[:, None, :]
    still = run_with(regressor, t[1], ("pi1", "pi2", "pi3"))
    vars(still.model).update(vars(model))
    assert sentence(still) == "pi3 = m*d**2/K: not excited by this reference"
    assert listed(("a",)) == "a"
    assert listed(("a", "b", "c")) == "a, b and c"


def test_errors_of_estimates_are_relative() -> None:
    """(theta_hat - theta)/theta, sample by sample."""
    run = run_with(np.zeros((2, 1, 2)), 1.0, ("a", "b"), estimate=np.array([[1.0, 3.0], [2.0, -1.0]]))
    np.testing.assert_array_equal(estimate_error(run, np.array([2.0, -2.0])), [[-0.5, -2.5], [0.0, -0.5]])


def hand_made(count: int, failure: Failure | None = None, **changed: Any) -> Run:
    """A run of the differential drive, a sample a second, whose signals are made by hand."""
    arrays = {"input": np.zeros((count, 2)), "error": np.zeros((count, 2)), "estimate": np.zeros((count, 6)), **changed}
    model = load_model("type_2_0")
    return Run(
        "AFL", model, np.arange(float(count)), np.zeros((count, 5)), command=np.full((count, 2), 99.0),
        reference=np.zeros((count, 2)), parameters=model.parameters(), known=np.ones(1), failure=failure, **arrays,
    )  # fmt: skip


def test_metrics_are_those_of_the_signals() -> None:
    """The largest input of each motor, the largest estimate, errors of the whole run and of its last two sevenths."""
    error = np.tile(np.array([[7.0, -1.0]]), (8, 1))
    error[5:] = [[0.5, -0.25], [0.1, 0.2], [-0.3, 0.1]]
    volts, estimate = np.zeros((8, 2)), np.zeros((8, 6))
    volts[3], volts[4], estimate[2, 4] = [-5.0, 1.0], [2.0, -3.0], -1.23456789012
    found = metrics(hand_made(8, error=error, input=volts, estimate=estimate))
    assert pytest.approx(5.0 / 7.0) == SETTLED
    assert found["samples"] == 8
    assert found["failure"] is None
    assert found["largest_input"] == [5.0, 3.0]
    assert found["largest_estimate"] == 1.23456789
    assert found["settled_since"] == pytest.approx(5.0)
    np.testing.assert_allclose(found["rms"], np.sqrt(np.mean(error**2, axis=0)), rtol=1e-8)
    np.testing.assert_allclose(found["rms_settled"], np.sqrt(np.mean(error[5:] ** 2, axis=0)), rtol=1e-8)
    assert found["largest_error_settled"] == [0.5, 0.25]


def test_metrics_of_a_run_that_failed_are_those_that_it_has() -> None:
    """Its cause, and what came before; nothing of errors, and nothing at all without a sample."""
    found = metrics(hand_made(3, Failure(3.0, "diverged"), input=np.full((3, 2), -4.0)))
    assert found == {
        "samples": 3, "failure": "stopped at t = 3 s: diverged", "largest_input": [4.0, 4.0], "largest_estimate": 0.0,
        "estimate": dict.fromkeys(load_model("type_2_0").base_parameter_units, 0.0), "conditions": [],
        "undetermined": None,
    }  # fmt: skip
    assert metrics(hand_made(0, Failure(0.0, "at once"))) == {"samples": 0, "failure": "stopped at t = 0 s: at once"}
