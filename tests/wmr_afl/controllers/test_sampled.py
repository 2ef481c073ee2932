"""References from functions in Python: how exact they are, and what is said of functions that give none."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wmr_afl
from tests.wmr_afl.controllers.test_pieces import LATE
from tests.wmr_afl.controllers.test_waypoints import differences, experiment
from tests.wmr_afl.onboard.test_live_references import STEP, driven
from wmr_afl import Controller, ShapeError, UnknownNameError, WmrError
from wmr_afl.analysis.feasibility import demand
from wmr_afl.controllers.live_reference import LiveReference
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.sampled import Sampled
from wmr_afl.controllers.waypoints import Waypoints
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats

OUTPUTS = ["y1", "y2"]
TEXTS = {"y1": "0.3*t + 0.1*sin(t)", "y2": "0.2*sin(0.5*t)**2"}


def yr(t: float) -> list[float]:
    return [0.3 * t + 0.1 * np.sin(t), 0.2 * np.sin(0.5 * t) ** 2]


def yr1(t: float) -> list[float]:
    return [0.3 + 0.1 * np.cos(t), 0.1 * np.sin(t)]


def yr2(t: float) -> list[float]:
    return [-0.1 * np.sin(t), 0.1 * np.cos(t)]


GIVEN: dict[str, dict[str, Any]] = {"yr": {}, "yr and yr1": {"yr1": yr1}, "all": {"yr1": yr1, "yr2": yr2}}


@pytest.mark.parametrize("given", GIVEN)
def test_it_is_the_function_and_derivatives_are_its_own(given: str) -> None:
    """Against the formula, and against differences of itself."""
    reference, formula = Sampled(OUTPUTS, yr, 8.0, **GIVEN[given]), Reference(TEXTS)
    times = np.linspace(0.0, 7.9999, 997)
    for found, expected, at_most in zip(reference.over(times), formula.over(times), (1e-13, 1e-11, 1e-8), strict=True):
        np.testing.assert_allclose(found, expected, atol=at_most)
    inner = times[1:-1]
    velocity, acceleration = differences(reference, inner)
    np.testing.assert_allclose(reference.over(inner)[1], velocity, atol=1e-8)
    np.testing.assert_allclose(reference.over(inner)[2], acceleration, atol=1e-8)


def missed(rate: float, since: float, **given: Any) -> Floats:
    """By how much a sine of this rate [rad/s] and its derivatives are missed, from `since` [s] after its beginning."""
    reference = Sampled(["y1"], lambda t: np.sin(rate * t), 20.0, **given)
    t = np.linspace(since, 20.0 - since, 20011)[:-1]
    true = np.sin(rate * t), rate * np.cos(rate * t), -rate * rate * np.sin(rate * t)
    return np.array([np.abs(part[:, 0] - one).max() for part, one in zip(reference.over(t), true, strict=True)])


def test_it_is_as_exact_as_its_docstring_says() -> None:
    """Velocities and accelerations of sines, in all of the time and without its ends."""
    given = {"yr1": lambda t: 5.0 * np.cos(5.0 * t), "yr2": lambda t: -25.0 * np.sin(5.0 * t)}
    for found, expected in (
        (missed(1.0, 0.0), (6e-12, 4e-9)),
        (missed(5.0, 0.2), (4e-10, 3e-7)),
        (missed(5.0, 0.0), (6e-8, 4e-5)),
        (missed(5.0, 0.0, **given), (2e-10, 9e-8)),
    ):
        assert np.all(found[1:] <= expected), (found, expected)
        assert np.all(found[1:] > 0.25 * np.array(expected)), (found, expected)


def test_a_velocity_that_is_given_tells_of_the_acceleration() -> None:
    """Near both ends, too, where the spline of yr alone is forty times as far off."""
    assert missed(5.0, 0.0, yr1=lambda t: 5.0 * np.cos(5.0 * t))[2] < 1e-6


def test_a_finer_step_is_more_exact() -> None:
    """By 2^5 and 2^4 for yr' and yr'' between ends, as splines of degree 5 are."""
    ratios = missed(5.0, 1.0, step=0.04)[1:] / missed(5.0, 1.0, step=0.02)[1:]
    np.testing.assert_allclose(ratios, [32.0, 16.0], rtol=0.3)


