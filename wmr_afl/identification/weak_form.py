"""Base parameters by the weak form: test functions psi take the derivative from the velocities, none is computed.

    sum psi R_1 u_1 = sum [psi (Y_0 - sum_i (dY_i/dt) v_i) - psi' sum_i Y_i v_i] pi - ...     along a window (I7)

Rows of a window are left out if a motor stands under voltage for more than a tenth of it: friction is undetermined
there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.identification.effort import FRICTION_WIDTH, Effort, blocks
from wmr_afl.identification.estimate import Estimate, Prior, jackknife
from wmr_afl.identification.motion import Motion
from wmr_afl.numerics.arrays import Floats

WINDOW = 0.24  # [s], half of a test function
SHORT = 0.15  # [s], the same where segments last two seconds or less
STANDS = 0.1  # of a window, during which a motor may stand under voltage
UNDER_VOLTAGE = 0.02  # of the largest voltage
FIRST = 1e-6  # of the prior as long as it is not known how little is left: a wrong description leaves much
COMMON = 8.0  # windows that a sample lies in: so many rows are worth one
OVERLAP = 16  # windows in a row that are no independent witnesses: two lengths of one
_CHUNK = 20_000  # samples that are worked on at a time


@dataclass(frozen=True)
class Rows:
    """Least squares rows: matrix (N, unknown) and right side (N,), of all windows and pseudo-velocities."""

    matrix: Floats
    right: Floats
    kind: Floats  # (N,), which pseudo-velocity


def bump(half: int) -> tuple[Floats, Floats]:
    """(1 - (k/(L+1))^2)^3 for k = -L ... L, and its slope by sample: both are zero at the ends."""
    s = np.arange(-half, half + 1) / (half + 1)
    return (1.0 - s**2) ** 3, -6.0 * s * (1.0 - s**2) ** 2 / (half + 1)


def rows_of(effort: Effort, motion: Motion, window: float, shown: Sequence[int]) -> Rows:
    """The windows of a segment, a quarter of a half window apart; rows of the pseudo-velocities that are `shown`."""
    dt = motion.segment.step
    half = max(4, round(window / dt))
    stride = max(1, half // 4)
    psi, slope = bump(half)
    weight = psi.sum()
    empty = Rows(np.empty((0, len(effort.units))), np.empty(0), np.empty(0, dtype=int))
    good = np.flatnonzero(motion.ok)
    if len(good) < 2 * half + 1:
        return empty
    matrices, rights, kinds = [], [], []
    for first in range(int(good[0]), int(good[-1]) + 1, _CHUNK):
        stop = min(first + _CHUNK + 2 * half, int(good[-1]) + 1)
        if stop - first < 2 * half + 1:
            break
        a, b, right, still = _terms(effort, motion, slice(first, stop))
        for start in range(0, min(stop - first - 2 * half, _CHUNK), stride):
            part = slice(start, start + 2 * half + 1)
            if psi @ still[part] > STANDS * weight:
                continue
            row = np.einsum("t,tup->up", psi, a[part]) - np.einsum("t,tup->up", slope / dt, b[part])
            matrices.append(row[list(shown)] / weight)
            rights.append(psi @ right[part][:, list(shown)] / weight)
            kinds.append(np.arange(len(shown)))
    if not matrices:
        return empty
    return Rows(np.concatenate(matrices), np.concatenate(rights), np.concatenate(kinds))


def _terms(effort: Effort, motion: Motion, part: slice) -> tuple[Floats, Floats, Floats, Floats]:
    """What psi multiplies (T, n-m, unknown), what psi' multiplies, R_1 u_1 (T, n-m), and if a motor stands (T,)."""
    x, u = motion.x[part], motion.u[part]
    a, b, first, rates = effort.weak_terms.map(len(x))(x.T, u.T)
    under = np.abs(u) > UNDER_VOLTAGE * np.abs(motion.u).max()
    still = ((np.abs(np.asarray(rates).T) < 2.0 * FRICTION_WIDTH) & under).any(axis=1)
    return blocks(a, len(x)), blocks(b, len(x)), np.asarray(first).T, still.astype(float)


