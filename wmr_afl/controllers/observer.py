"""What every observer is: it makes a state, and what was not expected, of what is measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from pydantic import Field

from wmr_afl.controllers.outer_loop import TrackingError, shorter_way
from wmr_afl.controllers.reference import Point
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fault, Part
from wmr_input.fields import Named, NotNegative, Number, Positive, Table


class ObserverTable(Table):
    """How the robot is looked at; every number has a default that needs no tuning."""

    kind: Literal["pose", "kalman"] | None = None  # "pose" where just q, or all of x, is measured
    rate: Positive | None = None  # of the observer [1/s], 0.6/(sample time) unless given
    cancel: bool = True  # whether what is not modelled is taken out of the command
    separate: bool = True  # whether the fast part of that is kept out of the data of least squares
    start: NotNegative = 2.0  # [s], from when it is cancelled: learn first
    ramp: Positive = 2.0  # [s], how slowly cancelling begins
    band: Positive = 1.0  # tau_d [s]: slower mismatch still teaches the estimates
    predict: bool = False  # whether the law goes by where the outputs will be when a late drive carries its command out
    bound: Positive = 1.0  # [m, rad], by how much a sample may surprise; beyond, the observer is lost
    deviation: Named | None = None  # of "kalman": noise of what is measured; its ratios matter
    slip: bool = True  # of "kalman", whether wheels may slip; only where all of q is measured
    slip_rate: Positive | None = None  # [1/s], how fast slip as it is read follows, and may change
    # Of "kalman": coordinates that nothing tells, which the motion carries along, and where others are at the start.
    carried: list[str] = Field(default_factory=list)
    first: dict[str, Number] = Field(default_factory=dict)


@dataclass(frozen=True)
class Seen:
    """What an observer makes of a sample: the state, y and y' there, and what y'' has that was not expected."""

    x: Array  # [q; v], (2n-m,)
    y: Array  # y that the law goes by, (n-m,)
    y_rate: Array
    unexpected: Array  # d^ [output units/s^2]
    E: Array  # output map J_h S at q, (n-m, n-m)
    surprise: Array  # by how much this sample differs from what was expected, the largest [m, rad]
    memory: Mapping[str, Any] = field(default_factory=dict)  # what else the observer will need

    def error(self, reference: Point, model: Model) -> TrackingError:
        """y^ - yr and its rate."""
        e = shorter_way(self.y - reference.position, model, reference.counts_turns)
        return TrackingError(e, self.y_rate - reference.velocity)


class Observer(Part):
    """`see` tells of a sample; `update` is told which acceleration to expect until the next."""

    name = "observer"
    rate: Floats
    bound: Floats
    measurement: Measurement | None = None  # what `see` is given; None is x as it is measured

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.rate) & (k.rate > 0), axis=-1),
            lambda k: (f"the rate of the observer is {k.rate[0]:g}", "choose a positive number [1/s]"),
        )
        yield (
            ~np.all(k.bound > 0, axis=-1),
            lambda k: (f"the bound of the observer is {k.bound[0]:g}", "choose a positive number [m, rad]"),
        )

    def see(self, x: Array, z: SimpleNamespace, k: SimpleNamespace, c: Array, model: Model, step: Array) -> Seen:
        """What this sample tells; x is what is measured, `step` [s] the time since the last sample."""
        raise NotImplementedError

    def update(self, seen: Seen, acceleration: Array, drift: Array, arrays: Arrays) -> dict[str, Array]:
        """The states one sample later; `acceleration` y'' as the law expects it, d^ included; `drift` E' v of it."""
        raise NotImplementedError
