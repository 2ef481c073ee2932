"""From base parameters to the physical parameters that a controller takes: near the description, and possible.

    min_z (base(p) - found)^T cov^-1 (base(p) - found) + sum_k (z_k/0.5)^2,    p_k = p0_k exp z_k           (I10)

Lengths that are not known, which may be negative, are p_k = p0_k + s z_k. What no voltage can tell (all masses and
torque gains times one factor, `scaled`) stays near the description.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import VAGUE, Estimate
from wmr_afl.numerics.arrays import Floats

SPREAD = 0.5  # of z: the description may be off by two thirds either way
LENGTH = 0.5  # of a length, by which one that is not known may be off for z = 1; of the largest length at least a tenth
MODEL = 2e-3  # of a base parameter, that no model is better than
TOLD = 0.7  # of the spread: what is left of it where the log says little of a parameter
MASS = re.compile(r"\b(kg|N)\b")  # in a unit that holds a mass
CONTRADICTION = 9.0  # chi^2 for each base parameter: no possible robot is within three standard deviations


@dataclass(frozen=True)
class Physical:
    """Physical parameters that come closest to what was found."""

    p: Floats  # (n_p,)
    uncertain: tuple[str, ...]  # parameters that were sought
    kept: tuple[str, ...]  # of these, what stays near the description because the log says little of it alone
    scaled: tuple[str, ...]  # of these, what voltages tell up to one common factor only
    chi2: float  # for each base parameter

    @property
    def is_contradiction(self) -> bool:
        """Whether no robot with positive masses, inertias and constants fits."""
        return self.chi2 > CONTRADICTION


def physical(effort: Effort, estimate: Estimate, described: Collection[str] = ()) -> Physical:
    """The physical parameters of an estimate, of which some numbers are only as `described`."""
    names, additive, sought = list(effort.model.parameter_units), np.array(effort.is_length), list(effort.sought)
    size = np.maximum(LENGTH * np.abs(effort.p), 0.1 * np.abs(effort.p[additive]).max(initial=0.0))
    wanted = estimate.unknown[: len(effort.base(effort.p))]
    sure = np.array([VAGUE if name in described else MODEL for name in list(effort.units)[: len(wanted)]])
    covariance = estimate.covariance[: len(wanted), : len(wanted)] + np.diag((sure * np.abs(wanted)) ** 2 + 1e-300)
    deviations = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(deviations, deviations) + 1e-12 * np.eye(len(wanted)))

    def parameters(z: Floats) -> Floats:
        p = effort.p.copy()
        p[sought] = np.where(
            additive[sought], p[sought] + size[sought] * z, p[sought] * np.exp(np.where(additive[sought], 0.0, z))
        )
        return p

    def residual(z: Floats) -> Floats:
        missed = np.linalg.solve(root, (effort.base(parameters(z)) - wanted) / deviations)
        return np.concatenate([missed, z / SPREAD])

    found = least_squares(residual, np.zeros(len(sought)), jac="3-point", x_scale="jac", max_nfev=200)
    _, sizes, directions = np.linalg.svd(found.jac, full_matrices=False)
    left = np.linalg.norm(directions / sizes[:, None], axis=0) / SPREAD
    chi2 = float(np.mean(residual(found.x)[: len(wanted)] ** 2))
    return Physical(
        p=parameters(found.x),
        uncertain=tuple(names[k] for k in sought),
        kept=tuple(names[k] for k, share in zip(sought, left, strict=True) if share > TOLD),
        scaled=scaled(effort),
        chi2=chi2,
    )


def scaled(effort: Effort) -> tuple[str, ...]:
    """The parameters that may all be multiplied by one factor without a change of any motion; none if one is known.

    These are all that have a unit of mass or force: a volt is what gives them their scale, and no motor tells it.
    """
    names = list(effort.model.parameter_units)
    together = [k for k in effort.sought if MASS.search(effort.model.parameter_units[names[k]])]
    p = effort.p.copy()
    p[together] *= 2.0
    is_same = together and np.allclose(effort.base(p), effort.base(effort.p), rtol=1e-9, atol=0.0)
    return tuple(names[k] for k in together) if is_same else ()
