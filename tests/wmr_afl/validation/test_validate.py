"""Generated models against MuJoCo, which finds rolling by friction and knows nothing of pseudo-velocities."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.conftest import DESCRIPTIONS
from tests.derive.descriptions import derived, motor, robot, steered, wheel
from wmr_afl import WmrError, load_model, validate
from wmr_afl.analysis.geometry import Geometry
from wmr_afl.cli import app
from wmr_afl.validation.bursts import bursts
from wmr_afl.validation.drive import drive
from wmr_afl.validation.engine import Engine
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, hung, rest_of
from wmr_afl.validation.validate import CONVENTIONAL, ROUGH, Bounds, drawn
from wmr_afl.validation.voltages import Waves

mujoco = pytest.importorskip("mujoco")
ROBOTS = list(DESCRIPTIONS)


def mechanism_of(name: str, **parameters: float) -> Mechanism:
    """A shipped robot in numbers."""
    model = load_model(name)
    return Mechanism(model, np.asarray(model.parameters(**parameters), dtype=float))


def bound(mechanism: Mechanism) -> float:
    """Of its accelerations."""
    is_rough = any(one.roller_angle is not None for one in mechanism.wheels)
    return (ROUGH if is_rough else CONVENTIONAL).bursts


@pytest.mark.parametrize("name", ROBOTS)
def test_accelerations_are_those_of_the_engine(name: str) -> None:
    """At random states, for the description's parameters."""
    mechanism = mechanism_of(name)
    found = bursts(mechanism, count=50)
    assert found.slipped == 0
    assert found.rms.max() < bound(mechanism)
    assert found.worst.max() < 20.0 * bound(mechanism)


@pytest.mark.parametrize("name", ["type_1_1", "tractor_trailer", "mecanum"])
def test_they_are_for_other_parameters_too(name: str) -> None:
    """Drawn ones, each by a factor of its own."""
    model = load_model(name)
    for parameters in drawn(model, 2, seed=3):
        assert not np.allclose(list(parameters.values()), model.parameters(), rtol=0.02)
        mechanism = mechanism_of(name, **parameters)
        assert bursts(mechanism, count=30).rms.max() < bound(mechanism)


@pytest.mark.parametrize("name", ["type_2_0_caster", "type_3_0", "tractor_3_trailers"])
def test_a_drive_is_that_of_the_engine(name: str) -> None:
    """Half the step halves the difference, so that both runs extrapolate to hardly any."""
    mechanism = mechanism_of(name)
    n = mechanism.model.coordinate_count
    found = drive(mechanism, np.zeros(n), 3.0)
    coarse, fine, extrapolated = found.differences(n)
    np.testing.assert_allclose(coarse / fine, 2.0, rtol=0.2)
    assert extrapolated.max() < 0.1 * ROUGH.drive
    assert found.ends(lambda x: x[:, :2])[2] < 0.1 * ROUGH.drive
    assert np.all(found.grip.friction > 0.0)
    assert np.all(found.grip.friction < 1.0)


def gain(mechanism: Mechanism) -> None:
    """The first motor one per cent stronger."""
    motors = mechanism.motors
    mechanism.__dict__["motors"] = (replace(motors[0], gain=1.01 * motors[0].gain), *motors[1:])


def rollers(mechanism: Mechanism) -> None:
    """Rollers that lie the other way."""
    turned = [replace(one, roller_angle=-one.roller_angle) for one in mechanism.wheels if one.roller_angle is not None]
    mechanism.__dict__["wheels"] = tuple(turned)


def forgotten(mechanism: Mechanism) -> None:
    """A body that does not resist turning."""
    bodies = mechanism.bodies
    mechanism.__dict__["bodies"] = (replace(bodies[0], inertia=0.0), *bodies[1:])


def moved(mechanism: Mechanism) -> None:
    """A wheel two per cent of its radius further out."""
    wheels = mechanism.wheels
    at = wheels[0].at + 0.02 * wheels[0].radius
    mechanism.__dict__["wheels"] = (replace(wheels[0], at=at), *wheels[1:])


