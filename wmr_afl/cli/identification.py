"""The verb that finds out a robot's numbers: `identify`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import app, console, numbers_by_name, progress_bar, reporting, say

if TYPE_CHECKING:
    from wmr_afl.identification.identified import Identified

LONGEST = 60  # characters of a formula


@app.command()
def identify(
    robot: Annotated[str, typer.Argument(help="A shipped model, or the path of a folder that derive has written.")],
    logs: Annotated[list[str], typer.Argument(help="CSV files: t, the voltages, angle:INPUT of each encoder, ...")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="NAME=VALUE: a parameter that was measured; may be repeated.")
    ] = None,
    guess: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE: where the search begins, instead of the description's value.")
    ] = None,
    hold_out: Annotated[
        str,
        typer.Option(help="What the methods are tried on: segments by name (*back), or a share between 0 and 0.8."),
    ] = "0.3",
    coulomb: Annotated[
        str, typer.Option(help="Dry friction of each motor, of equal ones grouped, or none.")
    ] = "grouped",
    delay: Annotated[float, typer.Option(help="By how much motors answer later than the log says [s].")] = 0.0,
    partial: Annotated[
        bool, typer.Option("--partial", help="Also if a motion is missing: what only that tells stays as described.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the files; results/identified-ROBOT unless named.")
    ] = None,
) -> None:
    """Find a robot's parameters from logs of its voltages and motion; write numbers, a table and a report.

    Exit with 1 if the robot does not match the log, or no possible robot is like that.
    """
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.analysis.identification_report import write_identification
    from wmr_afl.identification.identify import identify as identified
    from wmr_afl.model.model import load_model

    with reporting():
        model, parameters, guesses = (
            load_model(robot),
            numbers_by_name("--set", set_),
            numbers_by_name("--guess", guess),
        )
        folder = out or Path("results", f"identified-{model.name}")
        check_writable(folder)
        with progress_bar() as progress:
            progress.add_task(f"identifying {escape(model.name)}", total=None)
            found = identified(
                model,
                logs,
                parameters=parameters,
                guess=guesses,
                hold_out=_share(hold_out),
                coulomb=coulomb,  # type: ignore[arg-type]
                delay=delay,
                partial=partial,
            )
            files = write_identification(found, ", ".join(Path(log).name for log in logs), folder)
    for part in _told(found):
        console.print(part)
    say(f"{', '.join(file.name for file in files)} in {folder}")
    if found.is_contradiction:
        raise typer.Exit(1)


def _told(found: Identified) -> Iterator[RenderableType]:
    """Checks, numbers, physical parameters, verdict."""
    from wmr_afl.analysis.identification_report import SHARES, open_ends, origins

    log = found.log
    yield f"[bold]{escape(found.model.title)}[/bold]  ({escape(found.model.name)}; {log.duration:.1f} s of log)"
    yield ""
    checks = Table("check", "", "found", box=None, header_style="bold")
    for check in found.checks:
        text = escape(check.text) + (f"; [bold]{escape(check.remedy)}[/bold]" if check.remedy else "")
        checks.add_row(escape(check.name), "fine" if check.is_fine else "LOOK", text)
    yield checks
    yield ""
    numbers = Table(box=None, header_style="bold")
    for heading in ("number", "value", "± 2 sd", "unit", "of voltage", "told"):
        numbers.add_column(heading, no_wrap=True)
    numbers.add_column("formula", overflow="fold")
    told = found.told()
    for k, (name, unit) in enumerate(found.effort.units.items()):
        number, interval = f"{found.estimate.unknown[k]:.5g}", f"{found.estimate.interval[k]:.2g}"
        formula = found.effort.formulas[name].replace("**", "^")
        short = formula if len(formula) <= LONGEST else formula[: LONGEST - 3] + "..."
        numbers.add_row(name, number, interval, unit, f"{found.share[k]:.1%}", told[k], escape(short))
    yield numbers
    yield f"[dim]{escape(SHARES)}[/dim]"
    for gains in found.feedforward or ():
        yield escape(str(gains))
    yield ""
    physical = Table("parameter", "described", "found", "unit", "where it is from", box=None, header_style="bold")
    for name, described, value, origin in origins(found):
        unit = found.model.parameter_units[name]
        physical.add_row(escape(name), f"{described:.5g}", f"{value:.5g}", unit, escape(origin))
    yield physical
    for text in open_ends(found):
        yield escape(text)
    yield f"[bold]{escape(found.verdict)}[/bold]"


def _share(text: str) -> str | float:
    """A share of the log; else a segment's name, and a whole number is one."""
    try:
        return text if text.isdigit() else float(text)
    except ValueError:
        return text
