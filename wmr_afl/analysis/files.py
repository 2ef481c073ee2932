"""Runs -> files: a table of samples for each run, and the metrics of all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wmr_afl.analysis.metrics import metrics
from wmr_afl.errors import WmrError
from wmr_afl.experiments.experiment import file_name
from wmr_afl.simulation.result import Run


def check_writable(folder: Path) -> None:
    """Check before a long run that results can be written to `folder`.

    Raises:
        WmrError: if it cannot be written.
    """
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not os.path.isdir(there) or not os.access(there, os.W_OK | os.X_OK):
        raise WmrError(f"{there}: cannot be written", "name a writable folder")


def write_results(runs: Mapping[str, Run], folder: Path) -> list[Path]:
    """Write one CSV file for each run and `metrics.json` for all, and return their paths.

    Raises:
        WmrError: if the folder cannot be written.
    """
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, run in runs.items():
            files.append(folder / f"{file_name(name)}.csv")
            model = run.model
            header = [
                "time",
                *model.state_units,
                *model.input_units,
                *(f"error_{output}" for output in model.output_units),
                *(f"estimate_{theta}" for theta in model.base_parameter_units),
            ]
            table = np.hstack([run.time[:, None], run.state, run.input, run.error, run.estimate])
            np.savetxt(files[-1], table, fmt="%.10g", delimiter=",", header=",".join(header), comments="")
        files.append(folder / "metrics.json")
        text = json.dumps({name: metrics(run) for name, run in runs.items()}, indent=2)
        files[-1].write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise WmrError(
            f"{error.filename or folder}: cannot be written ({error.strerror})", "name a writable folder"
        ) from None
    return files
