"""A run that failed silently says so: saturated motors, estimates that drift, bounds that exclude the truth."""

import re
from pathlib import Path

import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS

STUDY = (EXPERIMENTS / "study_1.toml").read_text().split("[campaign]")[0].replace("duration = 140.0", "duration = 20.0")
GAIN = "gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0]"
BOUND = "lower = 0.1"
MOTORS = "[uncertainties.input_limits]\nvolts = 0.5\n\n[shared]"
SIGNS = {  # what is changed in study 1 -> what is said of the adaptive law
    "nothing": ({}, None),
    "weak motors": ({"[shared]": MOTORS}, r"a motor is at its limit in \d+% of the samples; follow a slower reference"),
    "a bound above the truth": ({BOUND: "lower = { theta3 = 0.1, theta2 = 0.3, theta5 = 0.1, theta6 = 0.1 }"},
                                r"the bounds 0.3 to inf exclude theta2 = 0.284 of this robot; widen them"),
    "a gain too high": ({GAIN: "gain = [10.0, 5.0, 10.0, 10.0, 300.0, 10.0]"},
                        r"the adaptation is too fast for the sample time at the start \([\d.]+ 1/s, alpha is 0.5\)"),
    "a narrow bound": ({BOUND: "lower = { theta5 = 0.1, theta6 = 0.99 }"},
                       r"the estimate of theta6 lies at its bound in \d+% of the last samples; widen"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
@pytest.mark.parametrize("sign", SIGNS)
def test_a_doubtful_run_says_why(sign: str, tmp_path: Path) -> None:
    changes, words = SIGNS[sign]
    text = STUDY
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "one.toml").write_text(text)
    runs = wmr_afl.run(tmp_path / "one.toml")
    found = "\n".join(runs["AFL"].warnings)
    if words is None:
        assert found == ""
    else:
        assert re.search(words, found), found
    assert not any("estimate" in warning for warning in runs["frozen estimates"].warnings)


def test_estimates_that_drift_while_the_robot_stands_still_are_reported() -> None:
    """Study 2 with high gains and no modification: finite to the end, and worth nothing."""
    run = wmr_afl.run("study_2_high_gain", controllers="AFL")["AFL"]
    assert run.failure is None
    assert any("grew from 1 to" in warning and "add leakage" in warning for warning in run.warnings)
