"""Closed loops: both libraries agree, integrators converge, failures are reported and keep what came before."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wmr_afl import SimulationError, SimulationWarning, UnknownNameError, WmrError
from wmr_afl.analysis import plots
from wmr_afl.analysis.files import write_results
from wmr_afl.analysis.stability import error_system, lyapunov_function
from wmr_afl.controllers import GradientAdaptation, Knowledge, OuterLoop, Projection, TrackingLaw
from wmr_afl.controllers.reference import Reference, figure_eight
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.model import load_model
from wmr_afl.numerics.parts import by_part
from wmr_afl.plant import InputLimits, MeasurementNoise, Plant
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.simulate import simulate


@pytest.fixture(scope="module")
def study_1() -> dict[str, ClosedLoop]:
    return assemble(*read_experiment("study_1"))


def eight(**plant: object) -> ClosedLoop:
    """The exact law on a figure eight."""
    model = load_model("type_2_0")
    p = model.parameters()
    law = TrackingLaw(Knowledge(model, model.known(p), model.base_parameters(p)), OuterLoop(2, 4.0, 4.0))
    reference = Reference(dict(zip(model.output_units, figure_eight([0.0, 0.0], 2.0, 0.2), strict=True)))
    return ClosedLoop(model, Plant(model, p, [0.1, 0.0, 0.5, 0.0, 0.0], **plant), law, reference, 0.01)


@pytest.mark.parametrize(
    "plant",
    [
        {},
        {"integrator": "rk4"},
        {"uncertainties": [InputLimits(2, 3.0)]},
        {"uncertainties": [MeasurementNoise(5, 0.001, seed=3)]},
    ],
    ids=["euler", "rk4", "limits", "noise"],
)
def test_numpy_and_casadi_agree(plant: dict) -> None:
    loop = eight(**plant)
    runs = [simulate(loop, 10.0, backend=backend) for backend in ("numpy", "casadi")]
    for signal in ("time", "state", "input", "error", "estimate", "reference"):
        first, second = (getattr(run, signal) for run in runs)
        assert np.max(np.abs(first - second)) <= 1e-9 * max(1.0, np.max(np.abs(first))), signal


def test_exact_parameters_make_the_error_linear() -> None:
    """e'' + b1 e' + b2 e = 0 (33) with theta~ = 0, in continuous time."""
    loop = replace(eight(integrator="rk4"), sample_time=1e-3)
    run = simulate(loop, 3.0)
    e0, rate0 = run.error[0], (run.error[1] - run.error[0]) / 1e-3
    rate0 = loop.model.output_rate(run.state[0], loop.values["c"]) - loop.reference.at(0.0).velocity
    t = run.time[:, None]
    exact = (e0 + (rate0 + 2.0 * e0) * t) * np.exp(-2.0 * t)  # double pole at -2
    assert np.max(np.abs(run.error - exact)) < 2e-3


def test_with_known_parameters_on_the_reference_adaptive_and_exact_control_coincide() -> None:
    loop = replace(eight(integrator="rk4"), sample_time=1e-3)
    c, reference = loop.values["c"], loop.reference.at(0.0)
    heading = np.arctan2(reference.velocity[1], reference.velocity[0])
    start = np.array([-c[0] * np.cos(heading), -c[0] * np.sin(heading), heading, np.hypot(*reference.velocity), 0.0])
    exact = replace(loop, plant=Plant(loop.model, loop.plant.parameters, start, "rk4"))
    adaptive = TrackingLaw(loop.law.knowledge, loop.law.outer_loop, adaptation=GradientAdaptation(6, 10.0))
    runs = [simulate(one, 5.0) for one in (exact, replace(exact, law=adaptive))]
    np.testing.assert_allclose(runs[1].state, runs[0].state, atol=1e-3)  # of the order of the sample time
    np.testing.assert_allclose(runs[1].estimate, runs[0].estimate, atol=1e-3)


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1), ("rk4", 4)])
def test_integrators_converge_with_their_order(integrator: str, order: int) -> None:
    model = load_model("type_2_0")
    plant = Plant(model, model.parameters(), [0.0, 0.0, 0.3, 0.5, -0.4], integrator)

    def end(steps: int) -> np.ndarray:
        z, k, u = by_part(plant.states), by_part(plant.values), np.array([1.0, -2.0])
        for i in range(steps):
            z = by_part(plant.update(i / steps, u, z, k, model, 1.0 / steps))
        return z.x

    exact = end(2048)
    errors = [np.max(np.abs(end(steps) - exact)) for steps in (32, 64)]
    assert 0.8 * 2**order < errors[0] / errors[1] < 1.3 * 2**order


def test_inputs_never_exceed_their_limits() -> None:
    run = simulate(eight(uncertainties=[InputLimits(2, [1.0, 0.5])]), 5.0)
    assert np.all(np.abs(run.input) <= [1.0, 0.5])
    assert np.any(np.abs(run.input) == [1.0, 0.5])


