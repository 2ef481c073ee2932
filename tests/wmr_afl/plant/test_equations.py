"""Each uncertainty, and the plant that they act on, against the equations, written here once more, for every robot."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from wmr_afl.errors import MissingTermError, ShapeError, UnknownNameError, WmrError
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.slip import wheel_rows
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.numerics.rules import Numbers
from wmr_afl.plant import (
    Disturbance,
    Friction,
    InputDelay,
    InputLimits,
    LateralSlip,
    MeasurementNoise,
    PayloadChange,
    Plant,
    Uncertainty,
)
from wmr_afl.plant.integrators import INTEGRATORS, euler, rk4
from wmr_afl.plant.joint_stops import JointStops
from wmr_afl.plant.order import UncertaintiesTable
from wmr_afl.plant.uncertainty import Resistance, Surroundings
from wmr_input import InputError
from wmr_input.toml_file import validate

CLOSE = {"rtol": 1e-11, "atol": 1e-11}
NOTHING = SimpleNamespace()


@pytest.fixture
def model(situation: Situation) -> Model:
    return situation.numpy


def uncertain_parameter(model: Model) -> str:
    """A mass or an inertia: what a payload may change, of which no base parameter is known."""
    return next(name for name, unit in model.parameter_units.items() if unit == "kg")


def own(part: Uncertainty) -> SimpleNamespace:
    return SimpleNamespace(**part.values)


STEP = 1e-7  # [s], so short that nothing is stopped


def force_of(friction: Friction, model: Model, situation: Situation) -> Floats:
    """w (n-m,) of what resists the robot in motion: Mbar v' changes by -w."""
    x, u, p = situation.x[0], situation.u[0], situation.p[0]
    plant = Plant(model, p, x, uncertainties=[friction])
    k, n = by_part(plant.values), model.coordinate_count
    held = plant.holding(0.0, x, u, k, model, STEP)
    change = plant.rate(0.0, x, u, k, model, held) - model.state_derivative(x, u, np.zeros(len(x) - n), p)
    return -model.inertia_matrix(situation.q[0], p) @ change[n:]


def test_friction_on_v_is_the_sum_of_its_terms(model: Model, situation: Situation) -> None:
    """w = Fv v + Kd sgn v (95), each pseudo-velocity by its own coefficients."""
    count, v = model.pseudo_velocity_count, situation.v[0]
    viscous, coulomb = 0.1 + np.arange(count), 0.2 + 2.0 * np.arange(count)
    found = force_of(Friction(model, viscous, coulomb), model, situation)
    np.testing.assert_allclose(found, viscous * v + coulomb * np.sign(v), rtol=1e-9, atol=1e-9)


def test_friction_on_the_wheels_acts_through_their_shafts(model: Model, situation: Situation) -> None:
    """w = X^T (Fv X v + Kd sgn X v) (10), (95)."""
    count = len(model.input_units)
    viscous, coulomb = 0.1 + np.arange(count), 0.2 + 2.0 * np.arange(count)
    X, v = model.actuator_rates_matrix(situation.q[0], situation.p[0]), situation.v[0]
    expected = X.T @ (viscous * (X @ v) + coulomb * np.sign(X @ v))
    found = force_of(Friction(model, viscous, coulomb, "wheels"), model, situation)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-7)


def test_friction_read_literally_takes_v_on_the_wheels(model: Model, situation: Situation) -> None:
    """w = X^T (Fv v + Kd sgn v), as (7), (13) read, if there are as many motors as pseudo-velocities."""
    if len(model.input_units) != model.pseudo_velocity_count:
        with pytest.raises(WmrError, match="leave `of` out"):
            Friction(model, 0.3, 0.2, "wheels", of_pseudo_velocities=True)
        return
    friction = Friction(model, 0.3, 0.2, "wheels", of_pseudo_velocities=True)
    v = situation.v[0]
    expected = model.actuator_rates_matrix(situation.q[0], situation.p[0]).T @ (0.3 * v + 0.2 * np.sign(v))
    found = friction.load(0.0, situation.x[0], situation.p[0], own(friction), model)
    np.testing.assert_allclose(found, expected, **CLOSE)


