"""The verb `reproduce`: draw the paper's figures and write the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from wmr_afl.analysis.paper.beyond import Sheet
from wmr_afl.cli.progress import print_metrics, run_with_progress
from wmr_afl.cli.terminal import Backend, Out, app, console, errors, reporting, say
from wmr_afl.errors import UnknownNameError
from wmr_afl.simulation.result import Run


@app.command()
def reproduce(
    figures: Annotated[list[str] | None, typer.Argument(help="Figures of the paper; all where none is named.")] = None,
    out: Out = Path("results"),
    backend: Backend = "auto",
    runs: Annotated[
        int | None,
        typer.Option(min=1, help="Robots at random beyond the paper; 200 unless given, 20 without a C compiler."),
    ] = None,
) -> None:
    """Draw the paper's figures; without names all of them, and report.html with its claims beside what was measured.

    Without names its studies 2 and 3 also run under laws beyond the paper, with robots at random, noise and delay.
    """
    from wmr_afl.analysis import plots
    from wmr_afl.analysis.files import check_writable, write_results
    from wmr_afl.analysis.paper.beyond import measure
    from wmr_afl.analysis.paper.beyond_figures import CAPTIONS, draw_beyond
    from wmr_afl.analysis.paper.claims import CLAIMS
    from wmr_afl.analysis.paper.figures import FIGURES, draw
    from wmr_afl.analysis.paper.report import write_report
    from wmr_afl.experiments.experiment import read_experiment

    with reporting():
        wanted = figures or list(FIGURES)
        for name in wanted:
            if name not in FIGURES:
                raise UnknownNameError("figure", name, FIGURES)
        check_writable(out)
        studies, pictures = {}, {}
        claimed = [] if figures else [claim.experiment for claim in CLAIMS]
        for experiment in dict.fromkeys([*(FIGURES[name].experiment for name in wanted), *claimed]):
            found = studies[experiment] = run_with_progress(experiment, backend, None)
            write_results(found, out / experiment)
            print_metrics(read_experiment(experiment)[0].title, found)
            for name in wanted:
                if FIGURES[name].experiment == experiment:
                    png, svg = plots.save(draw(name, found), out / name)
                    pictures[name] = png
                    say(f"{name}: {png}, {svg}")
        if not figures:
            with errors.status("beyond the paper") as status:
                beyond = measure(runs, backend, report=lambda text: status.update(escape(f"beyond the paper: {text}")))
            for name in CAPTIONS:
                png, svg = plots.save(draw_beyond(name, beyond), out / name)
                pictures[name] = png
                say(f"{name}: {png}, {svg}")
            _print_verdicts(studies)
            _print_sheets(beyond.sheets)
            say(f"report: {write_report(studies, pictures, beyond, out / 'report.html')}")


def _print_sheets(sheets: Sequence[Sheet]) -> None:
    for sheet in sheets:
        table = Table(box=None, header_style="bold")
        for index, heading in enumerate(sheet.headings):
            table.add_column(escape(heading), justify="right" if index else "left", no_wrap=index == 0)
        for row in sheet.rows:
            table.add_row(*map(escape, row))
        console.print(f"\n[bold]{escape(sheet.title)}[/bold]", escape(sheet.note), table, sep="\n")


def _print_verdicts(studies: dict[str, dict[str, Run]]) -> None:
    from wmr_afl.analysis.paper.claims import CLAIMS

    table = Table("study", "the paper's claim", "measured", "verdict")
    for claim in CLAIMS:
        verdict = claim.judge(studies[claim.experiment])
        table.add_row(claim.experiment, verdict.claim, verdict.measured, "met" if verdict.is_met else "not met")
    console.print(table)
