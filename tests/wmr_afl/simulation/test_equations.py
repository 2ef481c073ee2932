"""One step of a closed loop against its parts, samples and their times, windows, layouts, ensembles, batches."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

from tests.conftest import ROBOTS
from wmr_afl.controllers import GradientAdaptation, Knowledge, OuterLoop, TrackingLaw
from wmr_afl.controllers.outer_loop import tracking_error
from wmr_afl.controllers.reference import Reference
from wmr_afl.errors import ShapeError, SimulationError, UnknownNameError
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.plant import InputDelay, InputLimits, MeasurementNoise, Plant
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.batch import BatchOptions, advance_all
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times, trace
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.layout import Layout
from wmr_afl.simulation.result import Failure, Run
from wmr_afl.simulation.simulate import simulate

START = np.array([2.5, 0.1, 0.4, 0.2, -0.1])


@cache
def usual_loop() -> ClosedLoop:
    """An adaptive loop of the differential drive on a slow circle."""
    model = load_model("type_2_0")
    p = model.parameters()
    theta = 0.8 * model.base_parameters(p)
    adaptation = GradientAdaptation(6, 0.1 * theta**2, sees_applied=True)
    law = TrackingLaw(Knowledge(model, model.known(p), theta), OuterLoop(2, 2.0, 1.0), adaptation=adaptation)
    reference = Reference({"y1": "2.6*cos(t/5)", "y2": "2.6*sin(t/5)"})
    return ClosedLoop(model, Plant(model, p, START), law, reference, 0.02)


def loop_of(start: Floats = START, step: float = 0.02, **plant) -> ClosedLoop:
    """The usual loop with another start, sample time or plant."""
    usual = usual_loop()
    return replace(usual, plant=Plant(usual.model, usual.plant.parameters, start, **plant), sample_time=step)


def drive() -> list:
    return [MeasurementNoise(5, [0.01, 0.02, 0.03, 0.04, 0.05], seed=3), InputDelay(2, 1), InputLimits(2, 2.0)]


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_step_is_reference_measurement_law_drive_and_plant_in_this_order(robot: str) -> None:
    """The law sees what is measured, the motors get what the drive leaves, the log holds the true state's error."""
    loop = next(iter(assemble(*read_experiment(f"track_{robot}")).values()))
    model, inputs = loop.model, len(loop.model.input_units)
    noise = MeasurementNoise(len(model.state_units), 0.01)
    parts = [noise, InputDelay(inputs, 1), InputLimits(inputs, 1.5)]
    plant = Plant(model, loop.plant.parameters, loop.plant.start + 0.01, "rk4", parts)
    loop = replace(loop, plant=plant)
    z, k = by_part(loop.states), by_part(loop.values)
    z.input_delay.under_way = np.linspace(-2.0, 1.0, inputs)
    sample = np.random.default_rng(0).normal(size=len(model.state_units))
    following, signals = loop.step(0.3, z, k, sample, model)
    point, seen = loop.reference.at(0.3), z.x + 0.01 * sample
    action = loop.law.act(seen, point, z, k, model, loop.sample_time)
    reached = np.clip(z.input_delay.under_way, -1.5, 1.5)
    expected = {
        **plant.update(0.3, action.input, z, k, model, loop.sample_time),
        **loop.law.update(seen, action, reached, z, k, model, loop.sample_time),
    }
    assert set(following) == set(expected) == set(loop.states)
    for name, value in expected.items():
        np.testing.assert_allclose(following[name], value, rtol=1e-12, atol=1e-14, err_msg=name)
    np.testing.assert_array_equal(signals["x"], z.x)
    np.testing.assert_array_equal(signals["u"], reached)
    np.testing.assert_array_equal(signals["command"], action.input)
    np.testing.assert_array_equal(signals["e"], tracking_error(z.x, k.c, point, model).e)
    np.testing.assert_array_equal(signals["reference"], point.position)
    np.testing.assert_array_equal(signals["theta_hat"], z.theta_hat)
    assert signals["regularity"] == action.regularity
    assert {name: np.size(value) for name, value in signals.items()} == loop.signals


