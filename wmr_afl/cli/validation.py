"""The verb that holds a model against a physics engine: `validate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import app, console, numbers_by_name, progress_bar, reporting, say

if TYPE_CHECKING:
    from wmr_afl.validation.validate import Validation


@app.command()
def validate(
    robot: Annotated[str, typer.Argument(help="A shipped model, or the path of a folder that derive has written.")],
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="NAME=VALUE: a parameter of both robots; may be repeated.")
    ] = None,
    start: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE: where the drive begins; what is not named at zero.")
    ] = None,
    draws: Annotated[int, typer.Option(min=0, help="Sets of drawn parameters that are tried besides.")] = 0,
    seconds: Annotated[float, typer.Option(help="Of the drive [s].")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the random states and parameters.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for files; results/validated-ROBOT unless named.")] = None,
) -> None:
    """Hold a model against MuJoCo, which finds rolling by friction: accelerations at random states, and one drive.

    Exit with 1 if they differ. Writes the engine's robot, a figure and all numbers.
    """
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.analysis.validation_report import write_validation
    from wmr_afl.model.model import load_model
    from wmr_afl.validation.validate import drawn
    from wmr_afl.validation.validate import validate as validated

    with reporting():
        model = load_model(robot)
        parameters, begins = numbers_by_name("--set", set_), numbers_by_name("--start", start)
        folder = out or Path("results", f"validated-{model.name}")
        check_writable(folder)
        found = []
        with progress_bar() as progress:
            task = progress.add_task(f"validating {escape(model.name)}", total=None)
            for own in ({}, *drawn(model, draws, seed)):
                found.append(validated(model, parameters=own | parameters, start=begins, seconds=seconds, seed=seed))
                progress.advance(task)
        files = write_validation(found[0], folder)
    _tell(found[0])
    for number, one in enumerate(found[1:], 1):
        say(f"drawn parameters {number}: {one.verdict}")
    say(f"{', '.join(file.name for file in files)} in {folder}")
    if not all(one.agrees for one in found):
        raise typer.Exit(1)


def _tell(found: Validation) -> None:
    """Accelerations, the drive, friction, verdict."""
    rollers = sum(wheel.roller_angle is not None for wheel in found.mechanism.wheels)
    parts = f"{len(found.mechanism.frames)} frames, {len(found.mechanism.wheels)} wheels ({rollers} Swedish)"
    title = f"[bold]{escape(found.model.title)}[/bold]: {parts}, {len(found.mechanism.motors)} motors in MuJoCo"
    console.print(title)
    table = Table(box=None, header_style="bold")
    for heading in ("", "accelerations, rms", "worst", "drive, 1 ms", "0.5 ms", "extrapolated"):
        table.add_column(heading, justify="left" if not heading else "right")
    for i, name in enumerate(found.names):
        shares = (found.bursts.rms[i], found.bursts.worst[i], *found.differences[:, i])
        table.add_row(name, *(f"{100 * share:.4f} %" for share in shares))
    table.add_row("end of the path", "", "", *(f"{100 * share:.4f} %" for share in found.ends))
    console.print(table)
    worst = max(found.friction, key=lambda name: found.friction[name])
    say(f"friction that the drive needs: at most {found.friction[worst]:.2f} of the load, at wheel {worst}")
    say(found.verdict)
