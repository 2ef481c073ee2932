"""Which entries of a robot's state follow from what is measured, found by the rank of its derivatives by time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

STATES = 5  # random ones that are tried: what is determined at one of them is determined almost everywhere
ZERO = 1e-8  # of the largest singular value; smaller ones are rounding errors
TOUCHED = 1e-5  # a direction of length one that nobody sees has an entry this large where it matters
MOST_PROPOSED = 4

Jacobians = Mapping[str, list[Floats]]  # of a measured entry and its derivatives by time, at each random state


def undetermined(model: Model, measured: Sequence[str], p: ArrayLike) -> tuple[str, ...]:
    """The entries of the state that `measured` ones do not determine, whatever the motors and disturbances do.

    Of q' = S(q) v with v free to change: z, z', z'' ... depend on q, v, v' ...; an entry is determined if no direction
    in which none of them changes touches it. That is local and generic: at rest, or at special configurations, less may
    be. p (n_p,).

    Raises:
        UnknownNameError: if a name is neither an entry of the state nor a motor.
        WmrError: if nothing is measured, or something twice.
    """
    sees = Measurement(model, measured)
    if set(range(model.coordinate_count)) <= set(sees.coordinates):  # S has full rank: q tells v
        return ()
    return _unseen(_jacobians(model, measured, p), measured, list(model.state_units))


def remedies(model: Model, measured: Sequence[str], p: ArrayLike) -> list[tuple[str, ...]]:
    """The smallest sets of entries of the state that would have to be measured, too."""
    names, left = list(model.state_units), undetermined(model, measured, p)
    jacobians = _jacobians(model, [*measured, *left], p)
    for size in range(1, len(left) + 1):
        found = [more for more in combinations(left, size) if not _unseen(jacobians, [*measured, *more], names)]
        if found:
            return found[:MOST_PROPOSED]
    return []


def _jacobians(model: Model, names: Sequence[str], p: ArrayLike) -> Jacobians:
    """By q, v, v' ... of the named entries and as many of their derivatives as there are coordinates."""
    symbolic, n = model.in_library("casadi"), model.coordinate_count
    values = ca.DM(np.asarray(p, dtype=float))
    orders = n  # another derivative that tells nothing new ends it, and each tells of one more coordinate at least
    q, rates = ca.SX.sym("q", n), [ca.SX.sym(f"v{i}", model.pseudo_velocity_count) for i in range(orders + 1)]
    every, forward = ca.vertcat(q, *rates), ca.vertcat(symbolic.kinematic_matrix(q, values) @ rates[0], *rates[1:])
    moving = every[: forward.shape[0]]
    derivatives = [Measurement(model, names).of(ca.vertcat(q, rates[0]), values, symbolic)]
    for _ in range(orders):
        derivatives.append(ca.jtimes(derivatives[-1], moving, forward))
    jacobian = ca.Function("jacobian", [every], [ca.jacobian(ca.vertcat(*derivatives), every)])
    random = np.random.default_rng(0)
    signs, sizes = (
        random.choice([-1.0, 1.0], (STATES, every.shape[0])),
        random.uniform(0.3, 1.2, (STATES, every.shape[0])),
    )
    values_there = [
        matrix for matrix in (jacobian(state).full() for state in signs * sizes) if np.isfinite(matrix).all()
    ]
    return {name: [matrix[i :: len(names)] for matrix in values_there] for i, name in enumerate(names)}


def _unseen(jacobians: Jacobians, measured: Iterable[str], names: Sequence[str]) -> tuple[str, ...]:
    """The first columns that some direction touches in which nothing changes, at every one of the random states."""
    found = np.ones(len(names), dtype=bool)
    for rows in zip(*(jacobians[name] for name in measured), strict=True):
        found &= np.linalg.norm(_null_space(np.vstack(rows))[: len(names)], axis=1) > TOUCHED
    return tuple(name for name, is_left in zip(names, found, strict=True) if is_left)


def _null_space(matrix: Floats) -> Floats:
    """An orthonormal basis as columns, rows of the matrix scaled to length one."""
    lengths = np.linalg.norm(matrix, axis=1, keepdims=True)
    _, values, directions = np.linalg.svd(matrix / np.where(lengths > 0.0, lengths, 1.0))
    rank = int(np.count_nonzero(values > ZERO * values[0]))
    return np.asarray(directions[rank:].T)
