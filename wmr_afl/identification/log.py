"""A log: motor voltages and what was measured of a motion, on a uniform grid of time, segment by segment.

name            column              what it says of the motion
voltage         u_r                 held from its row to the next one [V]
encoder         angle:u_r           the angle of what the motor of that input drives: its rate is X_j v
                rate:u_r            the same as a rate, X_j v
coordinate      beta, phi, x        q_i: its rate is S_i v
                rate:phi            the same as a rate (a gyroscope), S_i v
pseudo-velocity v, omega            v_i
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.identification.columns import between, new_values, unwrapped, update_period
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

GAP = 2.5  # sample times without a row: a segment ends there
LONGEST = 0.5  # [s], from row to row
JITTER = 0.3  # of a sample time, by which the time from row to row may differ
SOME = 0.1  # of the rows, that may be further apart


@dataclass(frozen=True)
class Channel:
    """A measured column: a row of X, of S or of the identity times v, or what such a row integrates to."""

    name: str
    matrix: str  # "motor": X, "coordinate": S, "velocity": the identity
    index: int  # its row
    is_rate: bool  # whether the rate itself was measured


@dataclass(frozen=True)
class Segment:
    """T samples in a row."""

    name: str
    start: float  # [s]
    step: float  # sample time [s]
    u: Floats  # (T, n_u) [V], each held until the next sample
    z: Floats  # (T, channels), as measured
    is_new: NDArray[np.bool_]  # (T, channels), not a value between two that were measured

    @property
    def time(self) -> Floats:
        """(T,) [s]."""
        return np.asarray(self.start + self.step * np.arange(len(self.u)))

    def __len__(self) -> int:
        return len(self.u)

    def part(self, start: int, stop: int) -> Segment:
        """The samples from `start` to `stop`."""
        rows = slice(start, stop)
        later = self.start + start * self.step
        return replace(self, start=later, u=self.u[rows], z=self.z[rows], is_new=self.is_new[rows])

    def measuring(self, columns: Sequence[int]) -> Segment:
        """Only these channels."""
        return replace(self, z=self.z[:, columns], is_new=self.is_new[:, columns])


@dataclass(frozen=True)
class Log:
    """Segments with the same channels."""

    model: Model
    channels: tuple[Channel, ...]
    segments: tuple[Segment, ...]
    periods: Floats  # (channels,) [s], for which a channel keeps its value; 0 where every sample is a new one
    turned: tuple[str, ...] = ()  # channels that began anew after a turn and were counted on

    @property
    def duration(self) -> float:
        """[s]."""
        return sum(len(segment) * segment.step for segment in self.segments)

    def __repr__(self) -> str:
        names = ", ".join(channel.name for channel in self.channels)
        return f"<Log of {self.model.name}: {self.duration:.1f} s in {len(self.segments)} segments, measured {names}>"

    def of(self, segments: Sequence[Segment]) -> Log:
        """The same channels, other segments."""
        return replace(self, segments=tuple(segments))

    def measuring(self, columns: Sequence[int]) -> Log:
        """The same log with only these channels."""
        channels = tuple(self.channels[k] for k in columns)
        segments = tuple(one.measuring(columns) for one in self.segments)
        return replace(self, channels=channels, segments=segments, periods=self.periods[list(columns)])

    def joined(self, other: Log) -> Log:
        """Both logs' segments.

        Raises:
            WmrError: if something else was measured in the other one.
        """
        if other.channels != self.channels:
            first, second = (", ".join(channel.name for channel in log.channels) for log in (self, other))
            raise WmrError(f"one log measures {first}, another one {second}", "give logs with the same columns")
        turned = tuple(dict.fromkeys((*self.turned, *other.turned)))
        longest = np.maximum(self.periods, other.periods)
        return replace(self, segments=(*self.segments, *other.segments), periods=longest, turned=turned)


def channel(model: Model, name: str) -> Channel:
    """What a column measures.

    Raises:
        UnknownNameError: if it is no motor's angle or rate, coordinate, rate of one, or pseudo-velocity.
    """
    state, inputs = list(model.state_units), list(model.input_units)
    n = model.coordinate_count
    kind, _, of = name.rpartition(":")
    if kind in ("angle", "rate") and of in inputs:
        return Channel(name, "motor", inputs.index(of), kind == "rate")
    if kind in ("", "rate") and of in state[:n]:
        return Channel(name, "coordinate", state.index(of), kind == "rate")
    if not kind and of in state[n:]:
        return Channel(name, "velocity", state.index(of) - n, True)
    motors = [f"{one}:{motor}" for motor in inputs for one in ("angle", "rate")]
    raise UnknownNameError(
        "column", name, ["segment", "t", *inputs, *motors, *state, *(f"rate:{q}" for q in state[:n])]
    )


def log_of(
    model: Model,
    time: Floats,
    voltages: Floats,
    measured: Mapping[str, Floats],
    segments: Sequence[str] | None = None,
) -> Log:
    """A log from arrays: time (T,) [s], voltages (T, n_u) [V], and (T,) for each measured column by its name.

    The time from row to row may differ by a third of a sample; a gap of two samples begins another segment. Angles that
    begin anew after a turn are counted on; a column that is written more often than it is measured is a line from one
    new value to the next.

    Raises:
        ShapeError: if the columns have different lengths, or hold what is not a finite number.
        WmrError: if time stands still or goes backwards, rows are too irregular, or nothing is measured.
        UnknownNameError: if a column's name is unknown.
    """
    if not measured:
        raise WmrError("the log measures nothing", "add what was measured, as angle:u_r for a motor's encoder")
    channels = tuple(channel(model, name) for name in measured)
    t, u = np.asarray(time, dtype=float), np.asarray(voltages, dtype=float)
    z = (
        np.column_stack([np.asarray(column, dtype=float) for column in measured.values()])
        if len(t)
        else np.empty((0, 1))
    )
    if t.ndim != 1 or u.shape != (len(t), len(model.input_units)) or len(z) != len(t):
        raise ShapeError(
            f"time {t.shape}, voltages {u.shape} and measured {z.shape} do not fit", "give one row a sample"
        )
    whole = np.column_stack([t, u, z])
    if not np.all(np.isfinite(whole)):
        row = int(np.flatnonzero(~np.isfinite(whole).all(axis=1))[0])
        raise ShapeError(f"row {row + 1} of the log holds what is not a finite number", "leave such rows out")
    labels = np.asarray(["" for _ in t] if segments is None else segments)
    pieces: list[_Rows] = []
    starts = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1), len(t)] if len(t) else []
    for first, last in pairwise(starts):
        pieces += _cut(_Rows(str(labels[first]), t[first:last], u[first:last], z[first:last]), first)
    turned = _count_on(channels, list(model.state_units.values()), pieces)
    times = [one.t for one in pieces]
    periods = [update_period(times, [one.z[:, k] for one in pieces]) for k in range(len(channels))]
    uniform = tuple(_uniform(one, np.array(periods)) for one in pieces)
    return Log(model, channels, uniform, np.array(periods), turned)


@dataclass(frozen=True)
class _Rows:
    """Rows of a file without a gap."""

    name: str
    t: Floats  # (T,) [s]
    u: Floats  # (T, n_u) [V]
    z: Floats  # (T, channels)


def _cut(rows: _Rows, before: int) -> list[_Rows]:
    """Rows cut at gaps; parts that are too short are left out. `before` them the file has so many."""
    if len(rows.t) < 3:
        return []
    steps = np.diff(rows.t)
    if np.median(steps) > LONGEST:
        problem = f"rows are {np.median(steps):.3g} s apart"
        raise WmrError(problem, "give t in seconds (not milliseconds), and log at 50 Hz or more")
    if np.any(steps <= 0.0):
        at = int(np.flatnonzero(steps <= 0.0)[0])
        doing = "stands still" if steps[at] == 0.0 else "goes backwards"
        problem = f"time {doing} at t = {rows.t[at + 1]:g} s (row {before + at + 2})"
        raise WmrError(problem, "order the rows, and name tests that were run one after another in a column `segment`")
    cuts = [0, *(np.flatnonzero(steps > GAP * np.median(steps)) + 1), len(rows.t)]
    parts = [slice(first, last) for first, last in pairwise(cuts) if last - first >= 3]
    return [_Rows(rows.name, rows.t[part], rows.u[part], rows.z[part]) for part in parts]


def _count_on(channels: Sequence[Channel], units: Sequence[str], pieces: Sequence[_Rows]) -> tuple[str, ...]:
    """Count on, in their place, angles that begin anew after a turn; their names."""
    turned: dict[str, None] = {}
    for k, one in enumerate(channels):
        if one.is_rate or (one.matrix != "motor" and units[one.index] != "rad"):
            continue
        for piece in pieces:
            whole = unwrapped(piece.z[:, k])
            if np.any(whole != piece.z[:, k]):
                piece.z[:, k], turned[one.name] = whole, None
    return tuple(turned)


def _uniform(rows: _Rows, periods: Floats) -> Segment:
    """Rows on a uniform grid."""
    t, step = rows.t, float(np.median(np.diff(rows.t)))
    taken = np.round(np.diff(t) / step).astype(int)  # samples from row to row: a row may be missing
    even = float(t[-1] - t[0]) / max(int(taken.sum()), 1)
    grid = t[0] + even * np.arange(int(taken.sum()) + 1)
    if np.mean(np.abs(np.diff(t) / even - 1.0) > JITTER) > SOME:
        raise WmrError(f"rows near t = {t[0]:g} s are too irregular for a grid", "log at a fixed rate, or resample")
    held = np.clip(np.searchsorted(t, grid + 1e-9 * even, side="right") - 1, 0, len(t) - 1)
    z = np.column_stack([between(grid, t, column, period) for column, period in zip(rows.z.T, periods, strict=True)])
    is_new = np.ones(z.shape, dtype=bool)
    for k, period in enumerate(periods):
        if period:
            at = t[new_values(rows.z[:, k])]
            is_new[:, k] = np.isin(np.arange(len(grid)), np.round((at - t[0]) / even))
    return Segment(rows.name, float(t[0]), even, rows.u[held], z, is_new)
