"""Many closed loops that differ in numbers only: one trace serves all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.errors import WmrError
from wmr_afl.simulation import trace


def rms_of_many(loops: Sequence[ClosedLoop], duration: float) -> np.ndarray:
    """Root mean square of every loop's tracking error over `duration` [s], (loops, n-m); inf where a run fails.

    Raises: WmrError, where the loops differ in more than parameters, gains and starts.
    """
    return np.array(list(_rms(loops, duration)))


def _rms(loops: Sequence[ClosedLoop], duration: float) -> Iterator[np.ndarray]:
    first = loops[0]
    states, values = Layout(first.states), Layout(first.values)
    count = round(duration / first.sample_time) + 1
    times = (np.arange(count) * first.sample_time)[None, :]
    signals = Layout({name: np.zeros(size) for name, size in first.signals.items()})
    steps = trace(first).mapaccum("steps", count)
    for loop in loops:
        if Layout(loop.states).shapes != states.shapes or Layout(loop.values).shapes != values.shapes:
            raise WmrError("the loops differ in more than numbers; run them one by one")
        noise = loop.plant.noise.samples(count).T if loop.plant.noise else np.zeros((len(loop.states["x"]), count))
        z, k = states.pack(loop.states), ca.repmat(ca.DM(values.pack(loop.values)), 1, count)
        rows = steps(z, times, noise, k)[1].full()
        finite = bool(np.isfinite(rows).all())
        error = rows[signals.places["e"]]
        yield np.sqrt(np.mean(error**2, axis=1)) if finite else np.full(len(error), np.inf)