@pytest.mark.parametrize("place", ["pseudo_velocities", "wheels"])
def test_a_disturbance_acts_on_the_channel_that_is_named(model: Model, situation: Situation, place: str) -> None:
    """w = tau_d(t), or X^T tau_d(t); what is not named is free of it."""
    states = list(model.state_units)[model.coordinate_count :]
    channels = list(model.input_units) if place == "wheels" else states
    last = channels[-1]
    disturbance = Disturbance(model, {last: "2*t + 1"}, place)
    force = np.zeros(len(channels))
    force[-1] = 2.0 * 1.5 + 1.0
    if place == "wheels":
        force = model.actuator_rates_matrix(situation.q[0], situation.p[0]).T @ force
    found = disturbance.load(1.5, situation.x[0], situation.p[0], NOTHING, model)
    np.testing.assert_allclose(found, force, **CLOSE)
    with pytest.raises(UnknownNameError, match="channel"):
        Disturbance(model, {"nothing": "t"}, place)


def test_slip_moves_the_root_and_nothing_else(model: Model, situation: Situation) -> None:
    """What is added to x' is rU [-sin phi, cos phi, 0 ...]^T (96)."""
    added = LateralSlip(model, "0.1*t").rate(3.0, situation.x[0], situation.p[0], NOTHING, model)
    phi = situation.q[0][2]
    expected = np.zeros(len(model.state_units))
    expected[:2] = 0.1 * 3.0 * np.array([-np.sin(phi), np.cos(phi)])
    np.testing.assert_allclose(added, expected, rtol=1e-14, atol=1e-15)


def test_a_robot_whose_root_is_placed_by_formulas_cannot_slip() -> None:
    """(96) speaks of the root's pose, which must be made of coordinates."""
    frames = {"root": {"x": "x + 1", "y": "y", "heading": "phi"}}
    model = SimpleNamespace(
        name="odd",
        metadata={"geometry": {"frames": frames}},
        state_units={"x": "m", "y": "m", "phi": "rad", "v": "m/s"},
        coordinate_count=3,
    )
    with pytest.raises(MissingTermError, match="cannot slip"):
        LateralSlip(model, "1")


def everything(model: Model, p: Floats) -> list[Uncertainty]:
    """Two loads, a slip and a payload, all at once."""
    heavy = model.replaced(p, {uncertain_parameter(model): 50.0})
    return [
        Friction(model, 0.3, 0.2),
        Disturbance(model, "1 + 2*t"),
        LateralSlip(model, "0.3*t"),
        PayloadChange(model, 1.0, heavy),
    ]


@pytest.mark.parametrize("t", [0.5, 1.0, 1.5])
def test_the_plants_rate_is_the_state_equation_with_all_that_acts(model, situation, t: float) -> None:
    """x' = f + q + g u + xi (15): loads add up, at the time and the parameters that hold then; slip is added."""
    x, u, p = situation.x[0], situation.u[0], situation.p[0]
    parts = everything(model, p)
    plant = Plant(model, p, x, uncertainties=parts)
    now = p if t < 1.0 else model.replaced(p, {uncertain_parameter(model): 50.0})
    v = situation.v[0]
    load = 0.3 * v + 0.2 * np.sign(v) + (1.0 + 2.0 * t)
    expected = model.state_derivative(x, u, load, now)
    phi = situation.q[0][2]
    expected[:2] += 0.3 * t * np.array([-np.sin(phi), np.cos(phi)])
    k = by_part(plant.values)
    held = plant.holding(t, x, u, k, model, STEP)
    np.testing.assert_allclose(plant.rate(t, x, u, k, model, held), expected, rtol=1e-9, atol=1e-8)


