"""`controller.update` called from Python, as a robot's own loop would."""

from __future__ import annotations

import time

import numpy as np

import wmr_afl

ROUNDS, CALLS, RESET = 3, 100_000, 500


def update_times(rounds: int = ROUNDS, calls: int = CALLS) -> np.ndarray:
    """Seconds of each call of study 1's controller, sample after sample, (rounds, calls)."""
    controller, x = wmr_afl.Controller.from_experiment("study_1"), np.array([15.0, 25.0, 0.1, 0.2, 0.0])
    spent = np.empty((rounds, calls))
    for each in spent:
        for k in range(calls):
            if k % RESET == 0:  # the same x for long would lead the estimates anywhere
                controller.reset()
            t = controller.sample_time * (k % RESET)
            before = time.perf_counter()
            controller.update(t, x)
            each[k] = time.perf_counter() - before
    return spent