def test_coordinates_of_a_map_have_no_more_digits() -> None:
    """An offset of 5e6 m, as UTM coordinates have it."""
    reference = Sampled(["y1"], lambda t: 5e6 + np.sin(t), 20.0)
    t = np.linspace(0.0, 19.999, 5000)
    assert np.abs(reference.over(t)[2][:, 0] + np.sin(t)).max() < 1e-3


@pytest.mark.parametrize(("is_given", "far"), [(False, {1: 0.2, 10: 1e-4}), (True, {1: 1e-8, 10: 1e-8})])
def test_a_jump_of_the_acceleration_is_felt_a_few_samples_away(is_given: bool, far: dict[int, float]) -> None:
    at = 5.003
    given = {"yr1": lambda t: min(t, at), "yr2": lambda t: float(t < at)} if is_given else {}
    reference = Sampled(["y1"], lambda t: 0.5 * min(t, at) ** 2 + at * max(t - at, 0.0), 10.0, **given)
    t = np.linspace(0.0, 9.9999, 100_001)
    off = np.abs(reference.over(t)[2][:, 0] - (t < at))
    for samples, expected in far.items():
        assert off[np.abs(t - at) >= 0.01 * samples].max() < expected


def test_functions_are_called_while_it_is_built_and_never_again() -> None:
    called: list[float] = []

    def counting(t: float) -> list[float]:
        called.append(t)
        return yr(t)

    reference = Sampled(OUTPUTS, counting, 1.0, step=0.1)
    np.testing.assert_allclose(called, np.linspace(0.0, 1.0, 11), rtol=1e-15)
    copy = pickle.loads(pickle.dumps(reference))  # noqa: S301, our own
    for one in (reference, copy, reference.ordered(["y2", "y1"])):
        one.over([0.35])
        one.clock(np.array([0.35]), 0.1)
    np.testing.assert_array_equal(copy.over([0.35])[2], reference.over([0.35])[2])
    assert len(called) == 11
    assert all(type(t) is float for t in called)


@pytest.mark.parametrize("shape", ["a list", "an array", "a column", "a tuple"])
def test_a_function_may_give_numbers_in_any_of_these(shape: str) -> None:
    wrapped = {"a list": list, "an array": np.array, "a tuple": tuple, "a column": lambda y: np.reshape(y, (2, 1))}
    reference = Sampled(OUTPUTS, lambda t: wrapped[shape](yr(t)), 2.0)
    np.testing.assert_array_equal(reference.over([0.5])[0], Sampled(OUTPUTS, yr, 2.0).over([0.5])[0])


def test_it_rests_before_and_comes_to_rest_behind() -> None:
    """Along the straight line of points with free ends."""
    reference = Sampled(OUTPUTS, lambda t: [3.0 * t, 1.0 - 4.0 * t], 2.0, stop=2.5)
    points = Waypoints([0.0, 1.0, 2.0], {"y1": [0.0, 3.0, 6.0], "y2": [1.0, -3.0, -7.0]}, "cubic", "free", stop=2.5)
    assert reference.duration == pytest.approx(4.0)
    times = np.array([-1.0, 0.5, 2.5, 3.0, 4.5, 100.0])
    for found, expected in zip(reference.over(times), points.over(times), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-8)


