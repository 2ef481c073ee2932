"""What a call of a controller takes and gives, at the borders of what it takes."""

import pickle
from typing import Any

import numpy as np
import pytest

from wmr_afl import Controller, ShapeError, SimulationError, WmrError
from wmr_afl.controllers.live_reference import ReferenceBuffer
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.status import Status

X = np.array([15.0, 25.0, 0.1, 0.2, 0.05])
POSE = np.array([2.6, 5.4, 0.7, 0.1, 0.0])


@pytest.mark.parametrize(
    ("passed", "step"),
    [(0.02 * (1.0 + 5e-7), 0.02), (0.02 * (1.0 - 5e-7), 0.02), (0.02 * (1.0 + 2e-6), None), (0.02 * (1.0 - 2e-6), None),
     (0.01, None), (0.05, None)],
)  # fmt: skip
def test_jitter_of_a_clock_is_no_other_step(passed: float, step: float | None) -> None:
    """A millionth of a sample time; more is the time that passed. The first step is a sample time."""
    controller = Controller.from_experiment("study_1")
    controller.update(0.0, X)
    assert controller.last_step == 0.02
    controller.update(passed, X)
    assert controller.last_step == (passed if step is None else step)
    controller.update(passed, X + 0.1)  # the same sample again
    assert controller.last_step == (passed if step is None else step)
    with pytest.raises(SimulationError):
        controller.update(9.0, np.full(5, np.nan))
    assert controller.last_step == (passed if step is None else step)
    controller.reset()
    assert controller.last_step == 0.02


def test_after_a_refusal_time_goes_on_from_the_last_sound_sample() -> None:
    """As if there had been no call; the refused sample may come again, sound."""
    controller, other = (Controller.from_experiment("study_1") for _ in range(2))
    for one in (controller, other):
        one.update(0.0, X)
    with pytest.raises(SimulationError):
        controller.update(0.02, np.full(5, np.nan))
    np.testing.assert_array_equal(controller.update(0.04, X), other.update(0.04, X))
    np.testing.assert_array_equal(controller.states, other.states)
    assert controller.last_step == 0.04


@pytest.mark.parametrize("t", [-5.0, 0.0, 9.9e10, -9.9e10])
def test_a_clock_may_begin_anywhere(t: float) -> None:
    live, zero = Controller.from_experiment("study_1", is_live=True), np.zeros(2)
    assert np.isfinite(live.update(t, X, (zero, zero, zero))).all()
    live.reset()
    with pytest.raises(SimulationError, match="give seconds"):
        live.update(-1e11, X, (zero, zero, zero))


def test_what_was_measured_is_given_back_and_arrays_are_ones_own() -> None:
    """Nobody can write into a controller by what it has given."""
    controller = Controller.from_experiment("study_1")
    u = controller.update(0.0, X)
    np.testing.assert_array_equal(controller.as_measured, X)
    before = controller.states
    for given in (
        u,
        controller.as_measured,
        controller.states,
        controller.diagnostics.command,
        controller.diagnostics.error,
    ):
        given[:] = 99.0
    np.testing.assert_array_equal(controller.states, before)
    np.testing.assert_array_equal(controller.as_measured, X)
    assert not np.any(controller.diagnostics.command == 99.0)
    assert not np.any(controller.update(0.0, X) == 99.0)


def test_whoever_has_the_whole_state_may_give_it_to_a_law_that_measures_less() -> None:
    """The entries that are measured are picked; other shapes are refused, with what is expected."""
    controller, whole = (Controller.from_experiment("study_2_pose", "pose") for _ in range(2))
    assert controller.measured == ("x", "y", "phi")
    for k in range(3):
        np.testing.assert_array_equal(controller.update(0.02 * k, POSE[:3]), whole.update(0.02 * k, POSE))
    np.testing.assert_array_equal(whole.as_measured, POSE[:3])
    for wrong in (POSE[:4], POSE[:2], np.zeros(6)):
        with pytest.raises(ShapeError, match=rf"x has shape \({len(wrong)},\); expected \(3,\): x, y, phi"):
            controller.update(1.0, wrong)
        assert controller.diagnostics.status == Status.BAD_MEASUREMENT
    full = Controller.from_experiment("study_1")
    with pytest.raises(ShapeError, match=r"expected \(5,\)"):
        full.update(0.0, X[:3])


@pytest.mark.parametrize(
    ("entries", "words"), [([1], "y as measured is not finite"), ([0, 4], "x, omega as measured are not finite")]
)
def test_what_is_not_finite_is_named(entries: list[int], words: str) -> None:
    x = X.copy()
    x[entries] = np.nan
    with pytest.raises(SimulationError, match=f"at t = 0.5 s {words}; measure again"):
        Controller.from_experiment("study_1").update(0.5, x)


