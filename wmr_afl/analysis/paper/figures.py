"""The paper's figures, in its layout, from the shipped studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from matplotlib.figure import Figure

from wmr_afl.analysis import plots
from wmr_afl.analysis.plots import Runs


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


def _path_and_errors(*controllers: str) -> Callable[[Runs], Figure]:
    """(a) the path, (b) both errors over time, of these controllers."""

    def draw(runs: Runs) -> Figure:
        chosen = {name: runs[name] for name in controllers}
        figure = plots.new_figure(9.0, 4.2)
        axes = figure.subplot_mosaic([["path", "first"], ["path", "second"]])
        plots.draw_path(axes["path"], chosen)
        plots.draw_error(axes["first"], chosen, 0)
        plots.draw_error(axes["second"], chosen, 1)
        axes["first"].set(xlabel="")
        axes["first"].tick_params(labelbottom=False)
        for key, label in (("path", "(a)"), ("first", "(b)")):
            axes[key].set_title(label, loc="left", fontsize=9)
        figure.align_ylabels([axes["first"], axes["second"]])
        return figure

    return draw


def _inputs(*controllers: str) -> Callable[[Runs], Figure]:
    """The inputs of (a) one controller and (b) another."""

    def draw(runs: Runs) -> Figure:
        figure = plots.new_figure(7.5, 2.2 * len(controllers))
        for axes, name, label in zip(
            figure.subplots(len(controllers), 1, sharex=True), controllers, "abcdef", strict=False
        ):
            plots.draw_inputs(axes, runs[name])
            axes.set_title(f"({label}) {plots.verbatim(name)}", loc="left", fontsize=9)
            axes.label_outer()
        return figure

    return draw


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
    "fig6": PaperFigure(
        "study_2",
        "Figure 6: path and errors under both kinds of uncertainty, with leakage and without modification",
        _path_and_errors("AFL with leakage", "AFL"),
    ),
    "fig7": PaperFigure(
        "study_2", "Figure 7: inputs with leakage and without modification", _inputs("AFL with leakage", "AFL")
    ),
    "fig8": PaperFigure(
        "study_2",
        "Figure 8: path and errors under both kinds of uncertainty, with the robust term and without modification",
        _path_and_errors("robust AFL", "AFL"),
    ),
    "fig9": PaperFigure(
        "study_2", "Figure 9: inputs with the robust term and without modification", _inputs("robust AFL", "AFL")
    ),
    "high_gain": PaperFigure(
        "study_2_high_gain",
        "With high gains the law without modification drifts away; the modified laws do not",
        _path_and_errors("AFL with leakage", "robust AFL", "AFL"),
    ),
    "fig10": PaperFigure(
        "study_3",
        "Figure 10: path and errors while the wheels slip sideways from 50 s to 70 s",
        _path_and_errors("robust AFL", "AFL"),
    ),
}


def draw(name: str, runs: Runs) -> Figure:
    """The figure `name` of the runs of its experiment."""
    with plots.styled():
        figure = FIGURES[name].draw(runs)
        figure.suptitle(FIGURES[name].caption, fontsize=10)
    return figure
