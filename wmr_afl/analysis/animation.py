"""A run as a moving picture: the whole scene beside the robot close up, drawn from its description."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CalledProcessError
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from wmr_afl.analysis.geometry import Geometry
from wmr_afl.analysis.plots import COLOURS, REFERENCE, styled, verbatim
from wmr_afl.errors import WmrError
from wmr_afl.numerics.arguments import checked, to_write
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Run
from wmr_input.whole_files import replacing

Progress = Callable[[int, int], None]  # pictures done, of how many
MOST_PICTURES = 600  # of an animation; a .gif keeps all of them in memory, 1 MB each, until it is written
SIZE, DPI = (8.0, 4.7), 80  # [inch], [1/inch]; 640 x 376 pixels, even numbers as .mp4 needs them
LONGEST_LINE = 1000  # points of a drawn path, more than it has pixels


@checked
def animate(
    run: Run,
    path: str | Path,
    frames_per_second: int = 20,  # at most 50
    speed: float = 1.0,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Write a run, up to its failure if it failed, to a .gif or .mp4 file; `speed` times as fast as it was.

    Raises:
        WmrError: if the file cannot be written, or the run has less than two samples or takes too many pictures.
    """
    file = check_file(path)
    rows = _rows(run, frames_per_second, speed)
    writer: AbstractMovieWriter = (PillowWriter if file.suffix.lower() == ".gif" else FFMpegWriter)(frames_per_second)
    with styled():
        scene = Scene(run, rows, speed)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with replacing(file) as beside, writer.saving(scene.figure, str(beside), DPI):
                for picture in range(len(rows)):
                    scene.show(picture)
                    writer.grab_frame()
                    progress(picture + 1, len(rows))
        except (OSError, CalledProcessError) as error:
            why = getattr(error, "strerror", None) or "ffmpeg failed"
            raise WmrError(f"{file}: cannot be written ({why})", "name a file in a writable folder") from None
    return file


def check_file(path: str | Path) -> Path:
    """Check before a long run that a file of this kind can be written here.

    Raises:
        WmrError: if it cannot.
    """
    file = to_write("path", path)
    if file.suffix.lower() not in (".gif", ".mp4"):
        raise WmrError(f"{file}: unknown kind of animation {file.suffix!r}", "name a file that ends in .gif or .mp4")
    if file.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise WmrError(f"{file}: writing .mp4 takes ffmpeg, which is not installed", "install it or name a .gif file")
    if file.is_dir():
        raise WmrError(f"{file}: is a folder", "name a file")
    return file


class Scene:
    """The figure of a run and what moves in it; `rows` are the samples to show, (pictures,)."""

    def __init__(self, run: Run, rows: NDArray[np.int_], speed: float = 1.0) -> None:
        self.run, self.rows, self._speed = run, rows, speed
        geometry = Geometry(run.model, run.parameters)
        self.shapes = geometry.shapes(run.state[rows])
        self.tracked = list(run.model.output_units.values())[:2] == ["m", "m"]  # the output is a point of the plane
        self.point = (run.output if self.tracked else next(iter(geometry.frames(run.state).values())))[:, :2]
        self.figure = Figure(figsize=SIZE)
        FigureCanvasAgg(self.figure)
        self.figure.subplots_adjust(left=0.085, right=0.98, bottom=0.205, top=0.83, wspace=0.22)
        whole, near = self.figure.subplots(1, 2)
        self._panels = (_Panel(whole, self, 1.0, "the whole scene"), _Panel(near, self, 2.0, "close up"))
        middle, half, self._middles, self._half = self._views()
        _set_view(whole, middle, half)
        self.figure.legend(handles=near.get_legend_handles_labels()[0], loc="lower center", ncols=3, borderaxespad=1.5)
        end = verbatim(shorten(str(run.failure), 110)) if run.failure else ""
        self.figure.text(0.5, 0.015, end, ha="center", fontsize=8, color=COLOURS[1])
        self._title = self.figure.suptitle("", x=0.01, y=0.985, ha="left", fontsize=10)

    def show(self, picture: int) -> None:
        """Show one of the pictures."""
        for panel in self._panels:
            panel.show(picture)
        _set_view(self._panels[1].axes, self._middles[picture], self._half)
        time = self.run.time[self.rows]
        digits = max(1, int(np.ceil(-np.log10(np.max(np.diff(time))))))
        pace = "" if self._speed == 1.0 else f", shown {self._speed:.2g} times as fast"
        what = verbatim(shorten(self.run.model.title, 90)), verbatim(self.run.controller or self.run.model.name)
        self._title.set_text(f"{what[0]}\n{what[1]}{pace}: t = {time[picture]:.{digits}f} s")

    def _views(self) -> tuple[Floats, float, Floats, float]:
        """Middle (2,) and half the side [m] of the whole scene, and of the close-up in each picture, (pictures, 2)."""
        points = self.shapes.points
        home, point = points[0], self.point[self.rows, None]
        if np.max(np.abs(point - points[:, :1])) < 3.0 * _extent(home):  # as good as a point of the robot
            points = np.concatenate([points, point], axis=1)
        if self.tracked:
            home = np.concatenate([home, self.run.reference[:, :2]])
        middles = (points.max(axis=1) + points.min(axis=1)) / 2.0
        room = 2.0 * _extent(home)  # the scene does not grow with a robot that runs away
        seen = np.concatenate([home, np.clip(points.reshape(-1, 2), home.min(axis=0) - room, home.max(axis=0) + room)])
        middle, half = (seen.max(axis=0) + seen.min(axis=0)) / 2.0, 0.53 * _extent(seen)
        reach = 1.15 * float(np.max(np.abs(points - middles[:, None])))
        return middle, half, np.clip(middles, middle - half, middle + half), reach


