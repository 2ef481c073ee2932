"""The linear outer loop (27), the tracking error and the filtered error (34)."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.reference import Point
from wmr_afl.errors import WmrError
from wmr_afl.model.model import Language
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.numerics.vectors import per_entry
from wmr_input.fields import Numbers, Table


class OuterLoopTable(Table):
    """(27), (34)"""

    b1: Numbers
    b2: Numbers
    alpha: Numbers | None = None


@dataclass(frozen=True)
class TrackingError:
    """e = y - yr and e' = y' - yr', (n-m,) each [output units, output units/s]."""

    e: Array
    e_dot: Array


def tracking_error(x: Array, c: Array, reference: Point, language: Language) -> TrackingError:
    """The error of the outputs at state x."""
    model = language.model
    return TrackingError(
        model.output(x[: model.coordinate_count], c) - reference.position,
        model.output_rate(x, c) - reference.velocity,
    )


class OuterLoop:
    """eta = yr'' + b1 (yr' - y') + b2 (yr - y) (27), and E1 = e' + alpha e (34).

    b1 [1/s], b2 [1/s^2] and alpha [1/s] hold for each output or for all; alpha is b2/b1 unless given, as in the paper.
    (s + alpha)/(s^2 + b1 s + b2) must be strictly positive real (35): b2 > 0 and b1 > alpha > 0.

    Raises: WmrError, where it is not.
    """

    def __init__(self, outputs: int, b1: ArrayLike, b2: ArrayLike, alpha: ArrayLike | None = None) -> None:
        self.b1, self.b2 = per_entry("b1", b1, outputs), per_entry("b2", b2, outputs)
        if np.any(self.b1 <= 0) or np.any(self.b2 <= 0):
            raise WmrError(
                f"b1 = {self.b1}, b2 = {self.b2} do not stabilize the outer loop", "choose b1 > 0 and b2 > 0"
            )
        self.alpha = self.b2 / self.b1 if alpha is None else per_entry("alpha", alpha, outputs)
        if np.any(self.alpha <= 0) or np.any(self.b1 <= self.alpha):
            raise WmrError(
                f"(s + alpha)/(s^2 + b1 s + b2) is not strictly positive real (35) with b1 = {self.b1}, "
                f"b2 = {self.b2}, alpha = {self.alpha}",
                "choose b1 > alpha > 0 (alpha is b2/b1 unless given)",
            )

    @property
    def values(self) -> dict[str, Vector]:
        return {"b1": self.b1, "b2": self.b2, "alpha": self.alpha}

    def acceleration(self, error: TrackingError, reference: Point, k: SimpleNamespace) -> Array:
        """eta (27), the wanted y''."""
        return reference.acceleration - k.b1 * error.e_dot - k.b2 * error.e

    def filtered_error(self, error: TrackingError, k: SimpleNamespace) -> Array:
        """E1 (34)."""
        return error.e_dot + k.alpha * error.e