def test_adaptation_sees_what_is_measured_and_what_reaches_the_motors() -> None:
    """theta_hat' = Gamma W^T E1 with W at the measured state and, if it `sees_applied`, at the applied input."""
    loop = loop_of(uncertainties=drive())
    model, z, k = loop.model, by_part(loop.states), by_part(loop.values)
    sample = np.ones(5)
    following, signals = loop.step(0.0, z, k, sample, model)
    seen = START + np.array([0.01, 0.02, 0.03, 0.04, 0.05])
    E1 = loop.law.act(seen, loop.reference.at(0.0), z, k, model, loop.sample_time).memory["filtered_error"]
    regressor = model.regressor(seen, np.zeros(2), k.c)
    np.testing.assert_array_equal(signals["u"], np.zeros(2))
    expected = loop.law.knowledge.theta_hat + 0.02 * loop.law.adaptation.gain * (regressor.T @ E1)
    np.testing.assert_allclose(following["theta_hat"], expected, rtol=1e-12)


def test_a_trace_is_the_step() -> None:
    """One function of flat columns: states and signals as NumPy gives them."""
    loop = loop_of(uncertainties=drive())
    random = np.random.default_rng(1)
    z, k, sample = (Layout(part).pack(part) for part in (loop.states, loop.values, {"s": random.normal(size=5)}))
    z = z + 0.01 * random.normal(size=len(z))
    following, signals = loop.step(
        0.3, by_part(Layout(loop.states).unpack(z)), by_part(Layout(loop.values).unpack(k)), sample, loop.model
    )
    found = trace(loop)(z, 0.3, sample, k)
    np.testing.assert_allclose(found[0].full()[:, 0], Layout(loop.states).pack(following), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[1].full()[:, 0], loop.signal_layout.pack(signals), rtol=1e-12, atol=1e-12)


def test_a_run_is_its_steps_and_its_noise_is_philoxs() -> None:
    """Row k of a run is what step k logs; samples come from the seed's own stream, one row a sample."""
    loop = loop_of(uncertainties=drive())
    run = simulate(loop, 0.2, backend="numpy")
    generator = np.random.Generator(np.random.Philox(3))
    z, k = by_part(loop.states), by_part(loop.values)
    for i in range(11):
        following, signals = loop.step(0.02 * i, z, k, generator.standard_normal(5), loop.model)
        for row, name in (
            (run.state, "x"), (run.input, "u"), (run.command, "command"), (run.error, "e"),
            (run.estimate, "theta_hat"), (run.reference, "reference"),
        ):  # fmt: skip
            np.testing.assert_array_equal(row[i], signals[name], err_msg=name)
        z = by_part(following)
    assert len(run.time) == 11
    np.testing.assert_array_equal(run.parameters, loop.plant.parameters)
    np.testing.assert_array_equal(run.known, loop.law.knowledge.known)
    assert run.failure is None


