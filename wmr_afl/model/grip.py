"""The friction that wheels need: forces of the floor in its plane, over the weight that each wheel bears at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.model.model import Model
from wmr_afl.model.slip import sideways_rows
from wmr_afl.model.wheel_loads import wheel_loads
from wmr_afl.numerics.arrays import Floats

FLOOR = 0.8  # friction that dry floors and tyres offer


def has_grip(model: Model) -> bool:
    """Whether the forces on its wheels can be told: not those of constraints that no wheel makes."""
    return model.has("rolling_forces") and not model.metadata["further_constraints"]


def wheel_forces(model: Model, x: ArrayLike, u: ArrayLike, a: ArrayLike, p: ArrayLike, loads: Floats) -> Floats:
    """Forces of the floor on each wheel, along and to the left of its heading, (..., wheels, 2) [N].

    A Swedish wheel's only force is the one along its rollers' axles, told as along. Side forces of wheels that share
    constraints are not determined by these; each bears as much as its load (..., wheels) suggests: the sum of squares
    over loads is least among all forces f with A_w^T f = A^T lambda, where A_w has a row (2) for every wheel.
    """
    model = model.in_library("numpy")
    x, p = np.asarray(x, dtype=float), np.asarray(p, dtype=float)
    q, rows = x[..., : model.coordinate_count], sideways_rows(model)
    forces = np.zeros((*loads.shape, 2))
    forces[..., 0] = model.rolling_forces(x, u, a, p)
    if rows:
        wheels = list(rows)
        A, every = model.constraint_matrix(q, p), model.slip_matrix(q, p)[..., list(rows.values()), :]
        roots = np.sqrt(np.maximum(loads[..., wheels], 0.0))[..., None]
        shares = every @ np.linalg.pinv(A)  # A_w = shares A
        lever = np.linalg.pinv((roots * shares).swapaxes(-1, -2))
        forces[..., wheels, 1] = (roots * (lever @ model.constraint_forces(x, u, a, p)[..., None]))[..., 0]
    return forces


def friction_needed(model: Model, x: ArrayLike, u: ArrayLike, a: ArrayLike, p: ArrayLike) -> Floats:
    """The share of its weight at rest that each wheel's force in the plane needs, (..., wheels); NaN without mass."""
    loads = wheel_loads(model, np.asarray(x, dtype=float)[..., : model.coordinate_count], p)
    forces = np.linalg.norm(wheel_forces(model, x, u, a, p, loads), axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(loads > 0.0, forces / loads, np.nan)


def friction_along(model: Model, x: Floats, following: Floats, u: Floats, p: Floats, step: float) -> Floats:
    """What a motion needed at samples x (T, 2n-m), with the states one step later and inputs u held, (T, wheels).

    Differences of v tell accelerations whatever else acted, as means over a sample; when the input changes, at its
    start, they are larger by as much as the motors alone would lose in half of it. What cannot be told counts as
    nothing, what is beyond all bounds as the largest number there is.
    """
    model = model.in_library("numpy")
    n, nothing = model.coordinate_count, np.zeros(model.pseudo_velocity_count)
    with np.errstate(all="ignore"):
        lost = model.state_derivative(x, u, nothing, p) - model.state_derivative(following, u, nothing, p)
        a = ((following - x) / step + 0.5 * lost)[:, n:]
        return np.nan_to_num(friction_needed(model, x, u, a, p), posinf=np.finfo(float).max)
