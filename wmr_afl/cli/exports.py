"""The verb that carries a controller to a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wmr_afl.cli.terminal import app, console, reporting


@app.command()
def export(
    experiment: Annotated[str, typer.Argument(help="A shipped experiment, or a TOML file.")],
    out: Annotated[Path, typer.Option(help="The new folder.")],
    controller: Annotated[str | None, typer.Option(help="Which one; the first unless named.")] = None,
    single: Annotated[bool, typer.Option("--float", help="In single precision.")] = False,
    prefix: Annotated[str, typer.Option(help="Of all names in C.")] = "controller",
    tunable: Annotated[bool, typer.Option("--tunable", help="Gains and bounds are an argument of each step.")] = False,
    unlimited: Annotated[bool, typer.Option("--unlimited", help="Also if nothing limits the voltages.")] = False,
    reference: Annotated[
        bool, typer.Option("--reference/--no-reference", help="With the experiment's own reference beside the buffer.")
    ] = True,
    layout: Annotated[str, typer.Option(help="cmake, or platformio: with a library.json besides.")] = "cmake",
    samples: Annotated[int, typer.Option(help="How many samples are replayed.")] = 1000,
    fmu: Annotated[
        int | None, typer.Option(help="2 or 3: with FMUs of controller and robot for co-simulation, by that FMI.")
    ] = None,
) -> None:
    """Write a controller as C99 that stands on its own: law, reference, buffer of setpoints, replay, wiring."""
    with reporting():
        from wmr_afl.onboard.export import export as exported

        files = exported(
            experiment,
            controller,
            out,
            is_single=single,
            prefix=prefix,
            is_tunable=tunable,
            is_unlimited=unlimited,
            has_reference=reference,
            layout=layout,
            samples=samples,
            fmu=fmu,
        )
        console.print(f"{out}: {', '.join(sorted(files))}", highlight=False)
        console.print("README.md tells which wire is which, and how to replay what Python did", highlight=False)
