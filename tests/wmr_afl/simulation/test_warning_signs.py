"""What makes a run doubtful is said where it is so, and nowhere else."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wmr_afl.controllers import (
    DirectAdaptation,
    GradientAdaptation,
    Knowledge,
    LeastSquares,
    OuterLoop,
    PassivityLaw,
    Projection,
    TrackingLaw,
)
from wmr_afl.controllers.direct_adaptation import guessed_inertia
from wmr_afl.controllers.groups import groups_of
from wmr_afl.controllers.reference import Reference
from wmr_afl.model.grip import FLOOR
from wmr_afl.model.model import load_model
from wmr_afl.model.wheel_loads import GRAVITY
from wmr_afl.plant import InputLimits, Plant
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.conditions import BEYOND, MOST, conditions
from wmr_afl.simulation.warning_signs import GROWN, OFTEN, STUCK, warning_signs

MODEL = load_model("type_2_0")
P = MODEL.parameters()
TRUTH = MODEL.base_parameters(P)
NAMES = list(MODEL.base_parameter_units)


def loop(gain: Any = 1e-4, adapts: bool = True) -> ClosedLoop:
    """A loop with limits of 5 V and bounds of half and twice the true values."""
    bounds = Projection(6, 0.5 * TRUTH, 2.0 * TRUTH)
    adaptation = GradientAdaptation(6, gain, projection=bounds) if adapts else None
    law = TrackingLaw(Knowledge(MODEL, MODEL.known(P), TRUTH), OuterLoop(2, 2.0, 1.0), adaptation=adaptation)
    plant = Plant(MODEL, P, np.zeros(5), uncertainties=[InputLimits(2, [5.0, 3.0])])
    return ClosedLoop(MODEL, plant, law, Reference({"y1": "t", "y2": "0"}), 0.02)


def signs(one: ClosedLoop | None = None, count: int = 700, numbers: Any = None, **changed: Any) -> list[str]:
    """The signs of a run of these signals; nothing is doubtful about the others."""
    one = one or loop()
    usual = {"x": np.zeros((count, 5)), "u": np.zeros((count, 2)), "command": np.ones((count, 2))}
    signals = {**usual, "theta_hat": np.tile(TRUTH, (count, 1)), **changed}
    of_robot = {**one.values, **(numbers or {})}
    return list(warning_signs(one, signals, of_robot, conditions(one, signals, of_robot)))


def test_a_run_without_doubt_has_no_sign() -> None:
    """Nor has one without samples, or one that does not adapt."""
    assert signs() == []
    assert signs(count=0) == []
    assert signs(loop(adapts=False), theta_hat=np.full((700, 6), 1e9)) == []


@pytest.mark.parametrize("motor", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_motors_are_at_their_limits_too_often(motor: int, sign: float) -> None:
    """In more than a twentieth of the samples, of either sign, any motor at its own limit."""
    limit = (5.0, 3.0)[motor]
    for share, expected in ((OFTEN + 0.01, True), (OFTEN - 0.01, False)):
        u = np.zeros((700, 2))
        u[: round(share * 700), motor] = sign * limit
        found = [one for one in signs(u=u) if "limit" in one]
        assert bool(found) == expected
        if expected:
            assert found[0].startswith(f"a motor is at its limit in {share:.0%} of the samples; follow")
    below = np.full((700, 2), sign * 2.99)
    assert [one for one in signs(u=below) if "limit" in one] == []


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("volts", [3.0, 3.2])
def test_a_wheel_that_would_need_more_friction_than_floors_have_is_named(volts: float, side: int) -> None:
    """Held at rest: one motor's torque over the radius, beside half of the weight, of either sign, at one sample."""
    p = dict(zip(MODEL.parameter_units, MODEL.parameters(), strict=True))
    needed = p["K1"] * volts / p["r"] / ((p["m_C"] + 2.0 * p["m_w"]) * GRAVITY / 2.0)
    u = np.zeros((700, 2))
    u[35, side] = -volts
    found = [one for one in signs(u=u) if "friction" in one]
    assert bool(found) == (needed > FLOOR)
    if found:
        wheel, when = ("right", "left")[side], f"{needed:.2g} at {35 * 0.02:g} s"
        assert found[0].startswith(f"wheel {wheel} would need a friction of {when}, a dry floor has 0.8; start")


def test_bounds_that_exclude_the_true_value_are_named() -> None:
    """Each base parameter that lies outside; on a bound it is inside."""
    low, high = 0.5 * TRUTH, 2.0 * TRUTH
    low[1], high[1], high[3] = 1.01 * TRUTH[1], 2.0 * TRUTH[1], TRUTH[3]
    found = signs(numbers={"projection.lower": low, "projection.upper": high})
    bounds = [one for one in found if "exclude" in one]
    assert len(bounds) == 1
    assert f"exclude {NAMES[1]} = {TRUTH[1]:.3g} of this robot" in bounds[0]