@dataclass(frozen=True)
class WeakEstimate(Estimate):
    """With what only the weak form tells."""

    share: Floats = field(default_factory=lambda: np.empty(0))  # (unknown,), of each number in the voltages
    left: float = np.nan  # of the voltages, what is unexplained


@dataclass(frozen=True)
class WeakForm:
    """How the weak form is used on a log."""

    effort: Effort
    prior: Prior
    window: float  # [s], half of a test function
    shown: tuple[int, ...]  # pseudo-velocities that the log shows: rows of the others hold noise only

    def estimate(self, motions: Sequence[Motion]) -> WeakEstimate:
        """The unknown numbers, every segment counting alike.

        Raises:
            WmrError: if no window is left.
        """
        found = [
            rows
            for rows in (rows_of(self.effort, motion, self.window, self.shown) for motion in motions)
            if len(rows.right)
        ]
        if not found:
            problem = f"no {2 * self.window:g} s of the log are free of standstill under voltage"
            raise WmrError(problem, "log a motion that lasts, with voltages well above friction")
        total = sum(len(rows.right) for rows in found)
        shares = np.concatenate(
            [np.full(len(rows.right), np.sqrt(total / len(rows.right) / len(found))) for rows in found]
        )
        matrix, right, kind = (
            np.concatenate([getattr(one, name) for one in found]) for name in ("matrix", "right", "kind")
        )
        voltage, free = right, self.prior.is_free
        right = voltage - matrix[:, ~free] @ self.prior.mean[~free]
        scale = np.array([np.sqrt(np.mean(voltage[kind == i] ** 2)) for i in range(len(self.shown))])
        size = np.maximum(scale, 1e-9 * scale.max())[kind]
        share = np.sqrt(np.mean((matrix / size[:, None]) ** 2, axis=0))
        matrix, unknown, precision = matrix[:, free], self.prior.mean[free], COMMON * self.prior.precision
        for trust in (FIRST, 1.0, 1.0):  # rows of a pseudo-velocity by what is left in them
            weights = shares / np.maximum(scale, 1e-9 * scale.max())[kind]
            rows, wanted = matrix * weights[:, None], right * weights
            unknown = solved(rows, wanted, self.prior.mean[free], trust * precision)
            left = right - matrix @ unknown
            scale = np.array([np.sqrt(np.mean(left[kind == i] ** 2)) for i in range(len(self.shown))])
        weights = shares / np.maximum(scale, 1e-9 * scale.max())[kind]
        rows = matrix * weights[:, None]
        scores = rows * (left * weights)[:, None]
        ends = range(0, len(scores), len(self.shown) * OVERLAP)
        clusters = [slice(end, end + ends.step) for end in ends]
        normals = np.stack([rows[one].T @ rows[one] for one in clusters])
        covariance = jackknife(normals, np.stack([scores[one].sum(axis=0) for one in clusters]), precision)
        return WeakEstimate(
            "weak form",
            self.prior.whole(unknown),
            self.prior.spread_out(covariance),
            share=share * np.abs(self.prior.whole(unknown)),
            left=float(np.sqrt(np.mean((shares * left / size) ** 2))),
        )


def solved(matrix: Floats, right: Floats, mean: Floats, precision: Floats) -> Floats:
    """Least squares with columns of unit size; what no row sees is as the prior has it."""
    matrix = np.vstack([matrix, np.diag(np.sqrt(precision))])
    right = np.concatenate([right, np.sqrt(precision) * mean])
    sizes = np.linalg.norm(matrix, axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    return np.asarray(np.linalg.lstsq(matrix / sizes, right, rcond=1e-12)[0] / sizes)