def test_noise_taken_in_parts_is_the_same() -> None:
    """So that chunks change nothing."""
    whole = normal_samples(np.random.Generator(np.random.Philox(5)), 7, 3)
    generator = np.random.Generator(np.random.Philox(5))
    parts = [normal_samples(generator, count, 3) for count in (2, 1, 4)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert whole.shape == (7, 3)


@pytest.mark.parametrize(
    ("step", "duration", "count"),
    [(0.02, 140.0, 7001), (0.1, 0.3, 4), (0.1, 0.7, 8), (0.001, 0.55, 551), (0.5, 0.5, 2)],
)
def test_samples_go_from_zero_to_the_duration(step: float, duration: float, count: int) -> None:
    """Both ends included, whatever the rounding of duration/step: 0.7/0.1 is 7."""
    times = sample_times(loop_of(step=step), duration)
    np.testing.assert_allclose(times, np.arange(count) * step, rtol=1e-15)
    assert not times.flags.writeable


def test_a_run_of_one_sample_time_is_a_run() -> None:
    """Shorter ones are refused."""
    assert len(simulate(loop_of(step=0.1), 0.1).time) == 2
    with pytest.raises(SimulationError, match="longer than the run"):
        simulate(loop_of(step=0.1), 0.0999)


def hand_made_run(error: Floats, failure: Failure | None = None) -> Run:
    """A run of samples every second with these errors."""
    loop, count = loop_of(), len(error)
    zeros = {name: np.zeros((count, 2)) for name in ("input", "command", "reference")}
    return Run(
        "AFL", loop.model, np.arange(float(count)), np.zeros((count, 5)), error=np.asarray(error, dtype=float),
        estimate=np.zeros((count, 6)), parameters=loop.plant.parameters, known=np.ones(1), failure=failure, **zeros,
    )  # fmt: skip


def test_windows_include_both_of_their_ends() -> None:
    """RMS and largest error over since <= t <= until, each output by itself."""
    run = hand_made_run([[9.0, 1.0], [1.0, -2.0], [2.0, 1.0], [-4.0, 0.0], [8.0, 8.0]])
    np.testing.assert_allclose(run.rms(1.0, 3.0), [np.sqrt(21.0 / 3.0), np.sqrt(5.0 / 3.0)], rtol=1e-15)
    np.testing.assert_array_equal(run.largest_error(1.0, 3.0), [4.0, 2.0])
    np.testing.assert_array_equal(run.largest_error(), [9.0, 8.0])
    np.testing.assert_allclose(run.rms(3.0), [np.sqrt(40.0), np.sqrt(32.0)], rtol=1e-15)
    with pytest.raises(SimulationError, match=r"between 3\.1 s and 3\.9 s"):
        run.rms(3.1, 3.9)


def test_a_run_that_failed_can_be_asked_for_what_came_before() -> None:
    """A window that ends before the failure."""
    run = hand_made_run([[1.0, 1.0], [2.0, 2.0]], Failure(2.0, "why"))
    np.testing.assert_array_equal(run.largest_error(until=1.0), [2.0, 2.0])
    np.testing.assert_array_equal(run.largest_error(until=1.99), [2.0, 2.0])
    for until in (2.0, 3.0, np.inf):
        with pytest.raises(SimulationError, match="AFL stopped at t = 2 s: why"):
            run.largest_error(until=until)


def test_a_layout_lays_arrays_one_after_the_other_and_matrices_by_row() -> None:
    """Flat vectors and symbols alike; what is unpacked is what was packed."""
    named = {"p": np.arange(3.0), "law.G": np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), "law.mu": np.array([7.0])}
    layout = Layout(named)
    assert layout.size == 10
    flat = layout.pack(named)
    np.testing.assert_array_equal(flat, [0, 1, 2, 1, 2, 3, 4, 5, 6, 7])
    assert layout.places == {"p": slice(0, 3), "law.G": slice(3, 9), "law.mu": slice(9, 10)}
    for name, value in layout.unpack(flat).items():
        np.testing.assert_array_equal(value, named[name])
    column = ca.SX.sym("column", 10)
    found = layout.unpack_symbols(column)
    value = ca.Function("f", [column], [found.p, found.law.G, found.law.mu])(flat)
    np.testing.assert_array_equal(value[1].full(), named["law.G"])
    np.testing.assert_array_equal(value[2].full(), [[7.0]])
    assert Layout({}).pack({}).shape == (0,)


def test_an_ensemble_holds_a_column_for_each_robot() -> None:
    """Starts, numbers and seeds of loops that differ in numbers only."""
    loops = [loop_of(start=START + i, uncertainties=[MeasurementNoise(5, 0.1 * i, seed=i)]) for i in range(3)]
    ensemble = Ensemble.of(loops)
    assert ensemble.count == 3
    for i, loop in enumerate(loops):
        np.testing.assert_array_equal(ensemble.states[:, i], Layout(loop.states).pack(loop.states))
        np.testing.assert_array_equal(ensemble.values[:, i], Layout(loop.values).pack(loop.values))
    assert ensemble.seeds.tolist() == [0, 1, 2]
    first = ensemble.generator(2).standard_normal(4)
    np.testing.assert_array_equal(first, np.random.Generator(np.random.Philox(2)).standard_normal(4))
    block = ensemble.block(slice(1, 3), 4)
    np.testing.assert_array_equal(block.states, ensemble.states[:, [1, 2, 2, 2]])
    np.testing.assert_array_equal(block.values, ensemble.values[:, [1, 2, 2, 2]])
    assert block.seeds.tolist() == [1, 2, 2, 2]
    quiet = Ensemble.of([loop_of(), loop_of()])
    assert quiet.seeds.shape == quiet.block(slice(0, 2), 2).seeds.shape == (0,)
    for other in (loop_of(uncertainties=[InputLimits(2, 1.0)]), loop_of(uncertainties=[InputDelay(2, 2)])):
        with pytest.raises(ShapeError, match="differ in more than numbers"):
            Ensemble.of([loop_of(), other])


