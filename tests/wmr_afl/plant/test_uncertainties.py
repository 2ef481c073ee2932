"""Each uncertainty alone does what its equation says, in both libraries, for every robot."""

from pathlib import Path
from types import SimpleNamespace
from typing import get_args, get_type_hints

import numpy as np
import pytest

import wmr_afl
from wmr_afl import InputError
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.laws import Situation
from wmr_afl.numerics.arrays import NUMPY
from wmr_afl.numerics.parts import by_part
from wmr_afl.plant import Disturbance, Friction, InputDelay, LateralSlip, PayloadChange, Plant, Uncertainty
from wmr_afl.plant.order import UncertaintiesTable
from wmr_afl.simulation.simulate import simulate

ALONE = {
    "friction on v": 'friction = { viscous = 0.9, coulomb = 0.75, on = "pseudo_velocities" }',
    "friction on wheels": 'friction = { viscous = [0.1, 0.2], coulomb = 0.05, on = "wheels" }',
    "friction, literal": 'friction = { viscous = 0.1, coulomb = 0.05, on = "wheels", of = "pseudo_velocities" }',
    "disturbance on v": 'disturbance = { expression = { omega = "3*sin(3*t)" }, on = "pseudo_velocities" }',
    "disturbance on wheels": 'disturbance = { expression = "0.2*step(t - 1)", on = "wheels" }',
    "noise": "measurement_noise = { deviation = 0.001, seed = 3 }",
    "limits": "input_limits = { volts = 3.0 }",
    "limits of commands": "command_limits = { most = 3.0, least = -2.0, keeps_direction = true }",
    "delay": "input_delay = { seconds = 0.04 }",
    "slip": 'lateral_slip = { speed = "0.1*(step(t - 1) - step(t - 2))" }',
    "slip of wheels": 'wheel_slip = { right = { sideways = "0.1*step(t - 1)" }, left = { along = "t*step(t - 2)" } }',
    "payload": "payload = { time = 1.5, parameters = { m_C = 72.0 } }",
}


def experiment(tmp_path: Path, uncertainties: str, duration: float = 3.0) -> Path:
    text = (Path(wmr_afl.__file__).parent / "experiments" / "catalogue" / "study_1.toml").read_text()
    path = tmp_path / "one.toml"
    text = text.replace("duration = 140.0", f"duration = {duration}")
    text = text.replace("lower = 0.1", "lower = 0.5")  # with which a delay is tolerated
    path.write_text(text.replace("[shared]", f"[uncertainties]\n{uncertainties}\n\n[shared]", 1))
    return path


BEGINS = {  # [s], when it first acts; the others do from the start on
    "disturbance on wheels": 1.0,
    "slip": 1.0,
    "slip of wheels": 1.0,
    "payload": 1.5,
}


@pytest.mark.parametrize("uncertainty", ALONE)
def test_each_alone_acts_from_its_time_on_and_both_libraries_agree(uncertainty: str, tmp_path: Path) -> None:
    """Up to its time the run is the undisturbed one, to the bit; one sample later it no longer is."""
    loop = assemble(*read_experiment(experiment(tmp_path, ALONE[uncertainty])))["AFL"]
    first, second = (simulate(loop, 3.0, backend=backend) for backend in ("numpy", "casadi"))
    undisturbed = simulate(assemble(*read_experiment(experiment(tmp_path, "")))["AFL"], 3.0, backend="numpy")
    for signal in ("state", "input", "command", "estimate"):
        a, b = getattr(first, signal), getattr(second, signal)
        assert np.max(np.abs(a - b)) <= 1e-9 * max(1.0, np.max(np.abs(a))), signal
    before = round(BEGINS.get(uncertainty, 0.0) / loop.sample_time) + 1
    np.testing.assert_array_equal(first.state[:before], undisturbed.state[:before])
    assert np.max(np.abs(first.state[before + 1] - undisturbed.state[before + 1])) > 0.0
    assert np.max(np.abs(first.state - undisturbed.state)) > 1e-4


