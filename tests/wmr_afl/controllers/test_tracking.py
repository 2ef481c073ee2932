"""Every robot tracks its reference: exactly with its own parameters, adaptively if it has a forward form."""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import ROBOTS
from wmr_afl.controllers import TrackingLaw
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.model import load_model
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.simulate import simulate

FORWARD = [name for name in ROBOTS if load_model(name).has("regressor")]


def loops(robot: str) -> dict[str, ClosedLoop]:
    return assemble(*read_experiment(f"track_{robot}"))


def settled_error(loop: ClosedLoop, sample_time: float) -> float:
    """The largest error of any output after the start has died away."""
    return float(simulate(replace(loop, sample_time=sample_time), 45.0).largest_error(since=40.0).max())


def test_exact_linearization_tracks_and_its_error_shrinks_with_the_sample(robot: str) -> None:
    loop = loops(robot)["exact"]
    coarse, middle, fine = (settled_error(loop, step) for step in (0.016, 0.008, 0.004))
    assert fine < 1e-4
    # Below a micrometre what is left is the reference model's way from the start, whatever the sample time.
    assert fine < 1e-6 or fine < 0.7 * middle < 0.5 * coarse


@pytest.mark.parametrize("name", FORWARD)
def test_adaptation_makes_up_for_a_wrong_guess(name: str) -> None:
    adaptive = loops(name)["AFL"]
    law = adaptive.law
    kept = TrackingLaw(law.knowledge, law.outer_loop, law.linearizing, reference_model=law.reference_model)
    frozen, adapted = (simulate(replace(adaptive, law=one, sample_time=0.004), 65.0) for one in (kept, adaptive.law))
    assert frozen.rms(since=30.0).max() > 3e-3
    assert np.linalg.norm(adapted.rms(since=30.0)) < 0.2 * np.linalg.norm(frozen.rms(since=30.0))


def test_some_robots_have_a_forward_form_and_some_do_not() -> None:
    assert 0 < len(FORWARD) < len(ROBOTS)
