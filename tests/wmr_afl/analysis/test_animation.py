"""The robot is drawn where its motion says it is, and runs become moving pictures."""

from dataclasses import fields, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

from tests.conftest import EXPERIMENTS
from tests.wmr_afl.cli.test_cli import run as command
from wmr_afl.analysis.animation import Scene, animate
from wmr_afl.analysis.geometry import Geometry
from wmr_afl.errors import InputError, WmrError
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import list_experiments, read_experiment
from wmr_afl.model.laws import Situation
from wmr_afl.simulation.result import Failure, Run
from wmr_afl.simulation.simulate import simulate

STUDY = (EXPERIMENTS / "study_1.toml").read_text()


@cache
def short_run(experiment: str) -> Run:
    """0.2 s of an experiment's first controller, 11 samples."""
    name, loop = next(iter(assemble(*read_experiment(experiment)).items()))
    return simulate(replace(loop, sample_time=0.02), 0.2, name, "numpy")


def beginning(run: Run, samples: int) -> Run:
    arrays = {f.name: getattr(run, f.name) for f in fields(run) if isinstance(getattr(run, f.name), np.ndarray)}
    cut = {name: array[:samples] for name, array in arrays.items() if len(array) == len(run.time)}
    return replace(run, **cut)


def motion(s: Situation, kind: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Poses of all frames or wheels in random situations, and their rates along q' = S v by finite differences."""
    poses, step = getattr(Geometry(s.numpy, s.p[0]), kind), 1e-5
    rates = np.einsum("kij,kj->ki", s.numpy.kinematic_matrix(s.q, s.p[0]), s.v)
    ahead, behind = poses(s.q + step * rates), poses(s.q - step * rates)
    return {name: (pose, (ahead[name] - behind[name]) / (2.0 * step)) for name, pose in poses(s.q).items()}


def along(pose: np.ndarray, rate: np.ndarray, angle: float = 0.0) -> np.ndarray:
    """The velocity of a pose's origin along a direction turned by `angle` from its heading."""
    return np.cos(pose[:, 2] + angle) * rate[:, 0] + np.sin(pose[:, 2] + angle) * rate[:, 1]


def test_the_hub_of_a_conventional_wheel_moves_along_its_heading(situation: Situation) -> None:
    geometry = Geometry(situation.numpy, situation.p[0])
    for wheel, (pose, rate) in motion(situation, "wheels").items():
        sideways = along(pose, rate, np.pi / 2.0)
        if geometry.roller_angle(wheel) is None:
            np.testing.assert_allclose(sideways, 0.0, atol=1e-7)
        else:
            assert np.abs(sideways).max() > 0.1


def test_what_motors_drive_turns_as_the_drawing_moves(situation: Situation) -> None:
    model, p = situation.numpy, situation.p[0]
    geometry, wheels, frames = Geometry(model, p), motion(situation, "wheels"), motion(situation, "frames")
    shafts = np.einsum("kij,kj->ki", model.actuator_rates_matrix(situation.q, p), situation.v)
    for motor, shaft in zip(model.metadata["motors"].values(), shafts.T, strict=True):
        part = motor["drives"]
        if part in wheels:
            angle = geometry.roller_angle(part) or 0.0
            expected = along(*wheels[part], angle) / (geometry.radius(part) * np.cos(angle))
        else:
            parent = model.metadata["geometry"]["frames"][part]["parent"]
            expected = frames[part][1][:, 2] - frames[parent][1][:, 2]
        np.testing.assert_allclose(shaft, expected, atol=1e-6)


def test_drawn_parts_stay_rigid_and_wheels_have_their_true_size(situation: Situation) -> None:
    geometry = Geometry(situation.numpy, situation.p[0])
    shapes = geometry.shapes(situation.x)
    for part in (*shapes.hulls, *shapes.links, *shapes.wheels, *shapes.rollers):
        sides = np.linalg.norm(np.diff(part, axis=1), axis=2)
        np.testing.assert_allclose(sides, np.tile(sides[0], (len(sides), 1)), atol=1e-12)
    swedish = 0
    for (name, pose), corners in zip(geometry.wheels(situation.x).items(), shapes.wheels, strict=True):
        np.testing.assert_allclose(corners.mean(axis=1), pose[:, :2], atol=1e-12)
        forward = (corners[:, 0] - corners[:, 1]) / (2.0 * geometry.radius(name))
        np.testing.assert_allclose(forward, np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=1), atol=1e-12)
        swedish += geometry.roller_angle(name) is not None
    assert len(shapes.rollers) == 3 * swedish


def test_a_run_becomes_pictures_that_move(robot: str, tmp_path: Path) -> None:
    run = short_run(f"track_{robot}")
    reported: list[tuple[int, int]] = []
    file = animate(run, tmp_path / "run.gif", 10, progress=lambda done, total: reported.append((done, total)))
    assert reported == [(1, 3), (2, 3), (3, 3)]
    with Image.open(file) as animation:
        assert animation.n_frames == 3
        pictures = []
        for picture in range(3):
            animation.seek(picture)
            pictures.append(np.asarray(animation.convert("RGB"))[50:])  # below the title, which shows the time
    assert all(np.any(one != other) for one, other in pairwise(pictures))


