"""Whatever an experiment or its campaign holds, it ends in finite numbers, in a failure, or in one line a mistake."""

from __future__ import annotations

import json
import random
import tomllib
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from tests.derive.description.test_junk_descriptions import as_file, at
from tests.fuzzing import SEED, budget, stream
from tests.wmr_afl.junk import answered, is_finite
from tests.wmr_afl.model.mutations import mutated, places
from wmr_afl.analysis.metrics import metrics

STUDY_3 = (EXPERIMENTS / "study_3.toml").read_text().replace("duration = 140.0", "duration = 0.1")
RICH = (  # one of everything that an experiment may hold
    STUDY_3.replace("step(t - 50) - step(t - 70)", "step(t - 0.05)").replace(
        "[shared] ",
        """
        measurement_noise = { deviation = [0.001, 0.001, 0.001, 0.001, 0.001], seed = 3 }
        input_delay = { seconds = 0.04 }
        payload = { time = 0.05, parameters = { m_C = 12.0 } }
        [shared] """,
    )
    + """
    [controllers.modified]
    adaptation = { relative_gain = 1.0, leakage = 0.001, normalization = 1.0, input = "applied" }
    projection = { relative = 0.8 }
    guess = { m_C = 12.0, I_C = 3.5 }
    estimate = "exact"
    """
)
CAMPAIGN = """
    [campaign]
    controller = "AFL"
    seed = 1
    since = 0.04
    success = { rms = 10.0, largest_error = 10.0, largest_input = 100.0 }
    start = { x = { uniform = [2.0, 3.0] }, phi = { normal = [0.0, 0.2] } }
    parameters = { m_C = { choice = [9.0, 10.0, 11.0] } }
    gains = { b1 = { log_uniform = [2.0, 4.0] } }
    scale = { Gamma = { log_uniform = [0.5, 2.0] }, I_C = { uniform = [0.5, 2.0] } }
"""
NUMBERS = (0, -1, 1, 0.0, -0.0, 0.02, 0.04, 1e-9, 1e9, 1e-300, 1e300, -1e300, 5e-324, 1.7e308, 2**31, 2**63, 10**30)
EXPRESSIONS = (
    "t", "1/t", "sqrt(t - 1)", "1/(t - 0.04)", "exp(exp(exp(t)))", "sign(t)*1e30", "step(0)", "abs(t)**0.5", "t**9",
    "1e30*1e30*t", "0/0", "t**t", "atan2(0, 0)", "asin(2)", "tanh(1e30*t)", "x", "", "t t", "sin", "sin()", "'t'",
)  # fmt: skip
Act = Callable[[Path], object]


def changed(tables: dict[str, Any], chosen: random.Random) -> tuple[dict[str, Any], str]:
    """Tables in which one to three places hold something else, and what was done."""
    done, content = [], deepcopy(tables)
    for _ in range(chosen.randrange(1, 4)):
        there = places(content)
        if not there:
            break
        place = chosen.choice(there)
        old = at(content, place)
        if isinstance(old, float | int | str) and chosen.random() < 0.7:
            at(content, place[:-1])[place[-1]] = new = chosen.choice(EXPRESSIONS if isinstance(old, str) else NUMBERS)
            done.append(f"{'.'.join(map(str, place))} = {new}")
        else:
            content, what = mutated(content, chosen, place)
            done.append(what)
    return content, ", ".join(done)


def written(tables: dict[str, Any], chosen: random.Random) -> tuple[bytes, str]:
    """The file of changed tables, and what was changed."""
    try:
        content, done = changed(tables, chosen)
        return as_file(content), done
    except RecursionError:  # of this test, where a change is a thousand levels deep
        return b"a = " + b"[" * 900 + b"]" * 900, "nested deeply"


def searched(tables: dict[str, Any], name: str, rounds: int, folder: Path, act: Act) -> None:
    """Change the tables again and again; see that `act` answers to each file."""
    chosen, file = stream(name), folder / "junk.toml"
    worked = 0
    for number in range(budget(rounds)):
        content, done = written(tables, chosen)
        file.write_bytes(content)
        what = f"{SEED}:{number} {ascii(done)[:300]}"
        found, said = answered(what, lambda: act(file))
        assert is_finite(found), what
        worked += not said
    assert worked >= rounds // 20, "hardly any file meant something"


@pytest.fixture(autouse=True)
def _short_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """A duration may be changed to years, and is then refused sooner than it would be."""
    monkeypatch.setattr("wmr_afl.experiments.experiment.MOST_SAMPLES", 1000)


def in_numbers(file: Path) -> object:
    """The runs of an experiment, and their metrics as JSON, which has no number that is not finite."""
    runs = wmr_afl.run(file, "casadi")
    json.dumps([metrics(run) for run in runs.values()], allow_nan=False)
    return runs


def summarized(file: Path) -> object:
    """The result of a campaign, and its summary as JSON, which has no number that is not finite."""
    drawn = wmr_afl.campaign(file, 8, backend="casadi")
    json.dumps(drawn.summary(), allow_nan=False)
    return drawn.runs


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
def test_a_junk_experiment_is_answered(tmp_path: Path) -> None:
    searched(tomllib.loads(RICH), "experiments", 40, tmp_path, in_numbers)


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
def test_a_junk_campaign_is_answered(tmp_path: Path) -> None:
    tables = tomllib.loads(STUDY_3 + CAMPAIGN)
    only = {"campaign": tables.pop("campaign")}
    searched(
        only, "campaigns", 40, tmp_path,
        lambda file: summarized(with_rest(file, tables)),
    )  # fmt: skip


def with_rest(file: Path, tables: dict[str, Any]) -> Path:
    """The campaign in a file, completed by the rest of its experiment."""
    file.write_bytes(as_file(tables) + b"\n" + file.read_bytes())
    return file


FOUND = {  # what searches found: what stands in the experiment, what stood there instead, words of the answer
    "delay beyond memory": ("seconds = 0.04", "seconds = 1e9", "choose a shorter delay"),
    "delay beyond floating point": ("seconds = 0.04", "seconds = 1.7e308", "choose a shorter delay"),
    "gain beyond floating point": ("relative_gain = 1.0", "relative_gain = 1.7e308", "choose finite positive numbers"),
    "noise beyond floating point": ("deviation = [0.001", "deviation = [1e300", ""),
    "errors whose squares overflow": ("y = 6.0", "y = 1e200", ""),
    "a key of a thousand letters": ("measurement_noise", "measurement_noise" * 60, "unknown key"),
}


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
@pytest.mark.parametrize("found", FOUND)
def test_what_was_found_is_answered(found: str, tmp_path: Path) -> None:
    old, new, words = FOUND[found]
    assert old in RICH
    (tmp_path / "found.toml").write_text(RICH.replace(old, new, 1))
    result, said = answered(found, lambda: in_numbers(tmp_path / "found.toml"))
    assert is_finite(result)
    assert words in said
    assert bool(words) == bool(said)
