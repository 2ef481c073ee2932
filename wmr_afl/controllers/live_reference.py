"""References that come while a robot drives: setpoints, and a buffer of them that stops gently when no more come."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from enum import Enum
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.spline import horner, joined
from wmr_afl.controllers.tabled_reference import RowReference
from wmr_afl.errors import ShapeError, SimulationError, WmrError
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats

POWERS = np.arange(5.0, 0.0, -1.0)[:, None]  # of a polynomial of degree 5, which its derivative brings down
Setpoint = tuple[ArrayLike, ArrayLike, ArrayLike]  # yr, yr', yr'', (n-m,) each


class LiveReference(RowReference):
    """A reference that is given with each sample: `controller.update(t, x, reference=(yr, yr1, yr2))`.

    A law that looks ahead goes on with yr'' held.

    Raises:
        WmrError: if it has no outputs, or names one twice.
    """

    @checked
    def __init__(self, outputs: Sequence[str], counts_turns: bool = False) -> None:
        super().__init__(outputs, counts_turns)

    def _to_add(self, name: str) -> str:
        return f"name {name} among its outputs"

    def _of(self, outputs: tuple[str, ...]) -> LiveReference:
        return LiveReference(outputs, self.counts_turns)

    def at(self, t: Any) -> Point:
        """Nothing is known before it is given.

        Raises:
            SimulationError: always.
        """
        raise SimulationError("a live reference is known when it is given", "give reference = (yr, yr1, yr2)")

    def row(self, t: float) -> list[float]:
        """As `at`."""
        return self.at(t)  # type: ignore[return-value]

    def over(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """As `at`."""
        return self.at(times)  # type: ignore[return-value]

    def clock(self, times: Floats, lead: float = 0.0) -> Floats:
        """Rows [t, yr, yr', yr''] with a reference of zeros, (T, numbers)."""
        return np.hstack([times[:, None], np.zeros((len(times), 3 * len(self.outputs)))])

    def _later(self, clock: Any, now: Point, lead: float) -> Point:
        position = now.position + lead * now.velocity + 0.5 * lead * lead * now.acceleration
        return Point(position, now.velocity + lead * now.acceleration, now.acceleration, self.counts_turns)


class BufferState(Enum):
    """What a buffer gives."""

    EMPTY = "empty"  # nothing has come yet: there is no reference, which is not the same as a reference of zero
    FRESH = "fresh"  # between points that came
    HOLDING = "holding"  # behind the last one, whose velocity goes on
    STOPPING = "stopping"  # on a straight line to rest, for nothing has come in time
    STOPPED = "stopped"  # at rest, until `resume`


class ReferenceBuffer:
    """Setpoints as a planner pushes them, and the reference at any time between and after them.

    Between two points a polynomial of degree 5 joins yr, yr' and yr''. Behind the last point its velocity goes on for
    `timeout` [s]; then the outputs come to rest along a straight line within `stop` [s], and stay there, whatever comes
    later, until `resume` is called. One thread may push while another one reads.

    Raises:
        WmrError: if a time is not positive or there is no room for two points.
    """

    @checked
    def __init__(self, outputs: Sequence[str], timeout: float = 0.5, stop: float = 1.0, room: int = 64) -> None:
        if not (timeout > 0.0 and 0.0 < stop < inf and room >= 2):
            raise WmrError(
                f"a time-out of {timeout:g} s, {stop:g} s to stop and room for {room}",
                "choose positive times, two points",
            )
        self.outputs, self.timeout, self.stop = tuple(outputs), float(timeout), float(stop)
        self._points: deque[tuple[float, Floats]] = deque(maxlen=room)
        self._stopped_at: tuple[float, Floats] | None = None  # since when it stops, and [yr; yr'; yr''] then
        self._state, self._last_read, self._lock = BufferState.EMPTY, -inf, threading.Lock()

    @property
    def state(self) -> BufferState:
        """What it gave last."""
        return self._state

    def push(self, t: float, position: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike | None = None) -> None:
        """Add the setpoint of time t [s], later than all before; an acceleration that is not given is zero.

        Raises:
            ShapeError: if t is not a number, or what is given are no numbers.
            SimulationError: if a number is missing or not finite, t is not later than the last point, or the buffer is
                full of points yet to come.
        """
        t = _seconds(t)
        zero = np.zeros(len(self.outputs))
        rows = [self._row(name, one) for name, one in (("yr", position), ("yr1", velocity))]
        rows.append(zero if acceleration is None else self._row("yr2", acceleration))
        with self._lock:
            if not isfinite(t):
                raise SimulationError(f"a setpoint at t = {t}", "give seconds")
            if self._points and t <= self._points[-1][0]:
                raise SimulationError(
                    f"a setpoint at {t:g} s follows one at {self._points[-1][0]:g} s", "go on in time"
                )
            if len(self._points) == self._points.maxlen and self._points[1][0] > self._last_read:
                raise SimulationError(
                    f"{len(self._points)} setpoints are still to come", "push later, or give more room"
                )
            self._points.append((t, np.array(rows)))

    def age(self, t: float) -> float:
        """The time since the last point [s], negative while there are points to come; infinite if none has come.

        Raises:
            ShapeError: if t is not a number.
        """
        t = _seconds(t)
        with self._lock:
            return t - self._points[-1][0] if self._points else inf

    def resume(self) -> None:
        """Forget all points and the stop: the next setpoint begins anew."""
        with self._lock:
            self._points.clear()
            self._stopped_at, self._state, self._last_read = None, BufferState.EMPTY, -inf

    def at(self, t: float) -> tuple[Floats, Floats, Floats]:
        """yr, yr', yr'' at time t [s], (n-m,) each.

        Raises:
            ShapeError: if t is not a number.
            SimulationError: if t is not finite, nothing has come yet, or t lies before what has been read.
        """
        t = _seconds(t)
        if not isfinite(t):
            raise SimulationError(f"a reference at t = {t}", "give seconds")
        with self._lock:
            if not self._points:
                raise SimulationError("no setpoint has come yet", "push one, and command nothing until then")
            if t < self._last_read:
                raise SimulationError(f"time went back from {self._last_read:g} s to {t:g} s", "read forward")
            self._last_read = t
            y = self._now(t)
        return y[0], y[1], y[2]

    def _row(self, name: str, given: ArrayLike) -> Floats:
        row = real_numbers(name, given, f"give {len(self.outputs)} finite numbers").reshape(-1)
        if row.shape != (len(self.outputs),) or not np.isfinite(row).all():
            raise SimulationError(f"{name} of a setpoint is {row}", f"give {len(self.outputs)} finite numbers")
        return row

    def _now(self, t: float) -> Floats:
        last, row = self._points[-1]
        if self._stopped_at is None and t > last + self.timeout:
            self._stopped_at = last + self.timeout, _moved(row, self.timeout)
        if self._stopped_at is not None:
            since, then = self._stopped_at
            passed = min(t - since, self.stop)
            self._state = BufferState.STOPPED if t - since >= self.stop else BufferState.STOPPING
            left = 1.0 - passed / self.stop
            y = then[0] + then[1] * passed * (1.0 - 0.5 * passed / self.stop)
            moves = self._state is BufferState.STOPPING
            return np.array([y, left * then[1], -moves * then[1] / self.stop])
        if t >= last:
            self._state = BufferState.HOLDING if t > last else BufferState.FRESH
            return _moved(row, t - last) if t > last else row
        self._state = BufferState.FRESH
        while len(self._points) > 2 and self._points[1][0] <= t:
            self._points.popleft()
        first, a = self._points[0]
        if t <= first:  # at rest where the first point will be
            return a if t == first else np.array([a[0], 0.0 * a[1], 0.0 * a[2]])
        second, b = self._points[1]
        return _between(a, b, second - first, t - first)


def _seconds(t: Any) -> float:
    """A time [s] as a float.

    Raises:
        ShapeError: if it is not a number.
    """
    if type(t) is float:
        return t
    value = real_numbers("t", t, "give seconds as a number")
    if value.ndim:
        raise ShapeError(f"t has shape {value.shape}", "give seconds as a number")
    return float(value)


def _moved(row: Floats, passed: float) -> Floats:
    """Where the velocity of a setpoint leads."""
    return np.array([row[0] + passed * row[1], row[1], 0.0 * row[1]])


def _between(a: Floats, b: Floats, step: float, passed: float) -> Floats:
    """yr, yr' and yr'' on the polynomial of degree 5 from setpoint a to b, `step` [s] later."""
    y = joined(a, b, step)
    rate = POWERS * y[:-1]
    return np.array([horner(part, passed) for part in (y, rate, POWERS[1:] * rate[:-1])])
