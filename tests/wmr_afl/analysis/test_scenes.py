"""What stands in the pictures of an animation, of runs that are made by hand."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from PIL import Image

from tests.wmr_afl.analysis.test_samples import MODEL, TIME, run
from wmr_afl.analysis import animation
from wmr_afl.analysis.animation import (
    LONGEST_LINE,
    MOST_PICTURES,
    Scene,
    _extent,
    _rows,
    _set_view,
    animate,
    check_file,
)
from wmr_afl.analysis.geometry import Geometry
from wmr_afl.errors import WmrError
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Failure, Run

ROWS = np.array([0, 4, 10])


def near(samples: int = len(TIME)) -> Run:
    """A run of a robot along a small arc, with its reference beside it."""
    s = np.linspace(0.0, 1.0, samples)
    state = np.column_stack([0.4 * s, 0.3 * s**2, s, 0.0 * s, 0.0 * s])
    error = np.column_stack([0.1 + 0.0 * s, -0.2 * s])
    one = run()
    return replace(
        one, time=s, state=state, error=error, reference=state[:, :2] - error,
        **{name: np.zeros((samples, getattr(one, name).shape[1])) for name in ("input", "command", "estimate")},
    )  # fmt: skip


def data(line: Any) -> Floats:
    return np.column_stack([np.asarray(one, dtype=float) for one in line.get_data()])


@pytest.mark.parametrize("picture", [0, 1, 2])
def test_a_picture_shows_robot_path_and_goal_of_its_sample(picture: int) -> None:
    """In both panels: the path up to there, the output at its end, the reference, and each part where it is."""
    one = near()
    scene, row = Scene(one, ROWS), ROWS[picture]
    scene.show(picture)
    shapes = Geometry(MODEL, one.parameters).shapes(one.state[ROWS])
    for panel in scene._panels:
        np.testing.assert_array_equal(data(panel._path)[:-1], one.output[:row])
        np.testing.assert_array_equal(data(panel._path)[-1], one.output[row])
        np.testing.assert_array_equal(data(panel._point), one.output[None, row])
        np.testing.assert_array_equal(data(panel._goal), one.reference[None, row])
        np.testing.assert_array_equal(data(panel._joints), shapes.joints[picture])
        drawn = [collection for collection, _ in panel._moving]
        for collection, parts in zip(
            drawn, (shapes.hulls, shapes.links, shapes.wheels, shapes.rollers, shapes.arrow), strict=True
        ):
            corners = [path.vertices[: parts[0].shape[1]] for path in collection.get_paths()]
            assert len(corners) == len(parts)
            for found, part in zip(corners, parts, strict=True):
                np.testing.assert_array_equal(found, part[picture])
        assert list(panel.axes.collections) == drawn
        heights = [one.get_zorder() for one in (panel._path, *drawn)]
        assert heights[0] < heights[1] < min(heights[2:])  # the robot hides its path, and its wheels the hull


def test_a_scene_tells_what_it_shows() -> None:
    """Titles, axes in metres of one scale, the reference below, and a legend with an entry for each kind of line."""
    one = near()
    scene = Scene(one, ROWS)
    assert [axes.get_title(loc="left") for axes in scene.figure.axes] == ["the whole scene", "close up"]
    for axes in scene.figure.axes:
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [m]", "y [m]", 1.0)
        assert any(np.array_equal(data(line), one.reference) for line in axes.get_lines())
    (legend,) = scene.figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["reference", "output (y1, y2)", "heading"]


def test_an_output_that_is_no_point_leaves_the_origin_of_the_robot() -> None:
    """Without a reference, which is not a place."""
    model = load_model("type_2_0")
    model.output_units = {"phi": "rad", "y2": "m"}
    one = near()
    scene = Scene(replace(one, model=model), ROWS)
    scene.show(2)
    for panel in scene._panels:
        np.testing.assert_array_equal(data(panel._path), one.state[:, :2])
        assert not len(data(panel._goal))
        assert not any(np.array_equal(data(line), one.reference) for line in panel.axes.get_lines())
    assert [text.get_text() for text in scene.figure.legends[0].get_texts()] == ["origin of the robot", "heading"]


@pytest.mark.parametrize("speed", [1.0, 2.0, 0.25])
def test_above_a_picture_stand_robot_law_pace_and_time(speed: float) -> None:
    """As many digits as tell pictures apart; the pace unless it is that of the robot."""
    one = near()
    scene = Scene(replace(one, controller="$x$"), ROWS, speed)
    for picture, row in enumerate(ROWS):
        scene.show(picture)
        first, second = scene.figure.get_suptitle().split("\n")
        assert first == MODEL.title
        assert second.startswith(r"\$x\$")
        assert second.endswith(f": t = {one.time[row]:.1f} s")
        assert ("times as fast" in second) == (speed != 1.0)
        assert (f"{speed:g} times" in second) == (speed != 1.0)
    dense = Scene(one, np.arange(11))
    dense.run = replace(one, time=0.004 * np.arange(11))
    dense.show(1)
    assert dense.figure.get_suptitle().endswith("t = 0.004 s")
    slow = Scene(one, np.arange(11))
    slow.run = replace(one, time=20.0 * np.arange(11))
    slow.show(1)
    assert slow.figure.get_suptitle().endswith("t = 20.0 s")


def test_a_failure_stands_below() -> None:
    why = Failure(0.7, "the robot is singular: $")
    told = [text.get_text() for text in Scene(replace(near(), failure=why), ROWS).figure.texts]
    assert any("singular: \\$" in text for text in told)
    assert not any("singular" in text.get_text() for text in Scene(near(), ROWS).figure.texts)


def limits(axes: Any) -> Floats:
    """Middle and half the side of a view, (2, 2)."""
    both = np.array([axes.get_xlim(), axes.get_ylim()])
    return np.array([both.mean(axis=1), np.ptp(both, axis=1) / 2.0])


def test_the_whole_scene_holds_all_and_the_close_up_the_robot() -> None:
    """Robot in every picture and reference; squares; the close-up follows the robot and stays as large."""
    one = near()
    scene = Scene(one, ROWS)
    points, sizes, middles = scene.shapes.points, [], []
    for picture in range(3):
        scene.show(picture)
        (whole, half), (middle, reach) = (limits(axes) for axes in scene.figure.axes)
        assert half[0] == pytest.approx(half[1])
        assert reach[0] == pytest.approx(reach[1])
        seen = np.concatenate([points.reshape(-1, 2), one.reference])
        assert np.all(np.abs(seen - whole) <= half)
        assert np.max(np.abs(seen - whole)) > 0.85 * half[0]  # and not much more
        parts = np.concatenate([points[picture], one.output[None, ROWS[picture]]])
        assert np.all(np.abs(parts - middle) <= reach)
        assert reach[0] < half[0]
        sizes.append(reach[0])
        middles.append(middle)
    assert np.ptp(sizes) == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(*(middles[2] - middles[0])) > 0.3


def test_a_robot_that_runs_away_does_not_shrink_the_scene() -> None:
    """Farther than twice the size of what was there it is not followed; the close-up stays within the scene."""
    one = near()
    state = one.state.copy()
    state[10, 0] = 1e9
    scene = Scene(replace(one, state=state), ROWS)
    scene.show(2)
    home = _extent(np.concatenate([scene.shapes.points[0], one.reference]))
    (whole, half), (middle, _) = (limits(axes) for axes in scene.figure.axes)
    assert home < half[0] < 3.0 * home
    assert np.all(np.abs(middle - whole) <= half + 1e-9)
    halves = []
    for axis in (0, 1):
        for way in (-1e9, 1e9):
            state = one.state.copy()
            state[10, axis] = way
            fled = Scene(replace(one, state=state), ROWS)
            points = np.concatenate([fled.shapes.points[0], one.reference])
            half = limits(fled.figure.axes[0])[1, 0]
            halves.append(half / 0.53 - np.ptp(points, axis=0)[axis])  # how far beyond what was there
    assert 1.999 * home < min(halves) <= max(halves) < 2.5 * home  # to any side
    far = near()
    error = far.error + 50.0  # an output far from its robot is no part of it
    apart = Scene(replace(far, error=error, reference=far.reference + 50.0), ROWS)
    apart.show(0)
    assert limits(apart.figure.axes[1])[1, 0] < 5.0


def test_long_paths_are_thinned_and_end_where_the_robot_is() -> None:
    """No more than two thousand points; the same places."""
    samples = 3 * LONGEST_LINE + 5
    long = near(samples)
    scene = Scene(long, np.array([0, samples - 1]))
    scene.show(1)
    path = data(scene._panels[0]._path)
    assert LONGEST_LINE <= len(path) <= 2 * LONGEST_LINE
    np.testing.assert_array_equal(path[-1], long.output[-1])
    np.testing.assert_array_equal(path[:-1], long.output[: samples - 1 : 3])
    assert any(np.array_equal(data(line), long.reference[::3]) for line in scene.figure.axes[0].get_lines())


@pytest.mark.parametrize("half", [0.1, 0.3, 0.75, 1.5, 2.9, 3.0, 7.4, 40.0])
def test_ticks_stand_at_round_numbers_of_metres(half: float) -> None:
    """One, two or five times a power of ten, the largest that gives three ticks or more."""
    axes = Figure().subplots()
    _set_view(axes, np.array([0.3, -0.2]), half)
    np.testing.assert_allclose(
        [axes.get_xlim(), axes.get_ylim()], [[0.3 - half, 0.3 + half], [-half - 0.2, half - 0.2]]
    )
    steps = [
        np.diff(axis.get_major_locator().tick_values(-10.0 * half, 10.0 * half)) for axis in (axes.xaxis, axes.yaxis)
    ]
    np.testing.assert_allclose(steps[0], steps[0][0])
    assert steps[0][0] == pytest.approx(steps[1][0])
    round_ones = [factor * 10.0**power for power in range(-4, 4) for factor in (1.0, 2.0, 5.0)]
    assert steps[0][0] == pytest.approx(max(one for one in round_ones if one <= half / 1.5))


def test_the_extent_is_the_longer_side_and_never_nothing() -> None:
    assert _extent(np.array([[0.0, 1.0], [3.0, -4.0], [1.0, 0.0]])) == 5.0
    assert _extent(np.array([[2.0, 2.0]])) == 1e-3


def timed(samples: int, step: float) -> Any:
    return SimpleNamespace(time=step * np.arange(samples), failure=None)


def test_pictures_are_counted_before_they_are_drawn() -> None:
    """Fewer than the most; beyond, the speed that is named is one at which it goes."""
    usual = timed(599, 0.1)  # 59.8 s
    assert len(_rows(usual, 10, 1.0)) == 599
    assert _rows(usual, 10, 1.0)[[0, -1]].tolist() == [0, 598]
    for run_, rate in ((timed(601, 0.1), 10), (timed(9001, 0.1), 20)):
        with pytest.raises(WmrError, match=f"more than {MOST_PICTURES} pictures; play at a speed of") as caught:
            _rows(run_, rate, 1.0)
        speed = float(str(caught.value).rpartition(" ")[2])
        assert 0.9 * MOST_PICTURES < len(_rows(run_, rate, speed)) <= MOST_PICTURES
    assert _rows(timed(2, 0.001), 10, 1.0).tolist() == [0, 1]
    later: Any = SimpleNamespace(time=5.0 + 0.1 * np.arange(11), failure=None)
    assert _rows(later, 5, 1.0).tolist() == [0, 2, 4, 6, 8, 10]


@pytest.mark.parametrize(
    ("rate", "speed"), [(0, 1.0), (51, 1.0), (-1, 1.0), (10, 0.0), (10, -1.0), (10, np.inf), (10, np.nan)]
)
def test_what_is_no_rate_or_speed_is_refused(rate: int, speed: float) -> None:
    """Fifty pictures a second are the most, and one is enough."""
    with pytest.raises(WmrError, match="at most 50, speed above 0"):
        _rows(timed(11, 0.1), rate, speed)
    assert len(_rows(timed(11, 0.1), 50, 1.0)) == 51
    assert len(_rows(timed(11, 0.1), 1, 1.0)) == 2


@pytest.mark.parametrize("failure", [None, Failure(0.1, "the input is not finite")])
def test_one_sample_is_no_motion(failure: Failure | None) -> None:
    """The failure is the reason, if there is one."""
    short: Any = SimpleNamespace(time=np.zeros(1), failure=failure)
    with pytest.raises(WmrError, match="a run of 1 samples is too short") as caught:
        _rows(short, 10, 1.0)
    assert ("not finite" if failure else "run it for longer") in str(caught.value)


def test_a_kind_of_file_that_cannot_be_written_is_known_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Endings in any case; .mp4 takes ffmpeg, .gif nothing."""
    (tmp_path / "folder.gif").mkdir()
    for has_ffmpeg in (False, True):
        monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda has=has_ffmpeg: has)
        assert check_file(tmp_path / "a.GIF") == tmp_path / "a.GIF"
        for name, words in (("a.webm", "unknown kind"), ("a", "unknown kind"), ("folder.gif", "is a folder")):
            with pytest.raises(WmrError, match=words):
                check_file(tmp_path / name)
        if has_ffmpeg:
            assert check_file(str(tmp_path / "a.MP4")) == tmp_path / "a.MP4"
        else:
            with pytest.raises(WmrError, match="takes ffmpeg"):
                check_file(tmp_path / "a.MP4")


