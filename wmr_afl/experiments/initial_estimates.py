"""Where an estimate starts, and the gain and bounds that are told relative to it; for one robot or a batch of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.adaptation import AdaptationTable
from wmr_afl.controllers.projection import ProjectionTable
from wmr_afl.controllers.tracking_law import ControllerTable
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Vector
from wmr_afl.numerics.vectors import by_name


def first_estimate(model: Model, parameters: Mapping[str, ArrayLike], table: ControllerTable) -> Vector:
    """theta_hat(0), (..., n_theta): the plant's own or that of the guess, in batches as `parameters`, or as it is told.

    Raises: UnknownNameError, WmrError, where the table does not fit the model.
    """
    if table.guess or table.estimate == "exact":
        with np.errstate(all="ignore"):  # what is not finite is for the caller to tell
            return np.asarray(model.base_parameters(model.parameters(**{**parameters, **table.guess})))
    return by_name("base parameter", table.estimate, list(model.base_parameter_units))


def adaptation_gain(table: AdaptationTable, estimate: Vector, names: Sequence[str]) -> ArrayLike:
    """Gamma of (25), (n_theta, n_theta), or its diagonal (..., n_theta), also relative to theta_hat(0)."""
    if table.relative_gain is not None:
        return np.asarray(table.relative_gain * estimate**2)
    gain: Any = table.gain
    return by_name("base parameter", gain, names) if isinstance(gain, dict) else gain


def relative_bounds(table: ProjectionTable, estimate: Vector) -> tuple[Vector, Vector]:
    """Lower and upper bound (..., n_theta) of a projection that is told relative to the first estimate."""
    room = (table.relative or 0.0) * np.abs(estimate)
    return estimate - room, estimate + room
