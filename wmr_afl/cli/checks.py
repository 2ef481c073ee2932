"""The texts of `check` for an experiment: conditions of the laws' proofs, and what was learned of the robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.analysis.excitation import sentence, undetermined
from wmr_afl.cli.progress import run_with_progress
from wmr_afl.cli.terminal import console
from wmr_afl.simulation.result import Run


def check_experiment(experiment: str) -> bool:
    """Run an experiment and print, for every controller, what makes its run worth trust; whether nothing is doubtful.

    Raises:
        WmrError: if there is no such experiment, or it has a mistake.
    """
    runs = run_with_progress(experiment, "auto", None)
    doubts = {}
    for name, run in runs.items():
        for part in _told(run):
            console.print(part)
        whys = ("it failed" if run.failure else "", "it carries a warning" if run.warnings else "")
        broken = "" if all(one.holds for one in run.conditions) else "a condition is broken"
        doubts[name] = [why for why in (*whys, broken) if why]
    for name, why in doubts.items():
        if why:
            console.print(f"[bold]{escape(name)}[/bold] is doubtful: {' and '.join(why)}")
    return not any(doubts.values())


def _told(run: Run) -> Iterator[RenderableType]:
    """A heading, the conditions, the estimates, and what makes the run doubtful."""
    yield f"[bold]{escape(run.controller)}[/bold]{': ' + escape(str(run.failure)) if run.failure else ''}"
    adapts = bool(len(run.time)) and bool(np.ptp(run.estimate, axis=0).any())
    if not run.conditions and not adapts:
        yield "  nothing adapts: there is no condition to keep"
    if run.conditions:
        yield _conditions(run)
    if adapts:
        yield _estimates(run)
        if sentence(run):
            yield escape(sentence(run))
    for warning in run.warnings:
        yield escape(f"warning: {warning}")
    yield ""


def _conditions(run: Run) -> Table:
    table = Table("so that the energy falls", "largest", "bound", "verdict", box=None, header_style="bold")
    for one in run.conditions:
        verdict = "holds" if one.holds else f"BROKEN, {one.share:.2%}"
        table.add_row(escape(one.statement), f"{one.largest:.3g} at {one.time:g} s", f"{one.bound:.3g}", verdict)
    return table


def _estimates(run: Run) -> Table:
    """First guess, last estimate, and the robot's own value at the start."""
    headers = ("estimate", "unit", "first", "last", "deviation", "robot at start", "")
    table = Table(*headers, box=None, header_style="bold")
    truth = getattr(run.model.in_library("numpy"), run.estimated)(run.parameters)
    open_ones, said = undetermined(run), "not excited" if run.deviation is None else "undetermined"
    for index, (name, unit) in enumerate(run.estimate_units.items()):
        deviation = "" if run.deviation is None else f"{run.deviation[-1, index]:.2g}"
        table.add_row(
            name, unit, f"{run.estimate[0, index]:.4g}", f"{run.estimate[-1, index]:.4g}", deviation,
            f"{truth[index]:.4g}", said if name in open_ones else "",
        )  # fmt: skip
    return table
