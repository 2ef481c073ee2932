"""Figures beyond the paper: errors over time with the transient, and how many robots stay below an error."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wmr_afl.analysis import plots
from wmr_afl.analysis.campaign_plots import draw_shares
from wmr_afl.analysis.monte_carlo import Window
from wmr_afl.analysis.paper.beyond import SLIP, SLIPPING, STUDY, Beyond
from wmr_afl.analysis.plots import Runs
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Run

FIRST, SLIPS = (0.0, 3.0), (49.0, 54.0)  # [s], seconds that are shown as they are
PERIOD = 2.0 * np.pi / 3.0  # [s] of the force
SMALLEST = 0.1  # [mm] that is shown
CAPTIONS = {
    "beyond_errors": "Beyond the paper: the distance from the reference in studies 2 and 3",
    "beyond_robots": "Beyond the paper: how many robots stay below an error",
}


def draw_beyond(name: str, beyond: Beyond) -> Figure:
    """The figure `name` of `CAPTIONS`."""
    with plots.styled():
        figure = {"beyond_errors": _errors, "beyond_robots": _shares}[name](beyond)
        figure.suptitle(CAPTIONS[name], fontsize=10)
    return figure


def _errors(beyond: Beyond) -> Figure:
    """One row a study: on the left some seconds as they are, on the right the whole run as RMS over a period."""
    figure = plots.new_figure(9.5, 6.4)
    panels = figure.subplots(2, 2, sharey=True, width_ratios=[2, 3])
    seconds = ((STUDY, "study 2", FIRST), (SLIPPING, "study 3", SLIPS))
    for row, (study, title, window) in zip(panels, seconds, strict=True):
        _draw_distance(row[0], beyond.runs[study], window)
        _draw_smoothed(row[1], beyond.runs[study])
        row[0].set(xlim=window, yscale="log", ylim=(SMALLEST, None), ylabel=f"{title}: distance [mm]")
        row[0].yaxis.set_major_formatter("{x:g}")
        row[1].set_title("RMS over one period of the force", loc="left", fontsize=9)
    panels[0, 0].set_title("the first seconds", loc="left", fontsize=9)
    panels[1, 0].set_title("when the wheels begin to slip", loc="left", fontsize=9)
    for axes in panels[1]:
        axes.axvspan(*SLIP, color="0.92", zorder=0)
        axes.set(xlabel="time [s]")
    panels[1, 1].annotate("slip", (np.mean(SLIP), 0.96), xycoords=("data", "axes fraction"), ha="center", va="top")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _distance(run: Run) -> Floats:
    return 1e3 * np.linalg.norm(run.error, axis=1)


def _draw_distance(axes: Axes, runs: Runs, window: Window) -> None:
    for index, (name, run) in enumerate(runs.items()):
        inside = (run.time >= window[0]) & (run.time <= window[1])
        style = {**plots.style_of(index), "zorder": 2.0 + 0.1 * index}  # dashes above what they coincide with
        axes.plot(run.time[inside], _distance(run)[inside], label=plots.verbatim(name), **style)


def _draw_smoothed(axes: Axes, runs: Runs) -> None:
    for index, (name, run) in enumerate(runs.items()):
        count = int(np.count_nonzero(run.time < PERIOD))  # all of a run that failed before
        if count:
            rms = np.sqrt(np.convolve(_distance(run) ** 2, np.full(count, 1.0 / count), "valid"))
            axes.plot(run.time[count - 1 :], rms, label=plots.verbatim(name), **plots.style_of(index))


def _shares(beyond: Beyond) -> Figure:
    """Since 10 s in study 2, and while the wheels slip in study 3."""
    figure = plots.new_figure(9.5, 3.8)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    windows = ((STUDY, 0, "study 2, since 10 s"), (SLIPPING, 1, "study 3, while the wheels slip"))
    for axes, (study, window, title) in zip(panels, windows, strict=True):
        for index, (law, scores) in enumerate(beyond.scores[study].items()):
            draw_shares(axes, 1e3 * np.sort(scores.worse[window]), plots.verbatim(law), index)
        axes.set(xscale="log", ylim=(0.0, 105.0), xlabel="RMS error of the worse output [mm]")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_title(f"{title}, {beyond.count} robots", loc="left", fontsize=9)
    panels[0].set(ylabel="robots that stay below [%]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
