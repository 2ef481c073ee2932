"""The verb that holds a model against a physics engine: `validate`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import app, console, numbers_by_name, progress_bar, reporting, say

if TYPE_CHECKING:
    from wmr_afl.validation.tracking import Tracked
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
    experiment: Annotated[
        str | None, typer.Option(help="An experiment of this robot, whose controllers drive the engine's robot, too.")
    ] = None,
    controller: Annotated[
        list[str] | None, typer.Option(help="One of the experiment's, all unless named; may be repeated.")
    ] = None,
    space: Annotated[bool, typer.Option("--space", help="Let it rise, pitch and roll: wheel loads shift.")] = False,
    height: Annotated[
        float | None, typer.Option(help="Of all masses above the floor, in space [m]; a wheel's radius unless given.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="Of the drive [s].")] = 10.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the random states and parameters.")] = 1,
    video: Annotated[
        Path | None, typer.Option(help="A .gif or .mp4 file: the drive, or the first controller, in the engine.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for files; results/validated-ROBOT unless named.")] = None,
) -> None:
    """Hold a model against MuJoCo, which finds rolling by friction: accelerations at random states, and one drive.

    Exit with 1 if they differ. Writes the engine's robot, a figure and all numbers.
    """
    from wmr_afl.analysis.animation import check_file
    from wmr_afl.analysis.files import check_writable
    from wmr_afl.analysis.film import filming
    from wmr_afl.analysis.validation_report import write_validation
    from wmr_afl.experiments.load import load_experiment
    from wmr_afl.model.model import load_model
    from wmr_afl.validation.validate import drawn
    from wmr_afl.validation.validate import validate as validated

    with reporting():
        model = load_model(robot)
        parameters, begins = numbers_by_name("--set", set_), numbers_by_name("--start", start)
        folder = out or Path("results", f"validated-{model.name}")
        check_writable(folder)
        lasts = seconds if experiment is None else load_experiment(experiment).experiment.simulation.duration
        film = nullcontext() if video is None else filming(check_file(video), lasts)
        with progress_bar() as progress, film as camera:
            task = progress.add_task(f"validating {escape(model.name)}", total=None)
            asked: dict[str, Any] = {"start": begins, "seconds": seconds, "seed": seed}
            found = validated(
                model, parameters=parameters, experiment=experiment, controllers=controller, space=space,
                height=height, watch=camera or (lambda engine, time: None),
                progress=lambda done, total: progress.update(task, completed=done, total=total + draws), **asked,
            )  # fmt: skip
            others = []
            for own in drawn(model, draws, seed):
                others.append(validated(model, parameters=own | parameters, **asked))
                progress.advance(task)
        files = write_validation(found, folder)
    _tell(found)
    for number, one in enumerate(others, 1):
        say(f"drawn parameters {number}: {one.verdict}")
    say(f"{', '.join(file.name for file in files)} in {folder}" + (f"; {video}" if video else ""))
    if not all(one.agrees for one in (found, *others)):
        raise typer.Exit(1)


def _tell(found: Validation) -> None:
    """Accelerations, the drive, friction, verdict."""
    from wmr_afl.model.grip import FLOOR

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
    if found.tracked:
        console.print(_of_controllers(found.tracked))
    if left_out := sorted({name for one in found.tracked for name in one.left_out}):
        say(f"neither robot has what the experiment adds to the motion: {', '.join(left_out)}")
    if found.height is None:
        worst = max(found.friction, key=lambda name: found.friction[name])
        say(f"friction that is needed: at most {found.friction[worst]:.2f} of the load, at wheel {worst}")
    else:
        console.print(_of_wheels(found))
        say(f"masses at {found.height:.3g} m; every wheel stays on the floor, so that the planar model holds")
    if max(found.friction.values()) > FLOOR:
        say(f"no usual floor holds that: above {FLOOR} of its load a wheel slips, and the planar model does not hold")
    say(found.verdict)


def _of_controllers(tracked: Sequence[Tracked]) -> Table:
    """Errors in both worlds, and what is between them."""
    table = Table(box=None, header_style="bold")
    for heading in ("controller", "output", "rms error", "in MuJoCo", "between them", "extrapolated"):
        table.add_column(heading, justify="left" if heading in ("controller", "output") else "right")
    for one in tracked:
        for i, (name, unit) in enumerate(one.simulated.model.output_units.items()):
            numbers = one.errors[0, i], one.errors[1, i], one.apart[0, i], one.apart[2, i]
            table.add_row(escape(one.controller), escape(f"{name} [{unit}]"), *(f"{number:.3g}" for number in numbers))
    return table


def _of_wheels(found: Validation) -> Table:
    """Loads and friction in space."""
    table = Table(box=None, header_style="bold")
    for heading in ("wheel", "load at rest [N]", "least", "most", "friction needed"):
        table.add_column(heading, justify="left" if heading == "wheel" else "right")
    for name, wheel in found.wheels.items():
        loads = (f"{wheel[key]:.1f}" for key in ("rest", "least", "most"))
        table.add_row(escape(name), *loads, f"{wheel['friction']:.2f}")
    return table
