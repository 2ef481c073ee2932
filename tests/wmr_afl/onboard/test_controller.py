"""The controller for a robot's own loop is the simulator's, step for step."""

import copy
import json
import pickle
import sys
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl import CompilerError, Controller, ShapeError, SimulationError, UnknownNameError, WmrError
from wmr_afl.onboard import controller as onboard


@pytest.mark.parametrize(
    ("experiment", "name"),
    [
        ("study_1", "AFL"),
        ("study_2", "AFL with leakage"),
        ("study_2", "robust AFL"),
        ("track_mecanum", "AFL"),
        ("track_car", "composite"),
        ("track_mecanum", "direct"),
    ],
)
@pytest.mark.parametrize("has_compiler", [True, False])
def test_it_gives_the_simulators_inputs(
    experiment: str, name: str, has_compiler: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = wmr_afl.run(experiment, controllers=name)[name]
    if not has_compiler:
        monkeypatch.setattr(onboard, "Compiled", failing)
    controller = Controller.from_experiment(experiment, name)
    for k in range(350):  # 7 s of the studies
        u = controller.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, run.input[k], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(controller.estimate, run.estimate[k + 1], rtol=1e-9, atol=1e-12)


def failing(*arguments: object, **options: object) -> None:
    raise CompilerError("no C compiler was found")


def test_after_a_reset_it_starts_again() -> None:
    controller = Controller.from_experiment("study_1")
    first = [controller.update(0.02 * k, [15.0, 25.0, 0.1, 0.2, 0.0]) for k in range(5)]
    controller.reset()
    second = [controller.update(0.02 * k, [15.0, 25.0, 0.1, 0.2, 0.0]) for k in range(5)]
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", ["exact", "AFL", "composite", "direct"])
def test_a_second_call_at_the_same_time_gives_the_same_voltages(name: str) -> None:
    """And changes nothing; another state at that time gives others."""
    run = wmr_afl.run("track_mecanum", controllers=name)[name]
    controller = Controller.from_experiment("track_mecanum", name)
    for k in range(30):
        first = controller.update(run.time[k], run.state[k])
        before = controller.state_dict()
        np.testing.assert_array_equal(controller.update(run.time[k], run.state[k]), first)
        assert np.any(controller.update(run.time[k], run.state[k] + 0.01) != first)
        assert controller.state_dict() == before


def test_a_reference_model_goes_by_the_time_that_passed() -> None:
    """Whatever the steps between, the distance has faded as far."""
    x, ends = np.array([0.5, -0.3, 0.2, 0.0, 0.0, 0.0]), []
    for times in (np.arange(0.0, 0.41, 0.02), np.cumsum([0.0, *([0.005, 0.035] * 10)])):
        controller = Controller.from_experiment("track_mecanum", "exact")
        for t in times:
            controller.update(float(t), x)
        ends.append(controller.state_dict()["reference_model.distance"])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)


def test_a_late_sample_that_is_not_sound_changes_nothing() -> None:
    run = wmr_afl.run("track_mecanum", controllers="composite")["composite"]
    controller = Controller.from_experiment("track_mecanum", "composite")
    for k in range(5):
        controller.update(run.time[k], run.state[k])
    before = controller.state_dict()
    with pytest.raises(SimulationError):
        controller.update(run.time[4] + 0.1, np.full(6, np.nan))
    assert controller.state_dict() == before


def test_after_a_gap_nothing_is_learned_from_the_sample_before() -> None:
    """The composite law compares a sample with the last one; it begins again, and its estimates stay for a while."""
    run = wmr_afl.run("track_mecanum", controllers="composite")["composite"]
    controller = Controller.from_experiment("track_mecanum", "composite")
    for k in range(200):
        controller.update(run.time[k], run.state[k])
    kept = controller.estimate
    later = run.time + 3.0
    for k in (200, 201):
        controller.update(later[k], run.state[k] + 0.3)
        np.testing.assert_allclose(controller.estimate, kept, rtol=1e-3)
    assert controller.state_dict()["least_squares.is_running"] == [1.0]
    for k in range(202, 210):
        controller.update(later[k], run.state[k] + 0.3)
    assert np.all(np.isfinite(controller.estimate))


def test_its_memory_does_not_grow() -> None:
    controller, x = Controller.from_experiment("study_1"), np.array([15.0, 25.0, 0.0, 0.0, 0.0])
    for k in range(100):
        controller.update(0.02 * k, x)
    controller.reset()
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    for k in range(5000):
        controller.update(0.02 * k, x)
        controller.reset()
    grown = sum(line.size_diff for line in tracemalloc.take_snapshot().compare_to(before, "filename"))
    tracemalloc.stop()
    assert grown < 20_000


def test_inputs_stay_within_their_limits() -> None:
    controller = Controller.from_experiment("study_2")
    assert np.all(np.abs(controller.update(0.0, [50.0, -50.0, 0.0, 3.0, 3.0])) <= 24.0)


