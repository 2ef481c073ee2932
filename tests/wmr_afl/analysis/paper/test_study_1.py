"""The paper's first study, and its claim."""

from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from wmr_afl import Run
from wmr_afl.experiments.experiment import find_experiment


@pytest.fixture(scope="module")
def runs() -> dict[str, Run]:
    return wmr_afl.run("study_1")


def test_the_adaptive_law_converges_and_the_frozen_one_does_not(runs: dict[str, Run]) -> None:
    assert np.all(runs["AFL"].rms(since=100.0) < 1e-3)
    assert np.all(runs["frozen estimates"].rms(since=100.0) > 0.5)


def test_the_independent_implementations_figures_are_met(runs: dict[str, Run]) -> None:
    np.testing.assert_allclose(runs["frozen estimates"].rms(since=100.0), [0.87, 1.06], atol=0.01)


def test_estimates_stay_bounded(runs: dict[str, Run]) -> None:
    assert np.abs(runs["AFL"].estimate).max() < 10.0
    assert np.ptp(runs["frozen estimates"].estimate, axis=0).max() == 0.0


def test_both_libraries_agree_over_all_steps(runs: dict[str, Run]) -> None:
    stepwise = wmr_afl.run("study_1", backend="numpy")
    for name, run in wmr_afl.run("study_1", backend="casadi").items():
        assert len(run.time) == 7001
        for signal in ("state", "input", "error", "estimate"):
            mine, other = getattr(run, signal), getattr(stepwise[name], signal)
            assert np.max(np.abs(mine - other)) <= 1e-9 * np.max(np.abs(other)), (name, signal)


def test_shapes_are_the_documented_ones(runs: dict[str, Run]) -> None:
    run = runs["AFL"]
    assert (run.time.shape, run.state.shape, run.input.shape) == ((7001,), (7001, 5), (7001, 2))
    assert (run.error.shape, run.estimate.shape, run.rms().shape) == ((7001, 2), (7001, 6), (2,))
    np.testing.assert_allclose(run.error, run.model.output(run.state[:, :3], [[0.1]]) - run.reference, atol=1e-12)


def test_measurement_noise_costs_no_more_than_itself(tmp_path: Path) -> None:
    """With 5 mm, 5 mrad and 5 mm/s the adaptive law's error stays below the noise, and far below the frozen law's."""
    text = find_experiment("study_1").read_text()
    noise = "[uncertainties]\nmeasurement_noise = { deviation = 0.005 }\n\n[shared]"
    (tmp_path / "noisy.toml").write_text(text.replace("[shared]", noise, 1))
    noisy = wmr_afl.run(tmp_path / "noisy.toml")
    assert noisy["AFL"].rms(since=100.0).max() < 0.005
    assert noisy["frozen estimates"].rms(since=100.0).min() > 0.5


def test_without_its_bound_the_run_fails_within_the_first_second(tmp_path: Path) -> None:
    """What the study's file and the docs say of the projection."""
    text = find_experiment("study_1").read_text()
    unbounded = "\n".join(line for line in text.splitlines() if not line.startswith("projection"))
    (tmp_path / "unbounded.toml").write_text(unbounded)
    with pytest.warns(wmr_afl.SimulationWarning):
        failure = wmr_afl.run(tmp_path / "unbounded.toml", controllers="AFL")["AFL"].failure
    assert failure is not None
    assert failure.time < 1.0
