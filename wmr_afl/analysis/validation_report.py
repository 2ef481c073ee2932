"""A model and an engine side by side as files: a figure, the engine's robot, all numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from wmr_afl.analysis import plots
from wmr_afl.analysis.files import keep_only, renewed
from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.drive import STEP
from wmr_afl.validation.validate import Validation
from wmr_input.whole_files import write_whole

SMALLEST = 1e-10  # of a velocity: less is drawn as this much


def write_validation(found: Validation, folder: Path) -> list[Path]:
    """Write `ROBOT.xml`, `validation.json`, `validation.png` and `.svg`, all at once; `controllers.png` if any drove.

    Raises:
        WmrError: if the folder cannot be written.
    """
    with renewed(folder) as beside:
        files = [beside / f"{found.model.name}.xml", beside / "validation.json"]
        write_whole(files[0], found.xml)
        write_whole(files[1], json.dumps(found.numbers, indent=2, ensure_ascii=False) + "\n")
        with plots.styled():
            files += plots.save(figure(found), beside / "validation")
            if found.tracked:
                files += plots.save(controllers_figure(found), beside / "controllers")
        keep_only(files, beside)
    return [folder / file.name for file in files]


def figure(found: Validation) -> Figure:
    """Speeds of both, their difference on a logarithmic axis, and the path."""
    n, driven, names = found.model.coordinate_count, found.driven, found.names
    units = list(found.model.state_units.values())[n:]
    drawing = plots.new_figure(11.0, 1.2 + 1.9 * len(names))
    grid = drawing.add_gridspec(len(names), 3, width_ratios=(2.0, 2.0, 1.6))
    coarse = f"step {1e3 * STEP:g} ms"
    for i, (name, unit) in enumerate(zip(names, units, strict=True)):
        speeds, left = drawing.add_subplot(grid[i, 0]), drawing.add_subplot(grid[i, 1])
        speeds.plot(driven.time, driven.model[:, n + i], **plots.REFERENCE, label="generated model")
        speeds.plot(driven.time, driven.coarse[:, n + i], "--", color="black", linewidth=1.0, label="MuJoCo")
        speeds.set_ylabel(f"{name} [{unit}]")
        size = float(np.sqrt(np.mean(driven.model[:, n + i] ** 2)))
        runs = (coarse, driven.coarse), (f"step {500 * STEP:g} ms", driven.fine), ("extrapolated", driven.extrapolated)
        for (label, run), colour in zip(runs, plots.COLOURS, strict=False):
            apart = np.abs(run[:, n + i] - driven.model[:, n + i]) / size
            left.semilogy(driven.time, np.maximum(apart, SMALLEST), color=colour, linewidth=0.9, label=label)
        left.axhline(found.bounds.drive, color="0.4", linestyle=":", linewidth=1.0)
        left.set_ylabel("difference / rms")
        if i == 0:
            speeds.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
            left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
        if i == len(names) - 1:
            speeds.set_xlabel("time [s]")
            left.set_xlabel("time [s]")
    path = drawing.add_subplot(grid[:, 2])
    model, engine = (found.place(one) for one in (driven.model, driven.coarse))
    path.plot(*model.T, **plots.REFERENCE)
    path.plot(*engine.T, "--", color="black", linewidth=1.0)
    path.plot(*model[0], "o", color="black", markersize=4)
    path.set(xlabel="x [m]", ylabel="y [m]", title="path of the root")
    path.set_aspect("equal", "datalim")
    drawing.suptitle(f"{found.model.title}: the same voltages through the generated model and MuJoCo")
    return drawing


def controllers_figure(found: Validation) -> Figure:
    """The tracking error of each controller in both worlds, and what is between them on a logarithmic axis."""
    drawing = plots.new_figure(11.0, 0.9 + 1.9 * len(found.tracked))
    units = f"[{', '.join(dict.fromkeys(found.model.output_units.values()))}]"
    grid = drawing.subplots(len(found.tracked), 2, squeeze=False, sharex=True)
    for (errors, left), one in zip(grid, found.tracked, strict=True):
        time = one.simulated.time
        for run, style, label in (
            (one.simulated, plots.REFERENCE, "generated model"),
            (one.coarse, {"linestyle": "--", "color": "black", "linewidth": 1.0}, "MuJoCo"),
        ):
            errors.semilogy(time, _size(run.error), **style, label=label)
        told, coarse, fine = (run.output for run in (one.simulated, one.coarse, one.fine))
        steps = (f"step {1e3 * step:g} ms" for step in (one.step, 0.5 * one.step))
        runs = zip((*steps, "extrapolated"), (coarse, fine, 2.0 * fine - coarse), strict=True)
        for (label, y), colour in zip(runs, plots.COLOURS, strict=False):
            left.semilogy(time, _size(y - told), color=colour, linewidth=0.9, label=label)
        errors.set(ylabel=f"{plots.verbatim(one.controller)}\n|y - yr| {units}")
        left.set_ylabel(f"difference of y {units}")
    for axes, ncols in zip(grid[0], (2, 3), strict=True):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=ncols)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    drawing.suptitle(f"{found.model.title}: the same controllers on the generated model and in MuJoCo")
    return drawing


def _size(rows: Floats) -> Floats:
    """The largest entry of each row, (T,)."""
    return np.maximum(np.abs(rows).max(axis=1), SMALLEST)