def test_it_knows_what_the_drive_does_to_its_commands(tmp_path: Path) -> None:
    """Commands are limited but not late when they are returned; the law looks at the input that is both."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 10.0")
    text = text.replace("gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0]", 'relative_gain = 0.1, input = "applied"')
    drive = "[uncertainties]\ninput_delay = { seconds = 0.06 }\ninput_limits = { volts = 6.0 }\n\n[shared]"
    (tmp_path / "late.toml").write_text(text.replace("[shared]", drive, 1))
    run = wmr_afl.run(tmp_path / "late.toml", controllers="AFL")["AFL"]
    controller = Controller.from_experiment(tmp_path / "late.toml", "AFL")
    for k in range(len(run.time) - 1):
        u = controller.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, np.clip(run.command[k], -6.0, 6.0), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(controller.estimate, run.estimate[k + 1], rtol=1e-9, atol=1e-12)
    assert np.abs(run.input - np.clip(run.command, -6.0, 6.0)).max() > 1.0


@pytest.mark.parametrize("has_compiler", [True, False])
def test_what_cannot_be_controlled_is_reported_and_changes_nothing(
    has_compiler: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_compiler:
        monkeypatch.setattr(onboard, "Compiled", failing)
    controller = Controller.from_experiment("study_1")
    before = controller.estimate
    with pytest.raises(SimulationError, match="x, y, phi, v, omega as measured are not finite"):
        controller.update(0.0, [np.nan] * 5)
    np.testing.assert_array_equal(controller.estimate, before)
    for bad, cause in (
        ([15.0, 25.0, 0.0, np.nan, 0.0], "at t = 0.0 s v as measured is not finite"),
        ([np.inf, 25.0, 0.0, 0.0, 0.0], "x as measured is not finite"),
        ([15.0, 25.0, 0.0, 1e200, 0.0], "the voltages, or the estimates after them, are not finite"),
    ):
        with pytest.raises(SimulationError, match=cause):
            controller.update(0.0, bad)
    with pytest.raises(SimulationError, match="the time is not finite"):
        controller.update(np.nan, [15.0, 25.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(controller.estimate, before)
    with pytest.raises(ShapeError, match=r"expected \(5,\): x, y, phi, v, omega"):
        controller.update(0.0, [0.0] * 3)
    with pytest.raises(UnknownNameError, match="AFL"):
        Controller.from_experiment("study_1", "PID")


X = [15.0, 25.0, 0.1, 0.2, 0.05]


def test_a_sample_that_is_given_again_is_answered_and_learned_from_once() -> None:
    controller = Controller.from_experiment("study_1")
    first, estimate = controller.update(0.02, X), controller.estimate
    for _ in range(20):
        np.testing.assert_array_equal(np.isfinite(controller.update(0.02, X)), True)
        np.testing.assert_array_equal(controller.estimate, estimate)
    assert np.all(np.isfinite(first))
    other = Controller.from_experiment("study_1")
    other.update(0.02, X)
    np.testing.assert_array_equal(controller.update(0.04, X), other.update(0.04, X))


def test_estimates_move_by_the_time_that_passed_up_to_a_bound(tmp_path: Path) -> None:
    """theta_hat' = Gamma W^T E1, at the same sample: twice the time, twice the way; after a gap none."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("projection = { lower = 0.1 }", "")
    circle = "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }"
    (tmp_path / "point.toml").write_text(text.replace(circle, 'expressions = { y1 = "15.1", y2 = "25.05" }'))
    moved = {}
    for passed in (0.01, 0.02, 0.04, 0.19, 0.21, 5.0):
        controller = Controller.from_experiment(tmp_path / "point.toml")
        controller.update(0.0, X)
        before = controller.estimate
        u = controller.update(passed, X)
        assert np.all(np.isfinite(u))
        moved[passed] = controller.estimate - before
    reference = moved[0.02]
    for passed, factor in ((0.01, 0.5), (0.04, 2.0), (0.19, 2.0)):
        np.testing.assert_allclose(moved[passed], factor * reference, rtol=1e-9)
    for passed in (0.21, 5.0):
        np.testing.assert_array_equal(moved[passed], 0.0)


def test_time_goes_on_and_is_in_seconds() -> None:
    controller = Controller.from_experiment("study_1")
    controller.update(1.0, X)
    state = controller.state_dict()
    with pytest.raises(SimulationError, match=r"time went back from 1.0 s to 0.98 s; call reset\(\)"):
        controller.update(0.98, X)
    for wrong in (1_700_000_000_000_000_000, float("inf"), 1e11):
        with pytest.raises(SimulationError, match="give seconds"):
            controller.update(wrong, X)
    for wrong in (
        "0.02", None, timedelta(seconds=1), np.timedelta64(20, "ms"), np.datetime64("2020-01-01"), [1.0], True, 1j,
    ):  # fmt: skip
        with pytest.raises(ShapeError, match="give seconds as a number"):
            controller.update(wrong, X)
    assert controller.state_dict() == state
    for right in (1.02, np.float32(1.04), np.array(1.06), Fraction(27, 25), Decimal("1.1"), 2):
        assert np.all(np.isfinite(controller.update(right, X)))
    for sample_time, max_gap in ((0.0, None), (-0.02, None), (float("nan"), None), (0.02, 0.01)):
        with pytest.raises(WmrError, match="choose 0 < sample_time <= max_gap"):
            Controller(controller.model, controller.law, controller.reference, sample_time, max_gap=max_gap)


