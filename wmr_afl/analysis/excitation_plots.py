"""Voltages that were designed, as a figure and as a table of samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from wmr_afl.analysis.plots import COLOURS, new_figure, styled, verbatim
from wmr_afl.identification.voltage_design import Excitation

WALL: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": "--"}
OTHERS: dict[str, Any] = {"color": "0.75", "linewidth": 0.6, "zorder": 1}
GUESSED: dict[str, Any] = {"color": COLOURS[0], "linewidth": 1.3, "zorder": 3}


def draw_excitation(found: Excitation) -> Figure:
    """Voltages, and what is limited over time on the left, the path within its walls on the right."""
    names = list(found.limits)
    angles = names[2:]  # behind the two of the position
    rows = len(found.inputs) + len(angles)
    with styled():
        figure = new_figure(11.0, max(4.8, 0.9 + 1.25 * rows))
        grid = figure.add_gridspec(rows, 2, width_ratios=(1.25, 1.0))
        panels = [figure.add_subplot(grid[row, 0]) for row in range(rows)]
        for index, (axes, name) in enumerate(zip(panels, found.inputs, strict=False)):
            axes.stairs(found.voltages[:-1, index], found.time, color=COLOURS[index % len(COLOURS)], baseline=None)
            _between(axes, -found.volts, found.volts)
            axes.set(ylabel=f"{name} [V]")
        for axes, name in zip(panels[len(found.inputs) :], angles, strict=True):
            _draw_angle(axes, found, name)
        for axes in panels:
            axes.sharex(panels[0])
            axes.label_outer()
        panels[-1].set(xlabel="time [s]", xlim=(0.0, found.sample_time * (len(found.tried) - 1)))
        figure.align_ylabels(panels)
        _draw_room(figure.add_subplot(grid[:, 1]), found)
        figure.suptitle(f"{verbatim(found.robot)}: {found.verdict}", fontsize=9)
    return figure


def _draw_angle(axes: Axes, found: Excitation, name: str) -> None:
    index = list(found.limits).index(name)
    step = found.sample_time
    time = step * np.arange(len(found.tried))
    axes.plot(time, found.tried[:, 1:, index], **OTHERS)
    axes.plot(time, found.tried[:, 0, index], **GUESSED)
    _between(axes, *found.limits[name])
    axes.set(ylabel=f"{name} [rad]")


def _between(axes: Axes, lower: float, upper: float) -> None:
    for value in (lower, upper):
        axes.axhline(value, **WALL)
    margin = 0.12 * (upper - lower)
    axes.set_ylim(lower - margin, upper + margin)


def _draw_room(axes: Axes, found: Excitation) -> None:
    (x, y), (left, right), (low, high) = list(found.limits)[:2], *list(found.limits.values())[:2]
    axes.plot(found.tried[:, 1:, 0], found.tried[:, 1:, 1], **OTHERS)
    axes.plot([], [], label=f"{found.tried.shape[1] - 1} robots that are off", **OTHERS)
    axes.plot(found.tried[:, 0, 0], found.tried[:, 0, 1], label="as guessed", **GUESSED)
    axes.plot(*found.tried[0, 0, :2], "o", color="black", markersize=4, zorder=4, label="start")
    axes.add_patch(Rectangle((left, low), right - left, high - low, fill=False, label="walls, limits", **WALL))
    margin = 0.06 * (right - left)
    axes.set(
        xlabel=f"{x} [m]", ylabel=f"{y} [m]", aspect="equal",
        xlim=(left - margin, right + margin), ylim=(low - margin, high + margin),
    )  # fmt: skip
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4, fontsize=8)
