"""Study 1's numbers in the order in which the hand-written contenders take them."""

from __future__ import annotations

import numpy as np

from benchmarks.contenders.work import Numbers, Work

ROBOT = ("r", "b", "d", "L", "m_C", "m_w", "I_m", "I_C", "K1", "K2")
# 2, 2, 2, 6 and 6 numbers
GAINS = ("outer_loop.b1", "outer_loop.b2", "outer_loop.alpha", "adaptation.Gamma", "projection.lower")
STATES, PLANT, ESTIMATES, ERRORS, SIGNALS = 11, 5, 6, 2, 15
SINGULAR = 1e-9  # regularity below which a run is lost


def numbers(work: Work) -> Numbers:
    """(N, 33): the robot's parameters, the gains, the circle's centre (2), radius and rate, and the sample time."""
    loop, circle = work.loop, work.experiment.reference.circle
    units = list(loop.model.parameter_units)
    ends = np.cumsum([0, *(np.size(value) for value in loop.values.values())])
    place = dict(zip(loop.values, ends, strict=False))
    flat = work.values()
    wanted = [place["p"] + units.index(name) for name in ROBOT]
    for name in GAINS:
        wanted += range(place[name], place[name] + np.size(loop.values[name]))
    rest = [*circle.center, circle.radius, circle.rate, loop.sample_time]
    return np.ascontiguousarray(np.hstack([flat[:, wanted], np.tile(rest, (len(flat), 1))]))
