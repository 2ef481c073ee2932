"""Base parameters by output error: windows are simulated from the voltages and compared with what was measured, raw.

    min over unknown, {s0_w, o_w}   sum_w g_w sum_k | (z_wk - o_w - zhat_k(unknown, s0_w))/noise |^2   (I8)

First velocities and joint angles s0_w, and offsets o_w of the channels, belong to a window and are eliminated from
every linearized step by a QR decomposition of their sensitivities. Nothing measured is differentiated. The cost is 1
if the model explains the log down to its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import SimulationError
from wmr_afl.identification.estimate import Estimate, Prior, jackknife
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.simulated import FINEST, SUBSTEP, Simulated, channel_values
from wmr_afl.numerics.arrays import Floats

WINDOW = 1.0  # [s]
LOOSE = 0.2  # of a velocity's root mean square, by which that of a window's start may be off
JOINT = 4.0  # times the noise of a measured joint, by which its angle may be off: encoders cut off, they do not round
OUTLIER = 3.0  # medians, beyond which a window counts less
ROUNDS = 12
TRIES = 5  # of a step, with more and more damping
SEARCHES = 4  # more with finer steps or other weights of the channels, at most
ENOUGH = 0.5  # of the windows' weight, that is left where steps are fine enough
LEAST = 1e-3  # of a window's weight, that remains however coarse its steps
SETTLED = 0.05  # by which windows' weights may change, on average, without another search
ALIKE = 1.5  # times what it is taken for, that is left of a channel
_DONE = 0.1  # of what noise leaves of one sample, by which a round has to lessen the cost
_DIFFERENCE = 1e-4  # of a number, for its sensitivity
_HUGE = 1e60  # times the noise: a motion that leaves the world, or is no number
_ROWS = 4096  # motions that are simulated at a time


@dataclass(frozen=True)
class Windows:
    """Pieces of a log of the same length: W windows of K samples."""

    x0: Floats  # (W, 2n-m), the state with which each begins
    u: Floats  # (W, K, n_u) [V], held
    z: Floats  # (W, K+1, channels), from their first sample
    is_new: NDArray[np.bool_]  # (W, K+1, channels), not a value that is repeated
    weight: Floats  # (W,), so that all segments count alike
    step: float  # [s]

    def __len__(self) -> int:
        return len(self.x0)

    def part(self, chosen: slice) -> Windows:
        return replace(
            self,
            x0=self.x0[chosen],
            u=self.u[chosen],
            z=self.z[chosen],
            is_new=self.is_new[chosen],
            weight=self.weight[chosen],
        )


def delayed(u: Floats, delay: float, step: float) -> Floats:
    """What of a held u (T, n_u) acts on average from sample to sample, `delay` [s] later."""
    whole = int(np.floor(delay / step + 1e-9))
    part = delay / step - whole

    def shifted(samples: int) -> Floats:
        return u[np.clip(np.arange(len(u)) - samples, 0, len(u) - 1)]

    return np.asarray((1.0 - part) * shifted(whole) + part * shifted(whole + 1))


def windows_of(motions: Sequence[Motion], seconds: float) -> list[Windows]:
    """Windows of all segments, those of one sample time together; half overlapping where a segment holds few."""
    found: dict[float, list[Windows]] = {}
    for motion in motions:
        step = motion.segment.step
        count = max(4, round(seconds / step))
        good = np.flatnonzero(motion.ok)
        if len(good) < count + 1:
            continue
        stride = count if len(good) > 10 * count else max(1, count // 2)
        starts = np.arange(good[0], good[-1] - count + 1, stride)
        rows = starts[:, None] + np.arange(count + 1)
        z = motion.segment.z[rows]
        own = Windows(
            motion.x[starts],
            motion.segment.u[rows[:, :-1]],
            z - z[:, :1],
            motion.segment.is_new[rows],
            np.full(len(starts), len(starts) ** -0.5),
            step,
        )
        found.setdefault(round(step, 9), []).append(own)
    total = sum(len(own) for group in found.values() for own in group)
    share = np.sqrt(total / max(sum(map(len, found.values())), 1))
    return [
        Windows(
            x0=np.concatenate([own.x0 for own in group]),
            u=np.concatenate([own.u for own in group]),
            z=np.concatenate([own.z for own in group]),
            is_new=np.concatenate([own.is_new for own in group]),
            weight=share * np.concatenate([own.weight for own in group]),
            step=group[0].step,
        )
        for group in found.values()
    ]


@dataclass(frozen=True)
class SimulatedEstimate(Estimate):
    """With what only output error tells."""

    cost: float = np.nan  # root mean square of what is left of the windows, in units of the noise
    left: Floats = field(default_factory=lambda: np.empty(0))  # (channels,), root mean square in their units
    substep: float = SUBSTEP  # [s], that was fine enough


@dataclass(frozen=True)
class _Linearized:
    """All windows at one point of the search, first states and offsets eliminated."""

    gram: Floats  # (W, n+1, n+1), products of the scaled sensitivities and of what is left
    start: Floats  # (W, loose), by which first states move if nothing else does
    start_slope: Floats  # (W, loose, n), and less for a step of each unknown
    channels: Floats  # (W, channels), what is left of each channel's squares

    @property
    def squares(self) -> Floats:
        """(W,), what is left of each window."""
        return self.gram[:, -1, -1]

    def cost(self, weight: Floats) -> float:
        return float(weight @ self.squares) if np.all(np.isfinite(self.gram)) else np.inf


class OutputError:
    """The search over windows of one log."""

    def __init__(self, smoother: Smoother, windows: Sequence[Windows], prior: Prior, substep: float = SUBSTEP) -> None:
        self.effort, self.windows = smoother.effort, list(windows)
        self.used = np.flatnonzero(smoother.used)
        self.channels, self.noise = [smoother.channels[k] for k in self.used], smoother.noise[self.used]
        self.prior, self.mean, self.precision = prior, prior.mean[prior.is_free], prior.precision
        self.shares = np.concatenate([windows.weight for windows in self.windows]) ** 2
        self.trust = np.ones(len(self.shares))
        joints = {one.index: k for k, one in enumerate(smoother.channels) if smoother.effort.is_joint(one)}
        self.loose = [*joints, *range(self.effort.n, self.effort.n + self.effort.n_v)]
        v0 = np.concatenate([windows.x0[:, self.effort.n :] for windows in self.windows])
        rest = LOOSE * np.sqrt(np.mean(v0**2, axis=0)) + 1e-9
        self.spread = np.concatenate([JOINT * smoother.noise[list(joints.values())], rest])
        self.first = np.concatenate([windows.x0[:, self.loose] for windows in self.windows])
        self.substep, self.error = substep, self.noise
        self.samples = sum(int(windows.is_new[:, 1:, self.used].sum()) for windows in self.windows)

    def fit(self, start: Floats, rounds: int = ROUNDS) -> SimulatedEstimate:
        """The search from a first estimate (unknown,), by Levenberg and Marquardt.

        Channels that the model explains less well than their noise count as much as what it leaves of them. The
        description counts less the more the model leaves: what is left is alike along a window, then.

        Raises:
            SimulationError: if the robot of the first estimate cannot be simulated.
        """
        self.error, self.trust = self.noise, self._trust(start)
        found = self._search(start, rounds)
        for _ in range(SEARCHES):
            before, trust = (self.substep, self.trust), self._trust(found.unknown)
            while self.substep > FINEST and trust.mean() < ENOUGH:
                self.substep *= 0.5
                trust = self._trust(found.unknown)
            explains = np.all(found.left < ALIKE * self.error)
            is_settled = self.substep == before[0] and np.abs(trust - before[1]).mean() < SETTLED
            if explains and is_settled:
                break
            if not explains:
                self.error = np.maximum(self.noise, found.left)
            self.trust = trust
            found = self._search(found.unknown, rounds)
        return found

    def _trust(self, unknown: Floats) -> Floats:
        """How much each window counts, (W,): less, the more halving the steps changes what is foretold.

        Where friction reverses a motor in the middle of a step that is an error of first order, alike along the window:
        twice the change remains, and counts as one more standard deviation of the window's.
        """
        found, coarse = [], self.substep
        for windows in self.windows:
            numbers = np.repeat(unknown[None, self.prior.is_free], len(windows), axis=0)
            seen = []
            for self.substep in (coarse, 0.5 * coarse):
                seen.append(self._simulated(numbers, windows.x0, windows.u, windows.step) / self.error)
            self.substep = coarse
            change = seen[1] - seen[0]
            change -= change.mean(axis=1, keepdims=True)  # offsets take it
            with np.errstate(all="ignore"):
                found.append(1.0 / (1.0 + 4.0 * np.sum(change**2, axis=(1, 2))))
        return np.maximum(np.nan_to_num(np.concatenate(found)), LEAST)

    def misfit(self, estimate: Estimate) -> float:
        """What an estimate leaves of these windows, over the noise; first states and offsets at their best.

        A window that is far off counts less: near a singularity the best of estimates foretells nothing.
        """
        self.error = self.noise
        unknown = estimate.unknown[self.prior.is_free]
        first = self.first
        for _ in range(2):
            now = self._linearized(unknown, None, first)
            if not np.all(np.isfinite(now.squares)):
                return np.inf
            first = first + now.start
        return float(np.sqrt(now.cost(self._weight(now)) / self.samples))

    @property
    def weight(self) -> Floats:
        """Of each window's squares, (W,): segments count alike, windows that are integrated coarsely less."""
        return np.asarray(self.shares * self.trust / max(float(self.trust.mean()), 1e-12))

    def _search(self, start: Floats, rounds: int) -> SimulatedEstimate:
        unknown = start[self.prior.is_free]
        scale = np.where(unknown != 0.0, np.abs(unknown), 1e-3 * np.abs(unknown).max())
        first = self.first
        now = self._linearized(unknown, scale, first)
        if not np.isfinite(now.cost(self.weight)):
            raise SimulationError("the first estimate is no robot that can be simulated", "give a longer, livelier log")
        damping = 1e-3
        for _ in range(rounds):
            weight, precision = self._weight(now), self._precision(now)
            cost = now.cost(weight) + self._surprise(unknown, precision)
            normal, gradient = self._normal(now, weight, scale**2 * precision)
            gradient = gradient - scale * precision * (unknown - self.mean)
            least = _DONE * cost / self.samples
            promised = float(gradient @ np.linalg.solve(normal, gradient))
            for _ in range(TRIES if promised > least else 1):  # more damping gives less still
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
                other = self._limited(unknown, scale * step)
                moved = first + now.start - now.start_slope @ ((other - unknown) / scale)
                tried = self._linearized(other, None, moved).cost(weight) + self._surprise(other, precision)
                if tried < cost:
                    break
                damping *= 10.0
            else:
                break
            unknown, first, now, damping = other, moved, self._linearized(other, scale, moved), damping / 10.0
            if cost - tried < least:
                break
        self.first = first + now.start
        return self._found(unknown, scale, now)

    def _precision(self, now: _Linearized) -> Floats:
        """Of the prior, in units of what is left: of noise each sample counts, of the model's own errors a window."""
        own, samples = 1.0 - np.mean((self.noise / self.error) ** 2), self.samples / len(self.weight)
        return np.asarray(self.precision * max(1.0, now.cost(self.weight) / self.samples) * (1.0 + own * samples))

    def _surprise(self, unknown: Floats, precision: Floats) -> float:
        """What the prior adds to the cost."""
        return float(precision @ (unknown - self.mean) ** 2)

    def _weight(self, now: _Linearized) -> Floats:
        """The same, and windows that are far off less."""
        rms = np.sqrt(now.squares)
        return np.asarray(self.weight * np.minimum(1.0, OUTLIER * np.median(rms) / np.maximum(rms, 1e-300)) ** 2)

    def _normal(self, now: _Linearized, weight: Floats, precision: Floats) -> tuple[Floats, Floats]:
        """Matrix and right side of the step of the unknown numbers, in units of their scale."""
        gram = np.einsum("w,wij->ij", weight, now.gram)
        normal = gram[:-1, :-1] + np.diag(precision)
        return normal + 1e-14 * np.trace(normal) * np.eye(len(normal)), gram[:-1, -1]

    def _limited(self, unknown: Floats, step: Floats) -> Floats:
        """The next point: no number changes by more than half."""
        most = 0.5 * np.abs(unknown) + 1e-3 * np.abs(unknown).max()
        return np.asarray(unknown + step * min(1.0, float(np.min(most / np.maximum(np.abs(step), 1e-300)))))

    def _found(self, unknown: Floats, scale: Floats, now: _Linearized) -> SimulatedEstimate:
        weight = self._weight(now)
        windows = weight[:, None, None] * now.gram
        covariance = jackknife(windows[:, :-1, :-1], windows[:, :-1, -1], scale**2 * self._precision(now))
        covariance = covariance * np.outer(scale, scale)
        left = self.error * np.sqrt(self.weight @ now.channels / self.samples * len(self.channels))
        return SimulatedEstimate(
            "output error",
            unknown=self.prior.whole(unknown),
            covariance=self.prior.spread_out(covariance),
            cost=float(np.sqrt(np.mean((left / self.noise) ** 2))),
            left=left,
            substep=self.substep,
        )

    def _linearized(self, unknown: Floats, scale: Floats | None, first: Floats) -> _Linearized:
        """At these numbers and first states; without a scale only what is left at the best first states and offsets."""
        parts, begun = [], 0
        variants = 1 + (0 if scale is None else len(unknown)) + len(self.loose)
        for windows in self.windows:
            at_a_time = max(1, _ROWS // variants)
            for start in range(0, len(windows), at_a_time):
                part = windows.part(slice(start, start + at_a_time))
                parts.append(self._eliminated(part, unknown, scale, first[begun : begun + len(part)]))
                begun += len(part)
        return _Linearized(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def _eliminated(
        self, windows: Windows, unknown: Floats, scale: Floats | None, first: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """What `_Linearized` holds, of some windows: sensitivities by differences, all motions at once."""
        scale = np.empty(0) if scale is None else scale
        count, n_s, n = len(windows), len(self.loose), len(scale)
        steps = _DIFFERENCE * np.concatenate([scale, self.spread])
        changes = np.vstack([np.zeros((1, n + n_s)), np.diag(steps)])
        numbers = np.repeat(np.broadcast_to(unknown, (1 + n + n_s, len(unknown))), count, axis=0)
        numbers[:, :n] += np.repeat(changes[:, :n], count, axis=0)
        x0 = np.tile(windows.x0, (1 + n + n_s, 1))
        x0[:, self.loose] = (first + changes[:, None, n:]).reshape(-1, n_s)
        u = np.broadcast_to(windows.u, (1 + n + n_s, *windows.u.shape)).reshape(-1, *windows.u.shape[1:])
        with np.errstate(all="ignore"):
            seen = self._simulated(numbers, x0, u, windows.step) / self.error
        if not np.all(np.abs(seen) < _HUGE):
            nothing = np.full((count, n + 1, n + 1), np.inf)
            return nothing, np.zeros((count, n_s)), np.zeros((count, n_s, n)), np.zeros((count, len(self.channels)))
        seen = seen.reshape(1 + n + n_s, count, -1)
        left = (windows.z[:, :, self.used] / self.error).reshape(count, -1) - seen[0]
        slopes = np.moveaxis((seen[1:] - seen[0]) / steps[:, None, None], 0, -1)
        slopes[..., :n] *= scale
        offsets = np.broadcast_to(
            np.tile(np.eye(len(self.channels)), (windows.z.shape[1], 1)), (count, left.shape[1], len(self.channels))
        )
        is_new = windows.is_new[:, :, self.used].reshape(count, -1)
        local = np.concatenate([slopes[..., n:], offsets], axis=-1) * is_new[..., None]
        left, slopes = left * is_new, slopes * is_new[..., None]
        loose = np.zeros((count, n_s, local.shape[-1]))  # rows that hold first states: at rest friction hides them
        loose[:, :, :n_s] = np.diag(1.0 / self.spread)
        local = np.concatenate([local, loose], axis=1)
        left = np.concatenate([left, (windows.x0[:, self.loose] - first) / self.spread], axis=1)
        slopes = np.concatenate([slopes, np.zeros((count, n_s, slopes.shape[-1]))], axis=1)
        sizes = np.abs(local).max(axis=1, keepdims=True) + 1e-300
        q, r = np.linalg.qr(local / sizes)
        whole = np.concatenate([slopes[..., :n], left[..., None]], axis=-1)
        along = np.einsum("wki,wkj->wij", q, whole)
        rest = whole - np.einsum("wki,wij->wkj", q, along)
        moves = np.linalg.solve(r + 1e-14 * np.eye(r.shape[-1]), along)[:, :n_s] / np.moveaxis(sizes, 1, 2)[:, :n_s]
        squares = np.sum(rest[:, :-n_s, -1].reshape(count, -1, len(self.channels)) ** 2, axis=1)
        return np.einsum("wki,wkj->wij", rest, rest), moves[..., -1], moves[..., :-1], squares

    def _simulated(self, numbers: Floats, x0: Floats, u: Floats, step: float) -> Floats:
        """The used channels (N, K+1, .) of motions from x0 (N, 2n-m) under u (N, K, n_u), less where they begin."""
        states = Simulated(self.effort, step, self.substep).states(self.prior.whole(numbers), x0, u)
        every = channel_values(self.effort, self.channels, states.transpose(1, 0, 2).reshape(states.shape[1], -1))
        every = every.reshape(len(states), len(x0), -1).transpose(1, 0, 2)
        return np.asarray(every - every[:, :1])
