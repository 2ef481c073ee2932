"""Least squares on the robot's own motion, over a window that fades and with the first guess as a prior that stays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.groups import Group, RowsOfGroups, inner
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.covariance import Rows, corrected, symmetric
from wmr_afl.numerics.parts import Fault, Part
from wmr_afl.numerics.vectors import told

RECENT = 10.0  # [s], over which the misfit is averaged


class LeastSquares(Part):
    """pi_hat is what makes this least, without acceleration and without inverting anything:

        int exp(-(t - s)/T) |Phi pi - ubar|^2 / r^2 ds + (pi - pi_0)^T P0^-1 (pi - pi_0)

    Phi and ubar are d/dt N + H and R u (the motion, integrated), both behind a filter 1/(tau s + 1), sampled as
    (N - N_)/dt + (H + H_)/2 and (R + R_)/2 u_. The first guess pi_0 and its spread P0 never fade: without excitation
    estimates go back to it, and P <= P0 whatever happens. Row by row, f a row of Phi:

        P += dt/T (P - P P0^-1 P)        pi_hat -= dt/T P P0^-1 (pi_hat - pi_0)
        pi_hat += P f (ubar - f pi_hat) / (r^2/dt + f P f)        P -= P f f^T P / (r^2/dt + f P f)

    `noise` r [V s^1/2]: what the equation leaves unexplained; `filter` tau [s]; `memory` T [s]. `unexplained` tells
    what it really leaves: where that is more than r, deviations promise too much.

    Raises:
        WmrError: if a number is not positive.

    References: Slotine, Li, Composite adaptive control of robot manipulators, Automatica 25, 1989; Middleton, Goodwin,
    Adaptive computed torque control for rigid link manipulators, Systems and Control Letters 10, 1988.
    """

    name = "least_squares"

    def __init__(
        self,
        groups: Sequence[Group],
        inputs: int,
        prior: ArrayLike,
        spread: ArrayLike,
        noise: float = 0.05,
        filter: float = 0.1,
        memory: float = 200.0,
    ) -> None:
        """`prior` pi_0 and `spread` diag P0^(1/2), (n_pi,) each."""
        self.groups, self.inputs = RowsOfGroups(groups), inputs
        self.prior, self.spread = np.array(prior, dtype=float), np.array(spread, dtype=float)
        self.numbers = {"noise": noise, "filter": filter, "memory": memory}
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        numbers = {name: np.array([float(value)]) for name, value in self.numbers.items()}
        return {"prior": self.prior, "spread": self.spread, **numbers}

    @property
    def states(self) -> dict[str, Floats]:
        rows, entries = self.groups.rows, self.groups.entries
        return {
            "covariance": self.groups.packed_diagonals(self.spread**2),
            "before": np.zeros(entries),  # H/2 - N/dt of the last sample
            "effort_before": np.zeros(rows),  # R u/2 of the last sample
            "input_before": np.zeros(self.inputs),
            "regressor": np.zeros(entries),  # Phi
            "effort": np.zeros(rows),  # ubar
            "misfit": np.zeros(1),  # mean of (ubar - f pi_hat)^2 over the rows and the last seconds [V^2]
            "is_running": np.zeros(1),
        }

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        for name in self.numbers:
            value = getattr(k, name)
            yield ~np.all(np.isfinite(value) & (value > 0), axis=-1), _not_positive(name)
        yield (
            ~np.all(np.isfinite(k.spread) & (k.spread > 0), axis=-1),
            lambda k: (f"the guess has the spread {told(k.spread)}", "guess numbers that are not zero"),
        )

    def learn(
        self,
        x: Array,
        pi_hat: Array,
        z: SimpleNamespace,
        k: SimpleNamespace,
        c: Array,
        model: Model,
        step: Array,
    ) -> tuple[Array, dict[str, Array]]:
        """pi_hat after the data of the sample that has just ended, and the states."""
        arrays, runs = model.arrays, z.is_running[0]
        momentum = self.groups.picked(model.momentum_regressor(x, c), arrays)
        rest = self.groups.picked(model.rest_regressor(x, c), arrays)
        allocation = model.allocation(x[: model.coordinate_count], c)
        raw = momentum / step + 0.5 * rest + z.before
        raw_effort = 0.5 * (allocation @ z.input_before) + z.effort_before
        keep = arrays.exp(-step / k.filter[0])
        regressor = runs * (keep * z.regressor + (1.0 - keep) * raw)
        effort = runs * (keep * z.effort + (1.0 - keep) * raw_effort)
        learned: list[Array] = []
        covariance: list[Rows] = []
        misfit = 0.0
        blocks = zip(self.groups.blocks_of(z.covariance), self.groups.rows_of(regressor), strict=True)
        for (group, P), (_, rows) in blocks:
            pi, pi_0, P0 = ([of[i] for i in group.parameters] for of in (pi_hat, k.prior, k.spread * k.spread))
            pi, P = _faded(pi, P, pi_0, P0, step / k.memory[0])
            for row, f in zip(group.rows, rows, strict=True):
                miss = effort[row] - inner(f, pi)
                misfit = misfit + miss * miss / self.groups.rows
                pi, P = corrected(pi, P, dict(enumerate(f)), effort[row] - inner(f, pi), k.noise[0] * k.noise[0] / step)
            learned += pi
            covariance.append(P)
        following = {
            "covariance": self.groups.packed(covariance, arrays),
            "before": 0.5 * rest - momentum / step,
            "regressor": regressor,
            "effort": effort,
            "misfit": z.misfit + (1.0 - arrays.exp(-step / RECENT)) * (misfit - z.misfit),
            "is_running": arrays.vector([1.0]),
        }
        return self.groups.in_order(learned, arrays), following

    def unexplained(self, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array) -> Array:
        """What the equation of motion left unexplained in the last seconds, in the unit of r [V s^1/2], (1,)."""
        keep = arrays.exp(-step / k.filter[0])  # the filter takes noise down by this much
        return arrays.sqrt(step * z.misfit * (1.0 + keep) / (1.0 - keep))

    def deviation(self, z: SimpleNamespace, arrays: Arrays) -> Array:
        """The square root of P's diagonal, (n_pi,): as certain as the equation of motion is, not as the robot is."""
        blocks = [
            [arrays.sqrt(arrays.maximum(P[i][i], 0.0)) for i in range(len(P))]
            for _, P in self.groups.blocks_of(z.covariance)
        ]
        return self.groups.in_order([entry for block in blocks for entry in block], arrays)

    def applied(self, u: Array, allocation: Array, removed: Array = 0.0) -> dict[str, Array]:
        """The states that depend on what reached the motors, u (n_u,); R u + `removed` (n-m,) is what tells of pi."""
        return {"input_before": u, "effort_before": 0.5 * (allocation @ u) + removed}


def _not_positive(name: str) -> Callable[[SimpleNamespace], tuple[str, str]]:
    return lambda k: (f"{name} of the least squares is {getattr(k, name)[0]:g}", "choose a positive number")


def _faded(pi: list[Array], P: Rows, pi_0: list[Array], P0: list[Array], share: Array) -> tuple[list[Array], Rows]:
    """What is left after a share of the data has been forgotten, and of the prior has not."""
    size = range(len(pi))
    away = [(pi[n] - pi_0[n]) / P0[n] for n in size]
    scaled = [[P[i][n] / P0[n] for n in size] for i in size]
    faded = [pi[n] - share * inner(P[n], away) for n in size]
    return faded, symmetric(len(pi), lambda i, j: P[i][j] + share * (P[i][j] - inner(scaled[i], P[j])))