def test_a_reference_that_is_not_finite_is_told_and_not_taken_for_the_time() -> None:
    live, zero = Controller.from_experiment("study_1", is_live=True), np.zeros(2)
    for place in range(3):
        given = [zero, zero, zero]
        given[place] = np.array([0.0, np.inf])
        with pytest.raises(SimulationError, match="the reference as given is not finite; give finite numbers"):
            live.update(0.0, X, tuple(given))
        assert live.diagnostics.status == Status.BAD_REFERENCE
    with pytest.raises(ShapeError, match=r"yr1 has shape \(3,\); expected \(2,\): y1, y2"):
        live.update(0.0, X, (zero, np.zeros(3), zero))
    for wrong in ((zero, zero), (zero, zero, zero, zero), 3.0, {1: zero, 2: zero, 3: zero}):
        with pytest.raises(ShapeError, match="give yr, yr1, yr2, or a ReferenceBuffer"):
            live.update(0.0, X, wrong)  # type: ignore[arg-type]
    own = Controller.from_experiment("study_1")
    with pytest.raises(SimulationError, match="the controller has a reference of its own"):
        own.update(0.0, X, (zero, zero, zero))
    assert np.isfinite(live.update(0.0, X, np.zeros((3, 2)))).all()  # type: ignore[arg-type]


def test_the_age_of_a_reference_is_that_of_the_last_call() -> None:
    """None without a buffer, and none after a refusal."""
    live, zero = Controller.from_experiment("study_1", is_live=True), np.zeros(2)
    buffer = ReferenceBuffer(["y1", "y2"])
    buffer.push(0.0, [15.0, 25.0], [0.0, 0.0])
    live.update(0.1, X, buffer)
    assert live.diagnostics.reference_age == pytest.approx(0.1)
    live.update(0.12, X, (zero, zero, zero))
    assert live.diagnostics.reference_age is None
    live.update(0.14, X, buffer)
    with pytest.raises(WmrError):
        live.update("a", X, buffer)  # type: ignore[arg-type]
    assert (live.diagnostics.reference_age, live.diagnostics.status) == (None, Status.BAD_TIME_STEP)
    assert not live.diagnostics.command.any()


def test_a_singular_robot_gets_no_voltages() -> None:
    """Estimates at which nothing can be inverted, told as such."""
    controller = Controller.from_experiment("study_1", "frozen estimates")
    state = {name: np.zeros_like(value) for name, value in controller.state_dict().items()}
    assert set(state) == {"theta_hat"}
    controller._state[:] = 0.0
    with pytest.raises(SimulationError, match=r"at t = 0\.0 s what is inverted is singular; measure again"):
        controller.update(0.0, X)
    assert controller.diagnostics.status == Status.SINGULAR
    assert controller.diagnostics.regularity <= 0.0


@pytest.mark.parametrize("kind", ["gate", "observer"])
def test_who_is_lost_says_by_how_much_and_when_it_begins_again(kind: str) -> None:
    experiment, x, words = ("study_1", X, "the gate refuses a sample: it") if kind == "gate" else (
        "study_2_pose", POSE[:3], "the observer is lost: what is measured"
    )  # fmt: skip
    controller = Controller.from_experiment(experiment, gate=0.3 if kind == "gate" else None)
    for k in range(3):
        controller.update(0.02 * k, x)
    with pytest.raises(SimulationError, match=f"{words} differs by .* m or rad .*wait for a gap of 0.2 s"):
        controller.update(0.06, x + 5.0 * np.eye(len(x))[0])
    told = controller.diagnostics
    assert told.status == Status.LOST
    assert told.surprise == pytest.approx(5.0, abs=0.2)
    assert (told.observed is None) == (kind == "gate")
    assert Controller.from_experiment("study_1").diagnostics.surprise is None


def moving(controller: Controller, samples: range, **options: Any) -> list[Floats]:
    """Voltages along a made-up motion."""
    count, found = len(controller.measured), []
    for k in samples:
        t = controller.sample_time * k
        x = np.sin(0.7 * t + np.arange(count)) * np.linspace(0.3, 1.0, count)
        found.append(controller.update(t, x, **options))
    return found


def test_states_that_are_loaded_begin_a_new_time() -> None:
    """What compares samples begins again; states that are not given stay; nothing is remembered of before."""
    one, two = (Controller.from_experiment("track_car", "composite", gate=9.0) for _ in range(2))
    moving(one, range(30))
    saved = one.state_dict()
    assert saved["least_squares.is_running"] == saved["gate.is_running"] == [1.0]
    two.load_state(saved)
    expected = one.states
    expected[one.sampled.of_the_moment] = 0.0
    np.testing.assert_array_equal(two.states, expected)
    one.load_state({"theta_hat": saved["theta_hat"]})
    np.testing.assert_array_equal(one.states, two.states)
    for a, b in zip(moving(one, range(3)), moving(two, range(3)), strict=True):  # time may go back
        np.testing.assert_array_equal(a, b)
    assert one.last_step == one.sample_time
    before = two.states
    for wrong, words in (
        ({"theta_hat": [np.nan] * len(two.estimate)}, "finite numbers"), ({"a\n": [1.0]}, "is not a state"),
        ({"theta_hat": [1.0]}, f"expected {len(two.estimate)} finite"),
    ):  # fmt: skip
        with pytest.raises(ShapeError, match=words):
            two.load_state(wrong)
    np.testing.assert_array_equal(two.states, before)


