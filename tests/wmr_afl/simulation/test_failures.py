"""Every way of running says the same time and the same cause of a failure, and the cause is the true one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl.controllers.reference import Reference
from wmr_afl.experiments.load import load_experiment
from wmr_afl.simulation.failures import cause, outer_loop_growth
from wmr_afl.simulation.simulate import SimulationWarning, simulate

STUDY = (EXPERIMENTS / "study_1.toml").read_text().split("[campaign]")[0].replace("duration = 140.0", "duration = 4.0")
CIRCLE = "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }"

ENDING = 'expressions = { y1 = "15 + 0.1*sqrt(3.999 - t)", y2 = "25" }'
KINKED = 'expressions = { y1 = "15 + sqrt(t)", y2 = "25" }'
HIGH = {"estimate = 1.0": 'estimate = "exact"', "b1 = 2.0, b2 = 1.0": "b1 = 150.0, b2 = 900.0", "4.0": "100.0"}
WAYS = {  # what is changed in study 1 -> controller, words of the cause
    "a reference that ends": ({CIRCLE: ENDING}, "AFL", "the reference, or a derivative of it, is not finite"),
    "a derivative that is infinite": ({CIRCLE: KINKED}, "AFL", "the reference, or a derivative of it, is not finite"),
    "no bound": (
        {"lower = 0.1": "lower = 1e-14"},
        "AFL",
        "estimated decoupling matrix is singular; bound the estimates",
    ),
    "high gains": (
        HIGH,
        "frozen estimates",
        "a sample time of 0.02 s is too long for b1 = 150, b2 = 900; sample faster",
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_time_and_cause_are_the_same_however_it_is_run(way: str, tmp_path: Path) -> None:
    changes, controller, words = WAYS[way]
    text = STUDY
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "one.toml"
    path.write_text(text + "\n[campaign]\n[campaign.scale]\nm_w = { uniform = [1.0, 1.0000001] }\n")
    loaded = load_experiment(path)
    loop, duration = loaded.loops[controller], loaded.experiment.simulation.duration
    found = set()
    for backend in ("numpy", "casadi", "compiled"):
        with pytest.warns(SimulationWarning):
            failure = simulate(loop, duration, backend=backend).failure
        found.add((round(failure.time, 9), failure.cause))
    for backend in ("casadi", "compiled"):
        batch = wmr_afl.run_batch(path, controller, start={"x": [15.0, 15.0, 15.0]}, backend=backend)
        found |= {(round(t, 9), str(why)) for t, why in zip(batch.failure_time, batch.failure_cause, strict=True)}
    campaign = wmr_afl.campaign(path, 3, controller=controller)
    with pytest.warns(SimulationWarning):
        replayed = wmr_afl.replay(path, 0, controller).failure
    assert campaign.success_rate()[0] == 0.0
    assert (campaign.runs.failure_time[0], campaign.runs.failure_cause[0]) == (replayed.time, replayed.cause)
    times, causes = zip(*found, strict=True)
    assert max(times) - min(times) <= (0.05 if "diverged" in causes[0] else 0.0)  # rounding grows with the state
    assert len(set(causes)) == 1, causes
    assert words in causes[0]


def test_of_several_causes_the_first_one_along_the_loop_is_named() -> None:
    """State, estimate, reference, output, regularity, input; what is singular at the start is said to be so."""
    loop = load_experiment("study_1").loops["AFL"]
    sound = {"x": np.zeros(5), "theta_hat": np.ones(6), "e": np.zeros(2), "regularity": np.ones(1), "u": np.zeros(2)}
    along = {
        "x": (np.nan, "the state is not finite"),
        "theta_hat": (np.inf, "the estimate is not finite: the adaptation diverged; bound the estimates"),
        "e": (-np.inf, "the output is not finite there"),
        "regularity": (0.0, "the estimated decoupling matrix is singular; bound the estimates"),
        "u": (np.nan, "the input is not finite"),
    }
    signals = dict(sound)
    for name, (value, words) in reversed(along.items()):
        signals[name] = np.full_like(sound[name], value)
        assert cause(loop, 0.5, signals, loop.values).startswith(words)
    ends = replace(loop, reference=Reference({"y1": "sqrt(1 - t)", "y2": "0"}))
    assert cause(ends, 2.0, {**signals, "x": sound["x"], "theta_hat": sound["theta_hat"]}, loop.values).startswith(
        "the reference, or a derivative of it, is not finite"
    )


@pytest.mark.parametrize(
    ("controller", "matrix"),
    [("AFL", "the estimated decoupling matrix"), ("frozen estimates", "the decoupling matrix")],
)
@pytest.mark.parametrize(("t", "when"), [(0.0, " at the start"), (0.02, ""), (1.0, "")])
def test_what_is_singular_at_the_start_is_said_to_be_so(controller: str, matrix: str, t: float, when: str) -> None:
    """And only at the first sample; estimates that move are bounded, and fixed ones kept away from it."""
    loop = load_experiment("study_1").loops[controller]
    signals = {"x": np.zeros(5), "theta_hat": np.ones(6), "e": np.zeros(2), "regularity": np.zeros(1)}
    remedy = "bound the estimates" if loop.law.adapts else "keep away from where it is singular (wmr-afl show)"
    assert cause(loop, t, signals, loop.values) == f"{matrix} is singular{when}; {remedy}"
    of_passivity = {**loop.values, "error.rate": np.ones(1)}
    words = f"the output map E or the allocation R is singular{when}; keep away"
    assert cause(loop, t, signals, of_passivity).startswith(words)


RANGES = {"x": (14.0, 16.0), "y": (24.0, 26.0), "phi": (-0.5, 0.5)}  # of starts, in which a third of the runs fail


@pytest.mark.parametrize("backend", ["casadi", "compiled"])
def test_robots_of_one_block_fail_each_at_its_own_time_and_for_its_own_cause(backend: str) -> None:
    """Beside robots that do not fail."""
    random = np.random.default_rng(1)
    start = {name: random.uniform(*range_, 70) for name, range_ in RANGES.items()}
    batch = wmr_afl.run_batch("study_1", start=start, backend=backend)
    assert 5 < np.count_nonzero(batch.failed) < 65
    assert len(set(batch.failure_time[batch.failed])) > 3
    assert [bool(cause) for cause in batch.failure_cause] == batch.failed.tolist()
    loop = load_experiment("study_1").loops["AFL"]
    for robot in np.flatnonzero(batch.failed)[:3]:
        x = loop.plant.start.copy()
        x[:3] = [start[name][robot] for name in RANGES]
        plant = type(loop.plant)(loop.model, loop.plant.parameters, x)
        with pytest.warns(SimulationWarning):
            failure = simulate(replace(loop, plant=plant), 140.0, backend="numpy").failure
        assert abs(failure.time - batch.failure_time[robot]) < 0.05  # rounding grows before a divergence


def test_the_growth_of_the_outer_loop_is_what_its_gains_make_of_an_error() -> None:
    """Against e'' = -b1 e' - b2 e stepped with eta held, by Euler's rule and exactly."""
    for by_euler in (True, False):
        for b1, b2 in ((2.0, 1.0), (30.0, 200.0), (150.0, 900.0)):
            step, e, rate, sizes = 0.02, 1.0, 0.3, []
            for _ in range(400):
                eta = -b1 * rate - b2 * e
                e, rate = e + step * rate + (0.0 if by_euler else 0.5 * step * step * eta), rate + step * eta
                sizes.append(np.hypot(e, rate))
            growth = outer_loop_growth(np.array([b1]), np.array([b2]), step, by_euler)[0]
            assert (sizes[-1] / sizes[-101]) ** 0.01 == pytest.approx(growth, rel=0.03)


def test_a_draw_that_no_robot_can_have_counts_as_such(tmp_path: Path) -> None:
    path = tmp_path / "tail.toml"
    path.write_text(STUDY + "\n[campaign]\n[campaign.parameters]\nI_C = { normal = [15.6, 8.0] }\n")
    result = wmr_afl.campaign(path, 400)
    impossible = result.draws["parameters.I_C"] < 0.0
    assert 3 < np.count_nonzero(impossible) == result.impossible
    assert np.all(result.runs.failure_time[impossible] == 0.0)
    assert not np.any(result.succeeded[impossible])
    assert "impossible draw: I_C = -" in result.describe(int(np.argmax(impossible)))["cause"]
    with pytest.raises(wmr_afl.WmrError, match=r"impossible draw: I_C = -.* is negative; choose a mass"):
        wmr_afl.replay(path, int(np.argmax(impossible)))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"scale": {"Gamma": [1.0, -1.0]}}, r"robot 1: the adaptation gain .* is not symmetric positive definite"),
        ({"values": {"b1": [0.5, 2.0, 2.0]}}, r"robot 0: \(s \+ alpha\).*not strictly positive real"),
        ({"values": {"b1": [-1.0, 2.0, 2.0]}}, r"robot 0: b1 = \[-1. -1.\].*do not stabilize"),
        ({"parameters": {"r": [0.1, -0.1]}}, r"robot 1: the radius of wheel 'right' is -0.1; choose a positive one"),
        ({"parameters": {"K1": [0.0, 7.0]}}, r"robot 0: the torque gain of 'u_r' is 0; choose a positive one"),
        ({"scale": {"m_C": [1.0, -1.0]}}, r"robot 1: m_C = -36 kg is negative"),
        ({"start": {"x": [15.0, float("inf")]}}, r"robot 1: x is not finite"),
        ({"values": {"lower": [0.1, float("nan"), 0.1]}}, r"robot 1: projection.lower is not finite"),
        (
            {"values": {"b1": [2.0, 3.0]}},
            r"one value for each of 2 entries, or one for each of 2 robots; give the shape",
        ),
        ({"start": {"x": [[15.0], [16.0]]}}, r"x has shape \(2, 1\); expected one number, or 2"),
        ({"start": {"x": ["a"]}}, r"x is not an array of numbers"),
        ({"start": {"x": [15.0, [1.0, 2.0]]}}, r"x is not an array of numbers"),
        ({"seeds": [-1]}, r"expected whole numbers from zero"),
        ({"seeds": [1.5]}, r"expected whole numbers from zero"),
    ],
)
def test_numbers_of_a_batch_pass_the_checks_of_an_experiment(given: dict, words: str) -> None:
    with pytest.raises(wmr_afl.WmrError, match=words):
        wmr_afl.run_batch("study_1", **given)
