"""The linear outer loop (27), the tracking error and the filtered error (34)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from wmr_afl.controllers.reference import Point
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault, Part
from wmr_afl.numerics.rules import Rules
from wmr_afl.numerics.vectors import per_entry
from wmr_input.errors import FieldError
from wmr_input.fields import Numbers, Positive, Table


class OuterLoopTable(Table):
    """Gains of (27) and (34), or the bandwidth [1/s] from which b1 and b2 follow."""

    b1: Numbers | None = None
    b2: Numbers | None = None
    bandwidth: Positive | None = None
    alpha: Numbers | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> OuterLoopTable:
        gains = [self.b1, self.b2]
        if (self.bandwidth is None) == (gains == [None, None]) or (None in gains and gains != [None, None]):
            raise FieldError("gives neither b1 and b2 nor a bandwidth, or both", "give b1 and b2, or bandwidth")
        return self

    def gains(self, sample_time: float) -> tuple[Numbers, Numbers]:
        """b1 [1/s] and b2 [1/s^2]."""
        if self.b1 is not None and self.b2 is not None:
            return self.b1, self.b2
        return sampled_gains(self.bandwidth or 0.0, sample_time)

    def rules(self) -> Rules:
        """What follows from other numbers of the loop."""
        if self.alpha is not None:
            return {}
        return {"outer_loop.alpha": lambda n: usual_alpha(n["outer_loop.b1"], n["outer_loop.b2"])}


@dataclass(frozen=True)
class TrackingError:
    """e = y - yr and e' = y' - yr', (n-m,) each [output units, output units/s]."""

    e: Array
    e_dot: Array


def tracking_error(x: Array, c: Array, reference: Point, model: Model) -> TrackingError:
    """The error of the outputs at state x; of angles the shorter way round, unless the reference counts turns."""
    e = model.output(x[: model.coordinate_count], c) - reference.position
    return TrackingError(shorter_way(e, model, reference.counts_turns), model.output_rate(x, c) - reference.velocity)


def shorter_way(e: Array, model: Model, counts_turns: bool = False) -> Array:
    """A difference of outputs with angles the shorter way round, unless turns are counted."""
    angles = [unit == "rad" and not counts_turns for unit in model.output_units.values()]
    if not any(angles):
        return e
    arrays = model.arrays
    return arrays.vector([within_half_a_turn(e[i], arrays) if is_angle else e[i] for i, is_angle in enumerate(angles)])


def within_half_a_turn(angle: Array, arrays: Arrays) -> Array:
    """The angle [rad] less whole turns, from -pi up to pi; one that is there already stays as it is, to the bit."""
    return angle - 2.0 * pi * arrays.floor(angle / (2.0 * pi) + 0.5)


class OuterLoop(Part):
    """eta = yr'' + b1 (yr' - y') + b2 (yr - y) (27), and E1 = e' + alpha e (34).

    b1 [1/s], b2 [1/s^2] and alpha [1/s] hold for each output or for all; alpha is b2/b1 unless given, as in the paper.
    (s + alpha)/(s^2 + b1 s + b2) must be strictly positive real (35): b2 > 0 and b1 > alpha > 0.

    Raises:
        WmrError: if it is not strictly positive real.
    """

    name = "outer_loop"

    def __init__(self, outputs: int, b1: ArrayLike, b2: ArrayLike, alpha: ArrayLike | None = None) -> None:
        self.b1, self.b2 = per_entry("b1", b1, outputs), per_entry("b2", b2, outputs)
        with np.errstate(all="ignore"):  # a b1 of zero is reported by the check
            self.alpha = usual_alpha(self.b1, self.b2) if alpha is None else per_entry("alpha", alpha, outputs)
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"b1": self.b1, "b2": self.b2, "alpha": self.alpha}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            np.any((k.b1 <= 0) | (k.b2 <= 0), axis=-1),
            lambda k: (f"b1 = {k.b1}, b2 = {k.b2} do not stabilize the outer loop", "choose b1 > 0 and b2 > 0"),
        )
        yield (
            np.any((k.alpha <= 0) | (k.b1 <= k.alpha), axis=-1),
            lambda k: (
                f"(s + alpha)/(s^2 + b1 s + b2) is not strictly positive real (35) with b1 = {k.b1}, b2 = {k.b2}, "
                f"alpha = {k.alpha}",
                "choose b1 > alpha > 0 (alpha is b2/b1 unless given)",
            ),
        )

    def acceleration(self, error: TrackingError, reference: Point, k: SimpleNamespace) -> Array:
        """eta (27), the wanted y'', (n-m,)."""
        return reference.acceleration - k.b1 * error.e_dot - k.b2 * error.e

    def filtered_error(self, error: TrackingError, k: SimpleNamespace) -> Array:
        """E1 (34), (n-m,)."""
        return error.e_dot + k.alpha * error.e


def sampled_gains(bandwidth: float, sample_time: float) -> tuple[float, float]:
    """b1 and b2 that put both poles of y'' = eta, sampled, at exp(-bandwidth T)."""
    pole, T = float(np.exp(-bandwidth * sample_time)), sample_time
    return (1.0 - pole) * (3.0 + pole) / (2.0 * T), (1.0 - pole) ** 2 / T**2


def usual_alpha(b1: Floats, b2: Floats) -> Floats:
    """alpha = b2/b1 [1/s], the paper's choice, for one robot or many."""
    return b2 / b1
