"""Generalized forces on the pseudo-velocities, w = Fbar + taubar_d of (14), told where they act."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Protocol

from wmr_afl.errors import UnknownNameError
from wmr_afl.model.model import Language, Model
from wmr_afl.numerics.arrays import Array, Vector

PLACES = ("pseudo_velocities", "wheels")


class Load(Protocol):
    """Something that acts on a robot besides its motors."""

    @property
    def values(self) -> dict[str, Vector]: ...

    def force(self, t: Array, q: Array, v: Array, p: Array, k: SimpleNamespace, language: Language) -> Array:
        """w (n-m,), counted against the motion: Mbar v' + Cbar v + w = Bbar K1 u (14)."""
        ...


class Place:
    """Where a load acts: straight on v, or on the motors' shafts, from where X^T carries it to v.

    Raises: UnknownNameError, where there is no such place.
    """

    def __init__(self, model: Model, name: str) -> None:
        if name not in PLACES:
            raise UnknownNameError("place for a load", name, PLACES)
        self.on_wheels = name == "wheels"
        names = model.input_units if self.on_wheels else list(model.state_units)[model.coordinate_count :]
        self.channels = list(names)

    def rates(self, q: Array, v: Array, p: Array, language: Language) -> Array:
        """v, or the shafts' rates X v (10)."""
        return language.model.actuator_rates_matrix(q, p) @ v if self.on_wheels else v

    def on_v(self, force: Array, q: Array, p: Array, language: Language) -> Array:
        """The generalized force on v of a force at this place."""
        return language.model.actuator_rates_matrix(q, p).T @ force if self.on_wheels else force
