"""The verb that runs an experiment many times."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wmr_afl.cli.running import print_metrics
from wmr_afl.cli.terminal import Experiment, Out, app, console, progress_bar, reporting, say


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
    from wmr_afl.campaigns import campaign, report
    from wmr_afl.experiment import file_name
    from wmr_afl.loading import load_experiment
    from wmr_afl.results import check_writable

    with reporting():
        loaded = load_experiment(experiment)
        name = loaded.name(controller or (loaded.told.campaign.controller if loaded.told.campaign else None))
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
        files = report.write(result, folder)
    for part in report.tables(result):
        console.print(part, highlight=False)
    say(f"{', '.join(file.name for file in files)} in {folder}")


def _replay(experiment: str, index: int, controller: str | None, backend: str, folder: Path) -> None:
    from wmr_afl import plots
    from wmr_afl.campaigns import replay
    from wmr_afl.experiment import file_name
    from wmr_afl.results import write_results

    run = replay(experiment, index, controller, backend)
    files = write_results({run.controller: run}, folder)
    for name, figure in plots.overview({run.controller: run}, f"run {index} of a campaign").items():
        files += plots.save(figure, folder / file_name(name))
    print_metrics(f"run {index}", {run.controller: run})
    say(f"{len(files)} files in {folder}")
