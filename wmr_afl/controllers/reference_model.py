"""The reference model: from where the outputs are they come to the reference at a rate of their own."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.outer_loop import TrackingError, shorter_way
from wmr_afl.controllers.reference import Point
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault, Part


class ReferenceModel(Part):
    """yd = yr + d with d'' + 2 r d' + r^2 d = 0, where d starts as y - yr.

    A start far off then throws neither motors nor estimates. d is advanced exactly, so that
    yd is yr once it has arrived, whatever the sample time; `rate` r > 0 [1/s].

    Raises:
        WmrError: if the rate is not positive.
    """

    name = "reference_model"

    def __init__(self, outputs: int, rate: float) -> None:
        self.outputs, self.rate = outputs, np.array([float(rate)])
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"rate": self.rate}

    @property
    def states(self) -> dict[str, Floats]:
        return {"distance": np.zeros(self.outputs), "distance_rate": np.zeros(self.outputs), "is_running": np.zeros(1)}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.rate) & (k.rate > 0), axis=-1),
            lambda k: (f"the rate of the reference model is {k.rate[0]:g}", "choose a positive number [1/s]"),
        )

    def distance(
        self, error: TrackingError, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array
    ) -> TrackingError:
        """d and d' at this sample, `step` after the last one; they begin with the first error."""
        r, runs = k.rate[0], z.is_running[0]
        fading, moved = arrays.exp(-r * step), z.distance_rate + r * z.distance
        return TrackingError(
            (1.0 - runs) * error.e + runs * fading * (z.distance + step * moved),
            (1.0 - runs) * error.e_dot + runs * fading * (z.distance_rate - r * step * moved),
        )

    def seen_from(
        self, error: TrackingError, d: TrackingError, reference: Point, k: SimpleNamespace, model: Model
    ) -> tuple[TrackingError, Point]:
        """y - yd and its rate, and yd as the reference."""
        r = k.rate[0]
        wanted = Point(
            reference.position + d.e,
            reference.velocity + d.e_dot,
            reference.acceleration - 2.0 * r * d.e_dot - r * r * d.e,
            reference.counts_turns,
        )
        return TrackingError(shorter_way(error.e - d.e, model, reference.counts_turns), error.e_dot - d.e_dot), wanted

    def update(self, d: TrackingError, arrays: Arrays) -> dict[str, Array]:
        """The states one sample later."""
        return {"distance": d.e, "distance_rate": d.e_dot, "is_running": arrays.vector([1.0])}
