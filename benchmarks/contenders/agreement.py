"""Contenders must give the same before they are timed."""

from __future__ import annotations

import numpy as np

from benchmarks.contenders.work import LOGGED, Numbers, Summary, Work, split
from wmr_afl.simulation.result import Run

TOLERANCE = 1e-9


Trajectory = Numbers | Run  # rows of the signals LOGGED, or this project's own


def deviation(work: Work, found: Trajectory | Summary, expected: Trajectory | Summary) -> float:
    """The largest difference between two trajectories or summaries, relative to the largest size of each signal."""
    differences = []
    for name, signal in _signals(work, found).items():
        other = _signals(work, expected)[name]
        if signal.shape != other.shape:
            raise ValueError(f"{name} has shape {signal.shape}; expected {other.shape}")
        differences.append(np.max(np.abs(signal - other)) / np.max(np.abs(other)))
    return float(np.max(differences))


def _signals(work: Work, result: Trajectory | Summary) -> dict[str, Numbers]:
    if isinstance(result, Summary):
        return vars(result)
    if isinstance(result, Run):
        return dict(zip(LOGGED, (result.state, result.input, result.error, result.estimate), strict=True))
    return split(work, result)
