"""`python -m benchmarks.rehearsal [--runs 3] [--page docs/identification.md] [--experiment]`: from a log to control.

Study 1's robot, described wrongly by factors of a half to two: voltages are designed from the wrong description,
driven for 20 s and logged, the robot is identified, and both laws start from what was found; beside them both
laws start from the description, and the adaptive one from ones as in the paper.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl import load_model, run
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.identification.identify import identify
from wmr_afl.identification.recording import Sensors, record
from wmr_afl.identification.voltage_design import excite

UNKNOWN = ("d", "m_C", "m_w", "I_m", "I_C", "K1", "K2")
SECONDS = 20.0  # [s], of the log
SINCE = 100.0  # [s], as in the paper
GAIN = 0.1  # relative; where the first guess is right a large gain only follows what Euler's method does wrong
HEADINGS = ["law", "started from", "median error [mm]", "worst [mm]", "runs that fail"]
MARKS = "<!-- rehearsal -->", "<!-- end of rehearsal -->"


TITLE = """\
# Study 1's robot, described wrongly by factors of a half to two, was identified from 20 s of designed voltages;
# both laws from the description and from the log. `python -m benchmarks.rehearsal --experiment` writes this file.
title = "Study 1 from a log"
"""


def experiment(guesses: Mapping[str, Mapping[str, float]]) -> str:
    """Study 1 with both laws for each guess, and with the paper's own."""
    text = find_experiment("study_1").read_text(encoding="utf-8")
    head = TITLE + text[text.index("robot = ") : text.index("[controllers.AFL]")]
    head = "".join(line for line in head.splitlines(keepends=True) if not line.startswith("estimate"))
    head += '[controllers."adaptive from ones"]\nestimate = 1.0\nprojection = { lower = 0.1 }\n'
    head += "adaptation = { gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0] }\n"
    for name, guess in guesses.items():
        table = "{ " + ", ".join(f"{key} = {value:.6g}" for key, value in guess.items()) + " }"
        for law in ("exact", "adaptive"):
            head += f'\n[controllers."{law} from {name}"]\nguess = {table}\n'
        head += f"adaptation = {{ relative_gain = {GAIN} }}\nprojection = {{ relative = 0.8 }}\n"
    return head


def written(seed: int) -> str:
    """The experiment of one wrong description, and of what a log of the robot says."""
    model, random = load_model("type_2_0"), np.random.default_rng(7000 + seed)
    true = dict(zip(model.parameter_units, model.parameters().tolist(), strict=True))
    wrong = {name: true[name] * 2.0 ** random.uniform(-1.0, 1.0) for name in UNKNOWN}
    designed = excite(model, 12.0, 3.0, seconds=SECONDS, parameters=wrong, frequencies=(0.1, 0.25, 0.5, 1.0))
    log = record("study_1", commands=designed.played, sensors=Sensors(seed=seed))
    found = identify(model, log, guess=wrong)
    return experiment({"the description": wrong, "the log": found.guess})


def rehearsed(seed: int, folder: Path) -> dict[str, float]:
    """Errors of all laws [mm], for one wrong description; infinite where a run fails."""
    file = folder / "rehearsal.toml"
    file.write_text(written(seed), encoding="utf-8")
    return {
        name: np.inf if one.failure else 1e3 * float(np.linalg.norm(one.rms(since=SINCE)))
        for name, one in run(file).items()
    }


def rows(runs: int) -> list[list[str]]:
    """One for each law."""
    with tempfile.TemporaryDirectory() as folder:
        found = [rehearsed(seed, Path(folder)) for seed in range(runs)]
    table = []
    for name in found[0]:
        law, _, start = name.partition(" from ")
        errors = np.array([one[name] for one in found])
        worst = np.max(errors[np.isfinite(errors)], initial=0.0)
        table.append([law, start, f"{np.median(errors):.3g}", f"{worst:.3g}", str(int(np.isinf(errors).sum()))])
    return table


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--experiment", action="store_true", help="write the one that is shipped, instead")
    given = parser.parse_args()
    if given.experiment:
        find_experiment("study_1").with_name("study_1_identified.toml").write_text(written(0), encoding="utf-8")
        return
    found = rows(given.runs)
    Console(width=120).print(in_terminal(HEADINGS, found))
    if given.page:
        replace_between(given.page, MARKS, in_markdown(HEADINGS, found, left=2))


if __name__ == "__main__":
    main()
