"""What stands still stays where it is: dry friction and stops, against their laws and for every integrator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.derive import descriptions
from tests.derive.descriptions import derived, motor, steered, wheel
from wmr_afl import WmrError, load_model
from wmr_afl.model.laws import LAWS, Situation
from wmr_afl.model.model import Model
from wmr_afl.numerics import complementarity
from wmr_afl.numerics.arrays import CASADI, NUMPY, Floats
from wmr_afl.numerics.complementarity import stopping_forces
from wmr_afl.numerics.parts import by_part
from wmr_afl.plant import Friction, Plant
from wmr_afl.plant.loads import Place

INTEGRATORS = ("euler", "rk4")


@pytest.fixture
def model(robot: str) -> Model:
    return load_model(robot)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_forces_stop_what_they_can_and_give_way_where_they_cannot(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between its bounds a force leaves no rate; at a bound the rate that is left goes on against it."""
    monkeypatch.setattr(complementarity, "SWEEPS", 1000)  # odd matrices converge more slowly than robots
    random, seen = np.random.default_rng(count), set()
    for _ in range(20):
        root = random.normal(size=(count, max(1, count - 1)))  # more forces than motions
        rates = root @ random.normal(size=root.shape[1])
        effects, most = root @ root.T, random.uniform(0.0, 0.5, count)
        force = np.array(stopping_forces(list(rates), effects, list(-most), list(most), NUMPY))
        left = rates - effects @ force
        assert np.all(np.abs(force) <= most)
        holds = np.abs(force) < most - 1e-9
        assert np.all(np.abs(left[holds]) < 1e-6)
        assert np.all((left * np.sign(force))[~holds] > -1e-6)
        seen |= set(holds.tolist())
    assert seen == {True, False}


@pytest.mark.parametrize("place", ["pseudo_velocities", "wheels"])
def test_the_sweeps_suffice_for_every_robot(model: Model, place: str) -> None:
    """What is left of a motion that can be stopped."""
    s = Situation(model.name)
    for q, p, v in zip(s.q, s.p, s.v, strict=True):
        J = Place(model, place).matrix(q, p, model)
        effects = J @ np.linalg.solve(model.inertia_matrix(q, p), J.T)
        force = stopping_forces(list(J @ v), effects, [None] * len(J), [None] * len(J), NUMPY)
        assert np.abs(J @ v - effects @ np.array(force)).max() < 1e-6 * np.abs(J @ v).max()


def test_forces_are_the_same_in_both_libraries_and_may_have_no_bound() -> None:
    rates, effects = [0.3, -0.8], [[2.0, 0.5], [0.5, 1.0]]
    bounds = ([None, -0.1], [0.0, None])
    numpy = stopping_forces(rates, effects, *bounds, NUMPY)
    casadi = stopping_forces(rates, effects, *bounds, CASADI)
    np.testing.assert_allclose([float(f) for f in casadi], numpy, rtol=1e-15)
    assert numpy[0] == 0.0  # a stop does not pull
    assert numpy[1] == -0.1  # and dry friction gives way
    assert stopping_forces([1.0], [[0.0]], [-2.0], [2.0], NUMPY)[0] == 1.0  # without effect nothing is divided by zero


def moved(plant: Plant, model: Model, volts: Floats, samples: int, step: float = 0.01) -> Floats:
    """The states over some samples, (samples + 1, 2n-m)."""
    states, k = [plant.start], by_part(plant.values)
    for i in range(samples):
        z = by_part({**plant.states, "x": states[-1]})
        states.append(plant.update(i * step, volts, z, k, model, step)["x"])
    return np.array(states)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("place", ["pseudo_velocities", "wheels"])
def test_a_robot_with_friction_comes_to_rest_and_stays_there(model: Model, place: str, integrator: str) -> None:
    """Without voltages every motion ends, for good; no wheel is reversed by friction."""
    s = Situation(model.name, count=1)
    n, p = model.coordinate_count, model.parameters()
    x = np.concatenate([s.q[0], 0.02 * s.v[0]])
    friction = Friction(model, 0.0, 5.0, place)
    states = moved(Plant(model, p, x, integrator, [friction]), model, np.zeros(len(model.input_units)), 300)
    speed = np.abs(states[:, n:]).max(axis=1)
    assert speed[-1] < 1e-9
    assert np.abs(states[-1] - states[-2])[:n].max() < 1e-10
    if integrator == "euler" and place == "pseudo_velocities":
        assert np.all(states[1:, n:] * np.sign(states[:-1, n:]) > -1e-7)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_dry_friction_holds_against_less_and_gives_way_to_more(model: Model, integrator: str) -> None:
    """At rest the motors' torques X^T K1 u are held up to Kd, to the last bit of the position."""
    n, p = model.coordinate_count, model.parameters()
    x = np.concatenate([Situation(model.name, count=1).q[0], np.zeros(model.pseudo_velocity_count)])
    u = 1.0 + np.arange(len(model.input_units))
    push = np.abs(model.input_matrix(x[:n], p) @ u)
    for share, holds in ((1.01, True), (0.9, False)):
        friction = Friction(model, 0.0, share * push)
        states = moved(Plant(model, p, x, integrator, [friction]), model, u, 10)
        assert (np.abs(states[-1, :n] - x[:n]).max() < 1e-9) == holds


