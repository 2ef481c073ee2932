"""Running an experiment with progress bars, and printing its metrics."""

from __future__ import annotations

from rich.markup import escape
from rich.progress import TaskID
from rich.table import Table

from wmr_afl.analysis.excitation import sentence
from wmr_afl.analysis.metrics import metrics
from wmr_afl.cli.terminal import console, errors, progress_bar
from wmr_afl.simulation.result import Run


def run_with_progress(experiment: str, backend: str, controllers: list[str] | None) -> dict[str, Run]:
    """The runs of an experiment by controller, with a progress bar for each."""
    from wmr_afl.experiments.run import run

    with progress_bar() as progress:
        tasks: dict[str, TaskID] = {}

        def report(controller: str, done: int, total: int) -> None:
            if controller not in tasks:
                tasks[controller] = progress.add_task(escape(f"{experiment}: {controller}"), total=total)
            progress.update(tasks[controller], completed=done)

        return run(experiment, backend, controllers, report)


def print_metrics(title: str, runs: dict[str, Run]) -> None:
    """Print a table of metrics, one line for each run."""
    found_by_name = {name: metrics(run) for name, run in runs.items()}
    since = {f" since {found['settled_since']:g} s" for found in found_by_name.values() if "rms" in found}
    settled_error = f"RMS error{min(since, default=', settled')}"
    headers = ("controller", "RMS error", settled_error, "largest input", "failure")
    table = Table(*headers, title=escape(title), title_justify="left")
    for name, found in found_by_name.items():
        settled = _row(found["rms_settled"]) if "rms" in found else "-"
        largest = f"{max(found.get('largest_input', [0.0])):.3g} V"
        table.add_row(
            escape(name),
            _row(found["rms"]) if "rms" in found else "-",
            settled,
            largest,
            escape(found["failure"] or ""),
        )
    console.print(table)
    for name, run in runs.items():
        for warning in run.warnings:
            errors.print(f"warning: {escape(name)}: {escape(warning)}", soft_wrap=True)
        if run.undetermined:
            console.print(f"{escape(name)}: {escape(sentence(run))}", soft_wrap=True)


def _row(values: list[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
