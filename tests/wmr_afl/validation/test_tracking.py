"""Controllers drive the engine's robot; in space its wheels bear what they bear."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from tests.wmr_afl.validation.test_validate import ROBOTS, gain, mechanism_of
from wmr_afl import WmrError, validate
from wmr_afl.analysis.film import filming
from wmr_afl.analysis.geometry import Geometry
from wmr_afl.cli import app
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.wheel_loads import GRAVITY
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.simulation.simulate import simulate
from wmr_afl.validation import tracking
from wmr_afl.validation.camera import Camera
from wmr_afl.validation.drive import drive
from wmr_afl.validation.engine import Engine
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, hung
from wmr_afl.validation.tracking import Tracked, track
from wmr_afl.validation.validate import CONVENTIONAL

mujoco = pytest.importorskip("mujoco")
LAWS = [
    ("study_1", "AFL"), ("study_1_laws", "composite"), ("study_2_pose", "pose"), ("track_mecanum", "AFL"),
    ("track_type_1_1", "direct"), ("track_tractor_3_trailers", "exact"),
]  # fmt: skip
STANDING = ["type_2_0_caster", "type_1_1", "type_3_0"]  # on three wheels: statics tells all loads


def tracked(experiment: str, controller: str, seconds: float = 2.0, height: float | None = None) -> Tracked:
    """The first seconds of one."""
    return track(load_experiment(experiment).loops[controller], controller, seconds, height)


@pytest.mark.parametrize(("experiment", "controller"), LAWS)
def test_a_controller_brings_about_the_same_in_the_engine(experiment: str, controller: str) -> None:
    """Half the step halves what is between them, so that both runs extrapolate to hardly any."""
    found = tracked(experiment, controller)
    assert found.is_complete
    coarse, fine, extrapolated = found.apart.max(axis=1)
    assert coarse / fine == pytest.approx(2.0, rel=0.2)
    assert extrapolated < 0.05 * coarse
    assert found.share < 0.3 * CONVENTIONAL.loop
    np.testing.assert_allclose(found.errors[3], found.errors[0], rtol=1e-3)
    assert found.errors[0].max() > 10.0 * coarse


def test_a_stronger_motor_shows_in_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """One per cent in the engine alone, although the loop is closed around it."""

    def mistaken(model: object, p: object) -> Mechanism:
        found = Mechanism(model, p)  # type: ignore[arg-type]
        gain(found)
        return found

    monkeypatch.setattr(tracking, "Mechanism", mistaken)
    assert tracked("study_1_laws", "composite").share > 3.0 * CONVENTIONAL.loop


def test_what_acts_on_the_motion_is_left_out_of_both() -> None:
    """Friction and disturbances are no part of the engine's robot; limits of inputs are the drive's and stay."""
    found = tracked("study_2_pose", "pose")
    assert found.left_out == ("friction", "disturbance")
    loop = load_experiment("study_2_pose").loops["pose"]
    assert np.abs(found.coarse.input).max() <= 24.0
    assert np.abs(simulate(loop, 2.0).state - found.simulated.state).max() > 1e-3
    kept = [part for part in loop.plant.uncertainties if type(part).load is Uncertainty.load]
    assert [part.name for part in kept] == ["input_limits"]


@pytest.mark.parametrize("name", STANDING)
def test_a_robot_at_rest_in_space_bears_what_statics_tells(name: str) -> None:
    """On three wheels, at several angles of its joints."""
    mechanism = mechanism_of(name)
    for q in (np.zeros(mechanism.model.coordinate_count), np.full(mechanism.model.coordinate_count, 0.3)):
        engine = Engine(mechanism, Contact(), mechanism.loads(q), 0.4)
        engine.start(q, np.zeros_like(q))
        engine.drive(np.zeros(len(mechanism.motors)), 300)
        found = engine.grip
        assert found.least.sum() == pytest.approx(mechanism.mass * GRAVITY, rel=1e-4)
        np.testing.assert_allclose(found.least, mechanism.loads(q), rtol=2e-3)


@pytest.mark.parametrize(("name", "stands"), [("type_2_0_caster", True), ("mecanum", True), ("car", False)])
def test_a_robot_stands_on_three_wheels_or_more(name: str, stands: bool) -> None:
    """Two in a line balance its weight, and tip all the same."""
    mechanism = mechanism_of(name)
    q = np.zeros(mechanism.model.coordinate_count)
    assert mechanism.stands(q) is stands
    assert mechanism.loads(q).sum() == pytest.approx(mechanism.mass * GRAVITY)


def test_loads_shift_by_what_accelerates() -> None:
    """Masses times acceleration times height over the distance of axle and caster; no force is told to the test."""
    mechanism, height = mechanism_of("type_2_0_caster"), 0.5
    n, contact = mechanism.model.coordinate_count, Contact()
    engine = Engine(mechanism, contact, mechanism.loads(np.zeros(n)), height)
    engine.start(np.zeros(n), np.zeros(n))
    rest, names = engine.grip.least, [wheel.name for wheel in mechanism.wheels]
    engine.drive(np.full(2, 1.0), 20)
    before = engine.state
    engine.drive(np.full(2, 1.0), 5)
    change = (engine.state[n] - before[n]) / (5 * contact.step)
    low = sum(hung(wheel, mechanism, contact)[0] * (height - wheel.radius) for wheel in mechanism.wheels)
    places = Geometry(mechanism.model, mechanism.p).wheels(np.zeros((1, n)))
    distance = places["right"][0, 0] - places["caster_wheel"][0, 0]
    shift = (engine.grip.least - rest)[names.index("caster_wheel")]
    assert abs(shift) > 5.0
    assert shift == pytest.approx((mechanism.mass * height - low) * change / distance, rel=0.02)


def test_the_motion_in_space_is_that_of_the_plane() -> None:
    """While loads shift."""
    mechanism = mechanism_of("type_1_1")
    n = mechanism.model.coordinate_count
    flat, found = (drive(mechanism, np.zeros(n), 2.0, height) for height in (None, 0.4))
    assert found.differences(n)[2].max() < 0.1 * CONVENTIONAL.drive
    np.testing.assert_allclose(flat.grip.most - flat.grip.least, 0.0, atol=0.01)
    assert np.all(found.grip.most - found.grip.least > 3.0)


def test_a_planar_model_does_not_hold_where_a_wheel_lifts() -> None:
    """Masses high above the floor; nothing is judged."""
    with pytest.raises(WmrError, match=r"the drive lifts wheel caster_wheel off the floor at 0\.\d+ s; a planar model"):
        validate("type_2_0_caster", space=True, height=5.0, count=1, seconds=2.0)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"experiment": "track_car"}, "track_car is an experiment of car, not of type_2_0; name one of this robot"),
        ({"experiment": "track_type_2_0", "controllers": "smart"}, "unknown controller 'smart'; there is exact"),
        ({"experiment": "nowhere"}, "'nowhere'"),
        ({"experiment": "track_type_2_0", "parameters": {"m_C": 30.0}}, "parameters: m_C: stand in the experiment"),
        ({"experiment": "track_type_2_0", "start": {"x": 1.0}}, "start: x: stand in the experiment"),
        ({"controllers": "AFL"}, "controllers: AFL: stand in an experiment; name the experiment, too"),
        ({"space": True}, "type_2_0 does not stand: its centre of mass is not well within its wheels"),
        ({"height": 0.5}, "height: 0.5: is given without space"),
        ({"space": True, "height": -1.0}, "height: -1: is no height"),
    ],
)
def test_wrong_arguments_are_told(given: dict[str, object], told: str) -> None:
    """In one line."""
    with pytest.raises(WmrError) as error:
        validate("type_2_0", count=1, seconds=0.2, **given)  # type: ignore[arg-type]
    assert told in str(error.value)


def test_a_joint_at_its_stop_is_not_compared() -> None:
    """The engine has none."""
    left = [0.1, 0.2]
    model = SimpleNamespace(name="fork", coordinate_count=4, has=lambda name: name == "joint_stops")
    model.in_library, model.joint_stops = lambda name: model, lambda q, p: np.tile(left, (len(q), 1))
    run: Any = SimpleNamespace(model=model, controller="exact", state=np.zeros((3, 6)), parameters=np.ones(2))
    tracking._check_stops(run)
    left[1] = 0.0
    with pytest.raises(WmrError, match="exact brings a joint of fork to its stop"):
        tracking._check_stops(run)


def test_the_command_tells_of_controllers_and_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors of both, loads of wheels, and where the planar model holds."""
    monkeypatch.setattr("wmr_afl.validation.validate._loops", short_loops)
    arguments = ["--experiment", "track_type_3_0", "--space", "--seconds", "1", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["validate", "type_3_0", *arguments])
    assert done.exit_code == 0, done.output
    plain = " ".join(done.output.split())
    assert "% (bound 0.01 %)" in plain.partition("what controllers bring about by")[2]
    assert "every wheel stays on the floor, so that the planar model holds" in plain
    assert "load at rest [N]" in plain
    assert (tmp_path / "out" / "controllers.png").is_file()


