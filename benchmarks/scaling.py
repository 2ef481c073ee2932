"""How the cost of batches grows: with robots, steps, trailers and threads.

`python -m benchmarks.scaling` prints the table and writes results/scaling.json; it can also put the table into a
Markdown page and draw it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import casadi as ca
import numpy as np
import typer
from rich.console import Console, Group

from benchmarks import campaigns, machine, tables
from benchmarks.campaigns import over_workers
from benchmarks.contenders.own import many
from benchmarks.contenders.work import Work, lasting
from benchmarks.growth import description
from benchmarks.scaling_plot import draw
from benchmarks.timing import best_times
from derive.codegen.write import generate_one, write
from wmr_afl.analysis.plots import styled
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.simulation.closed_loop import trace

ROBOTS = (1, 4, 16, 64, 256, 1024, 4096)
STEPS = (100, 1_000, 10_000, 50_000)
TRAILERS = (0, 1, 2, 3, 4)
THREADS = (1, 2)
TOGETHER = 1024  # robots, where their number is not what grows
TRAILED = 2_000  # steps, with trailers
STORED = Path(__file__).parent / "results" / "scaling.json"
MARKS = "<!-- scaling -->", "<!-- end of scaling -->"
HEADINGS = (
    "what grows",
    "robots",
    "steps",
    "threads",
    "trailers",
    "operations of a step",
    "time [ms]",
    "per robot and step [ns]",
)
EXPERIMENT = """
title = "A tractor with trailers, exact feedback linearization"
robot = "model"
start = {{ y = 0.1, phi = 0.4 }}
reference = {{ figure_eight = {{ center = [0.0, 0.0], radius = 6.0, rate = 0.07 }} }}
simulation = {{ duration = {duration}, sample_time = 0.001, integrator = "rk4" }}
shared = {{ outer_loop = {{ b1 = 6.0, b2 = 9.0 }} }}
controllers = {{ exact = {{}} }}
"""


@dataclass(frozen=True)
class Cost:
    """What one batch took."""

    series: str  # what grows
    robots: int
    steps: int
    threads: int
    trailers: int | None  # none in study 1
    operations: int  # of a traced step
    seconds: float

    @property
    def nanoseconds(self) -> float:
        """Per robot and step."""
        return 1e9 * self.seconds / (self.robots * self.steps)


def costs(
    robots: Sequence[int] = ROBOTS, steps: Sequence[int] = STEPS, trailers: Sequence[int] = TRAILERS
) -> list[Cost]:
    """Every series, all batches in turns."""
    with TemporaryDirectory() as folder:
        study = Work(read_experiment("study_1")[1], "AFL")
        asked = [("robots", started(study, n), threads, None) for threads in THREADS for n in robots]
        for n in steps:
            work = Work(lasting("study_1", n * study.loop.sample_time, _below(folder, f"steps_{n}")), "AFL")
            asked.append(("steps", started(work, TOGETHER), 1, None))
        for n in trailers:
            work = Work(trailed(n, _below(folder, f"trailers_{n}")), "exact")
            asked.append(("trailers", started(work, TOGETHER), 1, n))
        calls: dict[str, Callable[[], object]] = {
            str(i): many(work, threads=threads) for i, (_, work, threads, _) in enumerate(asked)
        }
        times = best_times(calls, seconds=1.0, turns=5)
        return [
            Cost(series, work.robots, len(work.times), threads, n, operations(work), times[str(i)])
            for i, (series, work, threads, n) in enumerate(asked)
        ]


def started(work: Work, robots: int) -> Work:
    """So many robots, side by side within a decimetre."""
    x = work.loop.states["x"][list(work.loop.model.state_units).index("x")]
    return Work(work.file, work.controller, {"x": x + np.linspace(0.0, 0.1, robots)})


def trailed(trailers: int, folder: Path) -> Path:
    """The experiment of a tractor with this many trailers, derived beside it."""
    robot = folder / "robot.toml"
    robot.write_text(description(trailers), encoding="utf-8")
    write(generate_one(robot), folder / "model")
    experiment = folder / "experiment.toml"
    experiment.write_text(EXPERIMENT.format(duration=TRAILED / 1000.0), encoding="utf-8")
    return experiment


def operations(work: Work) -> int:
    """Arithmetic operations of one traced step."""
    step = trace(work.loop)
    idle = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
    return sum(step.instruction_id(k) not in idle for k in range(step.n_instructions()))


def rows(found: Sequence[Cost]) -> list[list[str]]:
    """For a table."""
    return [
        [
            cost.series, str(cost.robots), str(cost.steps), str(cost.threads), "" if cost.trailers is None else
            str(cost.trailers), str(cost.operations), tables.three_digits(1e3 * cost.seconds),
            tables.three_digits(cost.nanoseconds),
        ]
        for cost in found
    ]  # fmt: skip


def store(found: Sequence[Cost], workers: Sequence[tuple[int, float]]) -> None:
    """Machine and costs as JSON."""
    content = {
        "machine": machine.machine(),
        "costs": [{**asdict(c), "nanoseconds": c.nanoseconds} for c in found],
        "campaigns": [{"workers": count, "seconds": seconds} for count, seconds in workers],
    }
    STORED.parent.mkdir(exist_ok=True)
    STORED.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def measure() -> Group:
    """The tables for the terminal; the costs are stored beside."""
    found, workers = costs(), over_workers()
    store(found, workers)
    return in_terminal(found, workers)


def in_terminal(found: Sequence[Cost], workers: list[tuple[int, float]]) -> Group:
    """For rich."""
    return Group(
        tables.in_terminal(HEADINGS, rows(found), "Batches: what growth costs"),
        tables.in_terminal(campaigns.HEADINGS, campaigns.rows(workers), "Campaigns over workers"),
    )


def main(
    table: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="A Markdown page whose table is replaced.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Where the figure goes, a PNG file.")] = None,
) -> None:
    """Measure how the cost of batches grows, print what was found, and store it."""
    found, workers = costs(), over_workers()
    store(found, workers)
    Console(width=150, markup=False).print(in_terminal(found, workers))
    if table is not None:
        text = "\n\n".join(
            (
                f"Measured on {machine.described(machine.machine())}.",
                tables.in_markdown(HEADINGS, rows(found), left=1),
                tables.in_markdown(campaigns.HEADINGS, campaigns.rows(workers), left=1),
            )
        )
        tables.replace_between(table, MARKS, text)
    if plot is not None:
        with styled():
            draw(found, workers).savefig(plot, dpi=150, metadata={"Software": None})


def _below(folder: str, name: str) -> Path:
    place = Path(folder) / name
    place.mkdir()
    return place


if __name__ == "__main__":
    typer.run(main)
