"""References of several pieces: against their parts, where pieces meet, and loops that follow them."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import wmr_afl
from tests.wmr_afl.controllers.test_waypoints import differences, experiment
from tests.wmr_afl.onboard.test_live_references import STEP, driven
from wmr_afl import ArgumentError, Controller, UnknownNameError, WmrError
from wmr_afl.analysis.feasibility import demand
from wmr_afl.cli import app
from wmr_afl.controllers.live_reference import LiveReference
from wmr_afl.controllers.path import along
from wmr_afl.controllers.pieces import Pieces
from wmr_afl.controllers.reference import Reference, circle, line
from wmr_afl.controllers.sampled import Sampled
from wmr_afl.controllers.waypoints import Waypoints
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.experiments.load import load_experiment

OUTPUTS = ["y1", "y2"]
LINE = Reference(dict(zip(OUTPUTS, line([0.0, 1.0], [0.5, 0.0]), strict=True)))
CIRCLE = Reference({"y1": "5 + 2*sin(0.25*t)", "y2": "3 - 2*cos(0.25*t)"})  # goes on where the line is after 10 s
POINTS = Waypoints([0.0, 2.0, 5.0], {"y1": [1.0, 2.0, 4.0], "y2": [0.0, 1.0, 0.5]})
PATH = along({"y1": [4.0, 6.0, 7.0], "y2": [0.5, 0.5, 2.0]}, 1.0, 0.5)
SAMPLED = Sampled(OUTPUTS, lambda t: [7.0 + np.sin(t) ** 4, 2.0 - t**3 / 9.0], 1.5, stop=2.0)
ROWS: dict[str, list[tuple[Reference, float]]] = {  # pieces that meet, and how long each lasts
    "formulas that move": [(LINE, 10.0), (CIRCLE, 8.0)],
    "points, a path and a function": [
        (POINTS, POINTS.duration),
        (PATH, PATH.duration),
        (SAMPLED, SAMPLED.duration),
    ],
    "points that rest longer": [(POINTS, 7.5), (PATH, PATH.duration)],
}  # fmt: skip
AFTER = Reference({"y1": "5 + 2*sin(0.25*(t + 2))", "y2": "3 - 2*cos(0.25*(t + 2))"})
ROWS["a row within a row"] = [(Pieces(ROWS["formulas that move"]), 12.0), (AFTER, 3.0)]


def inner(pieces: Pieces, starts: list[float], gap: float = 1e-3) -> np.ndarray:
    """Times that are not where pieces meet."""
    times = np.linspace(0.01, pieces.duration - 0.01, 700)
    return times[np.abs(times[:, None] - np.array(starts)).min(axis=1) > gap]


def starts(row: list[tuple[Reference, float]]) -> list[float]:
    return np.cumsum([0.0, *(lasts for _, lasts in row)]).tolist()


@pytest.mark.parametrize("name", ROWS)
def test_each_piece_is_its_part_in_its_own_time(name: str) -> None:
    pieces, begin = Pieces(ROWS[name]), starts(ROWS[name])
    for (part, lasts), start in zip(ROWS[name], begin, strict=False):
        own = np.linspace(1e-3, lasts - 1e-3, 101)
        for found, expected in zip(pieces.over(start + own), part.over(own), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    assert pieces.duration >= begin[-1]


@pytest.mark.parametrize("name", ROWS)
def test_derivatives_are_its_own(name: str) -> None:
    pieces = Pieces(ROWS[name])
    times = inner(pieces, starts(ROWS[name]))
    velocity, acceleration = differences(pieces, times)
    np.testing.assert_allclose(pieces.over(times)[1], velocity, atol=1e-6)
    np.testing.assert_allclose(pieces.over(times)[2], acceleration, atol=2e-4)


@pytest.mark.parametrize("name", ROWS)
def test_where_pieces_meet_only_the_acceleration_jumps(name: str) -> None:
    """The value there is that of the later piece, and at the very end that of the last one."""
    pieces, meeting = Pieces(ROWS[name]), np.array(starts(ROWS[name])[1:])
    before, after = pieces.over(meeting - 1e-9), pieces.over(meeting + 1e-9)
    for side in range(2):
        np.testing.assert_allclose(before[side], after[side], atol=2e-6)
    for n, (part, _) in enumerate(ROWS[name][1:]):
        np.testing.assert_allclose(pieces.over(meeting[[n]])[2], part.over([0.0])[2], atol=1e-12)


@pytest.mark.parametrize("name", ROWS)
@pytest.mark.parametrize("lead", [0.0, 0.3])
def test_a_row_is_looked_up_as_it_is_evaluated(name: str, lead: float) -> None:
    pieces = Pieces(ROWS[name])
    times = np.concatenate([np.linspace(-1.0, pieces.duration + 2.0, 301), starts(ROWS[name])])
    rows = np.array([pieces.clock(np.array([t]), lead)[0] for t in times])
    np.testing.assert_allclose(rows, pieces.clock(times, lead), rtol=1e-12, atol=1e-12)
    assert rows.shape[1] == (13 if lead else 7)
    for t in (2.0, 11.0):
        point = pieces.at(t)
        rows = np.array([point.position, point.velocity, point.acceleration])
        np.testing.assert_allclose(rows, np.reshape(pieces.row(t), (3, 2)), rtol=1e-12, atol=1e-12)


KINDS = [Pieces(ROWS["points, a path and a function"], stop=0.3), POINTS, PATH, SAMPLED]


@pytest.mark.parametrize("reference", KINDS, ids=lambda one: type(one).__name__)
def test_a_step_sees_the_reference_now_and_later_in_its_row(reference: Reference) -> None:
    """As `at` gives it, in the order yr, yr', yr''; without a lead later is now."""
    for t in (0.4, 4.9, 6.0):
        for lead in (0.0, 0.3):
            seen, now, later = reference.seen(reference.clock(np.array([t]), lead)[0], lead)
            assert seen == t
            for found, expected in ((now, reference.at(t)), (later, reference.at(t + lead))):
                np.testing.assert_allclose(found.position, expected.position, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(found.velocity, expected.velocity, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(found.acceleration, expected.acceleration, rtol=1e-9, atol=1e-9)


def test_behind_its_end_it_comes_to_rest_as_points_with_free_ends_do() -> None:
    """On the same straight line, by the same deceleration; before zero it rests where it begins."""
    t = np.linspace(0.0, 2.0, 9)
    points = Waypoints(t, {"y1": 3.0 * t, "y2": -4.0 * t}, "cubic", "free", stop=2.5)
    pieces = Pieces([(Reference({"y1": "3*t", "y2": "-4*t"}), 2.0)], stop=2.5)
    assert pieces.duration == pytest.approx(points.duration) == pytest.approx(4.0)
    times = np.array([0.5, 2.5, 3.0, 3.999, 4.5, 100.0])
    for found, expected in zip(pieces.over(times), points.over(times), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)
    before = pieces.over([-3.0, -1e-6])
    np.testing.assert_array_equal(before[0], np.zeros((2, 2)))
    assert not before[1].any()
    assert not before[2].any()
    resting = Pieces([POINTS], stop=0.1)
    assert resting.duration == POINTS.duration
    np.testing.assert_allclose(resting.over([6.0])[0], [[4.0, 0.5]], atol=1e-12)


def test_a_piece_that_ends_by_itself_may_be_cut_short() -> None:
    """Points on the line, of which it leaves the stop behind their end away."""
    t = np.linspace(0.0, 4.0, 5)
    points = Waypoints(t, {"y1": 0.5 * t - 2.0, "y2": np.ones(5)}, "cubic", "free", stop=0.5)
    pieces = Pieces([(points, 4.0), (LINE, 10.0)])
    np.testing.assert_allclose(pieces.over([3.0, 4.0, 6.0])[1], [[0.5, 0.0]] * 3, atol=1e-9)
    with pytest.raises(WmrError, match=r"piece 1 ends at y1 = 0\.25, piece 2 begins at 0\.0: 0\.25 output units"):
        Pieces([points, (LINE, 10.0)])


def test_the_order_of_outputs_does_not_matter() -> None:
    turned = Reference({"y2": CIRCLE.expressions["y2"], "y1": CIRCLE.expressions["y1"]})
    pieces, mixed = (Pieces([(LINE, 10.0), (one, 8.0)], stop=0.2) for one in (CIRCLE, turned))
    times = np.linspace(0.0, 30.0, 61)
    for name, other in (("mixed", mixed), ("a copy", pickle.loads(pickle.dumps(pieces)))):  # noqa: S301, our own
        for found, expected in zip(other.over(times), pieces.over(times), strict=True):
            np.testing.assert_array_equal(found, expected, err_msg=name)
    other = pieces.ordered(["y2", "y1"])
    assert other.outputs == ("y2", "y1")
    for found, expected in zip(other.over(times), pieces.over(times), strict=True):
        np.testing.assert_array_equal(found, expected[:, ::-1])
    assert pieces.ordered(["y1", "y2"]) is pieces
    with pytest.raises(UnknownNameError, match="y2"):
        pieces.ordered(["y1"])
    with pytest.raises(WmrError, match="add y3 to every piece"):
        pieces.ordered(["y1", "y2", "y3"])


def test_turns_count_in_all_pieces_or_in_none() -> None:
    counting = [Reference(one.expressions, counts_turns=True) for one in (LINE, CIRCLE)]
    pieces = Pieces([(counting[0], 10.0), (counting[1], 8.0)])
    assert pieces.counts_turns
    assert pieces.at(12.0).counts_turns
    assert all(point.counts_turns for point in pieces.seen(pieces.clock(np.array([1.0]), 0.1)[0], 0.1)[1:])
    assert pieces.ordered(["y2", "y1"]).counts_turns
    assert not Pieces([(LINE, 10.0)]).at(0.0).counts_turns
    with pytest.raises(WmrError, match="one of pieces 1 and 2 counts turns; let all of them, or none"):
        Pieces([(LINE, 10.0), (counting[1], 8.0)])


JUMPS = Reference({"y1": "5.2 + 0.5*t", "y2": "1"})
BENDS = Reference({"y1": "5 + 0.2*t", "y2": "1 - t"})


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        (lambda: [], "there are no pieces; give one or more"),
        (lambda: [LINE], "piece 1 goes on for ever; give it a duration [s]"),
        (lambda: [(LINE, 10.0), CIRCLE], "piece 2 goes on for ever"),
        (lambda: [(LINE, -1.0)], "piece 1 lasts -1 s; give it a positive duration"),
        (lambda: [(LINE, 0.0)], "piece 1 lasts 0 s"),
        (lambda: [(LINE, np.nan)], "piece 1 lasts nan s"),
        (lambda: [(LINE, np.inf)], "piece 1 lasts inf s"),
        (
            lambda: [(LINE, 10.0), (JUMPS, 1.0)],
            "piece 1 ends at y1 = 5.0, piece 2 begins at 5.2: 0.2 output units apart; let piece 2 begin at y1 = 5.0, "
            "y2 = 1.0",
        ),
        (
            lambda: [(LINE, 10.0), (BENDS, 1.0)],
            "piece 1 ends at y2' = 0.0, piece 2 begins at -1.0: 1 output units/s apart; let piece 2 begin at "
            "y1' = 0.5, y2' = 0.0",
        ),
        (lambda: [(LINE, 10.0 + 1e-5), (CIRCLE, 1.0)], "5e-06 output units apart"),
        (lambda: [POINTS, PATH, (LINE, 1.0)], "piece 2 ends at y1 = 7.0, piece 3 begins at 0.0"),
        (lambda: [(LINE, 10.0), (Reference({"y1": "5 + 0.5*t"}), 1.0)], "piece 2: output 'y2' has no reference"),
        (lambda: [(LINE, 10.0), (Reference({"y1": "0", "y2": "0", "z": "0"}), 1.0)], "piece 2: unknown output 'z'"),
        (
            lambda: [(Reference({"y1": "t", "y2": "1/t"}), 1.0)],
            "y2 of piece 1, or a derivative, is not finite at its 0 s",
        ),
        (lambda: [(Reference({"y1": "sqrt(1 - t)", "y2": "1"}), 1.0)], "y1 of piece 1, or a derivative, is not finite"),
        (lambda: [(LiveReference(OUTPUTS), 1.0)], "piece 1 is not known in advance"),
    ],
)
def test_pieces_that_make_no_way_are_refused(pieces: object, words: str) -> None:
    with pytest.raises(WmrError) as caught:
        Pieces(pieces())  # type: ignore[operator]
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_of_the_message_fit() -> None:
    """Where the next piece should begin, copied from the text, and at which velocity."""
    before = Reference({"y1": "5e6 + sin(t)", "y2": "cos(t)/3"})
    start, velocity = [0.0, 0.0], [0.0, 0.0]
    for numbers in (start, velocity):
        with pytest.raises(WmrError) as caught:
            Pieces([(before, 1.7), (Reference(dict(zip(OUTPUTS, line(start, velocity), strict=True))), 1.0)])
        numbers[:] = [float(one.split(" = ")[1]) for one in caught.value.remedy.split(", ")]
    Pieces([(before, 1.7), (Reference(dict(zip(OUTPUTS, line(start, velocity), strict=True))), 1.0)])


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([3], "give a list, each entry a Reference or a tuple"),
        ([()], "piece 1 is (); give a reference, or (reference, duration [s])"),
        ([(LINE, 1.0, 2.0)], "give a reference, or (reference, duration [s])"),
        ([(1.0, LINE)], "give a reference, or (reference, duration [s])"),
        ([(LINE, "1")], "the duration of piece 1 is '1'; give seconds as a number"),
    ],
)
def test_what_are_no_pieces_is_refused(pieces: object, words: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        Pieces(pieces)  # type: ignore[arg-type]
    assert words in str(caught.value)


def test_a_stop_is_positive() -> None:
    with pytest.raises(WmrError, match="choose a positive deceleration"):
        Pieces([POINTS], stop=0.0)


# --- in an experiment ------------------------------------------------------------------------------------------------

TOML = """[reference]
pieces = [
    { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = 2.0 },
    { expressions = { y2 = "1.5 - 1.5*cos(0.2*t)", y1 = "0.6 + 1.5*sin(0.2*t)" }, duration = 1.5 },
]
stop = 0.5
"""
SAME = Pieces(
    [
        (Reference(dict(zip(OUTPUTS, line([0.0, 0.0], [0.3, 0.0]), strict=True))), 2.0),
        (Reference({"y1": "0.6 + 1.5*sin(0.2*t)", "y2": "1.5 - 1.5*cos(0.2*t)"}), 1.5),
    ],
    stop=0.5,
)
LATE = 'measures = "pose"\nobserver = { predict = true }\n'


def of_pieces(folder: Path, late: bool = False, reference: str = TOML) -> Path:
    """A differential robot that follows pieces, also with a drive that is late and a law that looks ahead."""
    file = experiment("type_2_0", folder, reference, LATE if late else "")
    if late:
        text = file.read_text()
        file.write_text(text.replace("[uncertainties]\n", "[uncertainties]\ninput_delay = { seconds = 0.04 }\n"))
    return file


@pytest.mark.parametrize("late", [False, True])
def test_all_ways_to_run_follow_pieces_alike(late: bool, tmp_path: Path) -> None:
    """NumPy, CasADi, compiled within rounding; a batch; the reference is that of Python."""
    file = of_pieces(tmp_path, late)
    runs = [wmr_afl.run(file, backend=backend)["exact"] for backend in ("numpy", "casadi", "compiled")]
    assert runs[0].failure is None
    for run in runs[1:]:
        np.testing.assert_allclose(run.state, runs[0].state, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(run.input, runs[0].input, rtol=1e-12, atol=1e-11)
    np.testing.assert_array_equal(runs[0].reference, SAME.over(runs[0].time)[0])
    batch = wmr_afl.run_batch(file, scale={"parameters.m_C": [1.0, 1.1]})
    np.testing.assert_allclose(batch.rms[0], runs[0].rms(), rtol=1e-9)
    again = wmr_afl.run(file, backend="casadi", reference=SAME)["exact"]
    np.testing.assert_array_equal(again.state, runs[1].state)


def test_a_robot_that_knows_everything_follows_pieces(tmp_path: Path) -> None:
    """Where acceleration jumps, too; and it comes to rest where they end."""
    run = wmr_afl.run(of_pieces(tmp_path), backend="casadi")["exact"]
    assert np.abs(run.error[run.time > 6.0]).max() < 1e-3
    np.testing.assert_allclose(run.reference[-1], SAME.over([100.0])[0][0], rtol=1e-12)


def test_a_controller_follows_pieces_as_if_they_were_given_live() -> None:
    loop = next(iter(load_experiment("study_1").loops.values()))
    pieces = Pieces([(LINE, 1.0), (Reference({"y1": "0.5 + 0.5*t + 0.1*t**2", "y2": "1"}), 2.0)], stop=0.7)
    own = Controller(loop.model, loop.law, pieces, STEP)
    live = Controller(loop.model, loop.law, LiveReference(OUTPUTS), STEP)
    np.testing.assert_allclose(driven(live, pieces), driven(own, None), rtol=1e-12, atol=1e-12)


def test_points_of_pieces_stand_in_files_that_are_read_again(tmp_path: Path) -> None:
    text = (
        '[reference]\npieces = [ { waypoints = { file = "a.csv" } }, '
        '{ path = { file = "b.csv", speed = 1.0, acceleration = 0.5 } } ]'
    )
    (tmp_path / "a.csv").write_text("t [s],y1,y2\n0,0,0\n2,1,0\n")
    file, ends = of_pieces(tmp_path, reference=text), []
    for last in (2.0, 3.0):
        (tmp_path / "b.csv").write_text(f"y1,y2\n1,0\n{last},0\n")
        reference = next(iter(load_experiment(file).loops.values())).reference
        ends.append(reference.over([1e3])[0][0, 0])
        np.testing.assert_allclose(reference.over([2.0])[0], [[1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(ends, [2.0, 3.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ("pieces = []", "[reference] pieces: has 0 entries; give 1"),
        ("pieces = [ { duration = 1.0 } ]", "[reference] pieces number 1: names no or several trajectories"),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] } } ]",
            "[reference.pieces]: piece 1 goes on for ever; give it a duration [s]",
        ),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = -1.0 } ]",
            "[reference] pieces number 1 duration: -1.0 does not fit",
        ),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = nan } ]",
            "[reference] pieces number 1 duration: nan does not fit; expected a finite number",
        ),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = 1.0 }, "
            "{ circle = { center = [0.0, 0.0], radius = nan, rate = 1.0 }, duration = 1.0 } ]",
            "[reference] pieces number 2 circle.radius: nan does not fit",
        ),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = 1.0 }, "
            "{ line = { start = [0.3, 0.1], velocity = [0.3, 0.0] }, duration = 1.0 } ]",
            "[reference.pieces]: piece 1 ends at y2 = 0.0, piece 2 begins at 0.1: 0.1 output units apart; "
            "let piece 2 begin at y1 = 0.3, y2 = 0.0",
        ),
        (
            "pieces = [ { line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }, duration = 1.0 }, "
            "{ line = { start = [0.3], velocity = [0.3] }, duration = 1.0 } ]",
            "[reference] pieces number 2 line: gives 1 coordinates for 2 outputs (y1, y2)",
        ),
        (
            'pieces = [ { expressions = { y1 = "t" }, duration = 1.0 } ]',
            "[reference] pieces number 1 expressions: output 'y2' has no reference",
        ),
        (
            "pieces = [ { waypoints = { points = { t = [0.0, 1.0], y1 = [0.0, 1.0] } } } ]",
            "[reference] pieces number 1 waypoints: output 'y2' has no reference; add a column y2",
        ),
        ('pieces = [ { waypoints = { file = "no.csv" } } ]', "no.csv: cannot be read"),
        ("pieces = [ { pieces = [] } ]", "unknown key 'pieces'"),
        (f"{TOML[12:]}line = {{ start = [0.0, 0.0], velocity = [0.3, 0.0] }}", "names no or several trajectories"),
        (
            "line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }\nstop = 1.0",
            "[reference]: stop means nothing without pieces; remove it",
        ),
        (TOML[12:].replace("0.5\n", "0.0\n"), "[reference] stop: 0.0 does not fit"),
    ],
)
def test_what_are_no_pieces_is_told_in_one_line_with_its_place(reference: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(WmrError) as caught:
        load_experiment(of_pieces(tmp_path, reference=f"[reference]\n{reference}"))
    assert words in str(caught.value)
    assert [line for line in str(caught.value).split("\n") if "pieces" not in line and "no.csv" not in line] == []


def test_whether_a_robot_can_follow_pieces_is_told(tmp_path: Path) -> None:
    """On the command line, and of a reference that only Python has."""
    file = of_pieces(tmp_path)
    text, model = file.read_text(), wmr_afl.load_model("type_2_0")
    ahead = dict(zip(model.parameter_units, model.parameters(), strict=True))["L"]
    begin, end = text.index("[start]"), text.index("[reference]")
    file.write_text(f"{text[:begin]}[start]\nx = {-ahead}\nv = 0.3\n\n{text[end:]}")
    done = CliRunner().invoke(app, ["check-reference", str(file)])
    assert done.exit_code == 0, done.output
    swift = Pieces([(Reference({"y1": "0.3*t", "y2": "0"}), 2.0), (Reference(
        {"y1": "0.6 + 0.3*t + 20*t**2", "y2": "0"}), 1.0)], stop=50.0)  # fmt: skip
    doubts = demand(*read_experiment(file), swift).doubts
    assert any("would need up to" in doubt.what and 1.9 < doubt.first < 2.5 for doubt in doubts)
    assert not any("jumps" in doubt.what for doubt in doubts)


def test_a_circle_of_a_file_is_that_of_a_piece(tmp_path: Path) -> None:
    """Named trajectories are pieces, too."""
    table = "circle = { center = [1.0, 2.0], radius = 0.5, rate = 0.4 }"
    text = f"[reference]\npieces = [ {{ {table}, duration = 3.0 }} ]\ncounts_turns = "
    for counts in (True, False):
        file = of_pieces(tmp_path, reference=f"{text}{str(counts).lower()}")
        assert next(iter(load_experiment(file).loops.values())).reference.counts_turns == counts
    reference = next(iter(load_experiment(file).loops.values())).reference
    expected = Reference(dict(zip(OUTPUTS, circle([1.0, 2.0], 0.5, 0.4), strict=True)))
    times = np.linspace(0.0, 2.99, 50)
    for found, value in zip(reference.over(times), expected.over(times), strict=True):
        np.testing.assert_array_equal(found, value)
