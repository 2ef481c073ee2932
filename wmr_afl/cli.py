"""The command line `wmr-afl`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from derive.__main__ import derive
from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.experiment import list_experiments
from wmr_afl.model import load_model
from wmr_afl.model_files import list_models
from wmr_afl.results import metrics
from wmr_afl.run import Run

app = typer.Typer(
    name="wmr-afl",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_console = Console()
_errors = Console(stderr=True)

Out = Annotated[Path, typer.Option(help="Folder for the results.")]
BackendOption = Annotated[
    str,
    typer.Option(
        help="numpy: step by step; casadi: traced; compiled: traced and built by a C compiler; auto: the faster one."
    ),
]


@contextmanager
def _reporting() -> Iterator[None]:
    """Errors end in one line each and exit status 2."""
    try:
        yield
    except WmrError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(2) from None


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wmr-afl {version('wmr-afl')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell the version.")
    ] = False,
) -> None:
    """Adaptive feedback linearizing control of wheeled mobile robots: look at models, derive new ones, simulate."""


@app.command()
def models() -> None:
    """List the shipped models."""
    table = Table("model", "what it is", "type", "base parameters", "outputs", box=None, header_style="bold")
    for name in list_models():
        model = load_model(name)
        count = f"{len(model.base_parameter_units)}, {model.parametrization}"
        table.add_row(name, escape(model.title), model.findings["type"], count, ", ".join(model.output_units))
    _console.print(table)
    _console.print(f"experiments: {', '.join(list_experiments())}", highlight=False)


@app.command()
def show(model: Annotated[str, typer.Argument(help="A shipped model, or a folder that derive has written.")]) -> None:
    """Tell what was found out about a robot."""
    from wmr_afl.show import describe

    with _reporting():
        for part in describe(load_model(model)):
            _console.print(part, highlight=False)


app.command()(derive)


@app.command()
def check(model: Annotated[str, typer.Argument(help="A shipped model, or a folder that derive has written.")]) -> None:
    """Check that a model obeys every law: mechanics, linearization, base parameters, code; exit with 1 where not."""
    from wmr_afl.laws import LAWS, Situation

    with _reporting():
        situation = Situation(model)
        deviations = {law: law.deviation(situation) for law in LAWS if law.applies(situation.numpy)}
    table = Table("law", "what must hold", "deviation", "at most", "verdict", box=None, header_style="bold")
    obeyed = True
    for law, deviation in deviations.items():
        holds = deviation <= law.tolerance  # also where the deviation is not a number
        table.add_row(
            law.name, escape(law.statement), f"{deviation:.1e}", f"{law.tolerance:g}", "holds" if holds else "BROKEN"
        )
        obeyed = obeyed and holds
    _console.print(table)
    if not obeyed:
        raise typer.Exit(1)


@app.command()
def simulate(
    experiment: Annotated[str, typer.Argument(help="A shipped experiment, or a TOML file.")],
    out: Out = Path("results"),
    backend: BackendOption = "auto",
    controller: Annotated[list[str] | None, typer.Option(help="Run this controller only; may be repeated.")] = None,
) -> None:
    """Run an experiment; write its samples, metrics and figures; exit with 1 where a run failed."""
    from wmr_afl import plots
    from wmr_afl.experiment import file_name, read_experiment
    from wmr_afl.results import check_writable, write_results

    with _reporting():
        told, path = read_experiment(experiment)
        check_writable(out / path.stem)
        runs = _run_with_progress(experiment, backend, controller)
        folder = out / path.stem
        files = write_results(runs, folder)
        for name, figure in plots.overview(runs, told.title).items():
            files += plots.save(figure, folder / file_name(name))
    _print_metrics(told.title, runs)
    _console.print(escape(f"{len(files)} files in {folder}"), highlight=False)
    if any(run.failure for run in runs.values()):
        raise typer.Exit(1)


@app.command()
def animate(
    experiment: Annotated[str, typer.Argument(help="A shipped experiment, or a TOML file.")],
    controller: Annotated[str | None, typer.Option(help="Whose run; the first one's where none is named.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="A .gif or .mp4 file; results/EXPERIMENT/CONTROLLER.gif where none is named.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long the animation plays.")] = 10.0,
    backend: BackendOption = "auto",
) -> None:
    """Run one controller of an experiment; write an animation of the robot; exit with 1 where the run failed."""
    from wmr_afl import animation
    from wmr_afl.assembly import assemble
    from wmr_afl.experiment import file_name, read_experiment
    from wmr_afl.results import check_writable

    with _reporting():
        told, path = read_experiment(experiment)
        name = next(iter(told.controllers)) if controller is None else controller
        file = animation.check_file(out or Path("results", path.stem, f"{file_name(name)}.gif"))
        check_writable(file.parent)
        if not 0.1 <= seconds <= 45.0:
            raise WmrError(f"an animation cannot play for {seconds:g} s; choose --seconds between 0.1 and 45")
        run = _run_with_progress(experiment, backend, [name])[name]
        speed = float(run.time[-1] - run.time[0]) / seconds if len(run.time) > 1 else 1.0
        p = assemble(told, path)[name].plant.parameters
        with Progress(console=_errors, transient=True) as progress:
            task = progress.add_task("drawing")
            animation.animate(run, p, file, 12, speed, lambda k, n: progress.update(task, completed=k, total=n))
    _console.print(escape(str(file)), highlight=False)
    if run.failure:
        _console.print(escape(str(run.failure)), highlight=False)
        raise typer.Exit(1)


@app.command()
def reproduce(
    figures: Annotated[list[str] | None, typer.Argument(help="Figures of the paper; all where none is named.")] = None,
    out: Out = Path("results"),
    backend: BackendOption = "auto",
) -> None:
    """Draw the paper's figures; without names all of them, and report.html with its claims beside what was measured."""
    from wmr_afl import plots
    from wmr_afl.beyond import beyond
    from wmr_afl.claims import CLAIMS
    from wmr_afl.experiment import read_experiment
    from wmr_afl.figures import FIGURES, draw
    from wmr_afl.report import write_report
    from wmr_afl.results import check_writable, write_results

    with _reporting():
        wanted = figures or list(FIGURES)
        for name in wanted:
            if name not in FIGURES:
                raise UnknownNameError("figure", name, FIGURES)
        check_writable(out)
        studies, pictures = {}, {}
        claimed = [] if figures else [claim.experiment for claim in CLAIMS]
        for experiment in dict.fromkeys([*(FIGURES[name].experiment for name in wanted), *claimed]):
            runs = studies[experiment] = _run_with_progress(experiment, backend, None)
            write_results(runs, out / experiment)
            _print_metrics(read_experiment(experiment)[0].title, runs)
            for name in wanted:
                if FIGURES[name].experiment == experiment:
                    png, svg = plots.save(draw(name, runs), out / name)
                    pictures[name] = png
                    _console.print(escape(f"{name}: {png}, {svg}"), highlight=False)
        if not figures:
            with _errors.status("beyond the paper"):
                rows = list(beyond("study_2"))
            _console.print(
                escape(f"report: {write_report(studies, pictures, rows, out / 'report.html')}"), highlight=False
            )
            _print_verdicts(studies)


