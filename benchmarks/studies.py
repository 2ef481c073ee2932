"""`python -m benchmarks.studies [--page docs/studies.md]`: what the studies come to, and which of them chatter."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console

import wmr_afl
from benchmarks.tables import in_markdown, in_terminal, replace_between, three_digits

STUDIES = ("study_1", "study_2", "study_2_high_gain", "study_3")
MARKS = ("<!-- studies -->", "<!-- end of studies -->")
HEADINGS = (
    "experiment", "controller", "RMS error [m]", "since 100 s [m]", "largest estimate", "reversals [%]", "digits",
)  # fmt: skip
CLAIMED = 0.1  # [m], RMS error over the whole run that the paper claims for modified laws
SETTLED = 100.0  # [s]
CHATTERS = 10.0  # [%] of samples; laws that do not chatter have none
STEP = 1.0  # [V], smaller changes of an input are no reversals


def rows(studies: tuple[str, ...] = STUDIES) -> Iterator[list[str]]:
    """One row for each run, on CasADi's virtual machine."""
    for study in studies:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # runs that fail say so in the table
            runs = wmr_afl.run(study, "casadi")
        for name, run in runs.items():
            errors = ["failed"] * 2
            if run.failure is None:
                errors = [three_digits(run.rms(since).max()) for since in (0.0, SETTLED)]
            share = reversals(run)
            digits = "of one processor" if share > CHATTERS else "the same everywhere"
            estimate = three_digits(np.abs(run.estimate).max(initial=0.0))
            yield [study, name, *errors, estimate, f"{share:.0f}", digits]


def reversals(run: wmr_afl.Run) -> float:
    """The share of settled samples at which an input turns round by more than a volt [%]."""
    change = np.diff(run.input[run.time >= SETTLED], axis=0)
    turns = (change[1:] * change[:-1] < 0.0) & (np.abs(change[1:]) > STEP)
    return 100.0 * float(turns.mean()) if turns.size else 0.0


def main() -> None:
    """Run the studies, print the table, and write it into the page if one is named."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--page", type=Path)
    page, found = reader.parse_args().page, list(rows())
    Console().print(in_terminal(HEADINGS, found))
    if page is not None:
        replace_between(page, MARKS, in_markdown(HEADINGS, found, left=2))


if __name__ == "__main__":
    main()
