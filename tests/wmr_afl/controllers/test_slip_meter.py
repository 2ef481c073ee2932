"""Slip as measured: what it reads of robots that slip and of robots that do not, and what it goes by."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wmr_afl
from tests.wmr_afl.controllers.test_pose_observer import LAWS, STEP, experiment, own
from wmr_afl import Controller, WmrError
from wmr_afl.analysis.files import columns, write_results
from wmr_afl.controllers.sight import Sight
from wmr_afl.controllers.slip_meter import SlipMeter
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.experiments.vary import Differences, vary
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.slip import is_driven, wheel_rows
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.plant import Plant, Uncertainty, WheelSlip
from wmr_afl.simulation.layout import Layout

RATE = 5.0  # [1/s]


def driven(model: Model, slips: list[Uncertainty], samples: int = 60) -> list[Floats]:
    """Measured states of a robot that coasts from an ordinary state, its motors off."""
    s = Situation(model.name, count=1)
    start = np.hstack([s.q[0], 0.3 * s.v[0]])
    plant = Plant(model, model.parameters(), start, "rk4", slips)
    k, x, states = by_part(plant.values), start, []
    for n in range(samples):
        states.append(x)
        z = SimpleNamespace(x=x)
        x = plant.update(STEP * n, np.zeros(len(model.input_units)), z, k, model, STEP)["x"]
    return states


def reads(meter: SlipMeter, states: list[Floats], model: Model, steps: list[float] | None = None) -> Floats:
    """sigma^ at every sample, (T, k)."""
    z, rows = SimpleNamespace(**meter.states), []
    for x, step in zip(states, steps or [STEP] * len(states), strict=True):
        seen = meter.see(x, z, own(meter), model, step)
        z = SimpleNamespace(**meter.update(seen, model))
        rows.append(seen.speeds)
    return np.array(rows)


def test_the_slip_of_every_wheel_is_read(robot: str) -> None:
    """Each alone, sideways and along: all rows within a few percent of what the plant has, six time constants later."""
    model = load_model(robot)
    meter = SlipMeter(model, model.parameters(), RATE, measures_v=True)
    assert meter.names == tuple(wheel_rows(model))
    for name in meter.names:
        wheel, direction = name.split()
        slip = WheelSlip(model, {wheel: {direction: "0.05"}}, model.parameters())
        states = driven(model, [slip])
        plant = Plant(model, model.parameters(), states[-1], uncertainties=[slip])
        true = plant.slip(0.0, states[-1], by_part(plant.values), model)
        read = reads(meter, states, model)[-1]
        assert read[meter.names.index(name)] == pytest.approx(0.05, rel=0.03)
        np.testing.assert_allclose(read, [true[row] for row in meter.rows], atol=0.0025)


def test_without_slip_next_to_nothing_is_read(robot: str) -> None:
    """What is left is of the second order in the sample time."""
    model = load_model(robot)
    meter = SlipMeter(model, model.parameters(), RATE, measures_v=True)
    assert np.abs(reads(meter, driven(model, []), model)).max() < 1e-3


def test_from_the_pose_alone_only_the_pose_is_looked_at(robot: str) -> None:
    """What slips sideways, to the bit, whatever is measured of v."""
    model, n = load_model(robot), load_model(robot).coordinate_count
    meter = SlipMeter(model, model.parameters(), RATE)
    assert meter.names == tuple(name for name, row in wheel_rows(model).items() if not is_driven(model, row))
    assert "v" not in meter.states
    if not meter.names:
        return
    wheel = meter.names[0].split()[0]
    states = driven(model, [WheelSlip(model, {wheel: {"sideways": "0.1"}}, model.parameters())])
    nonsense = [np.hstack([x[:n], np.full(len(x) - n, np.nan)]) for x in states]
    read = reads(meter, states, model)
    np.testing.assert_array_equal(read, reads(meter, nonsense, model))
    assert read[-1, 0] == pytest.approx(0.1, rel=0.03)


def test_an_angle_that_jumps_by_a_turn_is_no_motion(robot: str) -> None:
    """And a length that jumps as far is one."""
    model, n = load_model(robot), load_model(robot).coordinate_count
    meter = SlipMeter(model, model.parameters(), RATE, measures_v=True)
    states = driven(model, [], 6)
    turned = [x.copy() for x in states]
    units = list(model.state_units.values())[:n]
    for x in turned[3:]:
        x[:n] += [2.0 * np.pi if unit == "rad" else 0.0 for unit in units]
    np.testing.assert_allclose(reads(meter, turned, model), reads(meter, states, model), atol=1e-9)
    jumped = [x.copy() for x in states]
    for x in jumped[3:]:
        x[:2] += 2.0 * np.pi
    assert np.abs(reads(meter, jumped, model)).max() > 1.0


def pushed(speed: float, times: Floats) -> list[Floats]:
    """A differential robot whose wheels stand while it is pushed sideways, to its left."""
    return [np.array([0.0, speed * t, 0.0, 0.0, 0.0]) for t in times]


def test_it_follows_as_the_time_that_passed_says() -> None:
    """1 - exp(-rate t) of a constant slip, at even and uneven samples; nothing at the first."""
    model = load_model("type_2_0")
    meter = SlipMeter(model, model.parameters(), RATE)
    for steps in (np.full(40, STEP), STEP * np.random.default_rng(1).uniform(0.5, 1.5, 40)):
        times = np.cumsum(steps)
        read = reads(meter, pushed(0.2, times), model, list(steps))
        expected = 0.2 * (1.0 - np.exp(-RATE * (times - times[0])))
        np.testing.assert_allclose(read, np.stack([expected, expected], axis=1), atol=1e-12)


def test_the_first_sample_is_looked_at_where_the_robot_is() -> None:
    """Not half way from the origin, where Z or S may have no value."""
    model, places = load_model("type_2_0"), list[Floats]()
    meter, truth = SlipMeter(model, model.parameters(), RATE), model.slip_matrix
    model.slip_matrix = lambda q, p: places.append(q) or truth(q, p)
    reads(meter, [np.array([2.0, 4.0, 1.0, 0.0, 0.0]), np.array([2.0, 5.0, 2.0, 0.0, 0.0])], model)
    np.testing.assert_allclose(places, [[2.0, 4.0, 1.0], [2.0, 4.5, 1.5]])


def test_a_millimetre_of_noise_reads_as_millimetres_a_second() -> None:
    """(1 - B)/T sqrt(2/(1 + B)) of the noise, B = exp(-rate T): 4.9 mm/s at the usual rate."""
    model, random = load_model("type_2_0"), np.random.default_rng(2)
    meter = SlipMeter(model, model.parameters(), RATE)
    states = [np.array([*random.normal(0.0, 1e-3, 2), 0.0, 0.0, 0.0]) for _ in range(4000)]
    deviation, B = reads(meter, states, model)[200:, 0].std(), np.exp(-RATE * STEP)
    assert deviation == pytest.approx(1e-3 * (1.0 - B) / STEP * np.sqrt(2.0 / (1.0 + B)), rel=0.1)
    assert deviation == pytest.approx(4.9e-3, rel=0.1)


def test_a_rate_that_means_nothing_is_refused() -> None:
    model = load_model("type_2_0")
    for rate in (0.0, np.nan):
        with pytest.raises(WmrError, match="choose a positive number"):
            SlipMeter(model, model.parameters(), rate)
    with pytest.raises(WmrError, match="only an observer tells"):
        Sight(slip=SlipMeter(model, model.parameters(), RATE))


@pytest.mark.parametrize(
    ("table", "rate"), [("", 5.0), ("observer = { rate = 12.0 }", 2.0), ("observer = { slip_rate = 3.0 }", 3.0)]
)
@pytest.mark.parametrize("law", ["composite", "linearizing"])
def test_a_law_that_observes_measures_slip(law: str, table: str, rate: float, tmp_path: Path) -> None:
    """At a sixth of the observer's rate unless told; along where v is measured, too."""
    file = experiment("type_2_0", tmp_path, {law: f"{LAWS[law]}\n{table}"})
    loop = load_experiment(file).loops[law]
    assert loop.law.slip_names == ("right sideways", "left sideways")
    np.testing.assert_allclose(loop.values["slip.slip_rate"], rate)
    file.write_text(file.read_text().replace('measures = "pose"', "" if table else "observer = {}"))
    loop = load_experiment(file).loops[law]
    assert loop.law.slip_names == ("right sideways", "left sideways", "right along", "left along")
    file = experiment("mecanum", tmp_path, {"frozen": LAWS["frozen"]})
    assert load_experiment(file).loops["frozen"].law.slip_names == ()


