"""References through points: splines against what defines them, paths against their limits, and loops that follow."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS
from wmr_afl import WmrError
from wmr_afl.controllers.path import along
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.waypoints import Between, Waypoints
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats

T = np.array([1.0, 2.0, 3.5, 4.0, 6.0])
Y = {"y1": [0.0, 1.0, 0.5, 2.0, 2.5], "y2": [3.0, -1.0, 0.0, 0.0, 1.0]}
BETWEEN: list[Between] = ["quintic", "cubic"]


def differences(reference: Reference, times: Floats, step: float = 1e-5) -> tuple[Floats, Floats]:
    """y' and y'' by differences of y and of y'."""
    later, before = reference.over(times + step), reference.over(times - step)
    return (later[0] - before[0]) / (2.0 * step), (later[1] - before[1]) / (2.0 * step)


@pytest.mark.parametrize("between", BETWEEN)
@pytest.mark.parametrize("ends", ["rest", "free"])
def test_it_goes_through_its_points_and_derivatives_are_its_own(between: Between, ends: str) -> None:
    reference = Waypoints(T, Y, between, ends, stop=2.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(reference.over(T)[0], np.array(list(Y.values())).T, atol=1e-12)
    inner = np.linspace(1.01, reference.duration - 0.01, 400)
    inner = inner[np.abs(inner[:, None] - T).min(axis=1) > 1e-3]
    velocity, acceleration = differences(reference, inner)
    np.testing.assert_allclose(reference.over(inner)[1], velocity, atol=1e-6)
    np.testing.assert_allclose(reference.over(inner)[2], acceleration, atol=1e-5)


@pytest.mark.parametrize(("between", "order"), [("quintic", 3), ("cubic", 2)])
def test_derivatives_are_as_smooth_as_it_says(between: Between, order: int) -> None:
    """What is on both sides of a point is the same, up to y''' of a quintic and y'' of a cubic spline."""
    reference = Waypoints(T, Y, between)
    near = 1e-6
    for side in range(3):
        gap = reference.over(T[1:-1] + near)[side] - reference.over(T[1:-1] - near)[side]
        assert np.abs(gap).max() < 1e-3
    if order == 3:
        third = []
        for side in (1.0, -1.0):
            far, close = (reference.over(T[1:-1] + side * gap)[2] for gap in (2e-3, 1e-3))
            third.append((far - close) / (side * 1e-3))
        assert np.abs(third[0] - third[1]).max() < 0.05 * np.abs(third[0]).max()


@pytest.mark.parametrize("between", BETWEEN)
def test_it_rests_before_and_behind(between: Between) -> None:
    reference = Waypoints(T, Y, between)
    assert reference.duration == 6.0
    for t, at in ((-5.0, 0), (0.999, 0), (6.001, -1), (1e6, -1)):
        point = reference.at(t)
        np.testing.assert_allclose(point.position, [column[at] for column in Y.values()], atol=1e-12)
        assert not point.velocity.any()
        assert not point.acceleration.any()
    np.testing.assert_allclose(reference.over([1.0, 6.0])[1], 0.0, atol=1e-12)


def test_a_free_end_comes_to_rest_along_a_straight_line() -> None:
    """By the deceleration that is told, in the direction of its last velocity."""
    t = np.linspace(0.0, 2.0, 9)
    reference = Waypoints(t, {"y1": 3.0 * t, "y2": -4.0 * t}, "cubic", "free", stop=2.5)
    assert reference.duration == pytest.approx(2.0 + 5.0 / 2.5)
    position, velocity, acceleration = reference.over([3.0, 4.0, 9.0])
    np.testing.assert_allclose(velocity[0], [1.5, -2.0], rtol=1e-9)
    np.testing.assert_allclose(acceleration[0], [-1.5, 2.0], rtol=1e-9)
    np.testing.assert_allclose(position[1], [6.0 + 3.0, -8.0 - 4.0], rtol=1e-9)
    np.testing.assert_array_equal(position[2], position[1])
    assert not velocity[1:].any() or np.abs(velocity[1:]).max() < 1e-9


def test_outputs_come_in_the_order_that_is_asked_for() -> None:
    reference = Waypoints(T, Y)
    np.testing.assert_array_equal(reference.ordered(["y2", "y1"]).over(T)[0], reference.over(T)[0][:, ::-1])
    assert reference.ordered(["y1", "y2"]) is reference
    with pytest.raises(WmrError, match="y2"):
        reference.ordered(["y1"])
    with pytest.raises(WmrError, match="add a column y3"):
        reference.ordered(["y1", "y2", "y3"])
    copy = pickle.loads(pickle.dumps(reference))  # noqa: S301, our own
    np.testing.assert_array_equal(copy.over(T)[1], reference.over(T)[1])


PATHS = {
    "corner": {"y1": [0.0, 4.0, 4.0], "y2": [0.0, 0.0, 4.0]},
    "slalom": {"y1": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "y2": [0.0, 0.4, -0.4, 0.4, -0.4, 0.0]},
    "short": {"y1": [0.0, 0.05], "y2": [0.0, 0.0]},
    "long": {"y1": [0.0, 50.0], "y2": [0.0, 10.0]},
}


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("limits", [(1.0, 0.5, 0.3), (0.3, 2.0, 1.0), (3.0, 1.0, 1.0)])
def test_a_path_keeps_its_limits_and_is_not_slower_than_they_ask(path: str, limits: tuple[float, float, float]) -> None:
    """Speed, acceleration along it and across it; and somewhere one of them is reached."""
    speed, along_it, across = limits
    reference = along(PATHS[path], speed, along_it, across)
    times = np.linspace(0.0, reference.duration, 4001)
    position, velocity, acceleration = reference.over(times)
    points = np.array(list(PATHS[path].values())).T
    for point in points:
        assert np.linalg.norm(position - point, axis=1).min() < 0.01
    rates = np.linalg.norm(velocity, axis=1)
    moving = rates > 0.05 * speed
    direction = velocity[moving] / rates[moving, None]
    forward = np.abs((acceleration[moving] * direction).sum(axis=1))
    sideways = np.abs(acceleration[moving, 0] * direction[:, 1] - acceleration[moving, 1] * direction[:, 0])
    assert rates.max() <= 1.01 * speed
    assert forward.max() <= 1.1 * along_it
    assert sideways.max() <= 1.12 * across  # what a moving mean over curvature leaves
    assert max(rates.max() / speed, forward.max() / along_it, sideways.max() / across) > (
        0.5 if path == "short" else 0.9
    )
    np.testing.assert_allclose(reference.over([0.0, reference.duration])[1], 0.0, atol=1e-9)


def test_jerk_spreads_acceleration() -> None:
    slow, swift = (along(PATHS["long"], 2.0, 1.0, jerk=jerk) for jerk in (0.5, 20.0))
    assert slow.duration > swift.duration + 1.0
    times = np.linspace(0.0, 1.0, 200)
    steepest = [
        np.abs(np.diff(np.linalg.norm(one.over(times)[2], axis=1)) / np.diff(times)).max() for one in (slow, swift)
    ]
    assert steepest[0] < 0.8
    assert steepest[1] > 5.0


@pytest.mark.parametrize("between", BETWEEN)
def test_two_points_with_free_ends_are_a_straight_line(between: Between) -> None:
    reference = Waypoints([1.0, 3.0], {"y1": [0.0, 4.0], "y2": [1.0, 0.0]}, between, "free", stop=1e3)
    position, velocity, acceleration = reference.over([1.5, 2.9])
    np.testing.assert_allclose(position, [[1.0, 0.75], [3.8, 0.05]], rtol=1e-12)
    np.testing.assert_allclose(velocity, [[2.0, -0.5]] * 2, rtol=1e-12)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Waypoints([0.0], {"y1": [1.0]}), "give two or more"),
        (lambda: Waypoints([0.0, 1.0, 1.0], {"y1": [1.0, 2.0, 3.0]}), "time 1 s follows 1 s (point 3)"),
        (lambda: Waypoints([0.0, 2.0, 1.0], {"y1": [1.0, 2.0, 3.0]}), "give times that increase"),
        (lambda: Waypoints([0.0, np.nan], {"y1": [1.0, 2.0]}), "time 2 is not finite"),
        (lambda: Waypoints([0.0, 1.0], {"y1": [1.0, np.inf]}), "value 2 of y1 is not finite"),
        (lambda: Waypoints([0.0, 1.0], {"y1": [1.0]}), "1 values of y1 for 2 points"),
        (lambda: Waypoints([0.0, 1.0], {}), "no output has values"),
        (lambda: Waypoints([0.0, 1.0], {"y1": [1.0, 2.0]}, stop=0.0), "choose a positive deceleration"),
        (lambda: Waypoints([0.0, 1.0], {"y1": [1.0, 2.0]}, ends="loose"), "unknown kind of ends 'loose'"),
        (
            lambda: Waypoints([0.0, 1.0], {"y1": [1.0, 2.0]}, "linear"),
            "unknown spline 'linear'; there is quintic, cubic",
        ),
        (lambda: along({"y1": [0.0, 1.0]}, 1.0, 1e-12), "s; choose higher limits"),
        (lambda: along({"y1": [0.0, 1.0]}, 1.0, 1.0, jerk=1e-9), "the drive takes 1e+09 s"),
        (lambda: along({"y1": [0.0, 0.0], "y2": [1.0, 1.0]}, 1.0, 1.0), "points 1 and 2 are the same"),
        (lambda: along({"y1": [0.0, 1.0]}, 0.0, 1.0), "speed is 0; choose a positive limit"),
        (lambda: along({"y1": [0.0, 1.0]}, 1.0, 1.0, lateral=-1.0), "lateral is -1"),
        (lambda: along({"y1": [0.0, 1.0]}, 1e300, 1.0), "speed is 1e+300; choose a limit between"),
        (lambda: along({"y1": [0.0, 1.0]}, 1.0, 1e300), "acceleration is 1e+300; choose a limit between"),
        (lambda: along({"y1": [0.0, 1.0]}, 1e-300, 1.0), "speed is 1e-300; choose a limit between"),
        (lambda: along({}, 1.0, 1.0), "no output has values"),
    ],
)
def test_points_that_make_no_way_are_refused(build: object, words: str) -> None:
    with pytest.raises(WmrError) as caught:
        build()  # type: ignore[operator]
    assert words in str(caught.value)


def experiment(robot: str, folder: Path, reference: str, more: str = "") -> Path:
    """The shipped track of a robot with another reference, from where that begins."""
    text = find_experiment(f"track_{robot}").read_text()
    begin, end = text.index("[reference"), text.index("[simulation]")
    text = text[:begin] + reference + "\n\n" + text[end:]
    begin = text.index("duration = ", text.index("[simulation]"))
    text = text[:begin] + "duration = 8.0\n" + text[text.index("\n", begin) :]
    shared = text.index("[shared]")
    file = folder / "points.toml"
    file.write_text(text[:shared] + '[controllers.exact]\nlaw = "frozen"\nreference_rate = 3.0\n' + more)
    return file


def track(robot: str, times: Floats) -> tuple[list[str], Floats]:
    """Names of the outputs, and the shipped reference's values at some times."""
    reference = next(iter(load_experiment(f"track_{robot}").loops.values())).reference
    return list(reference.outputs), reference.over(times)[0]


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_table_is_followed_as_the_formula_that_it_was_made_of(robot: str, tmp_path: Path) -> None:
    """Points of the shipped reference every 0.1 s, in a file: the same run up to what lies between points."""
    times = np.arange(0.0, 10.001, 0.1)
    names, values = track(robot, times)
    rows = [
        ",".join(["t [s]", *names]),
        *(",".join(map(repr, row)) for row in np.column_stack([times, values]).tolist()),
    ]
    (tmp_path / "points.csv").write_text("\n".join(rows))
    table = experiment(robot, tmp_path, '[reference]\nwaypoints = { file = "points.csv", ends = "free" }')
    found = wmr_afl.run(table, backend="casadi")["exact"]
    text = find_experiment(f"track_{robot}").read_text()
    formula = experiment(robot, tmp_path, text[text.index("[reference") : text.index("[simulation]")])
    expected = wmr_afl.run(formula, backend="casadi")["exact"]
    assert found.failure is None
    middle = (found.time > 0.5) & (found.time < 8.0)
    np.testing.assert_allclose(found.reference[middle], expected.reference[middle], atol=2e-4)
    assert np.abs(found.error[found.time > 5.0]).max() < 5e-3


@pytest.mark.parametrize("late", [False, True])
def test_all_ways_to_run_follow_a_table_alike(late: bool, tmp_path: Path) -> None:
    """NumPy, CasADi, compiled, a batch; also a law that looks ahead."""
    points = "{ t = [0.0, 1.0, 2.0, 4.0], y1 = [0.0, 0.2, 0.6, 1.0], y2 = [0.0, 0.0, 0.2, 0.5] }"
    more = 'measures = "pose"\nobserver = { predict = true }\n' if late else ""
    file = experiment("type_2_0", tmp_path, f"[reference]\nwaypoints = {{ points = {points} }}", more)
    if late:
        file.write_text(
            file.read_text().replace("[uncertainties]\n", "[uncertainties]\ninput_delay = { seconds = 0.04 }\n")
        )
    runs = [wmr_afl.run(file, backend=backend)["exact"] for backend in ("numpy", "casadi", "compiled")]
    assert runs[0].failure is None
    for run in runs[1:]:
        np.testing.assert_allclose(run.state, runs[0].state, atol=1e-9)
        np.testing.assert_allclose(run.input, runs[0].input, atol=1e-8)
    for backend in ("compiled", "casadi"):
        batch = wmr_afl.run_batch(file, scale={"parameters.m_C": [1.0, 1.1]}, backend=backend)
        np.testing.assert_allclose(batch.rms[0], runs[0].rms(), rtol=1e-9)
    np.testing.assert_allclose(runs[0].reference[-1], [1.0, 0.5], atol=1e-12)


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    csv = tmp_path / "points.csv"
    file = experiment("type_2_0", tmp_path, '[reference]\nwaypoints = { file = "points.csv" }')
    ends = []
    for last in (1.0, 2.0):
        csv.write_text(f"t,y1,y2\n0,0,0\n5,{last},0\n")
        ends.append(wmr_afl.run(file, backend="casadi")["exact"].reference[-1, 0])
    np.testing.assert_allclose(ends, [1.0, 2.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("reference", "csv", "words"),
    [
        ('waypoints = { file = "no.csv" }', None, "cannot be read"),
        ('waypoints = { file = "p.csv" }', "t,y1\n0,1\n1,2\n", "add a column y2"),
        ('waypoints = { file = "p.csv" }', "y1,y2\n0,1\n1,2\n", "add a column t [s]"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2\n0,1\n1,2,3\n", "point 1: 2 cells for 3 columns"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2\n0,1,2\n1,two,3\n", "point 2, y1: 'two' is no finite number"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2\n0,1,2\n1,nan,3\n", "'nan' is no finite number"),
        ('waypoints = { file = "p.csv" }', "0,1,2\n1,2,3\n", "is no header"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2\n", "holds no points"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2,y3\n0,1,2,3\n1,2,3,4\n", "'y3'"),
        ('waypoints = { file = "p.csv" }', "t,y1,y2\n0,1,2\n0,2,3\n", "give times that increase"),
        (
            'path = { file = "p.csv", speed = 1.0, acceleration = 1.0 }',
            "y1,y2\n0,1\n0,1\n",
            "points 1 and 2 are the same",
        ),
        ('path = { file = "p.csv", speed = 1.0, acceleration = 1.0 }', "y1,y2,t\n0,1,2\n1,1,3\n", "'t'"),
        ('path = { file = "p.csv", speed = 0.0, acceleration = 1.0 }', "y1,y2\n0,1\n1,1\n", "greater than 0"),
        ("waypoints = { }", None, "give one of them"),
        ('waypoints = { file = "p.csv", between = "linear" }', "t,y1,y2\n0,1,2\n1,2,3\n", "'quintic' or 'cubic'"),
    ],
)
def test_what_is_no_reference_is_told_in_one_line(reference: str, csv: str | None, words: str, tmp_path: Path) -> None:
    if csv is not None:
        (tmp_path / "p.csv").write_text(csv)
    with pytest.raises(WmrError) as caught:
        load_experiment(experiment("type_2_0", tmp_path, f"[reference]\n{reference}"))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
