"""What a camera sees as a .gif or .mp4 file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import CalledProcessError

from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wmr_afl.errors import WmrError
from wmr_afl.validation.camera import Camera, Picture
from wmr_input.whole_files import replacing

SIZE, DPI = (640, 360), 80  # pixels, [1/inch]
PER_SECOND = 25  # pictures
MOST = 250  # pictures; of a longer drive they are farther apart, and it is shown faster


@contextmanager
def filming(file: Path, seconds: float, size: tuple[int, int] = SIZE, most: int = MOST) -> Iterator[Camera]:
    """A camera whose pictures of `seconds` [s] are in the file at the end.

    `size` [pixels]; at `most` so many pictures.

    Raises:
        WmrError: if the file cannot be written.
    """
    writer: AbstractMovieWriter = (PillowWriter if file.suffix.lower() == ".gif" else FFMpegWriter)(PER_SECOND)
    figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    shown = None

    def take(picture: Picture) -> None:
        nonlocal shown
        if shown is None:
            shown = axes.imshow(picture, aspect="auto", interpolation="nearest")
        shown.set_data(picture)
        writer.grab_frame()

    camera = Camera(take, max(1.0 / PER_SECOND, seconds / most), size)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as beside:
            writer.setup(figure, str(beside), DPI)
            try:
                yield camera
            except BaseException:
                with suppress(Exception):  # of a writer that has no picture yet
                    writer.finish()
                raise
            writer.finish()
    except (OSError, CalledProcessError) as error:
        why = getattr(error, "strerror", None) or "ffmpeg failed"
        raise WmrError(f"{file}: cannot be written ({why})", "name a file in a writable folder") from None
    finally:
        camera.close()