@pytest.mark.parametrize("experiment", list_experiments())
def test_the_close_up_holds_the_whole_robot(experiment: str) -> None:
    run = short_run(experiment)
    scene = Scene(run, np.array([0, 5, 10]))
    for picture, points in enumerate(scene.shapes.points):
        scene.show(picture)
        assert f"t = {0.1 * picture:.1f} s" in scene.figure.get_suptitle()
        for axes in scene.figure.axes:
            for limits, values in ((axes.get_xlim(), points[:, 0]), (axes.get_ylim(), points[:, 1])):
                assert limits[0] < values.min() < values.max() < limits[1]


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    one, other = (animate(short_run("study_1"), tmp_path / name, 10) for name in ("one.gif", "other.gif"))
    assert one.read_bytes() == other.read_bytes()


def test_a_robot_that_ran_away_or_has_no_point_as_output_is_drawn(tmp_path: Path) -> None:
    run = short_run("track_mecanum")
    state, error = run.state.copy(), run.error.copy()
    state[6:, 0] = error[6:, 0] = 1e200
    wild = replace(run, state=state, error=error, failure=Failure(0.22, "the input is not finite"))
    assert animate(wild, tmp_path / "wild.gif", 10).stat().st_size > 1000
    scene = Scene(wild, np.array([0, 10]))
    assert np.ptp(scene.figure.axes[0].get_xlim()) < 20.0
    model = Situation("mecanum").numpy
    model.output_units = {"phi": "rad", "y": "m", "x": "m"}
    assert animate(replace(run, model=model), tmp_path / "angle.gif", 10).stat().st_size > 1000


@pytest.mark.parametrize(
    ("name", "rate", "speed", "words"),
    [
        ("run.webm", 10, 1.0, (".gif", ".mp4")),
        ("run", 10, 1.0, (".gif", ".mp4")),
        ("folder.gif", 10, 1.0, ("is a folder",)),
        ("file/run.gif", 10, 1.0, ("cannot be written",)),
        ("run.gif", 0, 1.0, ("at most 50", "at speed 1")),
        ("run.gif", 10, float("nan"), ("speed nan",)),
        ("run.gif", 10, 1e-6, ("600 pictures", "play at a speed of")),
    ],
)
def test_what_cannot_be_animated_is_reported(
    name: str, rate: int, speed: float, words: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "folder.gif").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(WmrError) as caught:
        animate(short_run("study_1"), tmp_path / name, rate, speed)
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


def test_an_mp4_takes_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(WmrError, match=r"ffmpeg, which is not installed; install it or name a \.gif"):
        animate(short_run("study_1"), tmp_path / "run.mp4")


@pytest.mark.parametrize("samples", [0, 1])
def test_a_run_of_less_than_two_samples_is_reported(samples: int, tmp_path: Path) -> None:
    run = short_run("study_1")
    with pytest.raises(WmrError, match="too short for an animation"):
        animate(beginning(run, samples), tmp_path / "run.gif")
    assert animate(beginning(run, 2), tmp_path / "run.gif").is_file()


def test_a_damaged_geometry_is_reported() -> None:
    model = Situation("car").numpy
    model.metadata["geometry"]["wheels"]["front"]["x"] = "x + wheelbase"
    with pytest.raises(InputError, match=r"model\.json: geometry wheels front x: .*wheelbase.*derive the robot again"):
        Geometry(model, model.parameters()).shapes(np.zeros((1, len(model.state_units))))
    model.metadata["geometry"] = {"frames": {}, "wheels": {}}
    with pytest.raises(InputError, match=r"model\.json: geometry frames: is missing or damaged"):
        Geometry(model, model.parameters())


def test_the_command_writes_an_animation(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(STUDY.replace("duration = 140.0", "duration = 1.0"))
    done = command("animate", "short.toml", "--seconds", 0.25, "--backend", "numpy", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "results/short/AFL.gif\n"
    with Image.open(tmp_path / "results" / "short" / "AFL.gif") as animation:
        assert animation.n_frames == 4


def test_the_command_animates_a_failed_run_up_to_its_failure(tmp_path: Path) -> None:
    (tmp_path / "wild.toml").write_text(STUDY.replace("lower = 0.1", "lower = 1e-14").replace("140.0", "2.0"))
    done = command("animate", "wild.toml", "--seconds", 0.25, "--backend", "numpy", "--out", "wild.gif", cwd=tmp_path)
    assert done.returncode == 1
    assert "singular" in done.stdout
    assert (tmp_path / "wild.gif").read_bytes().startswith(b"GIF89a")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["--controller", "PID"], "AFL"), (["--out", "run.webm"], ".mp4"), (["--seconds", "0"], "--seconds")],
)
def test_the_command_ends_in_one_line_where_it_cannot(arguments: list[str], word: str, tmp_path: Path) -> None:
    done = command("animate", "study_1", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = (line for line in done.stderr.splitlines() if line.strip())
    assert line.startswith("error: ")
    assert word in line
    assert list(tmp_path.iterdir()) == []
