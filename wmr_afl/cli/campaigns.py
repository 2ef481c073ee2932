"""The verb `campaign`: run an experiment many times, and print what the runs amount to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.analysis import plots
from wmr_afl.cli.progress import print_metrics
from wmr_afl.cli.terminal import Experiment, Out, app, console, progress_bar, reporting, say
from wmr_afl.experiments.campaigns.result import LEVELS, CampaignResult

SHOWN = 5  # worst runs that are printed; summary.json lists ten
CAUSES = 4  # of failure that are listed, the most frequent ones


@app.command()
def campaign(
    experiment: Experiment,
    runs: Annotated[int, typer.Option(help="How many runs.")] = 1000,
    out: Out = Path("results"),
    controller: Annotated[str | None, typer.Option(help="Which controller; else as the table campaign says.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="tcp://HOST:PORT of a Dask scheduler whose workers run the blocks.")
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of each block.")] = 1,
    backend: Annotated[str, typer.Option(help="compiled, casadi, or auto: compiled where possible.")] = "auto",
    fresh: Annotated[bool, typer.Option("--fresh", help="Forget the finished blocks of an earlier campaign.")] = False,
    replay: Annotated[
        int | None, typer.Option(help="Run only the run of this index, as the campaign does, with all its samples.")
    ] = None,
) -> None:
    """Run an experiment many times as its campaign table draws; tell success, quantiles and worst runs; can go on."""
    from wmr_afl.analysis import campaign_plots
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.experiments.campaigns import campaign
    from wmr_afl.experiments.experiment import file_name
    from wmr_afl.experiments.load import load_experiment

    with reporting():
        loaded = load_experiment(experiment)
        name = loaded.name(
            controller or (loaded.experiment.campaign.controller if loaded.experiment.campaign else None)
        )
        folder = out / loaded.path.stem / f"campaign_{file_name(name)}"
        check_writable(folder)
        if replay is not None:
            _replay(experiment, replay, controller, backend, folder / f"run_{replay}")
            return
        try:
            with progress_bar() as progress:
                task = progress.add_task(f"{loaded.path.stem}: {runs} runs", total=runs)
                result = campaign(
                    experiment, runs, folder, controller, threads, backend, scheduler, fresh,
                    lambda done: progress.advance(task, done),
                )  # fmt: skip
        except KeyboardInterrupt:
            finished = len(list(folder.glob("block_*.npz")))
            typer.echo(
                f"interrupted: {finished} finished blocks are kept in {folder}; the same command goes on", err=True
            )
            raise typer.Exit(130) from None
        files = campaign_plots.write(result, folder)
    for part in tables(result):
        console.print(part, highlight=False)
    say(f"{', '.join(file.name for file in files)} in {folder}")


def tables(result: CampaignResult) -> Iterator[RenderableType]:
    """Success, quantiles and the worst runs."""
    rate, low, high = result.success_rate()
    bounds = [f"{name} at most {bound:g}" for name, bound in vars(result.criteria).items() if bound is not None]
    meaning = ", ".join(["did not fail", *bounds])
    yield f"{len(result)} runs of {escape(result.controller)}, seed {result.seed}"
    yield f"success ({meaning}): {rate:.2%}, with 95 % confidence {low:.2%} to {high:.2%}"
    for cause, count in list(result.causes().items())[:CAUSES]:
        yield escape(f"failed {count}: {cause}")
    quantiles = Table("", *(f"{level:.0%}" for level in LEVELS), box=None, header_style="bold")
    for name, row in result.quantiles().items():
        quantiles.add_row(escape(name), *(f"{value:.3g}" if np.isfinite(value) else "failed" for value in row))
    yield quantiles
    worst = Table("worst runs", "what it came to", "what it drew", box=None, header_style="bold")
    for index in result.worst(SHOWN):
        one = result.describe(index)
        error = max(result.runs.rms[index])
        came = f"RMS error {error:.3g}" if one["failed_at"] is None else f"failed at {one['failed_at']:g} s"
        worst.add_row(str(index), came, ", ".join(f"{name} = {value:.4g}" for name, value in one["drawn"].items()))
    yield worst


def _replay(experiment: str, index: int, controller: str | None, backend: str, folder: Path) -> None:
    from wmr_afl.analysis.files import keep_only, renewed, write_results
    from wmr_afl.experiments.campaigns import replay
    from wmr_afl.experiments.experiment import file_name

    run = replay(experiment, index, controller, backend)
    with renewed(folder) as beside:
        files = write_results({run.controller: run}, beside)
        for name, figure in plots.overview({run.controller: run}, f"run {index} of a campaign").items():
            files += plots.save(figure, beside / file_name(name))
        keep_only(files, beside)
    print_metrics(f"run {index}", {run.controller: run})
    say(f"{len(files)} files in {folder}")