def test_a_load_on_the_wheels_acts_with_the_parameters_that_hold_then(model: Model, situation: Situation) -> None:
    """X depends on p: after a payload has changed a length, torques reach v through the new one."""
    x, u, p = situation.x[0], situation.u[0], situation.p[0]
    length = next(name for name, unit in model.parameter_units.items() if unit == "m")
    other = model.replaced(p, {length: 2.0 * float(p[list(model.parameter_units).index(length)])})
    disturbance = Disturbance(model, "3", "wheels")
    plant = Plant(model, p, x, uncertainties=[disturbance, PayloadChange(model, 1.0, other)])
    torque = np.full(len(model.input_units), 3.0)
    for t, now in ((0.0, p), (2.0, other)):
        w = model.actuator_rates_matrix(situation.q[0], now).T @ torque
        found = plant.rate(t, x, u, by_part(plant.values), model)
        np.testing.assert_allclose(found, model.state_derivative(x, u, w, now), **CLOSE)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_loaded_robot_moves_like_one_that_was_always_so(model: Model, situation: Situation, integrator: str) -> None:
    """Loads and what resists act with the parameters that hold at their time, in every stage of a sample."""
    x, u, p = situation.x[0], situation.u[0], situation.p[0]
    names = [name for name, unit in model.parameter_units.items() if unit in ("m", "kg")]
    old = dict(zip(model.parameter_units, p, strict=True))
    other = model.replaced(p, {name: 1.5 * float(old[name]) for name in names})

    def after(t: float, parameters: Floats, *payload: Uncertainty) -> Floats:
        loads = [Friction(model, 0.3, 5.0, "wheels"), Disturbance(model, "3", "wheels")]
        plant = Plant(model, parameters, x, integrator, [*loads, *payload])
        return plant.update(t, u, by_part(plant.states), by_part(plant.values), model, 0.01)["x"]

    change = PayloadChange(model, 1.0, other)
    np.testing.assert_allclose(after(0.5, p, change), after(0.5, p), **CLOSE)
    np.testing.assert_allclose(after(2.0, p, change), after(2.0, other), **CLOSE)
    assert np.max(np.abs(after(2.0, other) - after(2.0, p))) > 1e-4


def test_without_uncertainties_the_plant_is_the_model(model: Model, situation: Situation) -> None:
    """x' = f + g u, no load, no noise, no seed."""
    x, u, p = situation.x[0], situation.u[0], situation.p[0]
    plant = Plant(model, p, x)
    expected = model.state_derivative(x, u, np.zeros(model.pseudo_velocity_count), p)
    np.testing.assert_array_equal(plant.rate(0.0, x, u, by_part(plant.values), model), expected)
    after = plant.update(0.0, u, by_part(plant.states), by_part(plant.values), model, 0.01)
    np.testing.assert_allclose(after["x"], x + 0.01 * expected, **CLOSE)
    assert (plant.samples, plant.seed, set(plant.values), set(plant.states)) == (0, 0, {"p"}, {"x"})


def test_eulers_step() -> None:
    """x + step x'(t, x)."""
    assert euler(lambda t, x: t + 2.0 * x, 0.5, 3.0, 0.1) == pytest.approx(3.0 + 0.1 * 6.5, rel=1e-15)
    assert {"euler": euler, "rk4": rk4} == INTEGRATORS


def test_runge_and_kuttas_step() -> None:
    """Exact for x' = polynomial of t of degree three; for x' = x the series of exp up to the fourth power."""
    t, step = 0.7, 0.3
    cubic = rk4(lambda time, x: 4.0 * time**3 - 3.0 * time**2 + 1.0, t, 2.0, step)
    exact = (t + step) ** 4 - t**4 - (t + step) ** 3 + t**3 + step
    assert cubic == pytest.approx(2.0 + exact, rel=1e-14)
    series = 1.0 + step + step**2 / 2.0 + step**3 / 6.0 + step**4 / 24.0
    assert rk4(lambda time, x: x, t, 2.0, step) == pytest.approx(2.0 * series, rel=1e-14)


def test_runge_kutta_keeps_its_order_under_a_load_that_varies_in_time() -> None:
    """Stages read the load at their own times: halving the step divides the error by sixteen."""
    model = load_model("type_2_0")
    start = [0.0, 0.0, 0.3, 0.5, -0.4]
    plant = Plant(model, model.parameters(), start, "rk4", [Disturbance(model, "20*sin(5*t)")])
    k, u = by_part(plant.values), np.array([1.0, -2.0])

    def end(steps: int) -> Floats:
        z = by_part(plant.states)
        for i in range(steps):
            z = by_part(plant.update(i / steps, u, z, k, model, 1.0 / steps))
        return z.x

    exact = end(1024)
    errors = [np.max(np.abs(end(steps) - exact)) for steps in (32, 64)]
    assert 12.0 < errors[0] / errors[1] < 21.0


class Stop(Uncertainty):
    """A stop for the motion `row` v, from which it is `distance` away."""

    name = "stop"

    def __init__(self, row: Floats, distance: float) -> None:
        self.row, self.distance = row, distance

    def resistance(self, x: Floats, p: Floats, k: SimpleNamespace, model: Model) -> Resistance:
        return Resistance(self.row[None], [None], [0.0], np.array([self.distance]))