@pytest.mark.parametrize(
    ("backend", "threads", "since"),
    [
        ("casadi", 1, 0.0),
        ("casadi", 1, 0.13),
        ("casadi", 1, 0.14),  # 0.14/0.02 is more than 7 in doubles
        ("casadi", 1, 0.4),
        ("compiled", 1, 0.2),
        ("compiled", 2, 0.13),
    ],
)
def test_a_batch_summarizes_what_single_runs_give(backend: str, threads: int, since: float) -> None:
    """RMS and largest error from `since` on, also between samples; largest input and estimate; last state."""
    starts = [START + 0.01 * i for i in range(66 if backend == "compiled" else 2)]
    loops = [loop_of(start=one, uncertainties=drive()) for one in starts]
    done = []
    options = BatchOptions(0.4, since, threads, backend, done.append)
    result = advance_all(loops[0], Ensemble.of(loops), options)
    assert sum(done) == len(loops)
    for i in {0, 1, len(loops) - 1}:
        run = simulate(loops[i], 0.4, backend="numpy")
        longer = simulate(loops[i], 0.42, backend="numpy")
        counted = run.time >= since - 1e-12
        close = {"rtol": 1e-9, "atol": 1e-12}
        np.testing.assert_allclose(result.rms[i], run.rms(since - 1e-12), **close)
        np.testing.assert_allclose(result.largest_error[i], run.largest_error(since - 1e-12), **close)
        np.testing.assert_allclose(result.largest_input[i], np.abs(run.input[counted]).max(axis=0), **close)
        np.testing.assert_allclose(result.largest_estimate[i], np.abs(run.estimate[counted]).max(), **close)
        np.testing.assert_allclose(result.final_state[i], longer.state[-1], **close)
    assert not result.failed.any()
    assert np.isnan(result.failure_time).all()


def test_errors_count_since_a_time_of_the_run() -> None:
    """From 0 to its end."""
    ensemble = Ensemble.of([loop_of()])
    for since in (-0.1, 0.41):
        with pytest.raises(SimulationError, match=r"a run goes from 0 to 0\.4 s"):
            advance_all(loop_of(), ensemble, BatchOptions(0.4, since))
    with pytest.raises(UnknownNameError, match="backend of a batch"):
        advance_all(loop_of(), ensemble, BatchOptions(0.4, backend="numpy"))
    assert vars(BatchOptions(1.0))["since"] == 0.0


@pytest.mark.parametrize("backend", ["casadi", "compiled"])
def test_what_is_recorded_is_every_sample_of_every_robot(backend: str) -> None:
    """In chunks that meet, and without the lanes that only fill a block."""
    loops = [loop_of(start=START + 0.1 * i, uncertainties=drive()) for i in range(3)]
    ensemble, pieces = Ensemble.of(loops), []

    def record(robots: slice, samples: slice, rows: Floats) -> None:
        pieces.append((robots, samples, rows.copy()))

    advance_all(loops[0], ensemble, BatchOptions(0.4, since=0.2, backend=backend), record)
    for i, loop in enumerate(loops):
        rows = [rows[:, :, i - robots.start] for robots, _, rows in pieces if robots.start <= i < robots.stop]
        samples = [samples for robots, samples, _ in pieces if robots.start <= i < robots.stop]
        assert [one.start for one in samples] == [0, *(one.stop for one in samples[:-1])]
        run, places = simulate(loop, 0.4, backend="numpy"), loop.signal_layout.places
        found = np.concatenate(rows)
        for name, expected in (("x", run.state), ("u", run.input), ("e", run.error), ("theta_hat", run.estimate)):
            np.testing.assert_allclose(found[:, places[name]], expected, rtol=1e-9, atol=1e-11)


