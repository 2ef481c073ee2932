"""From what was measured to q, v and u, with one zero-phase filter for all of them; nothing is differentiated twice.

v is the weighted least-squares solution of all rows that were measured, X_j v = angle_j' and S_i v = q_i', each over
the noise of its rate. Coordinates without a column are integrated from q' = S v.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from wmr_afl.errors import WmrError
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.log import Channel, Segment, usual_columns
from wmr_afl.identification.noise import parabola
from wmr_afl.numerics.arrays import Floats

WIDTH = 0.03  # [s], half of the kernel
PASSIVE = 1e-3  # weight of joints that nothing drives, where motors and gyroscope determine v
STANDS = 3  # samples without a change, at which a test begins at rest
REST = 0.5  # [s] put in front of a test that starts at rest, so that its transient stays inside


@dataclass(frozen=True)
class Motion:
    """What a segment says of the motion, (T, .) each; rows that the kernel reaches over are `ok`."""

    segment: Segment
    x: Floats  # (T, 2n-m)
    u: Floats  # (T, n_u) [V], smoothed like the rest
    rates: Floats  # (T, channels), of what was measured
    ok: NDArray[np.bool_]  # (T,)


@dataclass(frozen=True)
class Smoother:
    """A log's channels as rows on v."""

    effort: Effort
    channels: tuple[Channel, ...]
    noise: Floats  # (channels,), of a sample
    period: float = 0.0  # [s], for which the slowest channel keeps its value
    width: float = WIDTH  # [s], half of the kernel, of three samples and two updates at least
    least: int = 3  # samples

    def __post_init__(self) -> None:
        if not self.used.any():
            names, usual = ", ".join(one.name for one in self.channels), ", ".join(usual_columns(self.effort.model))
            problem = f"{names} alone {'does' if len(self.channels) == 1 else 'do'} not tell how the robot moves"
            raise WmrError(problem, f"add encoders and gyroscope ({usual}), or what there is of them")
        x = np.random.default_rng(0).normal(size=(4, self.effort.n))
        rank = int(np.linalg.matrix_rank(self.rows(x)[:, self.used]).min())
        if rank < self.effort.n_v:
            names = ", ".join(channel.name for channel in self.channels)
            problem = f"{names} determine {rank} of {self.effort.n_v} pseudo-velocities"
            motors = [f"angle:{motor}" for motor in self.effort.model.input_units]
            raise WmrError(problem, f"add the encoders of all motors ({', '.join(motors)}) or a gyroscope (rate:phi)")

    @property
    def measured(self) -> list[int]:
        """Coordinates with a column."""
        return [one.index for one in self.channels if one.matrix == "coordinate" and not one.is_rate]

    @property
    def used(self) -> NDArray[np.bool_]:
        """Whether a channel says something: a position in the plane does not if the heading is not measured."""
        hidden = [i for i in range(self.effort.n) if self.effort.cyclic[i] and i not in self.measured]
        x = np.random.default_rng(0).normal(size=(4, self.effort.n))
        moved = x.copy()
        moved[:, hidden] += 1.0
        return np.asarray(np.isclose(self.rows(x), self.rows(moved)).all(axis=(0, 2)))

    def half(self, step: float) -> int:
        """Half of the kernel, in samples of `step` [s]: two updates of the slowest channel at least."""
        return int(max(self.least, round(self.width / step), np.ceil(2.0 * self.period / step - 1e-9)))

    def reach(self, step: float) -> int:
        """Samples that what is read off a log needs before and after."""
        return self.half(step) + 1

    def averaged(self, rates: Floats, step: float) -> Floats:
        """Rates (T, ...) through the filter, without the samples at both ends that it needs."""
        level, _ = self._kernels(step)
        return np.asarray(sliding_window_view(rates, len(level), axis=0) @ level)

    def motion(self, segment: Segment) -> Motion:
        """q, v and u of a segment."""
        dt, h = segment.step, self.reach(segment.step)
        level, slope = self._kernels(dt)
        count = len(segment)
        inside = slice(h, count - h)
        u, x = self.smoothed(segment), np.zeros((count, self.effort.n + self.effort.n_v))
        ok = np.zeros(count, dtype=bool)
        if count <= 2 * h + 1:
            return Motion(segment, x, u, np.zeros_like(segment.z), ok)
        ok[inside] = True
        z = np.zeros((count, len(self.channels)))
        for k, channel in enumerate(self.channels):
            column = segment.z[:, k]
            z[inside, k] = np.correlate(column, level if channel.is_rate else slope, "valid")
            if channel.index in self.measured and channel.matrix == "coordinate" and not channel.is_rate:
                x[inside, channel.index] = np.correlate(column, level, "valid")
                x[:h, channel.index], x[count - h :, channel.index] = (
                    x[h, channel.index],
                    x[count - h - 1, channel.index],
                )
        weights = self._weights(level, slope)
        hidden = [i for i in range(self.effort.n) if i not in self.measured and not self.effort.cyclic[i]]
        if hidden:
            self._follow(x, z, weights, hidden, range(h, count - h), dt)
        else:
            x[inside, self.effort.n :] = self._velocity(x[inside, : self.effort.n], z[inside], weights)
        return Motion(segment, x, u, z, ok)

    def spread(self, segment: Segment, x: Floats) -> Floats:
        """The standard deviation that noise gives v at states x (T, 2n-m), root mean square over these, (n-m,)."""
        rows = self.rows(x[:, : self.effort.n]) * self._weights(*self._kernels(segment.step))[:, None]
        covariance = np.linalg.inv(np.einsum("tki,tkj->tij", rows, rows))
        return np.asarray(np.sqrt(np.mean(np.einsum("tii->ti", covariance), axis=0)))

    def _kernels(self, step: float) -> tuple[Floats, Floats]:
        """That smooth, and that differentiate: what they give has passed the same filter, as the voltages have.

        A difference over two samples is the mean of the rate over them; rates and voltages are averaged alike.
        """
        kernel = parabola(self.half(step))
        difference = np.array([-0.5, 0.0, 0.5]) / step
        return np.convolve(kernel, [0.25, 0.5, 0.25]), np.convolve(kernel, difference)

    def smoothed(self, segment: Segment) -> Floats:
        """The voltages (T, n_u) through the same filter: the mean of those held before and after a sample, smoothed."""
        held = segment.u.copy()
        held[1:] = 0.5 * (segment.u[1:] + segment.u[:-1])
        u, half = np.zeros_like(held), self.half(segment.step)
        if len(u) > 2 * half + 1:
            u[half:-half] = np.column_stack([np.correlate(one, parabola(half), "valid") for one in held.T])
        return u

    def _follow(self, x: Floats, z: Floats, weights: Floats, hidden: list[int], rows: range, dt: float) -> None:
        """Coordinates without a column from q' = S v by the midpoint rule; from zero where the segment begins."""
        n, q = self.effort.n, x[rows[0], : self.effort.n].copy()
        for t in rows:
            measured = x[t, :n].copy()
            measured[hidden] = q[hidden]
            x[t, :n] = measured
            v = self._velocity(measured[None], z[t : t + 1], weights)[0]
            x[t, n:] = v
            middle = measured + 0.5 * dt * (self.effort.kinematic(measured) @ v)
            q = measured + dt * (self.effort.kinematic(middle) @ v)

    def _velocity(self, q: Floats, z: Floats, weights: Floats) -> Floats:
        rows = self.rows(q) * weights[:, None]
        normal = np.einsum("tki,tkj->tij", rows, rows)
        right = np.einsum("tki,tk->ti", rows, z * weights)
        return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])

    def rows(self, q: Floats) -> Floats:
        """What each channel's rate is, times v: (T, channels, n-m)."""
        s, x = self.effort.kinematic(q), self.effort.motor_rates(q)
        s, x = (np.broadcast_to(one, (len(q), *one.shape[-2:])) for one in (s, x))
        unit = np.broadcast_to(np.eye(self.effort.n_v), (len(q), self.effort.n_v, self.effort.n_v))
        matrices = {"motor": x, "coordinate": s, "velocity": unit}
        return np.stack([matrices[one.matrix][:, one.index] for one in self.channels], axis=1)

    def _weights(self, level: Floats, slope: Floats) -> Floats:
        """1/noise of each rate after the kernel; those of passive joints are small if the others suffice."""
        kernels = np.array([np.linalg.norm(level if one.is_rate else slope) for one in self.channels])
        weights = self.used / (self.noise * kernels)
        joints = np.array([self.effort.is_joint(one) for one in self.channels])
        q = np.random.default_rng(0).normal(size=(4, self.effort.n))
        others = self.rows(q)[:, self.used & ~joints]
        if others.shape[1] and np.linalg.matrix_rank(others).min() == self.effort.n_v:
            weights[joints] *= PASSIVE
        return np.asarray(weights)


def with_rest(segment: Segment, is_rate: Floats) -> Segment:
    """With half a second of rest without voltage in front, if nothing moves at first.

    Voltage may be there already: a logger begins with the command, and motors answer later.
    """
    first = segment.z[:STANDS]
    if np.any(first != first[0]) or np.any(first[:, is_rate]):
        return segment
    count = round(REST / segment.step)
    u = np.vstack([np.zeros((count, segment.u.shape[1])), segment.u])
    z = np.vstack([np.repeat(segment.z[:1], count, axis=0), segment.z])
    is_new = np.vstack([np.repeat(segment.is_new[:1], count, axis=0), segment.is_new])
    return replace(segment, start=segment.start - count * segment.step, u=u, z=z, is_new=is_new)
