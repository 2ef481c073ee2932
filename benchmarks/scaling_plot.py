"""The figure of how the cost of batches grows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from wmr_afl.analysis.plots import COLOURS, new_figure, styled


class Cost(Protocol):
    """What is drawn of a batch."""

    series: str
    robots: int
    steps: int
    threads: int
    trailers: int | None
    operations: int
    seconds: float
    nanoseconds: float


def draw(found: Sequence[Cost], workers: Sequence[tuple[int, float]] = ()) -> Figure:
    """Robots and threads, steps, trailers; and, where given, seconds of the same work over the number of workers."""
    with styled():
        rows, columns = (2, 2) if workers else (1, 3)
        figure = new_figure(3.7 * columns, 3.1 * rows)
        axes = figure.subplots(rows, columns).ravel()
        draw_robots(axes[0], [cost for cost in found if cost.series == "robots"])
        draw_steps(axes[1], [cost for cost in found if cost.series == "steps"])
        draw_trailers(axes[2], [cost for cost in found if cost.series == "trailers"])
        if workers:
            draw_workers(axes[3], workers)
    return figure


def draw_robots(axes: Axes, found: Sequence[Cost]) -> None:
    """Time per robot and step over robots, a line for each number of threads."""
    for i, threads in enumerate(sorted({cost.threads for cost in found})):
        line = [cost for cost in found if cost.threads == threads]
        robots, times = [cost.robots for cost in line], [cost.nanoseconds for cost in line]
        axes.loglog(robots, times, "os"[i % 2] + "-", color=COLOURS[i], label=f"{threads} thread{'s' * (threads > 1)}")
    axes.set(xlabel="robots", ylabel="time per robot and step [ns]")
    _finish(axes)


def draw_steps(axes: Axes, found: Sequence[Cost]) -> None:
    """Time over steps, beside a straight proportion."""
    steps, times = [cost.steps for cost in found], [cost.seconds for cost in found]
    last = found[-1]
    axes.loglog(steps, [last.seconds * n / last.steps for n in steps], "--", color="0.6", label="in proportion")
    axes.loglog(steps, times, "o-", color=COLOURS[0], label=f"{last.robots} robots")
    axes.set(xlabel="steps", ylabel="time [s]")
    _finish(axes)


def draw_trailers(axes: Axes, found: Sequence[Cost]) -> None:
    """Operations and time of a step over trailers, as multiples of the tractor's own."""
    trailers, first = [cost.trailers for cost in found], found[0]
    operations = [cost.operations / first.operations for cost in found]
    times = [cost.nanoseconds / first.nanoseconds for cost in found]
    axes.plot(trailers, operations, "s--", color=COLOURS[1], label="operations of a step")
    axes.plot(trailers, times, "o-", color=COLOURS[0], label="time per robot and step")
    axes.set(xlabel="trailers", ylabel="relative to no trailer")
    _finish(axes)


def draw_workers(axes: Axes, workers: Sequence[tuple[int, float]]) -> None:
    """Speed over workers of a cluster, beside a straight proportion; the first is this process without any."""
    (_, alone), *others = workers
    counts = [count for count, _ in others]
    axes.plot([0, *counts], [0, *counts], "--", color="0.6", label="in proportion")
    axes.plot(counts, [alone / seconds for _, seconds in others], "o-", color=COLOURS[0], label="measured")
    axes.set(xlabel="workers of a cluster", ylabel="times as fast as one process")
    _finish(axes)


def _finish(axes: Axes) -> None:
    """Plain numbers at logarithmic axes; counts from zero at the others."""
    for line in axes.lines:
        line.set_markersize(4)
    if axes.get_xscale() == "log":
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    else:
        axes.margins(y=0.15)
        axes.set_ylim(0, None)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()