def test_an_estimate_that_grows_is_named() -> None:
    """Beyond thirty times the larger of its first and its true value, the worst one, of either sign."""
    for factor, expected in ((1.05 * GROWN, True), (0.95 * GROWN, False)):
        theta = np.tile(TRUTH, (700, 1))
        theta[10, 2] = -factor * TRUTH[2]
        found = [one for one in signs(theta_hat=theta) if "grew" in one]
        assert bool(found) == expected
        if expected:
            assert f"the estimate of {NAMES[2]} grew from {TRUTH[2]:.3g} to {factor * TRUTH[2]:.3g}" in found[0]
    started = np.tile(2.0 * TRUTH, (700, 1))
    started[10, 2] = 1.5 * GROWN * TRUTH[2]
    assert [one for one in signs(theta_hat=started) if "grew" in one] == []
    small = np.tile(0.01 * TRUTH, (700, 1))
    small[10, 2] = 0.95 * GROWN * TRUTH[2]
    assert [one for one in signs(theta_hat=small) if "grew" in one] == []


@pytest.mark.parametrize("worst", [0, 1])
def test_of_estimates_that_grow_the_one_that_means_least_is_named(worst: int) -> None:
    """By how many times its own first or true value it grew, however large another one is."""
    theta = np.tile(TRUTH, (700, 1))
    theta[10, :2] = 2.0 * GROWN * TRUTH[:2]
    theta[10, worst] *= 1.5
    found = [one for one in signs(theta_hat=theta) if "grew" in one]
    assert len(found) == 1
    assert f"the estimate of {NAMES[worst]} grew" in found[0]


