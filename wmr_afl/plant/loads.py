"""Where loads act: straight on the pseudo-velocities, or on the motors' shafts, from where X^T carries them to v."""

from __future__ import annotations

import numpy as np

from wmr_afl.errors import UnknownNameError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array

PLACES = ("pseudo_velocities", "wheels")  # names in an experiment's tables


class Place:
    """Where a load acts.

    Raises:
        UnknownNameError: if there is no such place.
    """

    def __init__(self, model: Model, name: str) -> None:
        if name not in PLACES:
            raise UnknownNameError("place for a load", name, PLACES)
        self.on_wheels = name == "wheels"
        names = model.input_units if self.on_wheels else list(model.state_units)[model.coordinate_count :]
        self.channels = list(names)

    def matrix(self, q: Array, p: Array, model: Model) -> Array:
        """What v is multiplied by for the rates, (channels, n-m)."""
        return model.actuator_rates_matrix(q, p) if self.on_wheels else np.eye(model.pseudo_velocity_count)

    def rates(self, q: Array, v: Array, p: Array, model: Model) -> Array:
        """v, or the shafts' rates X v (10)."""
        return model.actuator_rates_matrix(q, p) @ v if self.on_wheels else v

    def on_v(self, force: Array, q: Array, p: Array, model: Model) -> Array:
        """The generalized force on v of a force at this place."""
        return model.actuator_rates_matrix(q, p).T @ force if self.on_wheels else force