def short_loops(experiment: object, controllers: object, model: object) -> dict[str, object]:
    """Half a second of one controller."""
    return {"exact": (load_experiment("track_type_3_0").loops["exact"], 0.5)}


@pytest.mark.parametrize(("experiment", "total", "end"), [(None, 2, 0.2), ("track_type_3_0", 3, 0.5)])
def test_progress_and_what_is_watched(
    experiment: str | None, total: int, end: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Checks are counted from none to all; the drive is watched once, or the first controller in its place."""
    monkeypatch.setattr("wmr_afl.validation.validate._loops", short_loops if experiment else lambda *given: {})
    counts: list[tuple[int, int]] = []
    times: list[float] = []
    validate(
        "type_3_0",
        count=2,
        seconds=0.2,
        experiment=experiment,
        progress=lambda *now: counts.append(now),
        watch=lambda engine, time: times.append(time),
    )
    assert counts == [(k, total) for k in range(total + 1)]
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(end, abs=0.03)


def test_a_film_shows_the_robot_on_its_way(tmp_path: Path) -> None:
    """Pictures at 25 a second, none like the one before."""
    mechanism = mechanism_of("mecanum")
    start = np.zeros(mechanism.model.coordinate_count)
    try:
        with filming(tmp_path / "film.gif", 0.4) as camera:
            drive(mechanism, start, 0.4, watch=camera)
    except WmrError as error:
        pytest.skip(str(error))  # a machine that cannot draw; the message is tested below
    with Image.open(tmp_path / "film.gif") as pictures:
        assert 9 <= pictures.n_frames <= 11
        assert pictures.size == (640, 360)
        first = np.asarray(pictures.convert("RGB"), dtype=float)
        pictures.seek(8)
        last = np.asarray(pictures.convert("RGB"), dtype=float)
    assert 0.1 < np.abs(last - first).mean() < 60.0


@pytest.mark.parametrize("name", ROBOTS)
def test_what_one_sees_is_where_the_robot_is(name: str) -> None:
    """From the floor to the top of its wheels, over all of them and hardly further; corners of what turns stand out."""
    mechanism = mechanism_of(name)
    q = np.zeros(mechanism.model.coordinate_count)
    engine = Engine(mechanism, Contact(), mechanism.loads(q))
    engine.start(q, q)
    model, data, signs = engine.model, engine.data, np.array([*np.ndindex(2, 2, 2)]) * 2.0 - 1.0
    drawn = np.flatnonzero(model.geom_group == 1)
    middle, half = np.split(model.geom_aabb[drawn], 2, axis=1)
    corners = [
        data.geom_xpos[k] + (at + signs * size) @ data.geom_xmat[k].reshape(3, 3).T
        for k, at, size in zip(drawn, middle, half, strict=True)
    ]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    wheels = np.array([data.body(f"{wheel.name} wheel").xpos for wheel in mechanism.wheels])
    frames = [(data.body(body.frame), body.at) for body in mechanism.bodies]
    frames += [(data.body(frame.name), np.zeros(2)) for frame in mechanism.frames]
    places = np.array([*wheels, *(one.xpos + one.xmat.reshape(3, 3)[:, :2] @ at for one, at in frames)])[:, :2]
    radius = mechanism.axle_height
    assert -0.5 * radius < low[2] < 0.1 * radius
    assert radius < high[2] < 2.5 * radius
    assert np.all((low[:2] <= wheels[:, :2].min(axis=0)) & (low[:2] > places.min(axis=0) - 1.5 * radius))
    assert np.all((high[:2] >= wheels[:, :2].max(axis=0)) & (high[:2] < places.max(axis=0) + 1.5 * radius))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_plate_covers_what_its_frame_holds(name: str) -> None:
    """Bodies, wheels and what is hinged to it."""
    mechanism = mechanism_of(name)
    model = Engine(mechanism, Contact(), mechanism.loads(np.zeros(mechanism.model.coordinate_count))).model
    for frame in mechanism.frames:
        (plate,) = np.flatnonzero((model.geom_bodyid == model.body(frame.name).id) & (model.geom_type == 6))  # a box
        parts = [one.at for one in (*mechanism.wheels, *mechanism.bodies) if one.frame == frame.name]
        parts += [one.at for one in mechanism.frames if one.parent == frame.name]
        for at in (*parts, np.zeros(2)):
            assert np.all(np.abs(at - model.geom_pos[plate, :2]) <= model.geom_size[plate, :2] + 1e-12)


class Eye:
    """In the place of the engine's means of drawing: it keeps where it was told to look, and draws nothing."""

    seen: list[tuple[Any, float, float, float]]
    size: tuple[int, int]
    is_open: bool

    def __init__(self, model: object, height: int, width: int) -> None:
        Eye.seen, Eye.size, Eye.is_open = [], (height, width), True

    def update_scene(self, data: object, view: Any) -> None:
        Eye.seen.append((view.lookat.copy(), view.distance, np.radians(view.elevation), np.radians(view.azimuth)))

    def render(self) -> Any:
        return np.zeros((*Eye.size, 3), dtype=np.uint8)

    def close(self) -> None:
        Eye.is_open = False


def in_picture(points: Any, look: Any, distance: float, down: float, aside: float) -> Any:
    """Where points (T, 3) are, to the right and up, in halves of the picture's height; a camera sees 45 degrees."""
    ahead = np.array([np.cos(down) * np.cos(aside), np.cos(down) * np.sin(aside), np.sin(down)])
    right = np.array([np.sin(aside), -np.cos(aside), 0.0])
    axes = np.array([right, np.cross(right, ahead), ahead])
    across, up, deep = axes @ (points - (look - distance * ahead)).T
    return np.column_stack([across, up]) / (deep * np.tan(np.radians(22.5)))[:, None]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_whole_robot_is_in_the_picture(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen from above, wherever it has gone, and not too small to see."""
    monkeypatch.setattr(mujoco, "Renderer", Eye)
    mechanism = mechanism_of(name)
    q = np.zeros(mechanism.model.coordinate_count)
    engine = Engine(mechanism, Contact(), mechanism.loads(q))
    pictures: list[Any] = []
    camera = Camera(pictures.append, 1.0, (640, 360))
    for k, start in enumerate(([0.0, 0.0, 0.0], [5.0, -3.0, 2.0])):
        engine.start(np.concatenate([start, q[3:]]), np.zeros_like(q))
        camera(engine, float(k))
        wheels = np.array([engine.data.body(f"{wheel.name} wheel").xpos for wheel in mechanism.wheels])
        places = in_picture(wheels, *Eye.seen[-1])
        assert np.all(np.abs(places) < [16.0 / 9.0, 1.0])
        assert np.ptp(places, axis=0).max() > 0.2
        assert Eye.seen[-1][2] < 0.0
    assert [picture.shape for picture in pictures] == [(360, 640, 3)] * 2
    camera.close()
    assert not Eye.is_open


@pytest.mark.parametrize("rounding", [-1e-12, 0.0, 1e-12])
def test_a_picture_is_taken_once_a_period(rounding: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """However times are rounded; a camera that was never used has nothing to close."""
    monkeypatch.setattr(mujoco, "Renderer", Eye)
    mechanism = mechanism_of("type_2_0")
    engine = Engine(mechanism, Contact(), mechanism.loads(np.zeros(3)))
    pictures: list[Any] = []
    camera, counts = Camera(pictures.append, 0.04, (640, 360)), []
    camera.close()
    for k in range(41):
        camera(engine, 0.01 * k + rounding)
        counts.append(len(pictures))
    assert counts == [1 + k // 4 for k in range(41)]


def test_an_engine_that_cannot_draw_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line, and leaves no file."""

    def broken(*given: object) -> None:
        raise RuntimeError("an OpenGL platform library has not been loaded\nand more")

    monkeypatch.setattr(mujoco, "Renderer", broken)
    mechanism = mechanism_of("type_2_0")
    told = r"the engine cannot draw here \(an OpenGL platform library has not been loaded\); install EGL"

    def film() -> None:
        with filming(tmp_path / "film.gif", 0.1) as camera:
            drive(mechanism, np.zeros(3), 0.1, watch=camera)

    with pytest.raises(WmrError, match=told):
        film()
    assert not list(tmp_path.iterdir())
