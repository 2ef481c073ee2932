"""What a run amounts to, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from wmr_afl.simulation.result import Run

SETTLED = 5.0 / 7.0  # of a run's duration: the paper's studies of 140 s settle within 100 s


def metrics(run: Run) -> dict[str, Any]:
    """Samples, failure, largest input [V] and estimate; tracking errors of the whole run and once it has settled.

    Also the estimates at the end, with their deviations if the law knows them, and the conditions of its proof.
    """
    found: dict[str, Any] = {"samples": len(run.time), "failure": None if run.failure is None else str(run.failure)}
    if len(run.time):
        found["largest_input"] = _numbers(np.max(np.abs(run.input), axis=0))
        found["largest_estimate"] = float(f"{np.max(np.abs(run.estimate), initial=0.0):.9g}")
        found["estimate"] = _by_name(run, run.estimate[-1])
        if run.deviation is not None:
            found["deviation"] = _by_name(run, run.deviation[-1])
            found["unexplained"] = None if run.unexplained is None else float(f"{run.unexplained[-1]:.9g}")
        found["undetermined"] = None if run.undetermined is None else list(run.undetermined)
        found["conditions"] = [
            {"statement": one.statement, "largest": float(f"{one.largest:.9g}"), "at": one.time, "bound": one.bound,
             "broken_share": one.share}
            for one in run.conditions
        ]  # fmt: skip
    if run.failure is None:
        since = SETTLED * float(run.time[-1])
        found["rms"] = _numbers(run.rms())
        found["settled_since"] = since
        found["rms_settled"] = _numbers(run.rms(since))
        found["largest_error_settled"] = _numbers(run.largest_error(since))
    return found


def _by_name(run: Run, values: np.ndarray) -> dict[str, float]:
    return dict(zip(run.estimate_units, _numbers(values), strict=True))


def _numbers(values: np.ndarray) -> list[float]:
    return [float(f"{value:.9g}") for value in values]
