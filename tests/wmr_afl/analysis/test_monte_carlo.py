"""Robots at random: what is drawn, and that sums over samples are what whole trajectories say."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl.analysis import monte_carlo
from wmr_afl.analysis.monte_carlo import Crowd
from wmr_afl.experiments.load import Loaded, load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.batch import CHUNK

WINDOWS = ((1.0, np.inf), (0.5, 1.5), (0.0, np.inf))
NOISE = "measurement_noise = { deviation = 0.002 }\n"


@pytest.fixture
def noisy(tmp_path: Path) -> Loaded:
    """Study 2 from the pose alone with noise, for 2.5 s; longer than a chunk of samples at 2 ms."""
    text = (EXPERIMENTS / "study_2_pose.toml").read_text().replace("duration = 140.0", "duration = 2.5")
    text = text.replace("sample_time = 0.02", "sample_time = 0.002").replace("friction =", NOISE + "friction =", 1)
    (tmp_path / "noisy.toml").write_text(text)
    return load_experiment(tmp_path / "noisy.toml")


def test_draws_are_as_wide_as_they_say_and_the_seed_says_which() -> None:
    """Robots to both sides, guesses as often too small as too large, starts in a disc; known constants stay."""
    loop = load_experiment("study_2_pose").loops["pose"]
    crowd, again, other = (Crowd.drawn(loop, seed, 400) for seed in (1, 1, 2))
    assert set(crowd.robots) == {f"parameters.{name}" for name in loop.model.parameter_units} - {"parameters.L"}
    for factors in crowd.robots.values():
        assert 0.7 <= factors.min() < 0.72
        assert 1.28 < factors.max() <= 1.3
    for kind, guesses in crowd.guesses.items():
        assert list(guesses) == [f"estimates.{name}" for name in loop.model.units_of(kind)]
        for factors in guesses.values():
            assert 1.0 / 3.0 <= factors.min() < 0.36
            assert 2.8 < factors.max() <= 3.0
            assert 0.4 < np.mean(factors > 1.0) < 0.6
    distance = np.hypot(crowd.start["x"] - 2.5, crowd.start["y"] - 6.0)
    assert 0.95 < distance.max() <= 1.0
    assert np.mean(distance < 0.5) == pytest.approx(0.25, abs=0.08)  # even over the disc
    assert 0.9 < np.abs(crowd.start["phi"] + np.pi / 6.0).max() <= 1.0
    for name, column in crowd.start.items():
        np.testing.assert_array_equal(column, again.start[name])
        assert np.any(column != other.start[name])


@pytest.mark.parametrize("law", ["pose", "frozen, w = 40"])
def test_scores_are_what_whole_trajectories_say(noisy: Loaded, law: str, tmp_path: Path) -> None:
    """RMS in each window as of a batch and of its samples, travel in the first one; with noise, over chunks."""
    loop = noisy.loops[law]
    crowd = Crowd.drawn(loop, 3, 5)
    scores = crowd.score(noisy.experiment, law, loop, WINDOWS, backend="casadi")
    scale = {**crowd.robots, **crowd.guesses[loop.law.knowledge.estimated]}
    file = tmp_path / "runs.h5"
    batch = wmr_afl.run_batch(
        noisy.path, law, scale=scale, start=crowd.start, seeds=3 + np.arange(5), since=1.0, backend="casadi",
        trajectories=file,
    )  # fmt: skip
    np.testing.assert_allclose(scores.rms[0], batch.rms, rtol=1e-12)
    with h5py.File(file) as runs:
        time, error, u = (runs[name][:] for name in ("time", "error", "input"))
    assert len(time) > CHUNK
    for rms, (since, until) in zip(scores.rms, WINDOWS, strict=True):
        inside = (time >= since) & (time <= until)
        np.testing.assert_allclose(rms, np.sqrt(np.mean(error[:, inside] ** 2, axis=1)), rtol=1e-12)
    late = time >= 1.0
    path = np.abs(np.diff(u[:, late], axis=1)).sum(axis=1).mean(axis=1) / np.ptp(time[late])
    np.testing.assert_allclose(scores.travel, path, rtol=1e-12)
    np.testing.assert_array_equal(scores.worse, scores.rms.max(axis=2))
    twice = crowd.score(noisy.experiment, law, loop, WINDOWS, threads=2, backend="casadi")
    np.testing.assert_array_equal(twice.rms, scores.rms)
    np.testing.assert_array_equal(twice.travel, scores.travel)


def test_a_run_that_fails_is_infinitely_bad_and_the_others_are_as_before(tmp_path: Path) -> None:
    """Study 1, whose law fails from some starts within its first second."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 2.0")
    (tmp_path / "short.toml").write_text(text.replace("since = 100.0", "since = 1.0"))
    loaded = load_experiment(tmp_path / "short.toml")
    crowd = Crowd.drawn(loaded.loops["AFL"], 3, 12)
    scores = crowd.score(loaded.experiment, "AFL", loaded.loops["AFL"], WINDOWS[:1], backend="casadi")
    batch = wmr_afl.run_batch(loaded.path, "AFL", scale=crowd.robots, start=crowd.start, since=1.0, backend="casadi")
    assert 0 < batch.failed.sum() < 12
    np.testing.assert_array_equal(np.isinf(scores.travel), batch.failed)
    np.testing.assert_allclose(scores.rms[0], batch.rms, rtol=1e-12)


def test_a_law_that_says_its_first_estimates_keeps_them() -> None:
    """Draws of first estimates are for laws that take them from the robot."""
    seen: list[Floats] = []
    loaded = load_experiment("study_2")
    law = "AFL with leakage"
    crowd = Crowd.drawn(loaded.loops[law], 1, 3)

    def stop(loop, ensemble, options, record):
        seen.append(ensemble.values)
        raise InterruptedError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(monte_carlo, "advance_all", stop)
        for one in (crowd, replace(crowd, guesses={})):
            with pytest.raises(InterruptedError):
                one.score(loaded.experiment, law, loaded.loops[law], WINDOWS)
    np.testing.assert_array_equal(seen[0], seen[1])
