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
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.identification.columns import spikes, unwrapped, update_period
from wmr_afl.identification.rows import Rows, cut, on_grid
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


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
    spikes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # channel -> times of cells left out [s]
    lost: float = 0.0  # of the rows, that are missing
    jitter: float = 0.0  # of a sample, by which the time from row to row usually differs

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
        jumping = dict.fromkeys((*self.spikes, *other.spikes))
        return replace(
            self,
            segments=(*self.segments, *other.segments),
            periods=np.maximum(self.periods, other.periods),
            turned=turned,
            spikes={name: (*self.spikes.get(name, ()), *other.spikes.get(name, ())) for name in jumping},
            lost=max(self.lost, other.lost),
            jitter=max(self.jitter, other.jitter),
        )


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
    hint = f"it is a voltage; did you mean 'angle:{of}'?" if name in inputs else ""
    raise UnknownNameError("column", name, measurable(model), hint)


def measurable(model: Model) -> list[str]:
    """The names of all columns that can be measured."""
    state = list(model.state_units)
    motors = [f"{one}:{motor}" for motor in model.input_units for one in ("angle", "rate")]
    return [*motors, *state, *(f"rate:{q}" for q in state[: model.coordinate_count])]


def usual_columns(model: Model) -> list[str]:
    """The encoders of all motors, the angles of joints, and the rate of the heading."""
    n = model.coordinate_count
    units = dict(list(model.state_units.items())[:n])
    headings = {name for frame in model.metadata["geometry"]["frames"].values() for name in (frame["heading"],)}
    bases = [name for name in units if name in headings]
    joints = [name for name, unit in units.items() if unit == "rad" and name not in bases]
    return [*(f"angle:{motor}" for motor in model.input_units), *joints, *(f"rate:{name}" for name in bases)]


def log_of(
    model: Model,
    time: Floats,
    voltages: Floats,
    measured: Mapping[str, Floats],
    segments: Sequence[str] | None = None,
) -> Log:
    """A log from arrays: time (T,) [s], voltages (T, n_u) [V], and (T,) for each measured column by its name.

    Rows need no fixed rate, and some may be lost (`rows`); a gap of more than five samples begins another segment.
    Angles that begin anew after a turn are counted on, cells that are spikes left out; a column that is written more
    often than it is measured is a line from one new value to the next.

    Raises:
        ShapeError: if the columns have different lengths, or hold what is not a finite number.
        WmrError: if time stands still or goes backwards, too many rows are lost, or nothing is measured.
        UnknownNameError: if a column's name is unknown.
    """
    if not measured:
        usual = ", ".join(usual_columns(model))
        raise WmrError("the log measures no motion", f"add encoders and gyroscope ({usual}), or what there is of them")
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
    pieces: list[Rows] = []
    starts = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1), len(t)] if len(t) else []
    for first, last in pairwise(starts):
        pieces += cut(Rows(str(labels[first]), t[first:last], u[first:last], z[first:last]), first)
    turned = _count_on(channels, list(model.state_units.values()), pieces)
    bad = [np.column_stack([spikes(column) for column in one.z.T]) for one in pieces]
    times = [one.t for one in pieces]
    periods = np.array([update_period(times, [one.z[:, k] for one in pieces]) for k in range(len(channels))])
    grids = [on_grid(one, periods, own) for one, own in zip(pieces, bad, strict=True)]
    jumps = {
        one.name: tuple(float(at) for piece, own in zip(pieces, bad, strict=True) for at in piece.t[own[:, k]])
        for k, one in enumerate(channels)
    }
    return Log(
        model,
        channels,
        tuple(
            Segment(piece.name, float(piece.t[0]), grid.step, grid.u, grid.z, grid.is_new)
            for piece, grid in zip(pieces, grids, strict=True)
        ),
        periods,
        turned,
        {name: at for name, at in jumps.items() if at},
        lost=max((grid.lost for grid in grids), default=0.0),
        jitter=max((grid.jitter for grid in grids), default=0.0),
    )


def _count_on(channels: Sequence[Channel], units: Sequence[str], pieces: Sequence[Rows]) -> tuple[str, ...]:
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
