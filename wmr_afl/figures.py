"""The paper's figures, in its layout, from the shipped studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from wmr_afl import plots
from wmr_afl.plots import Runs


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper: the experiment it shows, and how."""

    experiment: str
    caption: str
    draw: Callable[[Runs], Figure]


def _paths_and_outputs(runs: Runs) -> Figure:
    """Path on the left, both outputs over time on the right."""
    figure = plots.new_figure(9.0, 4.2)
    axes = figure.subplot_mosaic([["path", "first"], ["path", "second"]])
    plots.draw_path(axes["path"], runs)
    plots.draw_output(axes["first"], runs, 0)
    plots.draw_output(axes["second"], runs, 1)
    axes["first"].set(xlabel="")
    axes["first"].tick_params(labelbottom=False)
    figure.align_ylabels([axes["first"], axes["second"]])
    return figure


def _estimates(runs: Runs) -> Figure:
    """The estimates of the first controller, which is the adaptive one."""
    figure = plots.new_figure(7.0, 3.4)
    plots.draw_estimates(figure.subplots(), next(iter(runs.values())))
    return figure


FIGURES: dict[str, PaperFigure] = {
    "fig4": PaperFigure(
        "study_1",
        "Figure 4: path of the adaptive and of the non-adaptive controller under parametric uncertainty",
        _paths_and_outputs,
    ),
    "fig5": PaperFigure("study_1", "Figure 5: estimated parameters", _estimates),
}


def draw(name: str, runs: Runs) -> Figure:
    """The figure `name` of the runs of its experiment."""
    with plots.styled():
        figure = FIGURES[name].draw(runs)
        figure.suptitle(FIGURES[name].caption, fontsize=10)
    return figure
