"""Direct adaptation: estimates move so that the error's energy falls (Slotine and Li), a gain for each group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.groups import Group, RowsOfGroups, groups_of, inner
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.covariance import Rows
from wmr_afl.numerics.parts import Fault, Part
from wmr_afl.numerics.vectors import told

SMALLEST = 1e-9  # of Y P0 Y^T, keeps 0/0 out before anything has moved
LARGEST = 1e12  # of Y P0 Y^T: beyond, nothing is learned from a sample, so that the gain falls by a bounded factor only


class DirectAdaptation(Part):
    """pi_hat -= dt gamma P Y_^T s for every group, Y_ of the last sample and s of this one.

        gamma = kappa lambda N0/m,    m the largest Y P0 Y^T so far among the group's rows

    `inertia` N0: of the guess, the least entry on the diagonal of Delta^-1 Mbar in the group, at the start. In this
    order the energy falls at a sample if dt gamma N^-1 Y P Y^T < 2 lambda - lambda^2 dt; the rule keeps the left side
    at most at kappa lambda dt N0/N. Nothing is learned from samples at which a motor was at its limit. `gain` is kappa
    [1/s].

    Raises:
        WmrError: if the gain is negative or an inertia is not positive.

    References: Slotine, Li, On the adaptive control of robot manipulators, Int. J. Robotics Research 6 (3), 1987.
    """

    name = "direct"

    def __init__(self, groups: Sequence[Group], gain: float, inertia: ArrayLike, spread: ArrayLike) -> None:
        """`inertia` (groups,); `spread` diag P0^(1/2) (n_pi,)."""
        self.groups, self.gain = RowsOfGroups(groups), np.array([float(gain)])
        self.inertia, self.spread = np.array(inertia, dtype=float), np.array(spread, dtype=float)
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"gain": self.gain, "inertia": self.inertia, "spread": self.spread}

    @property
    def states(self) -> dict[str, Floats]:
        return {
            "regressor_before": np.zeros(self.groups.entries),
            "largest": np.full(len(self.groups.groups), SMALLEST),
            "is_running": np.zeros(1),  # not at the first sample, and not after one with a motor at its limit
        }

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.gain) & (k.gain > 0), axis=-1),
            lambda k: (f"the direct gain is {k.gain[0]:g}", "choose a positive number [1/s]"),
        )
        yield (
            ~np.all(np.isfinite(k.inertia) & (k.inertia > 0), axis=-1),
            lambda k: (f"the guess has the inertia {told(k.inertia)}", "guess masses and inertias above zero"),
        )

    def learn(
        self,
        pi_hat: Array,
        s: Array,
        rate: Array,
        blocks: Sequence[Rows] | None,
        z: SimpleNamespace,
        k: SimpleNamespace,
        arrays: Arrays,
        step: Array,
    ) -> Array:
        """pi_hat after this sample's error s (n-m,); `blocks` of P, or none for P0."""
        change = [pi_hat[i] for i in range(pi_hat.shape[0])]
        for index, (group, rows) in enumerate(self.groups.rows_of(z.regressor_before)):
            gain = z.is_running[0] * step * k.gain[0] * rate * k.inertia[index] / z.largest[index]
            pushed = [sum(row[j] * s[i] for row, i in zip(rows, group.rows, strict=True)) for j in range(len(rows[0]))]
            for n, i in enumerate(group.parameters):
                shaped = inner(blocks[index][n], pushed) if blocks else k.spread[i] * k.spread[i] * pushed[n]
                change[i] = change[i] - gain * shaped
        return arrays.vector(change)

    def update(
        self, regressor: Array, is_free: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays
    ) -> dict[str, Array]:
        """The states one sample later, for this sample's Y (n-m, n_pi); `is_free` is 1 if no motor is at its limit."""
        picked = self.groups.picked(regressor, arrays)
        largest, usable = [], is_free
        for index, (group, rows) in enumerate(self.groups.rows_of(picked)):
            P0 = [k.spread[i] * k.spread[i] for i in group.parameters]
            top = z.largest[index]
            for row in rows:
                size = inner([a * a for a in row], P0)
                usable = usable * arrays.where(size < LARGEST, 1.0, 0.0)
                top = arrays.maximum(top, arrays.minimum(size, LARGEST))
            largest.append(top)
        return {
            "regressor_before": picked,
            "largest": arrays.vector(largest),
            "is_running": arrays.vector([usable]),
        }


def guessed_inertia(model: Model, x: Floats, pi_hat: Floats, c: Floats) -> Floats:
    """N0: the least diagonal entry of Delta^-1 L^-1 Mbar L^-T in each group, of the guess, (..., groups)."""
    n, count = model.coordinate_count, model.pseudo_velocity_count
    diagonal = []
    for j in range(count):
        unit = np.broadcast_to(np.eye(count)[j], (*x.shape[:-1], count))
        if model.has("row_map"):
            transposed = np.swapaxes(model.row_map(x[..., :n], c), -1, -2)
            unit = np.linalg.solve(transposed, unit[..., None])[..., 0]
        momentum = model.momentum_regressor(np.concatenate([x[..., :n], unit], axis=-1), c)
        diagonal.append(np.sum(momentum[..., j, :] * pi_hat, axis=-1))
    rows = np.stack(diagonal, axis=-1)
    return np.stack([rows[..., list(group.rows)].min(axis=-1) for group in groups_of(model)], axis=-1)