def test_a_run_becomes_a_file_of_pictures_that_differ(tmp_path: Path) -> None:
    """In a folder that is made for it; progress counts them."""
    told: list[tuple[int, int]] = []
    file = animate(near(), tmp_path / "new" / "a.gif", 2, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]
    with Image.open(file) as moving:
        assert moving.n_frames == 3
        assert moving.info["duration"] == 500  # [ms]
        pictures = []
        for picture in range(3):
            moving.seek(picture)
            pictures.append(np.asarray(moving.convert("RGB")))
    assert all(np.any(one != other) for one, other in pairwise(pictures))
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.gif"]


@pytest.mark.parametrize(
    ("error", "words"),
    [(OSError(28, "No space left"), "No space left"), (animation.CalledProcessError(1, "ffmpeg"), "ffmpeg failed")],
)
def test_a_picture_that_cannot_be_written_leaves_no_file(
    error: Exception, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(self: Scene, picture: int) -> None:
        if picture > 0:
            raise error

    monkeypatch.setattr(Scene, "show", failing)
    with pytest.raises(WmrError, match=f"a.gif: cannot be written .{words}"):
        animate(near(), tmp_path / "a.gif", 2)
    assert not list(tmp_path.iterdir())


def test_close_up_everything_is_drawn_larger() -> None:
    """Marks and lines of the robot and its output, and the ring of the goal around the output's dot."""
    whole, close = Scene(near(), ROWS)._panels
    for part in ("_goal", "_point", "_joints"):
        assert getattr(close, part).get_markersize() > getattr(whole, part).get_markersize() > 0.0
    for panel in (whole, close):
        assert panel._goal.get_markersize() > panel._point.get_markersize()
        above = [panel._point.get_zorder(), panel._goal.get_zorder(), panel._joints.get_zorder()]
        assert min(above) > max(collection.get_zorder() for collection, _ in panel._moving)
    for (one, _), (other, _) in list(zip(close._moving, whole._moving, strict=True))[:2]:
        assert one.get_linewidth()[0] > other.get_linewidth()[0] > 0.0
    rollers = [panel._moving[3][0].get_linewidth()[0] for panel in (whole, close)]
    assert 0.0 < rollers[0] < rollers[1]


@pytest.mark.parametrize("place", [0.0, 4e6])
def test_nothing_lies_on_anything_else_and_nothing_jumps(place: float) -> None:
    """Panels, title, legend and failure; the name beside an axis stays while the numbers beside it change."""
    one = near()
    shift = np.array([0.0, place])
    state = one.state + np.concatenate([shift, np.zeros(3)])
    moved = replace(one, state=state, reference=one.reference + shift, failure=Failure(0.7, "the robot is singular"))
    scene, names = Scene(moved, ROWS), []
    for picture in range(3):
        scene.show(picture)
        scene.figure.canvas.draw()
        boxes = [axes.get_window_extent() for axes in scene.figure.axes]
        boxes += [
            text.get_window_extent() for axes in scene.figure.axes for text in (axes.xaxis.label, axes.yaxis.label)
        ]
        boxes += [axes._left_title.get_window_extent() for axes in scene.figure.axes]
        boxes += [
            scene.figure.legends[0].get_window_extent(),
            *(text.get_window_extent() for text in scene.figure.texts),
        ]
        assert not [(i, k) for i, one in enumerate(boxes) for k, other in enumerate(boxes[:i]) if one.overlaps(other)]
        assert all(scene.figure.bbox.contains(*corner) for box in boxes for corner in (box.min, box.max))
        names.append([axes.yaxis.label.get_window_extent().bounds for axes in scene.figure.axes])
    np.testing.assert_array_equal(names[0], names[1])
    np.testing.assert_array_equal(names[0], names[2])
