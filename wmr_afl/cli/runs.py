"""Verbs that run one experiment: `simulate`, `animate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wmr_afl.cli.progress import print_metrics, run_with_progress
from wmr_afl.cli.terminal import Backend, Experiment, Out, app, progress_bar, reporting, say
from wmr_afl.errors import WmrError


@app.command()
def simulate(
    experiment: Experiment,
    out: Out = Path("results"),
    backend: Backend = "auto",
    controller: Annotated[list[str] | None, typer.Option(help="Run this controller only; may be repeated.")] = None,
) -> None:
    """Run an experiment; write its samples, metrics and figures; exit with 1 where a run failed."""
    from wmr_afl.analysis import plots
    from wmr_afl.analysis.files import check_writable, keep_only, renewed, write_results
    from wmr_afl.experiments.experiment import file_name, read_experiment

    with reporting():
        described, path = read_experiment(experiment)
        check_writable(out / path.stem)
        runs = run_with_progress(experiment, backend, controller)
        folder = out / path.stem
        with renewed(folder) as beside:
            files = write_results(runs, beside)
            for name, figure in plots.overview(runs, described.title).items():
                files += plots.save(figure, beside / file_name(name))
            keep_only(files, beside)
    print_metrics(described.title, runs)
    say(f"{len(files)} files in {folder}")
    if any(run.failure for run in runs.values()):
        raise typer.Exit(1)


@app.command()
def animate(
    experiment: Experiment,
    controller: Annotated[str | None, typer.Option(help="Whose run; the first one's where none is named.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="A .gif or .mp4 file; results/EXPERIMENT/CONTROLLER.gif where none is named.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long the animation plays.")] = 10.0,
    backend: Backend = "auto",
) -> None:
    """Run one controller of an experiment; write an animation of the robot; exit with 1 where the run failed."""
    from wmr_afl.analysis import animation
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.experiments.experiment import file_name
    from wmr_afl.experiments.load import load_experiment

    with reporting():
        loaded = load_experiment(experiment)
        name = loaded.name(controller)
        file = animation.check_file(out or Path("results", loaded.path.stem, f"{file_name(name)}.gif"))
        check_writable(file.parent)
        if not 0.1 <= seconds <= 45.0:
            raise WmrError(f"an animation cannot play for {seconds:g} s", "choose --seconds between 0.1 and 45")
        run = run_with_progress(experiment, backend, [name])[name]
        speed = float(run.time[-1]) / seconds if len(run.time) > 1 else 1.0
        with progress_bar() as progress:
            task = progress.add_task("drawing")
            animation.animate(run, file, 12, speed, lambda k, n: progress.update(task, completed=k, total=n))
    say(str(file))
    if run.failure:
        say(str(run.failure))
        raise typer.Exit(1)
