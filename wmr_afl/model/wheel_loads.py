"""The weight that each wheel of a standing robot bears."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value

GRAVITY = 9.81  # [m/s^2]
LEAST_LOAD = 0.02  # of an equal share of the weight, that a wheel bears on which the robot stands
BALANCED = 1e-6  # of the weight, and of its moments per metre, that may be left


def wheel_loads(model: Model, q: ArrayLike, p: ArrayLike) -> Floats:
    """The weight on each wheel at configurations q (..., n) with parameters p (n_p,), (..., wheels) [N].

    Least squares among the loads that balance the weight; equal shares where none do: the robot would tip. Zeros
    without any mass.
    """
    return _statics(model, q, p)[0]


def stands(model: Model, q: ArrayLike, p: ArrayLike) -> NDArray[np.bool_]:
    """Whether a robot stands on three wheels or more at q (..., n), its centre of mass well within them, (...)."""
    return _statics(model, q, p)[1]


def _statics(model: Model, q: ArrayLike, p: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
    """Loads (..., wheels) [N], and whether they hold the robot upright (...)."""
    q = np.asarray(q, dtype=float)
    coordinates = list(model.state_units)[: model.coordinate_count]
    names = dict(zip(model.parameter_units, np.asarray(p, dtype=float).tolist(), strict=True))
    names |= dict(zip(coordinates, np.moveaxis(q, -1, 0), strict=True))
    geometry = model.metadata["geometry"]
    wheels, bodies = list(geometry["wheels"].values()), list(geometry["bodies"].values())

    def seen(parts: list[Any], *keys: str) -> Floats:
        """(..., parts, keys)."""
        values = [[numpy_value(part[key], names) + np.zeros(q.shape[:-1]) for key in keys] for part in parts]
        return np.moveaxis(np.reshape(values, (len(parts), len(keys), *q.shape[:-1])), (0, 1), (-2, -1))

    places, masses = seen(wheels, "x", "y"), seen([*wheels, *bodies], "mass")
    mass, count = masses.sum(axis=-2), len(wheels)
    weight = GRAVITY * mass
    with np.errstate(invalid="ignore", divide="ignore"):
        centre = (masses * np.concatenate([places, seen(bodies, "x", "y")], axis=-2)).sum(axis=-2) / mass
    arms = np.nan_to_num(places - centre[..., None, :])
    balance = np.concatenate([np.ones((*arms.shape[:-1], 1)), arms], axis=-1).swapaxes(-1, -2)
    wanted = np.concatenate([weight, np.zeros((*weight.shape[:-1], 2))], axis=-1)
    loads = (np.linalg.pinv(balance) @ wanted[..., None])[..., 0]
    left = np.abs((balance @ loads[..., None])[..., 0] - wanted).max(axis=-1, keepdims=True)
    balances = (left <= BALANCED * weight) & (loads.min(axis=-1, keepdims=True) > LEAST_LOAD * weight / count)
    is_upright = balances[..., 0] & (np.linalg.matrix_rank(balance) == 3)
    return np.where(balances, loads, weight / count), is_upright
