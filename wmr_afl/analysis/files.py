"""Runs -> files: a table of samples for each run, and the metrics of all."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from wmr_afl.analysis.metrics import metrics
from wmr_afl.errors import WmrError
from wmr_afl.experiments.experiment import file_name
from wmr_afl.numerics.arguments import checked
from wmr_afl.simulation.result import Run
from wmr_input.whole_files import remove_abandoned, renewing, replacing, write_whole

NOTE = "written.json"  # in a result folder: the files that were written there, with their digests
SAMPLES = 10_000  # that are turned into text at a time


def check_writable(folder: Path) -> None:
    """Check before a long run that results can be written to `folder`.

    Raises:
        WmrError: if it cannot be written.
    """
    try:
        Path.cwd()
    except OSError:
        raise WmrError("the folder that you are in is gone", "change to one that is there") from None
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not os.path.isdir(there) or not os.access(there, os.W_OK | os.X_OK):
        raise WmrError(f"{there}: cannot be written", "name a writable folder")


@checked
def write_results(runs: Mapping[str, Run], folder: Path) -> list[Path]:
    """Write one CSV file for each run and `metrics.json` for all, and return their paths.

    Numbers have as many digits as it takes to read them back to the bit.

    Raises:
        WmrError: if the folder cannot be written.
    """
    files = []
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(folder)
        for name, run in runs.items():
            files.append(folder / f"{file_name(name)}.csv")
            with replacing(files[-1]) as beside, open(beside, "w", encoding="utf-8", newline="\n") as stream:
                stream.writelines(_lines(run))
        files.append(folder / "metrics.json")
        text = json.dumps({name: metrics(run) for name, run in runs.items()}, indent=2)
        write_whole(files[-1], text + "\n")
        _write_note(folder, {**_noted(folder), **_digests(files)})
    return files


@contextmanager
def renewed(folder: Path) -> Iterator[Path]:
    """Yield a folder for results, which takes the place of `folder` at once; what else lies there stays.

    Where nothing can be written beside the folder, it is another disk or one is in it, results go into it file by file.

    Raises:
        WmrError: if it cannot be written; what was there stays.
    """
    place = folder.resolve() if folder.is_dir() else folder  # results may lie on another disk, behind a link
    is_around = place.is_dir() and Path.cwd().is_relative_to(place)  # a shell would stand in a folder that is gone
    if is_around or (
        place.is_dir() and not (os.access(place.parent, os.W_OK | os.X_OK) and not os.path.ismount(place))
    ):
        yield folder
        return
    with _writing(folder), renewing(place) as beside:
        try:
            yield beside
        except WmrError as error:
            raise WmrError(error.problem.replace(str(beside), str(folder)), error.remedy) from None


def keep_only(files: Iterable[Path], folder: Path) -> None:
    """Remove what an earlier run has left in the folder, such as samples of other controllers, and note `files`.

    Only what this program has written is removed, and only if it is still as it was written.

    Raises:
        WmrError: if the folder cannot be written.
    """
    with _writing(folder):
        kept = _digests(files)
        for name, digest in _noted(folder).items():
            file = folder / name
            if name not in kept and not file.is_symlink() and file.is_file() and _digest(file) == digest:
                file.unlink()
        _write_note(folder, kept)


def columns(run: Run) -> list[str]:
    """The header of a run's samples: names with units."""
    model = run.model
    return [
        "time [s]",
        *_named("", model.state_units),
        *_named("", model.input_units),
        *_named("command_", model.input_units),
        *_named("reference_", model.output_units),
        *_named("error_", model.output_units),
        *_named("estimate_", run.estimate_units),
        *(() if run.deviation is None else _named("deviation_", run.estimate_units)),
        *(() if run.observed is None else _named("observed_", model.state_units)),
        *(() if run.unexpected is None else _named("unexpected_", _accelerations(model.output_units))),
        *(() if run.surprise is None else ("surprise [m or rad]",)),
        *(() if run.slip is None else _named("slip_", run.slip_units)),
        *(() if run.slip_true is None else _named("slip_true_", run.slip_units)),
    ]


def _lines(run: Run) -> Iterator[str]:
    """Header and samples of a run, a few thousand at a time."""
    yield ",".join(columns(run)) + "\n"
    surprise = None if run.surprise is None else run.surprise[:, None]
    optional = (run.deviation, run.observed, run.unexpected, surprise, run.slip, run.slip_true)  # as in the header
    for start in range(0, len(run.time), SAMPLES):
        part = slice(start, start + SAMPLES)
        table = np.hstack([
            run.time[part, None], run.state[part], run.input[part], run.command[part],
            run.reference[part], run.error[part], run.estimate[part],
            *(signal[part] for signal in optional if signal is not None),
        ])  # fmt: skip
        yield from (",".join(map(repr, row)) + "\n" for row in table.tolist())


def _accelerations(units: Mapping[str, str]) -> dict[str, str]:
    return {name: f"{unit}/s^2" for name, unit in units.items()}


def _named(before: str, units: Mapping[str, str]) -> list[str]:
    return [f"{before}{name} [{unit}]" for name, unit in units.items()]


def _noted(folder: Path) -> dict[str, str]:
    """The files that the last runs wrote into the folder, and their digests; none if nothing readable is noted."""
    try:
        content = json.loads((folder / NOTE).read_text(encoding="utf-8"))["sha256"]
        return {name: str(digest) for name, digest in content.items() if Path(name).name == name}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


def _write_note(folder: Path, digests: Mapping[str, str]) -> None:
    write_whole(folder / NOTE, json.dumps({"sha256": digests}, indent=2) + "\n")


def _digests(files: Iterable[Path]) -> dict[str, str]:
    return {file.name: _digest(file) for file in files}


def _digest(file: Path) -> str:
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turn failures of the disk into one line."""
    try:
        yield
    except OSError as error:
        raise WmrError(f"{folder}: cannot be written ({error.strerror})", "name a writable folder") from None
