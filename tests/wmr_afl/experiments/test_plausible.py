"""Shipped experiments ask of robots what robots can do, unless they are the paper's own."""

from __future__ import annotations

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl.analysis.feasibility import demand
from wmr_afl.experiments.experiment import Experiment, read_experiment
from wmr_afl.model.grip import FLOOR, friction_along

NAMES = sorted(path.stem for path in EXPERIMENTS.glob("*.toml"))
READ = {name: read_experiment(name) for name in NAMES}
LARGEST = 24.0  # [V], of the batteries of robots


def is_the_papers(experiment: Experiment) -> bool:
    """Whether its start and its reference are those of an experiment with a source: not ours to mend."""
    sourced = [other for other, _ in READ.values() if other.source]
    return any(other.start == experiment.start and other.reference == experiment.reference for other in sourced)


OURS = [name for name in NAMES if not is_the_papers(READ[name][0])]


def test_all_tracks_are_ours() -> None:
    assert {name for name in NAMES if name.startswith("track_")} <= set(OURS)
    assert all(name.startswith("study_") for name in set(NAMES) - set(OURS))


@pytest.mark.parametrize("name", OURS)
def test_a_dry_floor_and_a_battery_suffice(name: str) -> None:
    experiment, path = READ[name]
    limits = experiment.uncertainties.input_limits
    assert limits is not None
    assert np.max(limits.volts) <= LARGEST
    needed = demand(experiment, path)
    assert 0.0 < max(needed.friction.values()) < FLOOR
    for run in wmr_afl.run(name).values():
        step = experiment.simulation.sample_time
        found = friction_along(run.model, run.state[:-1], run.state[1:], run.input[:-1], run.parameters, step)
        assert found.max() < FLOOR, run.controller
        assert not any("friction" in warning for warning in run.warnings)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in OURS])
def test_runs_of_the_paper_that_no_floor_allows_say_so(name: str) -> None:
    """As they are published: what they need is told with their results."""
    experiment, _ = READ[name]
    for run in wmr_afl.run(name).values():
        step = experiment.simulation.sample_time
        found = friction_along(run.model, run.state[:-1], run.state[1:], run.input[:-1], run.parameters, step)
        told = [warning for warning in run.warnings if "friction" in warning]
        assert len(told) <= 1
        often = np.mean(found.max(axis=1) > FLOOR) > 0.01  # a few samples can lie between those that are looked at
        assert told or not often
        assert not told or found.max() > FLOOR