def _print_verdicts(studies: dict[str, dict[str, Run]]) -> None:
    from wmr_afl.claims import CLAIMS

    table = Table("study", "the paper's claim", "measured", "verdict")
    for claim in CLAIMS:
        verdict = claim.judge(studies[claim.experiment])
        table.add_row(claim.experiment, verdict.claim, verdict.measured, "met" if verdict.is_met else "not met")
    _console.print(table)


def _run_with_progress(experiment: str, backend: str, controllers: list[str] | None) -> dict[str, Run]:
    from wmr_afl.running import run

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=_errors, transient=True) as progress, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # failures stand in the table of metrics
        tasks: dict[str, TaskID] = {}

        def tell(controller: str, done: int, total: int) -> None:
            if controller not in tasks:
                tasks[controller] = progress.add_task(escape(f"{experiment}: {controller}"), total=total)
            progress.update(tasks[controller], completed=done)

        return run(experiment, backend, controllers, tell)


def _print_metrics(title: str, runs: dict[str, Run]) -> None:
    table = Table(
        "controller",
        "RMS error",
        "RMS error, settled",
        "largest input",
        "failure",
        title=escape(title),
        title_justify="left",
    )
    for name, run in runs.items():
        found = metrics(run)
        settled = f"{_row(found['rms_settled'])} (since {found['settled_since']:g} s)" if "rms" in found else "-"
        largest = f"{max(found.get('largest_input', [0.0])):.3g} V"
        table.add_row(
            escape(name),
            _row(found["rms"]) if "rms" in found else "-",
            settled,
            largest,
            escape(found["failure"] or ""),
        )
    _console.print(table)


def _row(values: list[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


if __name__ == "__main__":
    app()
