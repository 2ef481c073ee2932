"""The verb that proposes what to drive: `excite`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import app, console, numbers_by_name, progress_bar, reporting, say


@app.command()
def excite(
    robot: Annotated[str, typer.Argument(help="A shipped model, or the path of a folder that derive has written.")],
    volts: Annotated[float, typer.Option(help="The largest voltage of each motor.")],
    room: Annotated[float, typer.Option(help="How far it may go from the start, to each side in x and y [m].")],
    limit: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE: the largest angle of a coordinate [rad]; may be repeated.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long the voltages last.")] = 20.0,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="NAME=VALUE: a better guess of a parameter; may be repeated.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the files; results/excited-ROBOT unless named.")] = None,
) -> None:
    """Propose voltages that determine a robot's parameters within the voltage and the space there is.

    They are tried on robots whose parameters are up to 30 % off; exit with 1 where one of those breaks a limit.
    """
    from wmr_afl.analysis import plots
    from wmr_afl.analysis.excitation_plots import draw_excitation
    from wmr_afl.analysis.files import check_writable, renewed
    from wmr_afl.identification.voltage_design import NOISE
    from wmr_afl.identification.voltage_design import excite as excited
    from wmr_afl.model.model import load_model
    from wmr_input.whole_files import write_whole

    with reporting():
        model = load_model(robot)
        limits, parameters = numbers_by_name("--limit", limit), numbers_by_name("--set", set_)
        folder = out or Path("results", f"excited-{model.name}")
        check_writable(folder)
        with progress_bar() as progress:
            task = progress.add_task(f"designing voltages for {escape(model.name)}", total=None)
            found = excited(
                model, volts, room, limits, seconds, parameters,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )  # fmt: skip
        with renewed(folder) as beside:
            write_whole(beside / "voltages.csv", found.played.text(model))
            plots.save(draw_excitation(found), beside / "excitation")
    table = Table("number", f"deviation at {NOISE:g} V of noise", box=None, header_style="bold")
    for name, deviation in found.deviations.items():
        table.add_row(escape(name), f"{deviation:.2%}")
    console.print(table)
    table = Table("limit of", "lowest", "highest", "may be", box=None, header_style="bold")
    for name, (least, most) in found.excursions.items():
        lower, upper = found.limits[name]
        table.add_row(escape(name), f"{least:.3g}", f"{most:.3g}", f"{lower:.3g} to {upper:.3g}")
    console.print(table)
    for loop in found.loops:
        error = f"(angle_reference:{loop.coordinate} - {loop.coordinate})"
        say(f"drive {loop.motor} with its voltage of the file + {loop.gain:.4g} V/rad {error}, at most {volts:g} V")
    (before, now), (loose, tight) = found.log_determinants, found.conditions
    say(f"log determinant {before:.1f} of a random multisine, {now:.1f} of this; condition {loose:.3g}, {tight:.3g}")
    say(f"{found.rounds} rounds; IPOPT: {found.status}")
    say(found.verdict)
    say(f"voltages.csv, excitation.png and excitation.svg in {folder}")
    if not found.is_within_limits:
        raise typer.Exit(1)