def derivative(robot: str, uncertainty: Uncertainty) -> tuple[np.ndarray, np.ndarray, Situation]:
    """x' of the plant with and without an uncertainty, by a step so small that Euler's rule shows it."""
    s, step = Situation(robot, count=1), 1e-6
    changes = []
    for chosen in ([uncertainty], []):
        plant = Plant(s.numpy, s.p[0], s.x[0], uncertainties=chosen)
        following = plant.update(1.0, s.u[0], by_part(plant.states), by_part(plant.values), s.numpy, step)
        changes.append((following["x"] - s.x[0]) / step)
    return changes[0], changes[1], s


def test_friction_takes_power_and_a_load_acts_through_the_inertia(robot: str) -> None:
    """Mbar dv' = -w: what a load changes of v' is the inertia's answer; friction's work is not positive."""
    for place in ("pseudo_velocities", "wheels"):
        friction = Friction(Situation(robot, count=1).numpy, 0.3, 0.2, place)
        disturbed, free, s = derivative(robot, friction)
        n = s.numpy.coordinate_count
        force = s.numpy.inertia_matrix(s.q[0], s.p[0]) @ (disturbed - free)[n:]
        rates = s.v[0] if place == "pseudo_velocities" else s.numpy.actuator_rates_matrix(s.q[0], s.p[0]) @ s.v[0]
        power = -np.sum(0.3 * rates**2 + 0.2 * np.abs(rates))
        np.testing.assert_allclose(force @ s.v[0], power, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose((disturbed - free)[:n], 0.0, atol=1e-8)


def test_a_disturbance_on_the_wheels_is_a_torque_of_the_motors(robot: str) -> None:
    """tau_d on every shaft acts as -tau_d of motor torque: Mbar dv' = -X^T tau_d."""
    model = Situation(robot, count=1).numpy
    disturbed, free, s = derivative(robot, Disturbance(model, "2*t", "wheels"))
    n = model.coordinate_count
    force = s.numpy.inertia_matrix(s.q[0], s.p[0]) @ (disturbed - free)[n:]
    torque = np.full(len(model.input_units), 2.0)
    expected = -s.numpy.actuator_rates_matrix(s.q[0], s.p[0]).T @ torque
    np.testing.assert_allclose(force, expected, rtol=1e-6, atol=1e-6)


def test_slip_moves_the_root_across_its_heading(robot: str) -> None:
    slipping, free, s = derivative(robot, LateralSlip(Situation(robot, count=1).numpy, "0.3"))
    phi = s.q[0][2]
    expected = np.zeros(len(slipping))
    expected[:2] = 0.3 * np.array([-np.sin(phi), np.cos(phi)])
    np.testing.assert_allclose(slipping - free, expected, atol=1e-7)


def test_a_payload_counts_from_its_time_on() -> None:
    model = wmr_afl.load_model("type_2_0")
    p, heavy = model.parameters(), model.parameters(m_C=72.0)
    plant = Plant(model, p, np.zeros(5), uncertainties=[PayloadChange(model, 1.0, heavy)])
    k = by_part(plant.values)
    np.testing.assert_array_equal(plant.parameters_at(0.999, k, NUMPY), p)
    np.testing.assert_array_equal(plant.parameters_at(1.0, k, NUMPY), heavy)


def test_a_delay_hands_on_every_command_so_many_samples_later() -> None:
    delay, nothing = InputDelay(2, 3), SimpleNamespace()
    z, arrived = SimpleNamespace(**delay.states), []
    for i in range(6):
        u = np.array([i + 1.0, -i - 1.0])
        arrived.append(delay.applied(u, z, nothing, NUMPY))
        z = SimpleNamespace(**delay.update(u, z, nothing, NUMPY))
    np.testing.assert_array_equal(np.array(arrived)[:, 0], [0, 0, 0, 1, 2, 3])


def test_two_of_a_kind_add_up(robot: str) -> None:
    """Each keeps its own numbers under its own name."""
    s = Situation(robot, count=1)
    model, x, p = s.numpy, s.x[0], s.p[0]

    def load(*frictions: Friction) -> np.ndarray:
        plant = Plant(model, p, x, uncertainties=frictions)
        return plant.load(0.0, x, p, by_part(plant.values), model)

    one, other = Friction(model, viscous=1.0, on="pseudo_velocities"), Friction(model, viscous=5.0, on="wheels")
    assert np.any(load(other) != 0.0)
    np.testing.assert_allclose(load(one, other), load(one) + load(other), rtol=1e-14)
    names = list(Plant(model, p, x, uncertainties=[one, other]).values)
    assert names == ["p", "friction.viscous", "friction.coulomb", "friction_2.viscous", "friction_2.coulomb"]


def test_every_table_builds_the_uncertainty_of_its_key() -> None:
    """So that rules, states and numbers meet under one name."""
    tables = {name: field.annotation for name, field in UncertaintiesTable.model_fields.items()}
    built = {name: get_type_hints(get_args(table)[0].build)["return"] for name, table in tables.items()}
    assert {name: uncertainty.name for name, uncertainty in built.items()} == {name: name for name in tables}


def test_each_kind_of_uncertainty_is_tried_alone() -> None:
    assert {text.partition(" =")[0] for text in ALONE.values()} == set(UncertaintiesTable.model_fields)


def test_inputs_and_commands_are_both_logged(tmp_path: Path) -> None:
    run = wmr_afl.run(experiment(tmp_path, "input_limits = { volts = 0.5 }"))["AFL"]
    assert np.max(np.abs(run.input)) == 0.5
    assert np.max(np.abs(run.command)) > 0.5
    np.testing.assert_array_equal(run.input, np.clip(run.command, -0.5, 0.5))


@pytest.mark.parametrize(
    ("uncertainty", "words"),
    [
        ('friction = { viscous = 1.0, on = "roof" }', ["[uncertainties] friction.on", "'wheels'"]),
        ('friction = { viscous = -1.0, on = "wheels" }', ["[uncertainties.friction]", "zero or more"]),
        ('friction = { on = "pseudo_velocities", of = "wheels" }', ["[uncertainties.friction]", 'on = "wheels"']),
        ("friction = { viscous = 1.0 }", ["friction", "missing 'on'"]),
        ('disturbance = { expression = { v2 = "t" }, on = "pseudo_velocities" }', ["'v2'", "v, omega"]),
        ('disturbance = { expression = "sn(t)", on = "wheels" }', ["disturbance", "did you mean 'sin'"]),
        ("input_delay = { seconds = 0.03 }", ["[uncertainties.input_delay] seconds", "multiple"]),
        ("payload = { time = 1.0, parameters = { mass = 3.0 } }", ["[uncertainties.payload]", "'mass'", "m_C"]),
        ('lateral_slip = { speed = "y" }', ["[uncertainties.lateral_slip] speed", "unknown name 'y'"]),
        ('wheel_slip = { rigt = { along = "1" } }', ["[uncertainties.wheel_slip]", "did you mean 'right'"]),
        ('wheel_slip = { right = { along = "y" } }', ["[uncertainties.wheel_slip]", "right along", "unknown name 'y'"]),
        ('wheel_slip = { right = { beside = "1" } }', ["wheel_slip.right", "'beside'", "sideways, along"]),
        ("wheel_slip = { right = {} }", ["wheel_slip.right", "write sideways"]),
        ("wheel_slip = {}", ["[uncertainties.wheel_slip]", "names no wheel", "right, left"]),
        ("gremlins = 1", ["gremlins", "friction"]),
    ],
)
def test_a_mistake_in_an_uncertainty_is_reported(uncertainty: str, words: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        wmr_afl.run(experiment(tmp_path, uncertainty))
    for word in words:
        assert word in str(caught.value)