def test_a_sliding_robot_is_integrated_to_fourth_order() -> None:
    """The force of friction that does not change its sign is held over a sample, not added after it."""
    model = load_model("type_2_0")
    x, u = np.array([0.0, 0.0, 0.3, 2.0, 1.0]), np.array([3.0, 2.5])
    ends = {}
    for steps in (8, 16, 128):
        plant = Plant(model, model.parameters(), x, "rk4", [Friction(model, 0.1, 0.5, "wheels")])
        ends[steps] = moved(plant, model, u, steps, 1.6 / steps)[-1]
    coarse, fine = (np.abs(ends[steps] - ends[128]).max() for steps in (8, 16))
    assert 11.0 < coarse / fine < 40.0


STOPPED = descriptions.robot(
    steered("fork", ("a", "0"), "2*beta + 0.1") + 'limits = ["-a/b", 0.6]\n',
    wheel("rear"),
    wheel("front", "fork"),
    motor("rear"),
    motor("fork"),
    angles=("beta",),
    outputs={"y1": "x + a*cos(phi) + L*cos(phi + 2*beta)", "y2": "y + a*sin(phi) + L*sin(phi + 2*beta)"},
)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return derived(STOPPED, tmp_path_factory.mktemp("stopped"))


def test_the_distances_to_the_stops_are_those_of_the_description(stopped: Path) -> None:
    model = load_model(stopped)
    values = dict(zip(model.parameter_units, model.parameters(), strict=True))
    beta = 0.07
    expected = [2 * beta + 0.1 + values["a"] / values["b"], 0.6 - 2 * beta - 0.1]
    np.testing.assert_allclose(model.joint_stops([1, 2, 3, beta], model.parameters()), expected, rtol=1e-14)
    law = next(law for law in LAWS if law.name == "stops of joints")
    situation = Situation(stopped)
    assert law.applies(situation.numpy)
    assert law.deviation(situation) <= law.tolerance
    truth = situation.numpy.joint_stops_matrix
    situation.numpy.joint_stops_matrix = lambda q, p: 1.001 * truth(q, p)
    assert law.deviation(situation) > law.tolerance


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_turns_to_its_stop_stays_and_comes_back(stopped: Path, sign: float, integrator: str) -> None:
    model = load_model(stopped)
    p, start = model.parameters(), np.zeros(6)
    volts = np.array([0.0, 20.0 * sign])
    plant = Plant(model, p, start, integrator)
    there = moved(plant, model, volts, 300)
    left = model.joint_stops(there[:, :4], p)
    assert left.min() > (-1e-12 if integrator == "euler" else -1e-4)  # step^2, of the method of Runge and Kutta
    assert left[-1].min() < 1e-6  # at the stop, with the motor pushing
    assert np.abs(model.joint_stops_matrix(there[-1, :4], p) @ there[-1, 4:]).max() < 1e-3
    back = moved(Plant(model, p, np.concatenate([there[-1, :4], [0.0, 0.0]]), integrator), model, -volts, 3)
    assert model.joint_stops(back[-1, :4], p).min() > 0.01


EXPERIMENT = """
title = "A joint with stops"
robot = "{robot}"
start = {{ beta = {beta} }}
reference = {{ expressions = {{ y1 = "0.6 + 0.2*t", y2 = "1.5*t" }} }}
simulation = {{ duration = 2.0, sample_time = 0.01, integrator = "rk4" }}
controllers.exact = {{ outer_loop = {{ b1 = 6.0, b2 = 9.0 }} }}
"""


@pytest.fixture
def experiment(stopped: Path, tmp_path: Path) -> Path:
    file = tmp_path / "experiment.toml"
    file.write_text(EXPERIMENT.format(robot=stopped, beta=0.0))
    return file


def test_every_backend_stops_at_the_same_place_and_the_run_says_so(experiment: Path) -> None:
    runs = [wmr_afl.run(experiment, backend=backend)["exact"] for backend in ("numpy", "casadi", "compiled")]
    for run in runs[1:]:
        np.testing.assert_allclose(run.state, runs[0].state, rtol=1e-8, atol=1e-9)
    assert runs[0].state[:, 3].max() == pytest.approx(0.25, abs=1e-3)
    assert any("a joint is at its stop in" in sign for sign in runs[0].warnings)
    batch = wmr_afl.run_batch(experiment, start={"beta": [0.0, 0.1]}, backend="compiled")
    np.testing.assert_allclose(batch.rms[0], runs[0].rms(), rtol=1e-6)


def test_no_robot_starts_beyond_its_stops(experiment: Path, stopped: Path) -> None:
    problem = "the joint 'fork' starts 0.1 rad beyond its limits; start within them"
    experiment.write_text(EXPERIMENT.format(robot=stopped, beta=0.3))
    with pytest.raises(WmrError, match=rf"\[start\]: {problem}"):
        wmr_afl.run(experiment)
    experiment.write_text(EXPERIMENT.format(robot=stopped, beta=0.0))
    with pytest.raises(WmrError, match=problem):
        wmr_afl.run_batch(experiment, start={"beta": [0.0, 0.3]})