def test_it_takes_the_parameters_that_the_controller_takes_for_true(tmp_path: Path) -> None:
    """Those of each robot of a batch, and the guess in their place."""
    file = experiment("type_2_0", tmp_path, {"composite": f"{LAWS['composite']}\nguess = {{ m_C = 20.0 }}"})
    loaded = load_experiment(file)
    loop = loaded.loops["composite"]
    model, p = loop.model, loop.values["p"]
    np.testing.assert_array_equal(loop.values["slip.p"], model.replaced(p, {"m_C": 20.0}))
    differences = Differences(parameters={"b": [0.3, 0.4], "m_C": [7.0, 8.0]})
    robots = vary(loaded.experiment, "composite", loop, differences)
    given = [Layout(loop.values).unpack(column)["slip.p"] for column in robots.values.T]
    for found, b in zip(given, (0.3, 0.4), strict=True):
        np.testing.assert_array_equal(found, model.replaced(p, {"m_C": 20.0, "b": b}))


def test_a_gap_begins_it_again(tmp_path: Path) -> None:
    """A robot that was carried away meanwhile has not slipped; neither has one of which a sample was lost."""
    for gap in (20.0, 1.8):
        controller = Controller.from_experiment(experiment("type_2_0", tmp_path, {"frozen": LAWS["frozen"]}))
        for n in range(50):
            controller.update(STEP * n, [0.0, 0.1 * STEP * n, 0.0, 0.0, 0.0])
        assert controller.state_dict()["slip.speeds"][0] == pytest.approx(0.1, rel=0.02)
        begin = STEP * (49 + gap)
        for n in range(3):
            controller.update(begin + STEP * n, [0.3, 0.5, 0.0, 0.0, 0.0])
            assert np.abs(controller.state_dict()["slip.speeds"]).max() < (1e-9 if n else 0.1)


