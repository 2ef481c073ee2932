"""Every robot of the catalogue, derived once a session."""

from functools import cache
from pathlib import Path

import pytest

from derive.derivation import Derivation, derive_robot
from wmr_afl.model.laws import Situation

ROOT = Path(__file__).parents[1]
DESCRIPTIONS = {path.stem: path for path in sorted((ROOT / "derive" / "robots").glob("*.toml"))}
EXPERIMENTS = ROOT / "wmr_afl" / "experiments" / "catalogue"
ROBOTS = list(DESCRIPTIONS)


@cache
def _derived(name: str) -> Derivation:
    return derive_robot(DESCRIPTIONS[name])


@cache
def _situation(name: str) -> Situation:
    return Situation(name)


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> str:
    """The name of every robot in turn."""
    return str(request.param)


@pytest.fixture
def derivation(robot: str) -> Derivation:
    return _derived(robot)


@pytest.fixture
def situation(robot: str) -> Situation:
    return _situation(robot)