@pytest.mark.parametrize(
    ("name", "mistake"),
    [
        ("type_2_0", gain), ("mecanum", gain), ("mecanum", rollers), ("car", forgotten), ("type_1_2", forgotten),
        ("type_2_0", moved),
    ],
)  # fmt: skip
def test_a_mistake_shows(name: str, mistake: Callable[[Mechanism], None]) -> None:
    """In the engine's robot alone."""
    other = mechanism_of(name)
    mistake(other)
    assert bursts(mechanism_of(name), other, count=20).rms.max() > 2.0 * bound(other)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_engine_has_the_masses_of_the_description(name: str) -> None:
    """Mass, first moment and inertia of every frame with all that hangs on it, whichever wheel they were put on."""
    mechanism = mechanism_of(name)
    n = mechanism.model.coordinate_count
    engine = Engine(mechanism, Contact(), mechanism.loads(np.zeros(n)))
    q = np.random.default_rng(1).uniform(-0.7, 0.7, n)
    engine.start(q, np.zeros(n))
    matrix = np.zeros((engine.model.nv, engine.model.nv))
    mujoco.mj_fullM(engine.model, engine.data, matrix) if mujoco.__version__ >= "4" else mujoco.mj_fullM(
        engine.model, matrix, engine.data.qM
    )
    poses = {name: (one[0, :2], one[0, 2]) for name, one in Geometry(mechanism.model, mechanism.p).frames([q]).items()}
    mass, moment, inertia = 0.0, np.zeros(2), 0.0
    root = poses[mechanism.frames[0].name][0]
    for part in (*mechanism.bodies, *mechanism.wheels):
        place, heading = poses[part.frame]
        c, s = np.cos(heading), np.sin(heading)
        at = place + np.array([[c, -s], [s, c]]) @ part.at - root
        mass, moment, inertia = mass + part.mass, moment + part.mass * at, inertia + part.inertia + part.mass * at @ at
    light = 2e-3 * mass
    assert matrix[0, 0] == pytest.approx(mass, rel=1e-4)
    np.testing.assert_allclose(matrix[2, :2], [-moment[1], moment[0]], atol=light)
    assert matrix[2, 2] == pytest.approx(inertia, rel=2e-3)


def larger(mechanism: Mechanism, times: float) -> Mechanism:
    """All lengths so many times as long, with the same masses."""

    def part(one: Any) -> Any:
        given = {"at": times * one.at} | {key: times * getattr(one, key) for key in ("radius",) if hasattr(one, key)}
        squared = {key: times**2 * getattr(one, key) for key in ("inertia", "spin_inertia") if hasattr(one, key)}
        return replace(one, **given, **squared)

    other = Mechanism(mechanism.model, mechanism.p)
    for kind in ("frames", "bodies", "wheels"):
        other.__dict__[kind] = tuple(map(part, getattr(mechanism, kind)))
    return other


@pytest.mark.parametrize("name", ["car", "tractor_3_trailers", "mecanum"])
def test_what_the_description_leaves_without_mass_is_given_little(name: str) -> None:
    """A frame and its wheel; as little of a robot as of one twice as large."""
    mechanism, contact = mechanism_of(name), Contact()
    frame = mechanism.frames[-1].name
    for kind in ("bodies", "wheels"):
        parts = getattr(mechanism, kind)
        without = (replace(one, mass=0.0, inertia=0.0) if one.frame == frame else one for one in parts)
        mechanism.__dict__[kind] = tuple(without) if len(mechanism.frames) > 1 else parts
    other = larger(mechanism, 2.0)
    for one in mechanism.frames:
        small, large = (rest_of(robot_, one.name, contact) for robot_ in (mechanism, other))
        assert large.mass == pytest.approx(small.mass)
        assert large.inertia == pytest.approx(4.0 * small.inertia)
        np.testing.assert_allclose(large.centre, 2.0 * small.centre, atol=1e-12)
    for wheel_, twice in zip(mechanism.wheels, other.wheels, strict=True):
        np.testing.assert_allclose(hung(twice, other, contact), hung(wheel_, mechanism, contact) * np.array([1.0, 4.0]))