def test_the_order_of_outputs_does_not_matter() -> None:
    reference = Sampled(OUTPUTS, yr, 3.0, counts_turns=True)
    other, times = reference.ordered(["y2", "y1"]), np.linspace(-1.0, 5.0, 61)
    assert other.outputs == ("y2", "y1")
    assert other.counts_turns
    for found, expected in zip(other.over(times), reference.over(times), strict=True):
        np.testing.assert_array_equal(found, expected[:, ::-1])
    np.testing.assert_array_equal(other.row(1.0)[:2], reference.row(1.0)[1::-1])
    assert other.ordered(["y1", "y2"]).outputs == ("y1", "y2")
    assert reference.ordered(OUTPUTS) is reference
    with pytest.raises(UnknownNameError, match="y2"):
        reference.ordered(["y1"])
    with pytest.raises(WmrError, match="name y3 among its outputs"):
        reference.ordered(["y1", "y2", "y3"])


@pytest.mark.parametrize("lead", [0.0, 0.3])
def test_a_row_is_looked_up_as_it_is_evaluated(lead: float) -> None:
    reference = Sampled(OUTPUTS, yr, 3.0)
    times = np.concatenate([np.linspace(-1.0, 4.0, 301), np.arange(0.0, 3.001, 0.1)])
    rows = np.array([reference.clock(np.array([t]), lead)[0] for t in times])
    np.testing.assert_allclose(rows, reference.clock(times, lead), rtol=1e-9, atol=1e-9)


def nothing(t: float) -> list[float]:
    raise KeyError


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Sampled(["y1"], lambda t: 1.0 / (t - 1.0), 2.0), "yr(1) raised ZeroDivisionError: float division"),
        (lambda: Sampled(["y1"], lambda t: 1.0 / (t - 1.0), 2.0), "; let it be defined from 0 to 2 s"),
        (lambda: Sampled(["y1"], nothing, 2.0), "yr(0) raised KeyError; let it be defined"),
        (lambda: Sampled(["y1"], lambda: 1.0, 2.0), "yr(0) raised TypeError"),  # type: ignore[misc, arg-type]
        (lambda: Sampled(OUTPUTS, lambda t: [t], 2.0), "yr(0) has shape (1,); give a number for each of y1, y2"),
        (lambda: Sampled(OUTPUTS, lambda t: t, 2.0), "yr(0) has shape (); give a number for each of y1, y2"),
        (lambda: Sampled(OUTPUTS, lambda t: ["a", "b"], 2.0), "yr(0) is not an array of numbers"),
        (lambda: Sampled(OUTPUTS, lambda t: None, 2.0), "yr(0) is not an array of numbers: None"),
        (lambda: Sampled(OUTPUTS, lambda t: [t, np.nan if t > 1.005 else t], 2.0), "yr(1.01) is [1.01, nan]; give"),
        (lambda: Sampled(OUTPUTS, yr, 2.0, yr1=lambda t: [t]), "yr1(0) has shape (1,)"),
        (lambda: Sampled(OUTPUTS, yr, 2.0, yr2=lambda t: [t, np.inf]), "yr2(0) is [0.0, inf]"),
        (
            lambda: Sampled(["y1"], lambda t: t * t, 2.0, yr1=lambda t: t),
            "yr1(2) gives 2 for y1, whose samples tell 4; correct yr1, leave it out, or choose a shorter step",
        ),
        (
            lambda: Sampled(OUTPUTS, yr, 2.0, yr1=yr1, yr2=yr1),
            "yr2(0.79) gives 0.370385 for y1, whose samples tell -0.071",
        ),
        (lambda: Sampled(OUTPUTS, yr, -1.0), "a duration of -1 s and a step of 0.01 s; choose positive times"),
        (lambda: Sampled(OUTPUTS, yr, np.nan), "a duration of nan s"),
        (lambda: Sampled(OUTPUTS, yr, 2.0, step=0.0), "a step of 0 s"),
        (lambda: Sampled(OUTPUTS, yr, 1e6), "1e+08 samples are too many; choose a step of 2 s or more"),
        (lambda: Sampled(OUTPUTS, yr, 2.0, stop=0.0), "choose a positive deceleration"),
        (lambda: Sampled([], yr, 2.0), "its outputs are none; name each once"),
        (lambda: Sampled(["y1", "y1"], yr, 2.0), "its outputs are y1, y1; name each once"),
        (lambda: Sampled(["y1"], lambda t: 1e308 * np.sin(9.0 * t), 2.0), "numbers are too large; give smaller ones"),
    ],
)
def test_functions_that_make_no_reference_are_told_in_one_line(build: object, words: str) -> None:
    with pytest.raises(WmrError) as caught:
        build()  # type: ignore[operator]
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_a_function_says_in_several_lines_is_told_in_one() -> None:
    def long(t: float) -> float:
        raise ValueError("first\nsecond " + 100 * "x")

    with pytest.raises(WmrError) as caught:
        Sampled(["y1"], long, 2.0)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 130
    with pytest.raises(ShapeError):
        Sampled(["y1"], lambda t: object(), 2.0)  # type: ignore[arg-type, return-value]


