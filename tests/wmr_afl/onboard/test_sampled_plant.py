"""The robot as one step in discrete time is the simulator's, and each number of it has a name, a unit and a value."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENTS
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.onboard.sampled_plant import SampledPlant, joined, numbered
from wmr_afl.simulation.closed_loop import ClosedLoop

TROUBLE = """
[uncertainties]
measurement_noise = { deviation = { x = 0.002, phi = 0.001 }, seed = 3 }
input_delay = { seconds = 0.06 }
input_limits = { volts = 12.0 }
friction = { viscous = 0.1, coulomb = [0.2, 0.1], on = "wheels" }
payload = { time = 0.5, parameters = { m_C = 50.0 } }

[shared]"""


def numbers_of(column: Any) -> Floats:
    """A column of CasADi's as an array."""
    return np.array(column.full()[:, 0])


@pytest.fixture
def troubled(tmp_path: Path) -> ClosedLoop:
    """Study 1 with noise, a late drive, friction and a payload."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    assert "[shared]" in text
    (tmp_path / "troubled.toml").write_text(text.replace("[shared]", TROUBLE, 1))
    return load_experiment(tmp_path / "troubled.toml").loops["AFL"]


def sampled(loop: ClosedLoop) -> tuple[SampledPlant, Floats, Floats]:
    """With states and values that are made up but near those at the start."""
    plant, random = SampledPlant(loop), np.random.default_rng(5)
    values = plant.values.pack(loop.plant.values)
    return (
        plant,
        plant.start + random.normal(size=plant.states.size) * 0.3,
        values * (1.0 + 0.1 * random.random(values.size)),
    )


@pytest.mark.parametrize("t", [0.1, 0.7])
def test_a_step_is_that_of_the_simulator(troubled: ClosedLoop, t: float) -> None:
    """All states, before and after the payload, over a sample time and over half of it, for values of one's own."""
    plant, states, values = sampled(troubled)
    u = np.array([3.0, -20.0])
    after = []
    for step in (plant.sample_time, 0.5 * plant.sample_time):
        found = numbers_of(plant.traced()(states, u, t, step, values))
        z, k = by_part(plant.states.unpack(states)), by_part(plant.values.unpack(values))
        expected = troubled.plant.update(t, u, z, k, troubled.model.in_library("numpy"), step)
        np.testing.assert_allclose(found, plant.states.pack(expected), rtol=1e-12, atol=1e-12)
        after.append(found)
    assert np.all(after[0][:5] != after[1][:5])
    assert plant.counts_samples
    assert not SampledPlant(load_experiment("study_1").loops["AFL"]).counts_samples
    np.testing.assert_array_equal(plant.start[:5], troubled.plant.start)


def test_the_whole_state_is_measured_with_its_noise(troubled: ClosedLoop) -> None:
    """Normal numbers times their deviations, which may be set; nothing else is changed."""
    plant, states, values = sampled(troubled)
    x, normal = states[:5], np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    deviation = plant.values.unpack(values)["measurement_noise.deviation"]
    found = numbers_of(plant.traced_measurement()(x, normal, 0.0, values))
    np.testing.assert_allclose(found, x + normal * deviation, rtol=1e-14)
    np.testing.assert_array_equal(numbers_of(plant.traced_measurement()(x, np.zeros(5), 0.0, values)), x)
    assert np.count_nonzero(deviation) == 2
    assert plant.measured == tuple(troubled.model.state_units)
    assert plant.measured_units == troubled.model.state_units


def test_what_a_law_measures_is_picked_from_what_is_seen(tmp_path: Path) -> None:
    """A pose and the rates of motors, which are those of the robot as it is loaded at that time."""
    text = (EXPERIMENTS / "study_2_pose.toml").read_text()
    payload = "payload = { time = 0.5, parameters = { r = 0.2 } }\n"
    assert 'measures = "pose"' in text
    text = text.replace('measures = "pose"', 'measured = ["phi", "u_l", "x", "y", "u_r"]').replace(
        "friction =", payload + "friction =", 1
    )
    (tmp_path / "encoders.toml").write_text(text)
    loop = load_experiment(tmp_path / "encoders.toml").loops["pose"]
    plant = SampledPlant(loop)
    values, x = plant.values.pack(loop.plant.values), np.array([1.0, 2.0, 0.5, 0.7, -0.4])
    assert plant.measured == ("phi", "u_l", "x", "y", "u_r")
    units = {"phi": "rad", "u_l": "rad/s", "x": "m", "y": "m", "u_r": "rad/s"}
    assert plant.measured_units == units
    assert list(plant.measured_units) == list(units)
    model = loop.model.in_library("numpy")
    for t, radius in ((0.4, loop.plant.parameters[list(model.parameter_units).index("r")]), (0.6, 0.2)):
        p = loop.plant.parameters.copy()
        p[list(model.parameter_units).index("r")] = radius
        rates = dict(zip(model.input_units, model.actuator_rates_matrix(x[:3], p) @ x[3:], strict=True))
        found = numbers_of(plant.traced_measurement()(x, np.zeros(plant.plant.samples), t, values))
        np.testing.assert_allclose(found, [0.5, rates["u_l"], 1.0, 2.0, rates["u_r"]], rtol=1e-12)


def test_every_number_has_a_name_a_unit_and_its_value(troubled: ClosedLoop) -> None:
    """Physical parameters as the model tells of them; those of what disturbs the robot under its name."""
    numbers = list(SampledPlant(troubled).numbers())
    by_name = {one.name: one for one in numbers}
    assert len(by_name) == len(numbers) == SampledPlant(troubled).values.size
    model = troubled.model
    for (name, unit), value in zip(model.parameter_units.items(), troubled.plant.parameters, strict=True):
        one = by_name[f"parameters.{name}"]
        assert (one.unit, one.value, one.about) == (unit, value, model.metadata["about"][name])
    assert by_name["friction.coulomb.u_l"].unit == "N m"
    assert (by_name["friction.coulomb.u_r"].value, by_name["friction.coulomb.u_l"].value) == (0.2, 0.1)
    assert by_name["payload.parameters.m_C"].about == by_name["parameters.m_C"].about
    for name in ("friction.coulomb.u_r", "input_limits.volts.u_l", "payload.time"):
        assert by_name[name].about == "of what disturbs the robot"
    assert [one.value for one in numbers] == SampledPlant(troubled).values.pack(troubled.plant.values).tolist()


@pytest.mark.parametrize(
    ("value", "names"),
    [
        (np.array(3.0), [""]),
        (np.array([3.0]), [""]),
        (np.array([3.0, 4.0]), ["[1]", "[2]"]),
        (np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), [f"[{i},{j}]" for i in (1, 2) for j in (1, 2, 3)]),
        (np.array([[7.0]]), [""]),
    ],
)
def test_entries_without_names_are_counted_from_one(value: Floats, names: list[str]) -> None:
    """By row and column; a single one needs no number."""
    found = list(numbered(value))
    assert [entry for entry, _, _ in found] == names
    assert {unit for _, unit, _ in found} == {""}
    assert [number for _, _, number in found] == np.ravel(value).tolist()
    assert [joined("a.b", name) for name in names] == [f"a.b{name}" for name in names]
    named = {f"n{i}": f"u{i}" for i in range(np.size(value))}
    assert [(joined("a", entry), unit) for entry, unit, _ in numbered(value, named)] == [
        (f"a.{name}", unit) for name, unit in named.items()
    ]