def test_the_same_seed_gives_the_same_bytes() -> None:
    runs = [simulate(eight(uncertainties=[MeasurementNoise(5, 0.01, seed=seed)]), 2.0) for seed in (5, 5, 6)]
    assert runs[0].state.tobytes() == runs[1].state.tobytes()
    assert runs[0].state.tobytes() != runs[2].state.tobytes()


def test_the_lyapunov_function_does_not_increase_in_continuous_time(study_1: dict[str, ClosedLoop]) -> None:
    """(43)-(46), on every small step."""
    loop = study_1["AFL"]
    plant = Plant(loop.model, loop.plant.parameters, loop.plant.start, "rk4")
    free = TrackingLaw(
        loop.law.knowledge, loop.law.outer_loop, adaptation=GradientAdaptation(6, loop.values["adaptation.Gamma"])
    )
    run = simulate(replace(loop, plant=plant, law=free, sample_time=2e-5), 1.0)
    assert run.failure is None
    rates = loop.model.output_rate(run.state, np.tile(free.knowledge.known, (len(run.time), 1)))
    truth = loop.model.base_parameters(loop.plant.parameters)
    values = lyapunov_function(
        run.error,
        rates - loop.reference.over(run.time)[1],
        truth - run.estimate,
        error_system(free.outer_loop),
        free.adaptation,
    )
    steps = np.diff(values)
    assert values[-1] < 0.9 * values[0]
    assert steps.max() < 1e-3 * np.abs(steps).max()  # of the order of the step, and shrinking with it


def test_a_singular_decoupling_matrix_ends_the_run_with_time_and_cause(study_1: dict[str, ClosedLoop]) -> None:
    loop = study_1["AFL"]
    bounds = Projection(6, lower=[-np.inf] * 4 + [1e-14] * 2)
    adaptation = GradientAdaptation(6, loop.values["adaptation.Gamma"], projection=bounds)
    law = TrackingLaw(loop.law.knowledge, loop.law.outer_loop, adaptation=adaptation)
    runs = []
    for backend in ("numpy", "casadi"):
        with pytest.warns(SimulationWarning, match="singular"):
            runs.append(simulate(replace(loop, law=law), 10.0, "AFL", backend))
    for run in runs:
        assert run.failure is not None
        assert 0.1 < run.failure.time < 2.0
        assert "decoupling matrix is singular" in run.failure.cause
        assert len(run.time) == round(run.failure.time / 0.02)  # everything before
        for signal in (run.state, run.input, run.error, run.estimate):
            assert np.isfinite(signal).all()
        with pytest.raises(SimulationError, match="AFL stopped at"):
            run.rms()
        assert np.isfinite(run.rms(until=0.3)).all()
    assert runs[0].failure.time == runs[1].failure.time


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
def test_a_state_that_is_not_finite_ends_the_run(backend: str) -> None:
    loop = eight()
    wild = replace(loop, sample_time=10.0)
    with pytest.warns(SimulationWarning):
        run = simulate(wild, 1e5, backend=backend)
    assert run.failure is not None
    assert np.isfinite(run.state).all()
    assert len(run.time) < 1e4


def test_rms_needs_samples() -> None:
    run = simulate(eight(), 1.0)
    with pytest.raises(SimulationError, match="no sample"):
        run.rms(since=2.0)


def test_an_unknown_backend_lists_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match="numpy"):
        simulate(eight(), 1.0, backend="abacus")


@pytest.mark.parametrize(
    "make",
    [
        lambda: eight(integrator="simpson"),
        lambda: InputLimits(2, -1.0),
        lambda: InputLimits(2, [1.0, 2.0, 3.0]),
        lambda: MeasurementNoise(5, -0.1),
        lambda: Plant(load_model("type_2_0"), load_model("type_2_0").parameters(), [0.0, 0.0]),
        lambda: Plant(load_model("type_2_0"), load_model("type_2_0").parameters(), [np.nan] * 5),
    ],
)
def test_a_plant_that_means_nothing_is_refused(make) -> None:
    with pytest.raises(WmrError):
        make()


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
def test_a_run_that_fails_at_its_first_sample_says_what_is_not_finite(backend: str, tmp_path: Path) -> None:
    loop = replace(eight(), reference=Reference({"y1": "sqrt(t - 1)", "y2": "t"}))
    with pytest.warns(SimulationWarning, match="t = 0 s: the reference, or a derivative of it, is not finite"):
        run = simulate(loop, 1.0, "AFL $x$", backend)
    assert run.time.shape == (0,)
    assert run.reference.shape == (0, 2)
    assert "stopped at t = 0 s" in repr(run)
    with pytest.raises(SimulationError):
        run.rms(until=-1.0)
    write_results({"first": run}, tmp_path)
    for name, figure in plots.overview({"first $": run}, "$ costs").items():
        plots.save(figure, tmp_path / name)


def test_a_run_is_no_shorter_than_its_sample() -> None:
    with pytest.raises(SimulationError, match="longer than the run"):
        simulate(eight(), 0.001)