@pytest.mark.parametrize("room", [0.5, -0.5])
def test_a_stop_pushes_exactly_if_the_motion_would_go_beyond_it(
    model: Model, situation: Situation, room: float
) -> None:
    """d + dt J v + dt J v_next, where the motion is two samples later, is zero if it were negative without the stop."""
    row, step = np.random.default_rng(4).normal(size=model.pseudo_velocity_count), 0.01
    x, u, p, n = situation.x[0], situation.u[0], situation.p[0], model.coordinate_count

    def after(parts: list[Uncertainty]) -> Floats:
        plant = Plant(model, p, x, uncertainties=parts)
        return plant.update(0.0, u, by_part(plant.states), by_part(plant.values), model, step)["x"]

    free = after([])
    distance = room - step * row @ (x[n:] + free[n:])
    stopped = after([Stop(row, distance)])
    left = distance + step * row @ (x[n:] + stopped[n:])
    np.testing.assert_allclose(left, max(room, 0.0), atol=1e-9)
    force = model.inertia_matrix(x[:n], p) @ (stopped - free)[n:]
    np.testing.assert_allclose(force, row * (force @ row) / (row @ row), rtol=1e-6, atol=1e-9)


def test_limits_clip_every_motor_by_its_own() -> None:
    """|u_i| <= volts_i."""
    limits = InputLimits(3, [1.0, 2.0, 3.0])
    found = limits.applied(np.array([-5.0, 1.5, 5.0]), NOTHING, own(limits), NUMPY)
    np.testing.assert_array_equal(found, [-1.0, 1.5, 3.0])
    with pytest.raises(WmrError, match="positive voltage"):
        InputLimits(2, [1.0, 0.0])


@pytest.mark.parametrize("samples", [0, -1])
def test_a_delay_takes_a_sample_at_least(samples: int) -> None:
    """A delay of nothing is none."""
    with pytest.raises(WmrError, match="at least one"):
        InputDelay(2, samples)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_delay_hands_on_the_command_of_so_many_samples_ago(samples: int) -> None:
    """What arrives at k is u(k - samples), 0 V before, for every motor."""
    delay = InputDelay(3, samples)
    commands = np.random.default_rng(0).normal(size=(8, 3))
    z, arrived = SimpleNamespace(**delay.states), []
    for u in commands:
        arrived.append(delay.applied(u, z, NOTHING, NUMPY))
        z = SimpleNamespace(**delay.update(u, z, NOTHING, NUMPY))
    np.testing.assert_array_equal(arrived, np.vstack([np.zeros((samples, 3)), commands[:-samples]]))
    assert delay.is_of_drive
    assert InputLimits(1, 1.0).is_of_drive
    assert not Uncertainty.is_of_drive


@pytest.mark.parametrize("delay_first", [True, False])
def test_each_part_of_the_drive_takes_what_the_one_before_it_gives(delay_first: bool) -> None:
    """A delay before the limits keeps the command as it was, one behind them what they left of it."""
    model = load_model("type_2_0")
    drive = [InputDelay(2, 1), InputLimits(2, 1.0)]
    plant = Plant(model, model.parameters(), np.zeros(5), uncertainties=drive if delay_first else drive[::-1])
    z, k, u = by_part(plant.states), by_part(plant.values), np.array([3.0, -0.5])
    z.input_delay.under_way = np.array([0.25, -4.0])
    after = plant.update(0.0, u, z, k, model, 0.01)
    reached = np.array([0.25, -1.0]) if delay_first else np.array([0.25, -4.0])
    np.testing.assert_array_equal(plant.applied(u, z, k, NUMPY), reached)
    np.testing.assert_array_equal(after["input_delay.under_way"], u if delay_first else [1.0, -0.5])
    expected = 0.01 * model.state_derivative(np.zeros(5), reached, np.zeros(2), model.parameters())
    np.testing.assert_allclose(after["x"], expected, **CLOSE)


def test_noise_adds_up_and_every_part_draws_its_own_samples() -> None:
    """seen = x + deviation * sample, for each part with its own samples; the first part's seed is the plant's."""
    model = load_model("type_2_0")
    deviations = np.array([[0.1, 0.2, 0.3, 0.4, 0.5], [1.0, 2.0, 3.0, 4.0, 5.0]])
    parts = [InputLimits(2, 1.0), MeasurementNoise(5, deviations[0], 7), MeasurementNoise(5, deviations[1], 8)]
    plant = Plant(model, model.parameters(), np.zeros(5), uncertainties=parts)
    x, sample = np.arange(5.0), np.random.default_rng(0).normal(size=10)
    found = plant.measured(x, sample, by_part(plant.values), NUMPY)
    np.testing.assert_allclose(found, x + deviations[0] * sample[:5] + deviations[1] * sample[5:], rtol=1e-14)
    assert (plant.samples, plant.seed) == (10, 7)
    assert MeasurementNoise(5, 0.0).seed == 0
    np.testing.assert_array_equal(MeasurementNoise(2, 0.0).deviation, [0.0, 0.0])


