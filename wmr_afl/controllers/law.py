"""What every control law is: something with numbers and states that acts on what it sees, and knows no robot's p."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.reference import Point
from wmr_afl.errors import MissingTermError, ShapeError
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import NOTHING, Fixed, Part, Parts


class Knowledge(Fixed):
    """What a controller knows of a robot: its equations, its known constants and a first estimate; never p.

    `estimated` is the generated function of p whose values are estimated: `base_parameters`, theta, or
    `passivity_parameters`, pi.

    Raises:
        ShapeError: if the estimate does not fit the model.
        MissingTermError: if the model has no outputs to track, or no such parameters.
    """

    def __init__(
        self, model: Model, known: ArrayLike, theta_hat: ArrayLike, estimated: str = "base_parameters"
    ) -> None:
        """`known`: c (n_c,); `theta_hat`: the first estimate (n_theta,)."""
        if not model.has("decoupling_matrix"):
            raise MissingTermError(f"model {model.name} has no outputs to track", "derive it with [outputs]")
        self.model, self.estimated, self.units = model, estimated, model.units_of(estimated)
        self.known, self.theta_hat = np.array(known, dtype=float), np.array(theta_hat, dtype=float)
        count = len(self.units)
        if self.theta_hat.shape != (count,) or not np.all(np.isfinite(self.theta_hat)):
            names = ", ".join(self.units)
            raise ShapeError(f"the estimate has shape {self.theta_hat.shape}", f"expected ({count},) finite: {names}")
        for array in (self.known, self.theta_hat):
            array.flags.writeable = False

    def truth(self, p: ArrayLike) -> Floats:
        """What the estimates would be for a robot with parameters p (..., n_p), (..., n_theta)."""
        return np.asarray(getattr(self.model.in_library("numpy"), self.estimated)(p))


@dataclass(frozen=True)
class Action:
    """What a law commands at one sample, and what its update will need."""

    input: Array  # u [V], (n_u,)
    regularity: Array  # of the matrix that is inverted: positive if it is regular
    memory: Mapping[str, Any] = field(default_factory=dict)  # what else the law has computed


class Law(Fixed):
    """A control law: `act` gives the command of a sample, `update` the law's states one sample later."""

    knowledge: Knowledge
    parts: Parts[Part]
    adapts: bool  # whether its estimates move
    knows_deviation: bool = False  # of its estimates
    learning: tuple[str, ...] = ()  # parts whose states serve nothing but the estimates
    limits_inputs: bool = False  # whether its own commands are bounded
    observes: bool = False  # whether it goes by what an observer makes of the pose
    measurement: Measurement | None = None  # what `act` is given; None is x as it is measured
    slip_names: tuple[str, ...] = ()  # of what it measures of slip, in order
    lead: float = 0.0  # [s]: how much later than now the reference counts that it is given

    @property
    def values(self) -> dict[str, Floats]:
        """The numbers that may differ between robots of a batch."""
        return {"c": self.knowledge.known, **self.parts.values}

    @property
    def states(self) -> dict[str, Floats]:
        """The law's own states at the start."""
        return {"theta_hat": self.knowledge.theta_hat, **self.parts.states}

    def act(
        self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> Action:
        """The command at what is measured, x; `step` [s] is the time since the last sample."""
        raise NotImplementedError

    def sample(
        self,
        x: Array,
        reference: Point,
        drive: Callable[[Array], Array],
        z: SimpleNamespace,
        k: SimpleNamespace,
        model: Model,
        step: Array,
    ) -> tuple[Action, Array, dict[str, Array]]:
        """One sample, as simulator, robot and exported code run it: action, what reaches the motors, next states.

        `drive` tells what reaches the motors of a command.
        """
        action = self.act(x, reference, z, k, model, step)
        applied = drive(action.input)
        return action, applied, self.update(x, action, applied, z, k, model, step)

    @property
    def bounds(self) -> Projection | None:
        """What keeps the estimates within bounds, if anything does."""
        return None

    def at_bound(self, theta_hat: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """1 for each estimate that its bounds hold, else 0, (n_theta,)."""
        bounds = self.bounds
        if bounds is None:
            return 0.0 * theta_hat
        return bounds.reached(theta_hat, getattr(k, bounds.name, NOTHING), arrays)

    def deviation(self, z: SimpleNamespace, arrays: Arrays) -> Array:
        """The standard deviation of each estimate as the law knows it, (n_theta,)."""
        raise NotImplementedError

    def unexplained(self, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array) -> Array:
        """What a law that knows deviations could not explain by any estimate, (1,)."""
        raise NotImplementedError

    def update(
        self,
        x: Array,
        action: Action,
        applied: Array,
        z: SimpleNamespace,
        k: SimpleNamespace,
        model: Model,
        step: Array,
    ) -> dict[str, Array]:
        """The law's states one sample later; `applied` is what reached the motors of the command, (n_u,)."""
        raise NotImplementedError
