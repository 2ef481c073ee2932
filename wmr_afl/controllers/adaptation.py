"""Gradient adaptation of the base parameters (25), modified if the plain law is not enough, and projected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from wmr_afl.controllers.dead_zone import DeadZone
from wmr_afl.controllers.leakage import Leakage
from wmr_afl.controllers.modification import Modification
from wmr_afl.controllers.normalization import Normalization
from wmr_afl.controllers.projection import Projection
from wmr_afl.errors import ShapeError
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import NOTHING, Fault, Part, Parts
from wmr_afl.numerics.rules import Rules
from wmr_input.errors import FieldError
from wmr_input.fields import Gain, Named, Positive, Table


class AdaptationTable(Table):
    """(25); `relative_gain` g gives Gamma_i = g theta_hat_i(0)^2, for base parameters that differ in size and unit.

    The keys that name a Modification are the list of them, in the order in which they act: a new one is one file and
    one line.
    """

    gain: Gain | None = None
    relative_gain: Positive | None = None
    input: Literal["commanded", "applied"] = "commanded"  # at which W is taken
    order: Literal["early", "late"] = "early"  # W and E1 of one sample, or W of the last one with E1 of this one
    dead_zone: Annotated[Positive | None, DeadZone] = None
    normalization: Annotated[Positive | None, Normalization] = None
    leakage: Annotated[Named | None, Leakage] = None

    @model_validator(mode="after")
    def _one_gain(self) -> AdaptationTable:
        if (self.gain is None) == (self.relative_gain is None):
            raise FieldError("names no or two gains", "give gain or relative_gain")
        return self

    def rules(self) -> Rules:
        """What follows from other numbers of the loop."""
        g = self.relative_gain
        return {} if g is None else {"adaptation.Gamma": lambda n: relative_gain(n["theta_hat"], g)}

    def modifications(self, parameters: Sequence[str]) -> list[Modification]:
        """The modifications that are named, for base parameters of these names."""
        settings = ((getattr(self, key), field) for key, field in type(self).model_fields.items())
        return [
            kind.from_setting(setting, parameters)
            for setting, field in settings
            for kind in field.metadata
            if setting is not None and isinstance(kind, type) and issubclass(kind, Modification)
        ]


class GradientAdaptation(Part):
    """theta_hat' = Gamma W^T E1 (25), Gamma (n_theta, n_theta) or its diagonal, positive definite.

    `modifications` change the direction W^T E1 in their order, `projection` bounds the estimates. `sees_applied`: W is
    taken at the input that reaches the motors instead of the one that was commanded, if the two differ. `is_late`: W of
    the last sample meets E1 of this one, which allows twice the gain at a given sample time.

    Raises:
        ShapeError: if Gamma has the wrong shape.
        WmrError: if Gamma is not symmetric positive definite.
    """

    name = "adaptation"

    def __init__(
        self,
        count: int,
        gain: ArrayLike,
        modifications: Sequence[Modification] = (),
        projection: Projection | None = None,
        sees_applied: bool = False,
        is_late: bool = False,
    ) -> None:
        self.modifications, self.sees_applied, self.is_late = Parts(modifications), sees_applied, is_late
        self.projection = projection or Projection(count)
        try:
            self.gain = np.asarray(gain, dtype=float)
        except (TypeError, ValueError):
            raise ShapeError("the rows of the adaptation gain differ in length", "give rows of equal length") from None
        if self.gain.ndim == 0:
            self.gain = np.full(count, float(self.gain))
        if self.gain.shape not in ((count,), (count, count)):
            raise ShapeError(
                f"the adaptation gain has shape {self.gain.shape}",
                f"expected a number, a diagonal ({count},) or a matrix ({count}, {count})",
            )
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"Gamma": self.gain}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~_positive_definite(k.Gamma, self.gain.ndim),
            lambda k: (
                f"the adaptation gain {k.Gamma.tolist()} is not symmetric positive definite",
                "choose finite positive numbers",
            ),
        )

    @property
    def parts(self) -> tuple[Part, ...]:
        """The gradient law, its modifications and its projection, each with numbers of its own."""
        return (self, *self.modifications, self.projection)

    def update(
        self,
        regressor: Array,
        filtered_error: Array,
        theta_hat: Array,
        k: SimpleNamespace,
        arrays: Arrays,
        step: Array,
    ) -> Array:
        """theta_hat one sample later, (n_theta,), for W (n-m, n_theta) and E1 (n-m,); `k` holds all parts' numbers."""
        direction = regressor.T @ filtered_error
        for modification, own in self.modifications.with_values(k):
            direction = modification.modify(direction, regressor, filtered_error, theta_hat, own, arrays)
        gain = step * k.adaptation.Gamma  # the same at every step, so that it is multiplied once
        change = gain * direction if self.gain.ndim == 1 else gain @ direction
        return self.projection.project(theta_hat + change, getattr(k, self.projection.name, NOTHING), arrays)


def _positive_definite(gain: Floats, dimensions: int) -> Any:
    """Whether gains (..., n, n), or their diagonals (..., n), are finite, symmetric and positive definite, (...)."""
    if dimensions == 1:
        return np.all((gain > 0) & np.isfinite(gain), axis=-1)
    finite = np.where(np.isfinite(gain).all(axis=(-2, -1), keepdims=True), gain, 0.0)  # else there are no eigenvalues
    symmetric = np.isclose(finite, np.swapaxes(finite, -1, -2)).all(axis=(-2, -1))
    return symmetric & (np.linalg.eigvalsh(finite) > 0).all(axis=-1)


def relative_gain(estimate: Floats, g: float) -> Floats:
    """The diagonal of Gamma, g theta_hat(0)^2, (..., n_theta)."""
    return np.asarray(g * estimate**2)