def test_parameters_that_do_not_fit_the_robot_are_refused(model: Model) -> None:
    """A payload gives all physical parameters."""
    for wrong in (model.parameters()[:-1], 3.0, np.zeros((2, len(model.parameter_units)))):
        with pytest.raises(ShapeError, match="parameters have shape"):
            PayloadChange(model, 1.0, wrong)


def built(tables: dict, model: Model, p: Floats | None = None, step: float = 0.02) -> list[Uncertainty]:
    """What the tables of [uncertainties] build."""
    surroundings = Surroundings(model, model.parameters() if p is None else p, step)
    return validate(tables, UncertaintiesTable, "file").build(surroundings, lambda place: nullcontext())


def test_tables_build_what_they_say_in_the_order_in_which_it_acts(model: Model) -> None:
    """Every key of every table reaches the uncertainty, and the order is that of the schema, not of the file."""
    uncertain, motors = uncertain_parameter(model), len(model.input_units)
    p = model.parameters(**{uncertain: 5.0})
    known = next((name for name, unit in model.known_units.items() if unit == "m"), None)
    changes = {uncertain: 7.0}
    (wheel, direction), row = next((name.split(), row) for name, row in wheel_rows(model).items())
    tables = {
        "payload": {"time": 2.0, "parameters": changes},
        "lateral_slip": {"speed": "2*t"},
        "wheel_slip": {wheel: {direction: "3*t"}},
        "disturbance": {"expression": "3*t", "on": "wheels"},
        "friction": {"viscous": 0.3, "coulomb": 0.4, "on": "wheels"},
        "input_limits": {"volts": 6.0},
        "input_delay": {"seconds": 0.06},
        "measurement_noise": {"deviation": {"x": 0.1}, "seed": 5},
    }
    noise, delay, limits, friction, disturbance, slip, slip_of_wheel, payload = built(tables, model, p)
    np.testing.assert_array_equal(noise.deviation, [0.1] + [0.0] * (len(model.state_units) - 1))
    assert (noise.seed, noise.samples) == (5, len(model.state_units))
    assert (delay.inputs, delay.samples_late) == (motors, 3)
    np.testing.assert_array_equal(limits.volts, np.full(motors, 6.0))
    np.testing.assert_array_equal(friction.viscous, np.full(motors, 0.3))
    np.testing.assert_array_equal(friction.coulomb, np.full(motors, 0.4))
    assert (friction.place.on_wheels, friction.is_literal) == (True, False)
    assert disturbance.place.on_wheels
    x = np.zeros(len(model.state_units))
    assert slip.rate(1.5, x, p, NOTHING, model)[1] == 3.0
    b = slip_of_wheel.rate(1.5, x, p, NOTHING, model)[: model.coordinate_count]
    assert model.slip_matrix(x[: model.coordinate_count], p)[row] @ b == pytest.approx(4.5)
    np.testing.assert_array_equal(payload.values["time"], [2.0])
    np.testing.assert_array_equal(payload.values["parameters"], model.parameters(**{uncertain: 7.0}))
    if known is not None:
        with pytest.raises(WmrError, match=f"{known} is a known constant"):
            built({"payload": {"time": 0.0, "parameters": {known: 1.0}}}, model)


def test_a_payload_keeps_the_experiments_other_parameters() -> None:
    """The loaded robot differs from the experiment's, not from the defaults', in what is named; in batches, too."""
    model = load_model("type_2_0")
    p = model.parameters(b=0.6, m_C=30.0)
    tables = {"payload": {"time": 1.0, "parameters": {"m_C": 72.0}}}
    (payload,) = built(tables, model, p)
    np.testing.assert_array_equal(payload.values["parameters"], model.parameters(b=0.6, m_C=72.0))
    many = model.parameters(b=[0.6, 0.7], m_C=[30.0, 31.0])
    rules = validate(tables, UncertaintiesTable, "file").rules(model)
    assert list(rules) == ["payload.parameters"]
    loaded = Numbers(rules, {"p": many})["payload.parameters"]
    np.testing.assert_array_equal(loaded, model.parameters(b=[0.6, 0.7], m_C=[72.0, 72.0]))


