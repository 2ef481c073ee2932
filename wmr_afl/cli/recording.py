"""The verb that rehearses a log: `record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wmr_afl.cli.terminal import Experiment, app, reporting, say
from wmr_afl.errors import InputError


@app.command()
def record(
    experiment: Experiment,
    out: Annotated[Path | None, typer.Option(help="The CSV file; results/EXPERIMENT/log.csv unless named.")] = None,
    controller: Annotated[str | None, typer.Option(help="Whose run; the first one's unless named.")] = None,
    voltages: Annotated[
        Path | None, typer.Option(help="A file of voltages, as excite writes it, instead of a controller.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="How long; the experiment's or the file's duration unless given.")
    ] = None,
    encoder: Annotated[float, typer.Option(help="Steps of a motor's encoder a turn; 0: exact.")] = 2048.0,
    joint: Annotated[float, typer.Option(help="Steps of a joint's encoder a turn; 0: exact.")] = 4096.0,
    gyro: Annotated[float, typer.Option(help="Standard deviation of a measured rate [rad/s].")] = 0.01,
    every: Annotated[int, typer.Option(help="Samples of the controller from one row to the next.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    measured: Annotated[
        list[str] | None,
        typer.Option(help="A column, as angle:u_r, rate:phi or x; may be repeated. Encoders and a gyroscope if none."),
    ] = None,
) -> None:
    """Write a simulated run as a robot's logger would: encoders in steps, a noisy gyroscope, at the logger's rate."""
    from wmr_afl.experiments.load import load_experiment
    from wmr_afl.identification.log_file import write_log
    from wmr_afl.identification.recording import Sensors
    from wmr_afl.identification.recording import record as recorded
    from wmr_afl.identification.voltages import read_voltages

    with reporting():
        loaded = load_experiment(experiment)
        model = next(iter(loaded.loops.values())).model
        played = None if voltages is None else read_voltages(model.in_library("numpy"), voltages)
        sensors = Sensors(encoder, joint, gyro, every, seed, tuple(measured or ()))
        file = out or Path("results", loaded.path.stem, "log.csv")
        if voltages is not None and str(voltages) != "-" and file.exists() and file.samefile(voltages):
            raise InputError("out", str(file), "is the file of the voltages", "name another file")
        log = recorded(experiment, controller=controller, commands=played, seconds=seconds, sensors=sensors)
        driver = f"voltages of {voltages}" if voltages else f"controller {loaded.name(controller)}"
        about = [
            f"{model.name}, experiment {loaded.path.stem}, {driver}; simulated",
            "t [s], voltages [V], angles [rad]",
        ]
        write_log(log, file, about)
    say(f"{log!r} in {file}")
