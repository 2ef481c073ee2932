"""A campaign's result as files: plots, and a summary in numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from wmr_afl.analysis import plots
from wmr_afl.analysis.files import renewed
from wmr_afl.errors import WmrError
from wmr_afl.experiments.campaigns.ledger import locked
from wmr_afl.experiments.campaigns.result import CampaignResult, wilson
from wmr_afl.numerics.arrays import Floats
from wmr_input.whole_files import write_whole

Results = Mapping[str, CampaignResult]  # by the name of the controller
BINS = 10  # of a drawn quantity, with equally many runs in each; for 1000 runs the bounds are then within 10 %


def write(result: CampaignResult, folder: Path) -> list[Path]:
    """Write summary.json and the plots, all at once, and return their paths.

    Raises:
        WmrError: if the folder cannot be written, or another process runs a campaign there.
    """
    figures = {"errors": draw_errors(result), "success": draw_success(result)}
    with locked(folder), renewed(folder) as beside:
        files = [_write_json(beside / "summary.json", result.summary())]
        for name, figure in figures.items():
            files += plots.save(figure, beside / name)
    return [folder / file.name for file in files]


def write_comparison(results: Results, folder: Path) -> list[Path]:
    """Write comparison.json and the plot of several controllers, and return their paths.

    Raises:
        WmrError: if the folder cannot be written.
    """
    with renewed(folder) as beside:
        files = [_write_json(beside / "comparison.json", {name: one.brief() for name, one in results.items()})]
        files += plots.save(draw_comparison(results), beside / "comparison")
    return [folder / file.name for file in files]


def _write_json(path: Path, content: dict[str, Any]) -> Path:
    try:
        write_whole(path, json.dumps(content, indent=2) + "\n")
    except OSError as error:
        raise WmrError(f"{path}: cannot be written ({error.strerror})", "make room or name another --out") from None
    return path


def draw_comparison(results: Results) -> Figure:
    """For each controller the share of runs whose RMS error, the largest of the outputs of a unit, is below a bound."""
    some = next(iter(results.values()))
    units = list(dict.fromkeys(some.outputs.values()))
    with plots.styled():
        figure = plots.new_figure(1.6 + 4.4 * len(units), 3.6)
        panels = figure.subplots(1, len(units), sharey=True, squeeze=False)[0]
        for axes, unit in zip(panels, units, strict=True):
            columns = [index for index, other in enumerate(some.outputs.values()) if other == unit]
            for index, (name, result) in enumerate(results.items()):
                errors = np.sort(result.runs.rms[:, columns].max(axis=1))
                draw_shares(axes, errors, plots.verbatim(name), index)
            if some.criteria.rms is not None:
                axes.axvline(some.criteria.rms, label="wanted", **plots.REFERENCE)
            axes.set(xscale="log", ylim=(0.0, 105.0), xlabel=f"RMS tracking error [{unit}]")
        panels[0].set(ylabel="runs that stay below [%]")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.suptitle(f"{len(some)} runs, the same draws for each law", fontsize=10)
    return figure


def draw_shares(axes: Axes, errors: Floats, label: str, index: int) -> None:
    """The share of all runs below each error, of errors in order; those of failed runs are infinite."""
    share, kept = np.arange(1, len(errors) + 1) / len(errors), np.isfinite(errors) & (errors > 0.0)
    axes.step(errors[kept], 100.0 * share[kept], where="post", label=label, **plots.style_of(index))


def draw_errors(result: CampaignResult) -> Figure:
    """The share of runs whose RMS error stays below a bound, for each output."""
    with plots.styled():
        figure = plots.new_figure(6.0, 3.6)
        axes = figure.subplots()
        units = []
        for index, (output, unit) in enumerate(result.outputs.items()):
            draw_shares(axes, np.sort(result.runs.rms[:, index]), f"{output} [{unit}]", index)
            units.append(unit)
        if result.criteria.rms is not None:
            axes.axvline(result.criteria.rms, label="wanted", **plots.REFERENCE)
        rate, low, high = result.success_rate()
        axes.axhspan(100.0 * low, 100.0 * high, color="0.85", zorder=0)
        axes.annotate(f"success {rate:.1%}", (0.02, 100.0 * high), xycoords=("axes fraction", "data"), va="bottom")
        axes.set(xscale="log", ylim=(0.0, 105.0), xlabel=f"RMS tracking error [{', '.join(dict.fromkeys(units))}]")
        axes.set(ylabel="runs that stay below [%]")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.suptitle(plots.verbatim(f"{len(result)} runs of {result.controller}"), fontsize=10)
    return figure


def draw_success(result: CampaignResult) -> Figure:
    """The success rate over each drawn quantity, with 95 % bounds."""
    drawn = {name: column for name, column in result.draws.items() if name != "noise_seed"} or dict(result.draws)
    columns = min(3, len(drawn))
    rows = -(-len(drawn) // columns)
    with plots.styled():
        figure = plots.new_figure(1.0 + 2.5 * columns, 0.9 + 1.9 * rows)
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for axes, (name, column) in zip(panels, drawn.items(), strict=False):
            places, rates, bounds = _binned(column, result.succeeded)
            axes.errorbar(places, rates, bounds, fmt="o", markersize=3.5, color=plots.COLOURS[0], capsize=2)
            axes.set(xlabel=plots.verbatim(name), ylim=(-4.0, 104.0))
        for axes in panels[len(drawn) :]:
            axes.remove()
        figure.supylabel("success [%]", fontsize=9)
        figure.suptitle(plots.verbatim(f"{len(result)} runs of {result.controller}"), fontsize=10)
    return figure


def _binned(column: Floats, succeeded: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats]:
    """Middle of each bin, its success rate [%], and how far the bounds lie below and above."""
    places, rates, bounds = [], [], []
    values = np.unique(column)
    parts = np.array_split(np.argsort(column, kind="stable"), BINS)
    if len(values) <= BINS:  # a choice of few values: one point for each
        parts = [np.flatnonzero(column == value) for value in values]
    for part in parts:
        rate, low, high = wilson(int(np.count_nonzero(succeeded[part])), len(part), 0.95)
        places.append(np.median(column[part]))
        rates.append(100.0 * rate)
        bounds.append((100.0 * max(0.0, rate - low), 100.0 * max(0.0, high - rate)))
    return np.array(places), np.array(rates), np.array(bounds).T