def singular_loop(fails: bool) -> ClosedLoop:
    """A loop whose decoupling matrix is singular at once, because nothing is known of one gain; or is not."""
    model = load_model("type_2_0")
    p = model.parameters()
    theta = model.base_parameters(p).copy()
    guarded = [list(model.base_parameter_units).index(name) for name in model.findings["determinant_parameters"]]
    theta[guarded[0]] *= 0.0 if fails else 1.0
    return replace(loop_of(), law=TrackingLaw(Knowledge(model, model.known(p), theta), OuterLoop(2, 2.0, 1.0)))


@pytest.mark.parametrize("backend", ["casadi", "compiled"])
def test_summaries_of_a_run_that_failed_are_infinite_and_the_others_are_their_own(backend: str) -> None:
    """Beside a robot that fails another one is as if it were alone."""
    loops = [singular_loop(False), singular_loop(True)]
    both = advance_all(loops[0], Ensemble.of(loops), BatchOptions(0.4, backend=backend))
    alone = advance_all(loops[0], Ensemble.of(loops[:1]), BatchOptions(0.4, backend=backend))
    assert both.failed.tolist() == [False, True]
    assert both.failure_time[1] == 0.0
    for name in ("rms", "largest_error", "largest_input", "largest_estimate"):
        assert np.isinf(getattr(both, name)[1]).all()
        np.testing.assert_array_equal(getattr(both, name)[0], getattr(alone, name)[0])


@pytest.mark.parametrize("backend", ["numpy", "casadi", "compiled"])
def test_a_run_reports_its_progress_and_keeps_the_samples_before_its_failure(backend: str) -> None:
    """The time of the failure is that of the first sample that is not sound, on every backend."""
    model = load_model("type_2_0")
    reference = Reference({"y1": "2.6 + sqrt(0.205 - t)/1e9", "y2": "0.1"})
    loop = replace(loop_of(), reference=reference)
    done = []
    with pytest.warns(UserWarning, match=r"mine stopped at t = 0\.22 s: .*reference"):
        run = simulate(loop, 0.4, "mine", backend, done.append)
    assert len(run.time) == 11
    assert run.failure.time == pytest.approx(0.22, abs=1e-12)
    assert np.isfinite(run.error).all()
    assert sum(done) >= 11
    assert run.model is loop.model
    assert model.name == "type_2_0"


def test_numbers_of_one_robot_take_the_place_of_the_loops() -> None:
    """A run of a robot of an ensemble is the run of the loop that has its numbers, and says so."""
    first, second = loop_of(), loop_of(start=START + 0.3)
    robot = Ensemble.of([second])
    robot.values[Layout(second.values).places["p"].start + 4] *= 1.5
    runs = [simulate(first, 0.2, backend=backend, robot=robot) for backend in ("numpy", "casadi")]
    for run in runs:
        np.testing.assert_array_equal(run.state[0], START + 0.3)
        assert run.parameters[4] == 1.5 * first.plant.parameters[4]
    np.testing.assert_allclose(runs[0].state, runs[1].state, rtol=1e-10)


def test_an_input_that_the_law_wants_is_not_what_reaches_the_motors() -> None:
    """Both are logged, and the plant moves by the latter."""
    loop = loop_of(uncertainties=[InputLimits(2, 0.5)])
    run = simulate(loop, 0.1, backend="numpy")
    np.testing.assert_array_equal(run.input, np.clip(run.command, -0.5, 0.5))
    p, w = loop.plant.parameters, np.zeros(2)
    expected = run.state[0] + 0.02 * loop.model.state_derivative(run.state[0], run.input[0], w, p)
    np.testing.assert_allclose(run.state[1], expected, rtol=1e-14)
    assert loop.plant.applied(run.command[0], by_part(loop.states), by_part(loop.values), NUMPY).tolist() == list(
        run.input[0]
    )
