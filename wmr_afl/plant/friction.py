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
from wmr_afl.numerics.vectors import per_entry, told
from wmr_afl.plant.loads import Place
from wmr_afl.plant.uncertainty import Resistance, Surroundings, Uncertainty, UncertaintyTable
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

    At rest sgn 0 is any number from -1 to 1: Coulomb friction holds what is pushed by less than Kd, and within a sample
    it stops a motion but does not reverse it. `of_pseudo_velocities` takes r = v although the torque acts on the
    wheels, as (7) and (13) read literally; sgn 0 is 0 then.

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
        self.is_literal = of_pseudo_velocities and self.place.on_wheels
        if self.is_literal and count != model.pseudo_velocity_count:
            raise WmrError(f"{count} wheels for {model.pseudo_velocity_count} pseudo-velocities", "leave `of` out")

    @property
    def values(self) -> dict[str, Floats]:
        return {"viscous": self.viscous, "coulomb": self.coulomb}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            np.any((k.viscous < 0) | (k.coulomb < 0), axis=-1),
            lambda k: (
                f"friction {told(k.viscous)} (viscous) and {told(k.coulomb)} (Coulomb) would drive the robot",
                "choose zero or more",
            ),
        )

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        velocities = list(model.state_units.values())[model.coordinate_count :]
        of_velocities = self.is_literal or not self.place.on_wheels
        coulomb, viscous = dict[str, str](), dict[str, str]()
        for i, channel in enumerate(self.place.channels):
            is_along = of_velocities and velocities[i] == "m/s"
            coulomb[channel] = "N" if is_along and not self.place.on_wheels else "N m"
            viscous[channel] = f"{coulomb[channel]} s/{'m' if is_along else 'rad'}"
        return {"viscous": viscous, "coulomb": coulomb}

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        q, v = x[: model.coordinate_count], x[model.coordinate_count :]
        if self.is_literal:
            return self.place.on_v(k.viscous * v + k.coulomb * model.arrays.sign(v), q, p, model)
        return self.place.on_v(k.viscous * self.place.rates(q, v, p, model), q, p, model)

    def resistance(self, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Resistance | None:
        if self.is_literal:
            return None  # this torque may as well drive what it acts on: it stops nothing
        matrix = self.place.matrix(x[: model.coordinate_count], p, model)
        each = [k.coulomb[i] for i in range(len(self.place.channels))]
        return Resistance(matrix, [-most for most in each], each)
