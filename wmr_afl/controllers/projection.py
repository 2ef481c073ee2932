"""Projection of the estimates onto prior bounds, so that Dhat stays invertible (Remark 7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault, Part
from wmr_afl.numerics.rules import Rules
from wmr_afl.numerics.vectors import told
from wmr_input.errors import FieldError
from wmr_input.fields import ByName, Positive, Table


class ProjectionTable(Table):
    """Remark 7; a plain number bounds the estimates that enter det Dhat, names bound those named.

    `relative` r keeps every estimate within theta_hat(0) +- r |theta_hat(0)|.
    """

    lower: ByName | None = None
    upper: ByName | None = None
    relative: Positive | None = None

    @model_validator(mode="after")
    def _one_kind_of_bound(self) -> ProjectionTable:
        if self.relative is not None and (self.lower is not None or self.upper is not None):
            raise FieldError("names relative and absolute bounds", "give relative, or lower and upper")
        return self

    def rules(self) -> Rules:
        """What follows from other numbers of the loop."""
        share = self.relative
        if share is None:
            return {}
        return {
            "projection.lower": lambda n: relative_bounds(n["theta_hat"], share)[0],
            "projection.upper": lambda n: relative_bounds(n["theta_hat"], share)[1],
        }


class Projection(Part):
    """Keeps lower <= theta_hat <= upper, (n_theta,) each; infinite bounds leave an estimate free.

    Raises:
        WmrError: if nothing lies between the bounds.
    """

    name = "projection"

    def __init__(self, count: int, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf) -> None:
        self.lower = np.broadcast_to(np.asarray(lower, dtype=float), (count,)).copy()
        self.upper = np.broadcast_to(np.asarray(upper, dtype=float), (count,)).copy()
        self.check_numbers()

    def check(self, estimate: Floats, names: Sequence[str]) -> None:
        """The first estimate must lie within the bounds.

        Raises:
            WmrError: if it does not; the text names the base parameter.
        """
        for name, value, low, high in zip(names, estimate, self.lower, self.upper, strict=True):
            if not low <= value <= high:
                raise WmrError(
                    f"the first estimate of {name}, {value:g}, is not within {low:g} and {high:g}", "change one of them"
                )

    @property
    def values(self) -> dict[str, Floats]:
        """Bounds that bound anything."""
        bounds = {"lower": self.lower, "upper": self.upper}
        return {name: bound for name, bound in bounds.items() if np.isfinite(bound).any()}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        def bounds(k: SimpleNamespace) -> tuple[Floats, Floats]:
            return getattr(k, "lower", self.lower), getattr(k, "upper", self.upper)

        lower, upper = bounds(k)
        yield (
            ~np.all(lower < upper, axis=-1),
            lambda k: (f"bounds {' to '.join(map(told, bounds(k)))} leave nothing", "choose lower < upper"),
        )

    def project(self, theta_hat: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The nearest estimate within the bounds, (n_theta,)."""
        raised = arrays.maximum(theta_hat, k.lower) if "lower" in self.values else theta_hat
        return arrays.minimum(raised, k.upper) if "upper" in self.values else raised

    def reached(self, theta_hat: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """1 for each estimate that lies on a bound, else 0, (n_theta,)."""
        found: list[Array] = [0.0] * len(self.lower)
        for i, (low, high) in enumerate(zip(self.lower, self.upper, strict=True)):
            if np.isfinite(low):
                found[i] = arrays.where(theta_hat[i] <= k.lower[i], 1.0, found[i])
            if np.isfinite(high):
                found[i] = arrays.where(theta_hat[i] >= k.upper[i], 1.0, found[i])
        return arrays.vector(found)


def relative_bounds(estimate: Floats, share: float) -> tuple[Floats, Floats]:
    """theta_hat(0) -+ share |theta_hat(0)|, (..., n_theta) each."""
    room = share * np.abs(estimate)
    return estimate - room, estimate + room
