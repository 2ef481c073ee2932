"""Whole trajectories of many runs on disk: one HDF5 file, written chunk by chunk."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_input.whole_files import begin, discard, finish

DATASETS = {  # signal of the loop -> name in the file
    "x": "state",
    "u": "input",
    "command": "command",
    "e": "error",
    "reference": "reference",
    "theta_hat": "estimate",
    "deviation": "deviation",  # of a law that knows it
    "observed": "observed",  # of one that observes
    "unexpected": "unexpected",
    "surprise": "surprise",
    "slip": "slip",
    "slip_true": "slip_true",  # where wheels slip besides
}
SAMPLES = 1000  # of one run in one chunk of the file, as many as a batch records at a time


@contextmanager
def recording(path: Path, loop: ClosedLoop, times: Floats, count: int) -> Iterator[Callable[..., None]]:
    """Yield a function (robots, samples, rows) that writes signals; the file gets its name once all is written.

    Datasets: time (T,), state (N, T, 2n-m), input and command (N, T, n_u), error and reference (N, T, n-m), estimate
    (N, T, n_theta), failure_time (N,); of a law that knows it deviation; of one that observes observed, unexpected,
    surprise and slip, and slip_true where wheels slip. Their attribute `names` lists the entries with units. A run that
    failed has its failure_time, NaN in the others, and NaN in all signals from then on. If writing fails, what was at
    `path` stays.

    Raises:
        WmrError: if h5py is not installed, or the file cannot be written.
    """
    try:
        import h5py
    except ImportError:
        raise WmrError(
            "trajectories need h5py, which is not installed", 'pip install "wmr-afl[trajectories]"'
        ) from None
    names, places = _names(loop), loop.signal_layout.places
    datasets = {signal: dataset for signal, dataset in DATASETS.items() if signal in places}
    failures = np.full(count, np.nan)
    file = None
    with _one_line(path):
        unfinished = begin(path)
    try:
        with _one_line(path):
            # Without a cache a full disk shows where a chunk is written; with one HDF5 tries again later, and crashes.
            file = h5py.File(unfinished, "w", rdcc_nbytes=0)
            file.attrs["model"] = loop.model.name
            file.create_dataset("time", data=times).attrs["names"] = ["time [s]"]
            for signal, dataset in datasets.items():
                shape = (count, len(times), loop.signals[signal])
                chunks = (1, min(SAMPLES, len(times)), shape[-1]) if shape[-1] else None
                made = file.create_dataset(dataset, shape, "f8", chunks=chunks, fillvalue=np.nan)
                made.attrs["names"] = names[dataset]

        def record(robots: slice, samples: slice, rows: Floats) -> None:
            kept = _until_failure(rows, times[samples], failures[robots], loop)
            with _one_line(path):
                for signal, dataset in datasets.items():
                    file[dataset][robots, samples] = np.moveaxis(kept[:, places[signal]], 2, 0)

        yield record
        with _one_line(path):
            file.create_dataset("failure_time", data=failures).attrs["names"] = ["failure_time [s]"]
            file.close()
            finish(unfinished, path)
    finally:
        if file is not None:
            with suppress(OSError, RuntimeError):  # a full disk was reported already
                file.close()
        discard(unfinished)


def _names(loop: ClosedLoop) -> dict[str, list[str]]:
    """The entries of each dataset with their units."""
    model = loop.model
    units = {
        "state": model.state_units,
        "input": model.input_units,
        "command": model.input_units,
        "error": model.output_units,
        "reference": model.output_units,
        "estimate": loop.law.knowledge.units,
        "deviation": loop.law.knowledge.units,
        "observed": model.state_units,
        "slip": dict.fromkeys(loop.law.slip_names, "m/s"),
        "slip_true": dict.fromkeys(loop.law.slip_names, "m/s"),
        "unexpected": {name: f"{unit}/s^2" for name, unit in model.output_units.items()},
        "surprise": {"surprise": "m or rad"},
    }
    return {dataset: [f"{name} [{unit}]" for name, unit in table.items()] for dataset, table in units.items()}


def _until_failure(rows: Floats, times: Floats, failures: Floats, loop: ClosedLoop) -> Floats:
    """Signals (T, signals, robots) as NaN from each robot's failure on; `failures` (robots,) takes new ones."""
    regularity = loop.signal_layout.places["regularity"].start
    sound = np.isfinite(rows[:, list(loop.checked)]).all(axis=1) & (rows[:, regularity] > 0.0)
    lost = np.isfinite(failures) | ~np.logical_and.accumulate(sound, axis=0)
    fails_now = lost.any(axis=0) & ~np.isfinite(failures)
    failures[fails_now] = times[np.argmax(lost[:, fails_now], axis=0)]
    return np.where(lost[:, None, :], np.nan, rows) if lost.any() else rows


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn failures of the disk into one line; HDF5 raises some as RuntimeError with a text of many lines."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        cause = re.search(r"error message = '([^']*)'", str(error))
        why = cause[1] if cause else getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise WmrError(f"{path}: cannot be written ({why})", "name a writable place with room") from None
