"""Results of campaigns that are made by hand, for tests of what is counted and drawn."""

import numpy as np

from wmr_afl.experiments.campaigns import CampaignResult
from wmr_afl.experiments.distributions import SuccessTable
from wmr_afl.simulation.batch import BatchResult

NAN, INF = np.nan, np.inf


def result(rms: list[list[float]], failure: list[float] | None = None, **other) -> CampaignResult:
    """A campaign of two outputs and two motors; what is not given is the same for all runs."""
    count = len(rms)
    times = np.array([NAN] * count if failure is None else failure)
    runs = BatchResult(
        rms=np.array(rms),
        largest_error=other.get("largest_error", 2.0 * np.array(rms)),
        largest_input=other.get("largest_input", np.tile([1.0, 2.0], (count, 1))),
        largest_estimate=np.arange(1.0, count + 1.0),
        final_state=np.zeros((count, 5)),
        failure_time=times,
        failure_cause=np.array(["" if np.isnan(time) else "diverged; lower the gains" for time in times]),
    )
    drawn = {"start.x": np.linspace(0.0, 1.0, count)}
    return CampaignResult(
        "AFL", {"y1": "m", "y2": "rad"}, {"u_r": "V", "u_l": "V"}, 3, drawn, runs, other.get("success", SuccessTable())
    )