def test_an_estimate_of_almost_nothing_is_measured_by_the_largest_true_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousandth of it: an estimate that begins and should end at nothing may be anything below thirty times that."""
    truth = np.where(np.arange(6) == 2, 1e-9, TRUTH)
    monkeypatch.setattr(Knowledge, "truth", lambda self, p: truth)
    for factor, expected in ((1.05, True), (0.95, False)):
        theta = np.tile(truth, (700, 1))
        theta[10, 2] = factor * GROWN * 1e-3 * truth.max()
        found = [one for one in signs(theta_hat=theta) if "grew" in one]
        assert bool(found) == expected


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_is_at_one_of_its_stops_is_named(side: float) -> None:
    """Closer than a thousandth of a radian, at whichever of two, and in how many samples."""
    model = SimpleNamespace(
        has=lambda term: term == "joint_stops",
        joint_stops=lambda q, p: np.stack([p[0] - q[:, 1], p[0] + q[:, 1]], axis=-1),
        coordinate_count=3,
    )
    one = SimpleNamespace(
        model=SimpleNamespace(in_library=lambda _: model, has=lambda _: False),
        law=SimpleNamespace(adapts=False, observes=False),
    )
    x = np.zeros((1000, 5))
    for left, share, expected in ((0.9e-3, 7, "0.7%"), (-1e-3, 500, "50.0%"), (1.1e-3, 500, None)):
        x[:share, 1] = side * (0.4 - left)
        found = warning_signs(one, {"x": x}, {"p": np.array([0.4])}, ())  # type: ignore[arg-type]
        remedy = "follow a reference that turns less sharply"
        sign = f"a joint is at its stop in {expected} of the samples; {remedy}"
        assert found == ((sign,) if expected else ())


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_an_estimate_at_its_bound_at_the_end_is_named(factor: float) -> None:
    """In more than half of the last two sevenths, at either bound; what was before does not count."""
    for share, expected in ((STUCK + 0.02, True), (STUCK - 0.02, False)):
        theta = np.tile(TRUTH, (700, 1))
        theta[:500, 4] = factor * TRUTH[4]
        theta[500 : 500 + round(share * 200), 4] = factor * TRUTH[4]
        found = signs(theta_hat=theta)
        assert bool(found) == expected
        if expected:
            assert found == [
                f"the estimate of {NAMES[4]} lies at its bound in {share:.0%} of the last samples; widen its bounds"
            ]


@pytest.mark.parametrize(("left", "doubtful"), [(0.049, False), (0.051, True)])
def test_what_least_squares_cannot_explain_is_told_with_the_noise_that_would(left: float, doubtful: bool) -> None:
    """At the end of the run, against the noise that was expected."""
    pi = np.asarray(MODEL.passivity_parameters(P))
    part = LeastSquares(groups_of(MODEL), 2, pi, np.abs(pi), noise=0.05)
    law = PassivityLaw(Knowledge(MODEL, MODEL.known(P), pi, "passivity_parameters"), 10.0, 1.0, least_squares=part)
    one = ClosedLoop(MODEL, Plant(MODEL, P, np.zeros(5)), law, Reference({"y1": "t", "y2": "0"}), 0.02)
    unexplained = np.concatenate([np.full((699, 1), 9.0), [[left]]])
    found = signs(one, theta_hat=np.tile(pi, (700, 1)), unexplained=unexplained)
    assert bool(found) == doubtful
    if doubtful:
        assert found[0].startswith("the equation of motion leaves 0.051 V s^1/2 unexplained, 0.05 was expected")
        assert found[0].endswith("choose learning.noise = 0.051")
    wild = np.tile(pi, (700, 1))
    wild[5, 0] = 2.0 * GROWN * pi[0]
    assert "raise learning.noise" in signs(one, theta_hat=wild)[0]


@pytest.mark.parametrize("dense", [True, False])
def test_an_adaptation_that_is_too_fast_for_its_samples_is_named(dense: bool) -> None:
    """dt times the largest eigenvalue of W Gamma W^T at the first sample, against the smallest alpha."""
    x, u = np.tile([0.0, 0.0, 0.3, 1.0, 0.5], (700, 1)), np.tile([2.0, -1.0], (700, 1))
    x[1:], u[1:] = 100.0, 100.0
    W = MODEL.regressor(x[0], u[0], MODEL.known(P))
    shape = np.eye(6) + 0.1 if dense else np.diag(1.0 + np.arange(6.0))
    edge = 0.5 / (0.02 * np.linalg.eigvalsh(W @ shape @ W.T).max())
    for factor, expected in ((1.02, True), (0.98, False)):
        gain = factor * edge * shape
        found = [one for one in signs(loop(gain if dense else np.diag(gain)), x=x, command=u) if "alpha" in one]
        assert bool(found) == expected
        if expected:
            assert found[0].startswith(
                f"dt eig_max(W Gamma W^T) < alpha is broken at the start ({factor * 0.5:.3g}, the bound is 0.5); sample"
            )


@pytest.mark.parametrize(("times", "doubtful"), [(1.0, False), (80.0, False), (100.0, True)])
def test_a_guess_of_far_too_much_inertia_is_named(times: float, doubtful: bool) -> None:
    """kappa dt N0/N has to stay below 2 - lambda dt: here 1 /s, 20 ms, and 10 /s."""
    pi = np.asarray(MODEL.passivity_parameters(P))
    inertia = times * guessed_inertia(MODEL, np.zeros(5), pi, MODEL.known(P))
    direct = DirectAdaptation(groups_of(MODEL), 1.0, inertia, np.abs(pi))
    law = PassivityLaw(Knowledge(MODEL, MODEL.known(P), pi, "passivity_parameters"), 10.0, 1.0, direct=direct)
    one = ClosedLoop(MODEL, Plant(MODEL, P, np.zeros(5)), law, Reference({"y1": "t", "y2": "0"}), 0.02)
    found = signs(one, theta_hat=np.tile(pi, (700, 1)))
    assert bool(found) == doubtful
    if doubtful:
        assert found == [
            "kappa dt N0/N < 2 - lambda dt is broken at the start (2, the bound is 1.8); "
            "guess a smaller inertia, sample faster or lower the rate"
        ]


def test_a_condition_is_told_where_it_is_worst() -> None:
    """Largest value with its time, and the share of samples that break it, against W and Gamma sample by sample."""
    random, one = np.random.default_rng(3), loop(0.05)
    signals = {
        "x": random.normal(size=(50, 5)), "u": np.zeros((50, 2)), "command": random.normal(size=(50, 2)),
        "theta_hat": np.tile(TRUTH, (50, 1)),
    }  # fmt: skip
    (found,) = conditions(one, signals, one.values)
    W = [MODEL.regressor(x, u, MODEL.known(P)) for x, u in zip(signals["x"], signals["command"], strict=True)]
    speeds = np.array([0.02 * 0.05 * np.linalg.norm(w, 2) ** 2 for w in W])
    assert (found.at_start, found.largest) == pytest.approx((speeds[0], speeds.max()), rel=1e-12)
    assert found.time == pytest.approx(0.02 * speeds.argmax())
    assert found.bound == 0.5
    alpha = float(np.median(speeds))
    (found,) = conditions(one, signals, {**one.values, "outer_loop.alpha": np.array([9.0, alpha])})
    assert found.share == pytest.approx(np.mean(speeds >= alpha))
    assert not found.holds
    assert f"up to {speeds.max():.3g} at {found.time:g} s, the bound is {alpha:.3g}" in str(found)


def test_numbers_that_overflow_break_a_condition() -> None:
    """Infinite or undefined speeds break it; the largest number stands for them; long runs are looked at in steps."""
    x = np.zeros((3, 5))
    x[1, 3:] = 1e200
    signals = {"x": x, "u": np.zeros((3, 2)), "command": np.ones((3, 2)), "theta_hat": np.tile(TRUTH, (3, 1))}
    (found,) = conditions(loop(), signals, loop().values)
    assert (found.largest, found.time, found.share) == (BEYOND, 0.02, pytest.approx(1.0 / 3.0))
    many = {name: np.repeat(signal[:1], 2 * MOST + 1, axis=0) for name, signal in signals.items()}
    many["x"][1] = 1e200  # every third is looked at
    (found,) = conditions(loop(), many, loop().values)
    assert found.holds