def test_waves_begin_with_nothing() -> None:
    """And turn wheels at about the speed that they are meant for."""
    mechanism = mechanism_of("type_2_0")
    waves = Waves.of(mechanism)
    np.testing.assert_allclose(waves.at([0.0]), 0.0, atol=1e-12)
    motor_, wheel_ = mechanism.motors[0], mechanism.wheels[0]
    speed = waves.at(np.linspace(2.0, 60.0, 2000))[:, 0].mean() * motor_.gain / motor_.back_emf * wheel_.radius
    assert speed == pytest.approx(0.8, rel=0.1)


FORK = steered("fork", ("a", "0"), "beta + pi/6")
BACK = steered("back", ("-a", "0"), "-2*beta")


def test_joints_that_follow_one_coordinate_are_coupled(tmp_path: Path) -> None:
    """An offset and a slope; the engine's robot then moves as the model does."""
    wheels = wheel("front", "fork"), wheel("rear", "back")
    model = load_model(derived(robot(FORK, BACK, *wheels, motor("front"), motor("fork"), angles=("beta",)), tmp_path))
    mechanism = Mechanism(model.in_library("numpy"), np.asarray(model.parameters(), dtype=float))
    assert mechanism.joints == ("fork", "back")
    other, offset, slope = mechanism.couplings["back"]
    assert other == "fork"
    assert (offset, slope) == pytest.approx((np.pi / 3.0, -2.0))
    assert bursts(mechanism, count=40).rms.max() < ROUGH.bursts


def test_what_an_engine_cannot_have_is_refused(tmp_path: Path) -> None:
    """Constraints that no wheel makes, and joints that do not turn by one coordinate of their own."""
    text = robot(wheel("one", at=("0", "b")), motor("one")) + '[[constraints]]\nexpression = "x_dot*sin(phi)"\n'
    (tmp_path / "one").mkdir()
    with pytest.raises(WmrError, match="has constraints that no wheel makes"):
        validate(derived(text, tmp_path / "one"))
    bent = steered("back", ("-a", "0"), "sin(beta)")
    (tmp_path / "three").mkdir()
    text = robot(FORK, bent, wheel("front", "fork"), wheel("rear", "back"), motor("front"), angles=("beta",))
    with pytest.raises(WmrError, match="joints fork and back follow one coordinate, not in proportion"):
        validate(derived(text, tmp_path / "three"))
    both = steered("fork", ("a", "0"), "beta + gamma")
    wheels = wheel("front", "fork"), wheel("rear", "back"), steered("back", ("-a", "0"), "beta")
    text = robot(both, wheels[2], *wheels[:2], motor("front"), angles=("beta", "gamma"))
    (tmp_path / "two").mkdir()
    with pytest.raises(WmrError, match=r"joint fork of small turns by beta \+ gamma, not by one coordinate of its own"):
        validate(derived(text, tmp_path / "two"))


def test_the_engine_has_to_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the message says how to get it."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(WmrError, match=r"MuJoCo is not installed; pip install 'wmr-afl\[mujoco\]'"):
        validate("type_2_0")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"count": 0}, "count: 0: is too little"),
        ({"seconds": 0.0}, "seconds: 0: is too little"),
        ({"start": {"z": 1.0}}, "start: z: is no coordinate; name one of x, y, phi"),
        ({"parameters": {"m_X": 1.0}}, "m_X"),
        ({"parameters": {"m_C": [1.0, 2.0]}}, "are those of several robots"),
        ({"start": {"x": float("nan")}}, "is not finite; give finite numbers"),
    ],
)
def test_wrong_arguments_are_told(given: dict, told: str) -> None:
    """Before anything is driven."""
    with pytest.raises(WmrError) as error:
        validate("type_2_0", **given)
    assert told in str(error.value)