# --- in loops --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [False, True])
def test_all_ways_to_run_follow_a_function_alike(late: bool, tmp_path: Path) -> None:
    """NumPy, CasADi, compiled within rounding, and the formula up to what lies between samples."""
    lines = ", ".join(f'{name} = "{text}"' for name, text in TEXTS.items())
    file = experiment("type_2_0", tmp_path, f"[reference]\nexpressions = {{ {lines} }}", LATE if late else "")
    if late:
        text = file.read_text()
        file.write_text(text.replace("[uncertainties]\n", "[uncertainties]\ninput_delay = { seconds = 0.04 }\n"))
    reference = Sampled(["y2", "y1"], lambda t: yr(t)[::-1], 10.0)
    backends = ("numpy", "casadi", "compiled")
    runs = [wmr_afl.run(file, backend=backend, reference=reference)["exact"] for backend in backends]
    assert runs[0].failure is None
    for run in runs[1:]:
        np.testing.assert_allclose(run.state, runs[0].state, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(run.input, runs[0].input, rtol=1e-12, atol=1e-11)
    formula = wmr_afl.run(file, backend="casadi")["exact"]
    np.testing.assert_allclose(runs[1].state, formula.state, atol=1e-8)
    np.testing.assert_allclose(runs[1].reference, formula.reference, atol=1e-12)


def test_a_controller_follows_a_function_as_if_it_were_given_live() -> None:
    loop = next(iter(load_experiment("study_1").loops.values()))
    reference = Sampled(OUTPUTS, yr, 3.0)
    own = Controller(loop.model, loop.law, reference, STEP)
    live = Controller(loop.model, loop.law, LiveReference(OUTPUTS), STEP)
    np.testing.assert_allclose(driven(live, reference), driven(own, None), rtol=1e-9, atol=1e-9)


def test_a_reference_of_python_has_to_fit_the_robot(tmp_path: Path) -> None:
    file = experiment("type_2_0", tmp_path, '[reference]\nexpressions = { y1 = "t", y2 = "0" }')
    with pytest.raises(WmrError, match="output 'y2' has no reference; name y2 among its outputs"):
        wmr_afl.run(file, reference=Sampled(["y1"], lambda t: t, 2.0))
    with pytest.raises(UnknownNameError, match="unknown output 'y3'"):
        wmr_afl.run(file, reference=Sampled(["y1", "y2", "y3"], lambda t: [t, t, t], 2.0))


def test_whether_a_robot_can_follow_a_function_is_told(tmp_path: Path) -> None:
    """A formula and its samples need the same voltages."""
    lines = ", ".join(f'{name} = "{text}"' for name, text in TEXTS.items())
    read = read_experiment(experiment("type_2_0", tmp_path, f"[reference]\nexpressions = {{ {lines} }}"))
    expected, found = demand(*read), demand(*read, Sampled(OUTPUTS, yr, 10.0))
    for name, volts in expected.volts.items():
        assert found.volts[name] == pytest.approx(volts, rel=1e-6)
    swift = demand(*read, Sampled(OUTPUTS, lambda t: [0.3 * t + 0.3 * np.sin(8.0 * t), 0.0], 10.0))
    assert any("would need up to" in doubt.what for doubt in swift.doubts)
