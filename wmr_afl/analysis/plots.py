"""Plots of runs: path, outputs, errors, inputs, estimates, each drawn into given axes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Run
from wmr_input.whole_files import replacing

Runs = Mapping[str, Run]  # by the name of the controller

# Okabe and Ito's palette: distinguishable in print and with colour vision deficiencies.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":")  # dashes distinguish runs in black and white
REFERENCE: dict[str, Any] = {"color": "0.55", "linewidth": 2.5, "linestyle": "-", "zorder": 1}  # below the runs
LONGEST = 34  # characters of a formula above a panel
SETTINGS: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "svg.hashsalt": "wmr-afl",  # same input, same bytes
    "svg.fonttype": "none",
}


@contextmanager
def styled() -> Iterator[None]:
    """The project's plot settings, for the time of drawing and saving."""
    with mpl.rc_context(SETTINGS):
        yield


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size [inch], without any global state."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@checked
def save(figure: Figure, stem: Path) -> list[Path]:
    """Write `stem`.png and `stem`.svg, and return their paths.

    Raises:
        WmrError: if the folder cannot be written.
    """
    files = [stem.with_name(stem.name + ending) for ending in (".png", ".svg")]
    try:
        stem.parent.mkdir(parents=True, exist_ok=True)
        with styled(), replacing(files[0]) as png, replacing(files[1]) as svg:
            figure.savefig(png, dpi=150, metadata={"Software": None})
            figure.savefig(svg, metadata={"Date": None})
    except OSError as error:
        raise WmrError(f"{stem}: cannot be written ({error.strerror})", "name a writable folder") from None
    return files


def style_of(index: int) -> dict[str, Any]:
    """Colour and dashes of the run with this index."""
    dashes = STYLES[index % len(STYLES)]
    width = 1.9 if dashes == ":" else 1.3  # dots look thinner than lines
    return {
        "color": COLOURS[index % len(COLOURS)], "linestyle": dashes, "linewidth": width, "zorder": 3 - 0.1 * index
    }  # fmt: skip


def draw_path(axes: Axes, runs: Runs) -> None:
    """First against second output, with the reference."""
    reference = max(runs.values(), key=lambda run: len(run.time)).reference
    axes.plot(reference[:, 0], reference[:, 1], label="reference", **REFERENCE)
    for index, (name, run) in enumerate(runs.items()):
        axes.plot(run.output[:, 0], run.output[:, 1], label=verbatim(name), **style_of(index))
        axes.plot(*run.output[:1, :2].T, "o", color=COLOURS[index % len(COLOURS)], markersize=4)
    names, units = _outputs(runs)
    axes.set(xlabel=f"{names[0]} [{units[0]}]", ylabel=f"{names[1]} [{units[1]}]", aspect="equal", adjustable="datalim")
    axes.legend(loc="best")


def draw_output(axes: Axes, runs: Runs, output: int) -> None:
    """One output over time, with the reference."""
    first = max(runs.values(), key=lambda run: len(run.time))
    axes.plot(first.time, first.reference[:, output], label="reference", **REFERENCE)
    for index, (name, run) in enumerate(runs.items()):
        axes.plot(run.time, run.output[:, output], label=verbatim(name), **style_of(index))
    _over_time(axes, runs, output, "")


def draw_error(axes: Axes, runs: Runs, output: int) -> None:
    """One output's tracking error over time."""
    for index, (name, run) in enumerate(runs.items()):
        axes.plot(run.time, run.error[:, output], label=verbatim(name), **style_of(index))
    _over_time(axes, runs, output, "error of ")