class _Panel:
    """Robot, paths and points in one pair of axes."""

    def __init__(self, axes: Axes, scene: Scene, scale: float, title: str) -> None:
        self.axes, self._scene = axes, scene
        self._thin = max(1, len(scene.point) // LONGEST_LINE)
        travelled: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.8, "zorder": 2}
        ring: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": "0.35", "markersize": 5.0 + 2.0 * scale}
        self._path = axes.plot([], [], **travelled)[0]
        self._goal = axes.plot([], [], "o", **ring, markeredgewidth=1.5, zorder=8)[0]
        self._point = axes.plot([], [], "o", color=COLOURS[1], markersize=3.0 + scale, zorder=8)[0]
        if scene.tracked:
            axes.plot(*scene.run.reference[:: self._thin, :2].T, **REFERENCE)
            axes.plot([], [], marker="o", **ring, **REFERENCE, label="reference")
        names = ", ".join(list(scene.run.model.output_units)[:2])
        what = f"output ({names})" if scene.tracked else "origin of the robot"
        axes.plot([], [], **travelled, marker="o", markersize=5.0, label=what)
        axes.plot([], [], linestyle="", marker=r"$\rightarrow$", color="0.2", markersize=14.0, label="heading")
        fill: dict[str, Any] = {"color": "#CFE3F1", "linewidth": 2.0 * scale**2, "joinstyle": "round", "zorder": 3}
        self._moving = (
            (PolyCollection([], **fill), scene.shapes.hulls),
            (LineCollection([], color=COLOURS[0], linewidth=scale, zorder=4), scene.shapes.links),
            (PolyCollection([], color="0.2", linewidth=0.5, zorder=5), scene.shapes.wheels),
            (LineCollection([], color="1.0", linewidth=0.6 * scale, zorder=6), scene.shapes.rollers),
            (PolyCollection([], color="0.2", linewidth=0.0, zorder=5), scene.shapes.arrow),
        )
        for collection, _ in self._moving:
            axes.add_collection(collection, autolim=False)
        self._joints = axes.plot([], [], "o", color=COLOURS[0], mfc="1.0", markersize=2.0 * scale, zorder=7)[0]
        axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axes.set_title(title, loc="left", fontsize=9)
        axes.yaxis.set_label_coords(-0.14, 0.5)

    def show(self, picture: int) -> None:
        """Move everything to one of the pictures."""
        row, point = int(self._scene.rows[picture]), self._scene.point
        self._path.set_data(*np.vstack([point[: row : self._thin], point[row]]).T)
        self._point.set_data(*point[row, :, None])
        if self._scene.tracked:
            self._goal.set_data(*self._scene.run.reference[row, :2, None])
        for collection, parts in self._moving:
            collection.set_verts([part[picture] for part in parts])
        self._joints.set_data(*self._scene.shapes.joints[picture].T)


def _rows(run: Run, frames_per_second: int, speed: float) -> NDArray[np.int_]:
    """The sample of each picture, (pictures,)."""
    if len(run.time) < 2:
        why = str(run.failure or "run it for longer")
        raise WmrError(f"a run of {len(run.time)} samples is too short for an animation, which takes two", why)
    if not (0 < frames_per_second <= 50 and 0.0 < speed < np.inf):
        raise WmrError(
            f"cannot show {frames_per_second} pictures a second at speed {speed:g}", "at most 50, speed above 0"
        )
    span = float(run.time[-1] - run.time[0])
    if span / speed * frames_per_second >= MOST_PICTURES:
        least = 1.05 * span * frames_per_second / MOST_PICTURES
        raise WmrError(f"{span / speed:g} s take more than {MOST_PICTURES} pictures", f"play at a speed of {least:.2g}")
    count = int(span / speed * frames_per_second + 1.0 + 1e-9)
    times = run.time[0] + np.arange(max(2, count)) * speed / frames_per_second
    return np.clip(np.searchsorted(run.time, times - 0.5 * span / (len(run.time) - 1)), 0, len(run.time) - 1)


def _extent(points: Floats) -> float:
    """The longer side of the box around points (k, 2) [m]."""
    return float(np.max(np.ptp(points, axis=0), initial=1e-3))


def _set_view(axes: Axes, middle: Floats, half: float) -> None:
    """A square view with a tick at every round number of metres."""
    magnitude = 10.0 ** np.floor(np.log10(half / 1.5))
    step = magnitude * max((factor for factor in (2.0, 5.0) if factor * magnitude <= half / 1.5), default=1.0)
    for axis, limit, centre in ((axes.xaxis, axes.set_xlim, middle[0]), (axes.yaxis, axes.set_ylim, middle[1])):
        axis.set_major_locator(MultipleLocator(step))
        limit(centre - half, centre + half)