@pytest.mark.parametrize("is_learning", [True, False])
def test_the_first_sample_has_nothing_to_be_corrected_and_a_pause_learns_nothing_of_it(is_learning: bool) -> None:
    """Applied voltages before the first sample change nothing; in a pause they move no estimate."""
    hears, plain = (
        Controller.from_experiment("track_car", "composite", hears_applied=hears) for hears in (True, False)
    )
    applied = np.full(len(hears.model.input_units), 0.4)
    np.testing.assert_array_equal(moving(hears, range(1), applied=applied), moving(plain, range(1)))
    np.testing.assert_array_equal(hears.states, plain.states)
    moving(hears, range(1, 20))
    if not is_learning:
        hears.pause_learning()
    before = hears.estimate
    moving(hears, range(20, 21), applied=applied)
    assert np.any(hears.estimate != before) == is_learning
    assert hears.is_learning == is_learning
    with pytest.raises(SimulationError, match="build it with hears_applied=True"):
        moving(plain, range(20, 21), applied=applied)


def test_of_a_sample_that_is_given_again_nothing_is_corrected() -> None:
    """It is no new one, whatever is told of the motors."""
    hears = Controller.from_experiment("track_car", "composite", hears_applied=True)
    first = moving(hears, range(10))[-1]
    before = hears.states
    again = moving(hears, range(9, 10), applied=np.full(len(hears.model.input_units), 0.4))[0]
    np.testing.assert_array_equal(again, first)
    np.testing.assert_array_equal(hears.states, before)


@pytest.mark.parametrize(
    ("wrong", "error", "words"),
    [
        ([0.1], ShapeError, r"expected \(2,\)"), ([0.1, np.nan], SimulationError, "give what is known, or"),
        ("ab", ShapeError, "give 2 voltages"), ([[0.1, 0.2]], ShapeError, r"expected \(2,\)"),
    ],
)  # fmt: skip
def test_applied_voltages_that_are_none_are_refused(wrong: Any, error: type[WmrError], words: str) -> None:
    """And change nothing."""
    hears = Controller.from_experiment("study_2_pose", "pose", hears_applied=True)
    moving(hears, range(3))
    before = hears.states
    with pytest.raises(error, match=words):
        moving(hears, range(3, 4), applied=wrong)
    np.testing.assert_array_equal(hears.states, before)
    assert hears.diagnostics.status == Status.BAD_MEASUREMENT


def test_a_copy_has_gate_and_ear_of_its_original() -> None:
    one = Controller.from_experiment("track_car", "composite", gate=0.25, hears_applied=True)
    moving(one, range(3))
    two: Controller = pickle.loads(pickle.dumps(one))  # noqa: S301
    assert two.sampled.gate is not None
    assert two.sampled.gate.bound.tolist() == [0.25]
    assert (two.max_gap, two.sample_time, two.last_step) == (one.max_gap, one.sample_time, one.last_step)
    applied = np.full(len(one.model.input_units), 0.1)
    np.testing.assert_array_equal(moving(two, range(3, 6), applied=applied), moving(one, range(3, 6), applied=applied))


def test_a_deviation_is_told_by_laws_that_know_one() -> None:
    assert Controller.from_experiment("study_1").deviation is None
    knows = Controller.from_experiment("track_car", "composite")
    first = knows.deviation
    moving(knows, range(40))
    later = knows.deviation
    assert first is not None
    assert later is not None
    assert np.all(later <= first * (1.0 + 1e-9))
    assert np.any(later < 0.99 * first)


def test_is_learning_of_laws_that_adapt() -> None:
    for name, adapts in (("AFL", True), ("frozen estimates", False)):
        controller = Controller.from_experiment("study_1", name)
        assert controller.is_learning == adapts
        controller.pause_learning()
        assert not controller.is_learning
        controller.resume_learning()
        assert controller.is_learning == adapts


def test_an_experiment_gives_sample_time_drive_and_reference() -> None:
    loop = load_experiment("study_2").loops["AFL"]
    controller, live = (Controller.from_experiment("study_2", "AFL", is_live=is_live) for is_live in (False, True))
    assert controller.reference is loop.reference or type(controller.reference) is type(loop.reference)
    assert type(live.reference).__name__ == "LiveReference"
    assert (controller.sample_time, live.sample_time) == (loop.sample_time, loop.sample_time)
    names = [part.name for part in loop.plant.drive]
    assert names == [part.name for part in controller.sampled.drive] == [part.name for part in live.sampled.drive]
    assert names


@pytest.mark.parametrize("t", [10**400, np.array([1.0]), np.array(True), np.timedelta64(1, "s"), b"1", [1.0]])
def test_what_is_no_time_is_refused(t: Any) -> None:
    """A number too large for seconds, arrays of one, truth values, durations."""
    controller = Controller.from_experiment("study_1")
    with pytest.raises(ShapeError, match="give seconds as a number"):
        controller.update(t, X)
    assert controller.diagnostics.status == Status.BAD_TIME_STEP
    assert np.isfinite(controller.update(np.array(0.5), X)).all()