@pytest.mark.parametrize(
    "x",
    [
        tuple(X), np.array(X, np.float16), np.array(X, np.longdouble), np.repeat(X, 2)[::2], np.array(X, ">f8"),
        np.array(X, object), [Decimal(str(one)) for one in X], [15, 25, 0, 0, 0], np.ma.array(X),
    ],
)  # fmt: skip
def test_a_state_may_be_any_sequence_of_real_numbers(x) -> None:
    expected = Controller.from_experiment("study_1").update(0.02, np.asarray(x, dtype=float))
    np.testing.assert_array_equal(Controller.from_experiment("study_1").update(0.02, x), expected)


@pytest.mark.parametrize(
    "x",
    [
        np.ma.array(X, mask=[0, 0, 0, 1, 0]), [15.0, 25.0, 0.1, None, 0.05], None, [15.0, 25.0, 0.1, "a", 0.05],
        [15.0, 25.0, 0.1, "0.2", 0.05], dict(zip("abcde", X, strict=True)), np.array(X) + 0.5j,
        [15.0, [25.0, 1.0], 0.1, 0.2, 0.05], np.array(X)[:, None], np.array(X, dtype=bool),
    ],
)  # fmt: skip
def test_a_state_that_is_none_is_refused_and_changes_nothing(x) -> None:
    controller = Controller.from_experiment("study_1")
    state = controller.state_dict()
    with pytest.raises(ShapeError):
        controller.update(0.02, x)
    assert controller.state_dict() == state


@pytest.mark.parametrize("name", ["AFL", "AFL with leakage", "robust AFL"])
def test_a_restart_from_saved_states_goes_on_as_if_there_had_been_none(name: str) -> None:
    """Estimates and the robust term's states, through JSON; gains and bounds stay those of the experiment."""
    controller, x = Controller.from_experiment("study_2", name), np.array([2.6, 5.4, 0.7, 0.1, 0.0])
    for k in range(50):
        controller.update(0.02 * k, x + 0.001 * k)
    again = Controller.from_experiment("study_2", name)
    again.load_state(json.loads(json.dumps(controller.state_dict())))
    np.testing.assert_array_equal(again.estimate, controller.estimate)
    for k in range(50, 60):
        np.testing.assert_array_equal(controller.update(0.02 * k, x + 0.001 * k), again.update(0.02 * k, x + 0.001 * k))
    fresh = Controller.from_experiment("study_2", name)
    assert np.any(fresh.estimate != again.estimate)  # what is restored leaks into no other controller


@pytest.mark.parametrize(
    "state", [{"theta": [1.0]}, {"theta_hat": [1.0]}, {"theta_hat": [np.nan] * 6}, {"theta_hat": "six"}]
)
def test_a_state_that_does_not_fit_is_refused_and_changes_nothing(state: dict) -> None:
    controller = Controller.from_experiment("study_1")
    before = controller.state_dict()
    with pytest.raises(ShapeError, match="theta"):
        controller.load_state(state)
    assert controller.state_dict() == before


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])  # noqa: S301
def test_a_copy_is_a_controller_of_its_own(duplicate: Callable[[Controller], Controller]) -> None:
    controller = Controller.from_experiment("study_1")
    controller.update(0.0, X)
    other, before = duplicate(controller), controller.estimate
    np.testing.assert_array_equal(other.estimate, before)
    other.update(0.02, X)
    np.testing.assert_array_equal(controller.estimate, before)
    twin = duplicate(controller)
    np.testing.assert_array_equal(controller.update(0.02, X), twin.update(0.02, X))


def test_attributes_that_would_do_nothing_cannot_be_set() -> None:
    controller = Controller.from_experiment("study_1")
    for name in ("reference", "sample_time", "law", "estimate", "anything"):
        with pytest.raises(AttributeError):
            setattr(controller, name, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        controller.estimate[:] = 2.0


def test_two_threads_get_the_voltages_of_their_own_samples() -> None:
    controller = Controller.from_experiment("study_1", "frozen estimates")
    samples = [np.array(X), np.array(X) + 0.1]
    wanted = [controller.update(0.0, x) for x in samples]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            wrong = pool.map(
                lambda i: sum(not np.array_equal(controller.update(0.0, samples[i]), wanted[i]) for _ in range(20_000)),
                range(2),
            )
            assert list(wrong) == [0, 0]
    finally:
        sys.setswitchinterval(interval)
