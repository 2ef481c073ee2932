"""Viscous and Coulomb friction (95)."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import Fault
from wmr_afl.numerics.vectors import per_entry
from wmr_afl.plant.loads import Place
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import Numbers


class FrictionTable(UncertaintyTable):
    """Fv r + Kd sgn r (95), acting on the pseudo-velocities or on the motors' shafts ("wheels").

    `of` = "pseudo_velocities" with `on` = "wheels" is the literal reading of (7), (13).
    """

    viscous: Numbers = 0.0
    coulomb: Numbers = 0.0
    on: Literal["pseudo_velocities", "wheels"]
    of: Literal["pseudo_velocities", "wheels"] | None = None

    def build(self, surroundings: Surroundings) -> Friction:
        if self.of == "wheels" and self.on != "wheels":
            raise WmrError("friction of the wheels acts on the wheels", 'write on = "wheels"')
        return Friction(surroundings.model, self.viscous, self.coulomb, self.on, self.of == "pseudo_velocities")


class Friction(Uncertainty):
    """F(r) = Fv r + Kd sgn r (95), of the rates r at the place where it acts.

    `of_pseudo_velocities` takes r = v although the torque acts on the wheels, as (7) and (13) read literally.

    Raises:
        WmrError: if a coefficient is negative or the channels do not match.
    """

    name = "friction"

    def __init__(
        self,
        model: Model,
        viscous: ArrayLike = 0.0,
        coulomb: ArrayLike = 0.0,
        on: str = "pseudo_velocities",
        of_pseudo_velocities: bool = False,
    ) -> None:
        self.place = Place(model, on)
        count = len(self.place.channels)
        self.viscous, self.coulomb = per_entry("viscous", viscous, count), per_entry("coulomb", coulomb, count)
        self.check_numbers()
        self.of_v = of_pseudo_velocities or not self.place.on_wheels
        if self.of_v and count != model.pseudo_velocity_count:
            raise WmrError(f"{count} wheels for {model.pseudo_velocity_count} pseudo-velocities", "leave `of` out")

    @property
    def values(self) -> dict[str, Floats]:
        return {"viscous": self.viscous, "coulomb": self.coulomb}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            np.any((k.viscous < 0) | (k.coulomb < 0), axis=-1),
            lambda k: (f"friction {k.viscous}, {k.coulomb} would drive the robot", "choose zero or more"),
        )

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        q, v = x[: model.coordinate_count], x[model.coordinate_count :]
        rates = v if self.of_v else self.place.rates(q, v, p, model)
        return self.place.on_v(k.viscous * rates + k.coulomb * model.arrays.sign(rates), q, p, model)