def test_the_command_tells_and_writes(tmp_path: Path) -> None:
    """A verdict with its bounds; the engine's robot, numbers and a figure."""
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["validate", "type_1_1", "--seconds", "1", "--draws", "1", "--out", str(out)])
    assert done.exit_code == 0, done.output
    plain = " ".join(done.output.split())
    assert re.search(r"AGREES: accelerations at random states by 0\.000\d+ % \(bound 0\.004 %\), the drive by", plain)
    assert "drawn parameters 1: AGREES" in plain
    written = {one.name for one in out.iterdir()}
    assert {"type_1_1.xml", "validation.json", "validation.png", "validation.svg"} <= written
    numbers = json.loads((out / "validation.json").read_text())
    assert numbers["agrees"] is True
    assert numbers["bursts"]["count"] == 200
    assert mujoco.MjModel.from_xml_path(str(out / "type_1_1.xml")).nu == 2
    (tmp_path / "file").write_text("")
    assert CliRunner().invoke(app, ["validate", "type_1_1", "--out", str(tmp_path / "file")]).exit_code == 2
    assert CliRunner().invoke(app, ["validate", "nowhere"]).exit_code == 2


def test_a_robot_that_differs_ends_with_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The verdict says so."""
    monkeypatch.setattr("wmr_afl.validation.validate.CONVENTIONAL", Bounds(1e-9, 1e-9))
    done = CliRunner().invoke(app, ["validate", "type_2_0", "--seconds", "0.5", "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert "DIFFERS" in done.output


def test_the_narrow_bounds_are_for_shipped_robots_as_they_are_described() -> None:
    """And for drawn ones; with a thousandth of a mass the engine is less exact."""
    model = load_model("type_2_0")
    (near,) = drawn(model, 1)
    for parameters, bounds in (({}, CONVENTIONAL), (near, CONVENTIONAL), ({"m_C": 0.03}, ROUGH)):
        assert validate(model, parameters=parameters, count=1, seconds=0.2).bounds == bounds


def test_agreement_means_nothing_where_wheels_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a drive needs more friction than there is nothing is judged."""
    monkeypatch.setattr("wmr_afl.validation.engine.SLIPS", 0.01)
    with pytest.raises(WmrError, match="it slips; agreement would mean nothing"):
        validate("car", seconds=2.0, count=1)


@pytest.mark.parametrize(("friction", "slips"), [(0.02, True), (2.0, False)])
def test_a_wheel_that_slips_is_told(friction: float, slips: bool) -> None:
    """It needs all the friction that there is; what rolls needs less."""
    mechanism = mechanism_of("type_2_0_caster")
    q = np.zeros(mechanism.model.coordinate_count)
    engine = Engine(mechanism, Contact(friction=friction), mechanism.loads(q))
    engine.start(q, q)
    engine.drive(np.full(2, 0.5), 30)
    if not slips:
        engine.grip.check(mechanism, friction, "the test")
        return
    with pytest.raises(WmrError, match=r"the test needs 0\.02 of the load in friction at wheel \w+: it slips"):
        engine.grip.check(mechanism, friction, "the test")


def test_random_states_at_which_wheels_slip_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """And counted; where all do nothing is judged."""
    mechanism = mechanism_of("car")
    monkeypatch.setattr("wmr_afl.validation.bursts.SLIPS", 0.002)
    some = bursts(mechanism, count=30)
    assert 0 < some.slipped < 30
    assert some.rms.max() < bound(mechanism)
    monkeypatch.setattr("wmr_afl.validation.bursts.SLIPS", 0.0)
    none = bursts(mechanism, count=5)
    assert (none.slipped, none.count) == (5, 5)
    assert np.isnan([none.rms, none.worst]).all()
    with pytest.raises(WmrError, match="every random state needs more friction than there is"):
        validate("car", count=2, seconds=0.1)
