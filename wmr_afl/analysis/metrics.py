"""Writing runs to files: a table of samples a run, and the metrics of all."""

from __future__ import annotations

from typing import Any

import numpy as np

from wmr_afl.simulation.result import Run


def metrics(run: Run) -> dict[str, Any]:
    """What a run amounts to, in numbers: over the whole of it and over its last two sevenths."""
    found: dict[str, Any] = {"samples": len(run.time), "failure": None if run.failure is None else str(run.failure)}
    if len(run.time):
        found["largest_input"] = _numbers(np.max(np.abs(run.input), axis=0))
        found["largest_estimate"] = float(f"{np.max(np.abs(run.estimate), initial=0.0):.9g}")
    if run.failure is None:
        since = float(run.time[-1]) * 5.0 / 7.0
        found["rms"] = _numbers(run.rms())
        found["settled_since"] = since
        found["rms_settled"] = _numbers(run.rms(since))
        found["largest_error_settled"] = _numbers(run.largest_error(since))
    return found


def _numbers(values: np.ndarray) -> list[float]:
    return [float(f"{value:.9g}") for value in values]