@pytest.mark.parametrize(
    ("table", "is_literal"),
    [
        ({"on": "wheels", "of": "pseudo_velocities"}, True),
        ({"on": "wheels", "of": "wheels"}, False),
        ({"on": "wheels"}, False),
        ({"on": "pseudo_velocities"}, False),
        ({"on": "pseudo_velocities", "of": "pseudo_velocities"}, False),
    ],
)
def test_friction_is_of_the_rates_where_it_acts_unless_told_otherwise(table: dict, is_literal: bool) -> None:
    """`of` = "pseudo_velocities" is the literal reading."""
    (friction,) = built({"friction": {"viscous": 1.0, **table}}, load_model("type_2_0"))
    assert friction.is_literal is is_literal
    assert friction.coulomb.tolist() == [0.0, 0.0]
    (dry,) = built({"friction": {"coulomb": 1.0, **table}}, load_model("type_2_0"))
    assert dry.viscous.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"input_delay": {"seconds": 0.03}}, "no whole number"),
        ({"input_delay": {"seconds": 0.005}}, "no whole number"),
        ({"input_delay": {"seconds": 0.0}}, "seconds"),
        ({"input_limits": {"volts": 0.0}}, "positive voltage"),
        ({"measurement_noise": {"deviation": -0.1}}, "zero or more"),
        ({"measurement_noise": {"deviation": 0.1, "seed": -1}}, "seed"),
        ({"payload": {"time": -1.0, "parameters": {"m_C": 1.0}}}, "time"),
        ({"payload": {"time": 1.0, "parameters": {}}}, "parameters"),
        ({"friction": {"coulomb": -1.0, "on": "wheels"}}, "would drive"),
        ({"friction": {"viscous": -1.0, "on": "wheels"}}, "would drive"),
    ],
)
def test_a_table_that_means_nothing_is_refused(tables: dict, words: str) -> None:
    """Times, deviations and coefficients have their signs, a delay is a whole number of samples."""
    with pytest.raises((WmrError, InputError), match=words):
        built(tables, load_model("type_2_0"))


@pytest.mark.parametrize("step", [1e-6, 1e-3, 0.02, 50.0])
@pytest.mark.parametrize("samples", [1, 3, 7, 100_000])
def test_a_delay_is_a_whole_number_of_samples_at_every_scale(samples: int, step: float) -> None:
    """Rounding of the quotient does not matter: 0.14/0.02 is 7; a part of a sample does, however short samples are."""
    (delay,) = built({"input_delay": {"seconds": samples * step}}, load_model("type_2_0"), step=step)
    assert delay.samples_late == samples
    for off in (-0.5, 0.3, 0.5):
        with pytest.raises(WmrError, match="no whole number"):
            built({"input_delay": {"seconds": (samples + off) * step}}, load_model("type_2_0"), step=step)


@pytest.mark.parametrize("step", [1e9, 1e9 + 1.0, 1e9 - 1.0])
def test_a_billionth_of_a_delay_does_not_matter(step: float) -> None:
    """Exactly that much more or less is still one sample; twice as much is not."""
    tables, model = {"input_delay": {"seconds": 1e9}}, load_model("type_2_0")
    (delay,) = built(tables, model, step=step)
    assert delay.samples_late == 1
    if step != 1e9:
        with pytest.raises(WmrError, match="no whole number"):
            built(tables, model, step=2.0 * step - 1e9)


def test_stops_push_along_the_rates_of_their_distances_and_never_pull() -> None:
    """Those that the model tells, at the coordinates of the state and with the parameters that the robot has."""
    model = SimpleNamespace(
        coordinate_count=2,
        joint_stops=lambda q, p: np.array([p[0] - q[1], p[0] + q[1]]),
        joint_stops_matrix=lambda q, p: np.array([[-p[1], 0.0], [p[1], q[0]]]),
    )
    x, p = np.array([3.0, 0.2, 9.0, 9.0]), np.array([0.6, 2.0])
    found = JointStops().resistance(x, p, SimpleNamespace(), model)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.matrix, [[-2.0, 0.0], [2.0, 3.0]])
    np.testing.assert_allclose(found.distance, [0.4, 0.8], rtol=1e-15)
    assert (list(found.least), list(found.most)) == ([None, None], [0.0, 0.0])  # F = most as a distance grows: none
