"""A controller that is given its reference with each sample, from a planner's buffer or from a table."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tests.wmr_afl.controllers.test_waypoints import T, Y
from wmr_afl import Controller, WmrError, load_model
from wmr_afl.controllers.live_reference import BufferState, LiveReference, ReferenceBuffer
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.waypoints import Waypoints
from wmr_afl.errors import SimulationError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

STEP = 0.02
LAWS = [("study_1", None), ("study_1_laws", "composite"), ("study_2_pose", "pose")]


def driven(controller: Controller, reference: Reference | None, samples: int = 200) -> Floats:
    """Voltages along a motion that is prescribed, with the reference given live or not."""
    rows = []
    for n in range(samples):
        t = STEP * n
        x = np.array([0.1 * t, 5.0 + 0.2 * np.sin(t), 0.3 * np.cos(t), 0.2, -0.1])
        given = None if reference is None else reference.over([t])
        rows.append(controller.update(t, x) if given is None else controller.update(t, x, [part[0] for part in given]))
    return np.array(rows)


@pytest.mark.parametrize(("experiment", "name"), LAWS)
def test_a_reference_given_live_is_the_reference_of_the_file(experiment: str, name: str | None) -> None:
    """The same voltages, whether the formula is traced or its values are given."""
    own = Controller.from_experiment(experiment, name)
    live = Controller.from_experiment(experiment, name, is_live=True)
    np.testing.assert_allclose(driven(live, own.reference), driven(own, None), rtol=1e-9, atol=1e-9)


def test_a_table_is_looked_up_as_it_is_evaluated() -> None:
    """One row at a time and all at once: the same numbers, inside and outside, for every spline."""
    times = np.concatenate([np.linspace(-1.0, 9.0, 301), T])
    for between in ("quintic", "cubic"):
        for ends in ("rest", "free"):
            reference = Waypoints(T, Y, between, ends)  # type: ignore[arg-type]
            for lead in (0.0, 0.3):
                rows = np.array([reference.clock(np.array([t]), lead)[0] for t in times])
                np.testing.assert_allclose(rows, reference.clock(times, lead), rtol=1e-9, atol=1e-9)


def test_a_controller_follows_a_table() -> None:
    """As the same law with the reference given live."""
    loaded = load_experiment("study_1")
    loop = next(iter(loaded.loops.values()))
    table = Waypoints(
        np.linspace(0.0, 4.0, 9), {"y1": np.linspace(2.0, 3.0, 9), "y2": 5.0 + np.linspace(0.0, 1.0, 9) ** 2}
    )
    own = Controller(loop.model, loop.law, table, STEP)
    live = Controller(loop.model, loop.law, LiveReference(["y1", "y2"]), STEP)
    np.testing.assert_allclose(driven(live, table), driven(own, None), rtol=1e-9, atol=1e-9)


def model_and_law() -> tuple[Model, object]:
    loop = next(iter(load_experiment("study_1").loops.values()))
    return loop.model, loop.law


def test_what_is_given_live_is_looked_at() -> None:
    """Names and number of outputs, what is finite, and whether anything was given; a refusal changes nothing."""
    live, x = Controller.from_experiment("study_1", is_live=True), [0.0, 5.0, 0.0, 0.0, 0.0]
    point = ([2.0, 5.0], [0.0, 0.1], [0.0, 0.0])
    first = live.update(0.0, x, point)
    before = live.state_dict()
    for wrong, words in (
        (None, "give reference = (yr, yr1, yr2)"),
        (([2.0], [0.0, 0.1], [0.0, 0.0]), r"yr has shape \(1,\)"),
        (([2.0, np.nan], [0.0, 0.1], [0.0, 0.0]), "reference as given is not finite"),
        ((["a", "b"], [0.0, 0.1], [0.0, 0.0]), "yr"),
    ):
        with pytest.raises(WmrError, match=words.replace("(yr, yr1, yr2)", r"\(yr, yr1, yr2\)")):
            live.update(STEP, x, wrong)  # type: ignore[arg-type]
        assert live.state_dict() == before
    np.testing.assert_array_equal(live.update(0.0, x, point), first)
    with pytest.raises(WmrError, match="has a reference of its own"):
        Controller.from_experiment("study_1").update(0.0, x, point)  # type: ignore[arg-type]
    with pytest.raises(WmrError, match="output"):
        Controller(load_model("type_2_0"), model_and_law()[1], LiveReference(["y1"]), STEP)  # type: ignore[arg-type]


def pushed(buffer: ReferenceBuffer, reference: Reference, times: Floats) -> None:
    for t, *rows in zip(times, *reference.over(times), strict=True):
        buffer.push(float(t), *rows)


def smooth() -> Reference:
    return Reference({"y1": "sin(t)", "y2": "0.5*t + cos(2*t)"})


def test_between_points_it_is_the_polynomial_that_joins_them() -> None:
    """Exact at points, and of degree six in their distance between them; derivatives are its own."""
    worst = []
    for gap in (0.2, 0.1):
        buffer = ReferenceBuffer(["y1", "y2"], room=256)
        pushed(buffer, smooth(), np.arange(0.0, 4.0 + gap, gap))
        times = np.linspace(0.0, 4.0, 401)
        found = np.array([np.array(buffer.at(t)) for t in times])
        assert buffer.state is BufferState.FRESH
        worst.append(np.abs(found[:, 0] - smooth().over(times)[0]).max())
        rates = np.diff(found[:, 0], axis=0) / np.diff(times)[:, None]
        np.testing.assert_allclose(rates, 0.5 * (found[1:, 1] + found[:-1, 1]), atol=1e-4)
        bends = np.diff(found[:, 1], axis=0) / np.diff(times)[:, None]
        np.testing.assert_allclose(bends, 0.5 * (found[1:, 2] + found[:-1, 2]), atol=1e-3)
    assert worst[0] < 1e-6
    assert worst[1] < worst[0] / 30.0


def test_when_nothing_comes_it_holds_and_then_stops_for_good() -> None:
    """Velocity goes on until the time-out and then falls to zero; what comes later is not followed until `resume`."""
    buffer = ReferenceBuffer(["y1", "y2"], timeout=0.5, stop=2.0)
    assert buffer.state is BufferState.EMPTY
    with pytest.raises(SimulationError, match="no setpoint has come yet"):
        buffer.at(0.0)
    buffer.push(1.0, [0.0, 1.0], [2.0, -1.0])
    states, rows = [], []
    times = np.arange(1.0, 5.0, 0.01)
    for t in times:
        rows.append(np.array(buffer.at(float(t))))
        states.append(buffer.state)
    y, rate = np.array(rows)[:, 0], np.array(rows)[:, 1]
    assert [*dict.fromkeys(states)] == [
        BufferState.FRESH, BufferState.HOLDING, BufferState.STOPPING, BufferState.STOPPED,
    ]  # fmt: skip
    np.testing.assert_allclose(y[-1], np.array([0.0, 1.0]) + (0.5 + 1.0) * np.array([2.0, -1.0]), rtol=1e-9)
    assert not rate[-1].any()
    np.testing.assert_allclose(np.diff(y, axis=0), 0.005 * (rate[1:] + rate[:-1]), atol=1e-3)
    assert np.abs(np.diff(rate, axis=0)).max() < 0.02
    buffer.push(6.0, [9.0, 9.0], [0.0, 0.0])
    np.testing.assert_array_equal(buffer.at(6.0)[0], y[-1])
    assert buffer.state is BufferState.STOPPED
    buffer.resume()
    assert buffer.state is BufferState.EMPTY
    buffer.push(7.0, [9.0, 9.0], [0.0, 0.0])
    np.testing.assert_array_equal(buffer.at(7.0)[0], [9.0, 9.0])


def test_before_the_first_point_it_waits_there() -> None:
    buffer = ReferenceBuffer(["y1"])
    buffer.push(1.0, [2.0], [0.0])
    buffer.push(2.0, [3.0], [0.0])
    assert buffer.at(0.5)[0] == 2.0


@pytest.mark.parametrize(
    ("push", "words"),
    [
        ((1.0, [0.0, 0.0], [0.0, 0.0]), "follows one at 1 s"),
        ((np.nan, [0.0, 0.0], [0.0, 0.0]), "give seconds"),
        ((2.0, [0.0], [0.0, 0.0]), "yr of a setpoint"),
        ((2.0, [0.0, np.inf], [0.0, 0.0]), "give 2 finite numbers"),
        ((2.0, [0.0, 0.0], [0.0, 0.0], [np.nan, 0.0]), "yr2 of a setpoint"),
    ],
)
def test_a_setpoint_that_is_none_is_refused_and_changes_nothing(push: tuple, words: str) -> None:  # type: ignore[type-arg]
    buffer = ReferenceBuffer(["y1", "y2"])
    buffer.push(1.0, [1.0, 2.0], [0.0, 0.0])
    with pytest.raises(WmrError, match=words):
        buffer.push(*push)
    np.testing.assert_array_equal(buffer.at(1.0)[0], [1.0, 2.0])


def test_a_full_buffer_says_so_and_time_does_not_go_back() -> None:
    buffer = ReferenceBuffer(["y1"], room=3)
    for n in range(3):
        buffer.push(float(n), [0.0], [0.0])
    with pytest.raises(WmrError, match="3 setpoints are still to come"):
        buffer.push(3.0, [0.0], [0.0])
    buffer.at(1.5)
    buffer.push(3.0, [0.0], [0.0])
    with pytest.raises(WmrError, match=r"time went back from 1.5 s to 1 s"):
        buffer.at(1.0)
    for wrong in ({"timeout": 0.0}, {"stop": 0.0}, {"room": 1}):
        with pytest.raises(WmrError, match="choose positive times"):
            ReferenceBuffer(["y1"], **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("t", ["a", None, [1.0], np.nan, 1j])
def test_a_time_is_a_number(t: object) -> None:
    buffer = ReferenceBuffer(["y1"])
    buffer.push(1.0, [2.0], [0.0])
    asked = [lambda: buffer.at(t), lambda: buffer.push(t, [2.0], [0.0])]  # type: ignore[arg-type]
    if t is not np.nan:
        asked.append(lambda: buffer.age(t))  # type: ignore[arg-type, return-value]
    for act in asked:
        with pytest.raises(WmrError, match="give seconds"):
            act()
    assert buffer.at(np.float64(1.0))[0] == buffer.at(1)[0] == 2.0  # type: ignore[arg-type]


def test_outputs_are_named_once_and_in_any_order() -> None:
    live = LiveReference(["y1", "y2"], counts_turns=True)
    assert live.ordered(["y2", "y1"]).outputs == ("y2", "y1")
    assert live.ordered(["y2", "y1"]).counts_turns
    assert live.ordered(["y1", "y2"]) is live
    with pytest.raises(WmrError, match="output 'y3' has no reference; name y3 among its outputs"):
        live.ordered(["y1", "y2", "y3"])
    for wrong in ([], ["y1", "y1"]):
        with pytest.raises(WmrError, match="name each once"):
            LiveReference(wrong)


def test_what_is_given_live_goes_on_with_its_acceleration_held() -> None:
    """For a law that looks ahead."""
    clock = np.array([1.0, 2.0, 3.0, 0.5, -0.5, 4.0, -2.0])
    t, now, ahead = LiveReference(["y1", "y2"]).seen(clock, 0.1)
    assert t == 1.0
    np.testing.assert_array_equal([now.position, now.velocity, now.acceleration], clock[1:].reshape(3, 2))
    np.testing.assert_allclose(ahead.position, [2.0 + 0.05 + 0.02, 3.0 - 0.05 - 0.01], rtol=1e-12)
    np.testing.assert_allclose(ahead.velocity, [0.9, -0.7], rtol=1e-12)
    np.testing.assert_array_equal(ahead.acceleration, [4.0, -2.0])


def test_one_thread_pushes_while_another_reads() -> None:
    """Every value lies on the line that is pushed."""
    buffer = ReferenceBuffer(["y1"], timeout=1e6, room=100_000)
    buffer.push(0.0, [0.0], [1.0])

    def push() -> None:
        for n in range(1, 5000):
            buffer.push(0.001 * n, [0.001 * n], [1.0])

    thread = threading.Thread(target=push)
    thread.start()
    for n in range(5000):
        t = 0.001 * n
        assert abs(buffer.at(t)[0][0] - t) < 1e-9
    thread.join()