def draw_inputs(axes: Axes, run: Run) -> None:
    """All inputs of one run over time."""
    for index, (name, _) in enumerate(run.model.input_units.items()):
        axes.plot(run.time, run.input[:, index], label=name, color=COLOURS[index % len(COLOURS)], linewidth=0.6)
    axes.set(xlabel="time [s]", ylabel="input [V]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.2)


def draw_estimate(axes: Axes, run: Run, index: int) -> None:
    """One estimate with a band of one standard deviation to each side, and what was true at the start, dotted."""
    names, units = zip(*run.estimate_units.items(), strict=True)
    colour, estimate = COLOURS[index % len(COLOURS)], run.estimate[:, index]
    true = getattr(run.model.in_library("numpy"), run.estimated)(run.parameters)[index]
    if run.deviation is not None:
        half = run.deviation[:, index]
        axes.fill_between(run.time, estimate - half, estimate + half, color=colour, alpha=0.2, linewidth=0.0)
    axes.plot(run.time, estimate, color=colour)
    axes.axhline(true, color="black", linestyle=":", linewidth=1.0)
    formula = run.model.formulas_of(run.estimated)[names[index]]
    formula = formula.replace("**", "^")
    short = formula if len(formula) <= LONGEST else formula[: LONGEST - 3] + "..."
    axes.set_title(f"{_pretty(names[index])} = {verbatim(short)}", loc="left", fontsize=8)
    axes.set(ylabel=f"[{units[index]}]")


def draw_estimates(axes: Axes, run: Run, true_values: np.ndarray | None = None) -> None:
    """All estimates of one run over time; the true values, if given, are dotted."""
    for index, name in enumerate(run.estimate_units):
        colour = COLOURS[index % len(COLOURS)]
        dashes = STYLES[(index // len(COLOURS)) % len(STYLES)]
        axes.plot(run.time, run.estimate[:, index], label=_pretty(name), color=colour, linestyle=dashes)
        if true_values is not None:
            axes.axhline(true_values[index], color=colour, linestyle=":", linewidth=0.8)
    axes.set(xlabel="time [s]", ylabel="estimated base parameters")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


@checked
def overview(runs: Runs, title: str) -> dict[str, Figure]:
    """The standard figures of an experiment: path, errors, and for each controller inputs and estimates.

    Raises:
        WmrError: if there is no run.
    """
    if not runs:
        raise WmrError("there is nothing to draw", "give a run")
    some = next(iter(runs.values()))
    outputs = len(some.model.output_units)
    figures = {}
    with styled():
        if outputs >= 2:
            figures["path"] = new_figure(6.0, 5.0)
            draw_path(figures["path"].subplots(), runs)
        figures["errors"] = new_figure(7.0, 1.6 + 1.4 * outputs)
        rows = figures["errors"].subplots(outputs, 1, sharex=True, squeeze=False)[:, 0]
        for output, axes in enumerate(rows):
            draw_error(axes, runs, output)
            axes.label_outer()
        rows[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
        figures["errors"].align_ylabels(rows)
        figures["inputs"] = new_figure(7.0, 1.4 + 1.8 * len(runs))
        for axes, (name, run) in zip(
            figures["inputs"].subplots(len(runs), 1, sharex=True, squeeze=False)[:, 0], runs.items(), strict=True
        ):
            draw_inputs(axes, run)
            axes.set_title(verbatim(name), loc="left", fontsize=9)
            axes.label_outer()
        for name, run in runs.items():
            if run.estimate.size and np.ptp(run.estimate, axis=0).any():
                figures[f"estimates_{name}"] = _estimates(run)
            if run.observed is not None and len(run.time):
                figures[f"observed_{name}"] = _observed(run)
            if run.slip is not None and len(run.time):
                figures[f"slip_{name}"] = _slip(run, run.slip)
        for figure in figures.values():
            figure.suptitle(verbatim(title), fontsize=10)
    return figures


def _estimates(run: Run) -> Figure:
    """All estimates in one panel, or one each if they have bands."""
    if run.deviation is None:
        figure = new_figure(7.0, 3.2)
        draw_estimates(figure.subplots(), run)
        return figure
    count = run.estimate.shape[1]
    columns = min(3, count)
    rows = -(-count // columns)
    figure = new_figure(3.0 * columns, 0.9 + 1.5 * rows)
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for index, axes in enumerate(panels[:count]):
        draw_estimate(axes, run, index)
    for axes in panels[count:]:
        axes.remove()
    for axes in panels[max(0, count - columns) : count]:
        axes.set_xlabel("time [s]")
        axes.tick_params(labelbottom=True)
    figure.supxlabel("band: one standard deviation to each side; dotted: the robot at the start", fontsize=8)
    return figure


def _observed(run: Run) -> Figure:
    """What is not measured as it is and as the observer tells it, and what was not expected of each output."""
    n, model, observed = run.model.coordinate_count, run.model, run.observed
    entries = list(enumerate(model.state_units.items()))
    shown = [entry for entry in entries if entry[0] >= n or _differs(observed, run.state, entry[0])]
    outputs = list(model.output_units.items())
    figure = new_figure(7.0, 0.9 + 1.3 * (len(shown) + len(outputs)))
    panels = figure.subplots(len(shown) + len(outputs), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (index, (name, unit)) in zip(panels, shown, strict=False):
        axes.plot(run.time, run.state[:, index], label="of the robot", **style_of(0))
        if observed is not None:
            axes.plot(run.time, observed[:, index], label="observed", **style_of(1))
        axes.set(ylabel=f"{name} [{unit}]")
    for index, (axes, (name, unit)) in enumerate(zip(panels[len(shown) :], outputs, strict=True)):
        if run.unexpected is not None:
            axes.plot(run.time, run.unexpected[:, index], color=COLOURS[2])
        axes.set(ylabel=f"unexpected of\n{name} [{unit}/s^2]")
    panels[-1].set(xlabel="time [s]")
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    figure.align_ylabels(panels)
    return figure


def _differs(observed: Floats | None, state: Floats, index: int) -> bool:
    """Whether an entry of the state is not taken from the robot as it is."""
    return observed is not None and not np.array_equal(observed[:, index], state[:, index])


def _slip(run: Run, measured: Floats) -> Figure:
    """How each wheel slips as measured, over how it slips."""
    count = len(run.slip_names)
    figure = new_figure(7.0, 0.9 + 1.3 * count)
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for index, (axes, name) in enumerate(zip(panels, run.slip_names, strict=True)):
        if run.slip_true is not None:
            axes.plot(run.time, run.slip_true[:, index], label="of the robot", **REFERENCE)
        axes.plot(run.time, measured[:, index], label="measured", **style_of(0))
        wheel, _, direction = name.rpartition(" ")
        axes.set(ylabel=verbatim(wheel) + f" slips\n{direction} [m/s]")
    panels[-1].set(xlabel="time [s]")
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    figure.align_ylabels(panels)
    return figure


def verbatim(text: str) -> str:
    """A text that a person chose, safe from matplotlib's own markup: no mathematics, no hidden legend entry."""
    return text.replace("$", r"\$").removeprefix("_") if text.strip("_") else "(" + text + ")"


def _over_time(axes: Axes, runs: Runs, output: int, what: str) -> None:
    names, units = _outputs(runs)
    axes.set(xlabel="time [s]", ylabel=f"{what}{names[output]} [{units[output]}]")


def _outputs(runs: Runs) -> tuple[list[str], list[str]]:
    units = next(iter(runs.values())).model.output_units
    return list(units), list(units.values())


def _pretty(name: str) -> str:
    """theta3, pi3 -> a Greek letter with its index."""
    head = name.rstrip("0123456789")
    return rf"$\hat\{head}_{{{name[len(head) :]}}}$" if head in ("theta", "pi") else name
