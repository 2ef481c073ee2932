"""Closed loops: this project against code by hand and other tools, one robot and a thousand, as ratios within one run.

`python -m benchmarks.closed_loops` prints the tables and writes results/closed_loops.json; it can also put the tables
into a Markdown page.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console, Group

from benchmarks import campaigns, machine, tables, targets
from benchmarks.contenders import ANY_LOOP, GENERATED, LITERAL, MANY_ROBOTS, ONE_ROBOT
from benchmarks.contenders.work import Work, lasting
from benchmarks.contest import Result, hold
from benchmarks.first_run import first_runs
from benchmarks.real_time import update_times
from benchmarks.targets import Target
from wmr_afl.experiments.experiment import read_experiment

ROBOTS = 1024
SHORT = 7.0  # [s], 7001 samples of 1 ms
OTHERS = (("track_tractor_3_trailers", "exact"), ("track_mecanum", "exact"), ("track_mecanum", "AFL"))
STORED = Path(__file__).parent / "results" / "closed_loops.json"
MARKS = "<!-- closed loops -->", "<!-- end of closed loops -->"
HEADINGS = "contender", "robots timed", "time per robot and step [ns]", "times as fast", "deviation"
TARGETS = "target", "promised", "measured", ""


def contests() -> list[Result]:
    """All contests, one after the other."""
    random = np.random.default_rng(0)
    single = Work(read_experiment("study_1")[1], "AFL")
    results = hold(single, "one", ONE_ROBOT, LITERAL, seconds=3.0, turns=20)
    results += hold(varied(single, random, "m_C"), "many", MANY_ROBOTS, LITERAL, seconds=2.0, turns=7)
    for experiment, controller in OTHERS:
        with TemporaryDirectory() as folder:
            single = Work(lasting(experiment, SHORT, Path(folder)), controller)
            results += hold(single, "one", ANY_LOOP, GENERATED, seconds=2.0, turns=10)
            results += hold(varied(single, random), "many", ANY_LOOP, GENERATED, seconds=2.0, turns=5)
    return results


def varied(work: Work, random: np.random.Generator, *parameters: str) -> Work:
    """Many robots that start up to 0.1 m beside, and whose `parameters` differ by up to a tenth."""
    start = work.loop.states["x"][list(work.loop.model.state_units).index("x")] + random.uniform(-0.1, 0.1, ROBOTS)
    own = dict(zip(work.loop.model.parameter_units, work.loop.values["p"], strict=True))
    columns = {name: own[name] * random.uniform(0.9, 1.1, ROBOTS) for name in parameters}
    return Work(work.file, work.controller, {"x": start}, columns)


def judged(results: list[Result]) -> list[Target]:
    """Every promise."""
    return [
        *targets.of_contests(results), *targets.of_updates(update_times()), *targets.of_first_runs(first_runs()),
        *campaigns.of_campaigns(),
    ]  # fmt: skip


def measure() -> Group:
    """The tables for the terminal; the results are stored beside."""
    results = contests()
    promises = judged(results)
    store(results, promises)
    return in_terminal(results, promises)


def store(results: list[Result], promises: list[Target]) -> None:
    """Machine, results and promises as JSON."""
    content = {
        "machine": machine.machine(),
        "results": [asdict(result) for result in results],
        "targets": [promise.as_dict() for promise in promises],
    }
    STORED.parent.mkdir(exist_ok=True)
    STORED.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def in_terminal(results: list[Result], promises: list[Target]) -> Group:
    """For rich."""
    contested = [tables.in_terminal(HEADINGS, rows, title) for title, rows in _grouped(results)]
    return Group(*contested, tables.in_terminal(TARGETS, [promise.row() for promise in promises], "Targets"))


def in_markdown(results: list[Result], promises: list[Target]) -> str:
    """For a page."""
    parts = [f"Measured on {machine.described(machine.machine())}."]
    parts += [f"{title}:\n\n{tables.in_markdown(HEADINGS, rows, left=1)}" for title, rows in _grouped(results)]
    parts.append(tables.in_markdown(TARGETS, [promise.row() for promise in promises], left=1))
    return "\n\n".join(parts)


def _grouped(results: list[Result]) -> Iterator[tuple[str, list[list[str]]]]:
    """Title and rows of each contest."""
    contested: dict[str, list[Result]] = {}
    for result in results:
        work = "one robot, every sample logged" if result.kind == "one" else f"{ROBOTS} robots, end and RMS error"
        title = f"{result.experiment}, {result.controller}, {result.steps} steps, {work}; ratios to {result.reference}"
        contested.setdefault(title, []).append(result)
    for title, group in contested.items():
        yield title, [_row(result) for result in group]


def _row(result: Result) -> list[str]:
    numbers = map(tables.three_digits, (result.nanoseconds, result.times_as_fast))
    return [result.contender, str(result.robots), *numbers, f"{result.deviation:.0e}"]


def main(
    table: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="A Markdown page whose tables are replaced.")
    ] = None,
) -> None:
    """Measure closed loops, print what was found, and store it."""
    results = contests()
    promises = judged(results)
    store(results, promises)
    Console(width=150, markup=False).print(in_terminal(results, promises))
    if table is not None:
        tables.replace_between(table, MARKS, in_markdown(results, promises))


if __name__ == "__main__":
    typer.run(main)
