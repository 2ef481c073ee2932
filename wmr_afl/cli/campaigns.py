"""The verb `campaign`: run an experiment many times, and print what the runs amount to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
from wmr_afl.errors import WmrError
from wmr_afl.experiments.campaigns.result import LEVELS, CampaignResult

SHOWN = 5  # worst runs that are printed; summary.json lists ten
CAUSES = 4  # of failure that are listed, the most frequent ones


@app.command()
def campaign(
    experiment: Experiment,
    runs: Annotated[int, typer.Option(help="How many runs.")] = 1000,
    out: Out = Path("results"),
    controller: Annotated[
        list[str] | None, typer.Option(help="Which controller; may be repeated; else as the table campaign says.")
    ] = None,
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
    """Run an experiment many times as its campaign table draws; tell success, quantiles and worst runs; can go on.

    Several controllers meet the same draws, and are compared in one table and one plot.
    """
    from wmr_afl.analysis import campaign_plots
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.experiments.campaigns import campaign_folder, compare
    from wmr_afl.experiments.load import load_experiment

    with reporting():
        loaded = load_experiment(experiment)
        names, place = loaded.drawn(controller), out / loaded.path.stem
        folders = {name: campaign_folder(place, name) for name in names}
        check_writable(folders[names[0]])
        if replay is not None and len(names) > 1:
            raise WmrError(f"a replay is of one controller, not of {', '.join(names)}", "name one with --controller")
        if replay is not None:
            _replay(experiment, replay, names[0], backend, folders[names[0]] / f"run_{replay}")
            return
        try:
            with progress_bar() as progress:
                tasks = {name: progress.add_task(escape(f"{name}: {runs} runs"), total=runs) for name in names}
                results = compare(
                    experiment, runs, place, names, threads, backend, scheduler, fresh,
                    lambda name, done: progress.advance(tasks[name], done),
                )  # fmt: skip
        except KeyboardInterrupt:
            finished = sum(len(list(folder.glob("block_*.npz"))) for folder in folders.values())
            where = folders[names[0]] if len(names) == 1 else place
            typer.echo(
                f"interrupted: {finished} finished blocks are kept in {where}; the same command goes on", err=True
            )
            raise typer.Exit(130) from None
        written = {folders[name]: campaign_plots.write(result, folders[name]) for name, result in results.items()}
        if len(names) > 1:
            written[place / "comparison"] = campaign_plots.write_comparison(results, place / "comparison")
    for part in comparison(results) if len(names) > 1 else tables(results[names[0]]):
        console.print(part)
    for folder, files in written.items():
        say(f"{', '.join(file.name for file in files)} in {folder}")


def comparison(results: Mapping[str, CampaignResult]) -> Iterator[RenderableType]:
    """One line for each controller: who fails, who succeeds, and how large errors are."""
    some = next(iter(results.values()))
    yield f"{len(some)} runs, seed {some.seed}, the same draws for each; bounds hold with 95 % confidence"
    headers = ("controller", "failed [%]", "succeeded [%]", "RMS, median", "99 %", "worst")
    table = Table(*headers, box=None, header_style="bold")
    for name, result in results.items():
        one = result.brief()
        errors = ("failed" if one[key] is None else f"{one[key]:.2g}" for key in ("rms_median", "rms_99", "rms_worst"))
        rates = (_percent(one[what], one[f"{what}_95"]) for what in ("failed", "success"))
        table.add_row(escape(name), *rates, *errors)
    yield table
    for name, result in results.items():
        for cause, count in list(result.causes().items())[:CAUSES]:
            yield escape(f"{name} failed {count}: {cause}")


def _drawn(value: float) -> str:
    """Seeds are whole numbers, of which every digit counts."""
    return str(value) if isinstance(value, int) else f"{value:.4g}"


def _percent(share: float, bounds: list[float]) -> str:
    low, high = (100.0 * bound for bound in bounds)
    return f"{100.0 * share:.1f} ({low:.1f}-{high:.1f})"


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
        worst.add_row(str(index), came, ", ".join(f"{name} = {_drawn(value)}" for name, value in one["drawn"].items()))
    yield worst


def _replay(experiment: str, index: int, controller: str, backend: str, folder: Path) -> None:
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