def study(folder: Path) -> Path:
    """Study 3 from the pose alone, its slip at 5 s instead of 50 s."""
    text = find_experiment("study_3_pose").read_text()
    for old, new in (("140.0", "9.0"), ("step(t - 50)", "step(t - 5)"), ("step(t - 70)", "step(t - 8)")):
        assert old in text
        text = text.replace(old, new)
    file = folder / "study.toml"
    file.write_text(text)
    return file


def test_the_slip_of_the_study_is_read_and_written(tmp_path: Path) -> None:
    """0.1 m/s of both wheels, in spite of friction and a force, and nothing along."""
    h5py = pytest.importorskip("h5py")
    file = study(tmp_path)
    runs = wmr_afl.run(file, backend="casadi")
    for name in ("pose", "v measured"):
        run = runs[name]
        assert run.slip is not None
        assert run.slip_true is not None
        at = {label: run.slip[(low < run.time) & (run.time < high)] for label, low, high in
              (("before", 2.5, 5.0), ("slipping", 6.5, 8.0))}  # fmt: skip
        assert np.abs(at["before"]).max() < 1e-3
        np.testing.assert_allclose(at["slipping"][:, :2], 0.1, atol=1e-3)
        assert np.abs(at["slipping"][:, 2:]).max(initial=0.0) < 2e-3
        expected = 0.1 * ((run.time >= 5.0) & (run.time < 8.0))
        np.testing.assert_allclose(run.slip_true[:, :2], np.stack([expected, expected], axis=1), atol=1e-12)
        np.testing.assert_allclose(run.slip_true[:, 2:], 0.0, atol=1e-12)
    assert runs["frozen, w = 40"].slip is None
    run = runs["pose"]
    names = ["slip_right sideways [m/s]", "slip_left sideways [m/s]"]
    assert columns(run)[-4:] == [*names, *(name.replace("slip_", "slip_true_") for name in names)]
    write_results({"pose": run}, tmp_path)
    table = np.loadtxt(tmp_path / "pose.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table[:, -4:], np.hstack([run.slip, run.slip_true]))
    wmr_afl.run_batch(file, "pose", scale={"m_C": [1.0]}, trajectories=tmp_path / "runs.h5", backend="casadi")
    with h5py.File(tmp_path / "runs.h5") as record:
        np.testing.assert_allclose(record["slip"][0], run.slip, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(record["slip_true"][0], run.slip_true, atol=1e-12)
