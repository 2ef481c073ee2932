"""Whole trajectories of many runs on disk: one HDF5 file, written chunk by chunk."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop

DATASETS = {"x": "state", "u": "input", "e": "error", "theta_hat": "estimate"}  # signal of the loop -> name in the file
SAMPLES = 1000  # of one run in one chunk of the file, as many as a batch records at a time


@contextmanager
def recording(path: Path, loop: ClosedLoop, times: Floats, count: int) -> Iterator[Callable[..., None]]:
    """Yield a function (robots, samples, rows) that writes signals; the file gets its name once all is written.

    Datasets: time (T,), state (N, T, 2n-m), input (N, T, n_u), error (N, T, n-m), estimate (N, T, n_theta); their
    attribute `names` lists the entries with units. If writing fails, no half-written file stays.

    Raises:
        WmrError: if h5py is not installed, or the file cannot be written.
    """
    try:
        import h5py
    except ImportError:
        raise WmrError(
            "trajectories need h5py, which is not installed", 'pip install "wmr-afl[trajectories]"'
        ) from None
    model, places = loop.model, loop.signal_layout.places
    names = {
        "state": [f"{name} [{unit}]" for name, unit in model.state_units.items()],
        "input": [f"{name} [{unit}]" for name, unit in model.input_units.items()],
        "error": [f"{name} [{unit}]" for name, unit in model.output_units.items()],
        "estimate": [f"{name} [{unit}]" for name, unit in model.base_parameter_units.items()],
    }
    unfinished = path.with_name(f"{path.name}.part")
    file = None
    try:
        with _one_line(path):
            file = h5py.File(unfinished, "w")
            file.attrs["model"] = model.name
            file.create_dataset("time", data=times)
            for signal, dataset in DATASETS.items():
                size = loop.signals[signal]
                chunk = (1, min(SAMPLES, len(times)), max(1, size))
                made = file.create_dataset(dataset, (count, len(times), size), "f8", chunks=chunk if size else None)
                made.attrs["names"] = names[dataset]

        def record(robots: slice, samples: slice, rows: Floats) -> None:
            with _one_line(path):
                for signal, dataset in DATASETS.items():
                    file[dataset][robots, samples] = np.moveaxis(rows[:, places[signal]], 2, 0)

        yield record
        with _one_line(path):
            file.close()
            os.replace(unfinished, path)
    finally:
        if file is not None:
            with suppress(OSError, RuntimeError):  # a full disk was reported already
                file.close()
        unfinished.unlink(missing_ok=True)


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn failures of the disk into one line; HDF5 raises some as RuntimeError with a text of many lines."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        cause = re.search(r"error message = '([^']*)'", str(error))
        why = cause[1] if cause else getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise WmrError(f"{path}: cannot be written ({why})", "name a writable place with room") from None
