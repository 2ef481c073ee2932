"""The tracking law: outer loop, linearizing law, adaptation and robust term put together (Theorem 1)."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.controllers.adaptation import AdaptationTable, GradientAdaptation
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.outer_loop import OuterLoop, OuterLoopTable, tracking_error
from wmr_afl.controllers.projection import ProjectionTable
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.robust_term import RobustTable, RobustTerm
from wmr_afl.errors import MissingTermError, ShapeError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import Fixed, Part, Parts, prefixed
from wmr_afl.numerics.rules import Rule, Rules
from wmr_afl.numerics.vectors import by_name
from wmr_input.fields import Estimate, Number, Numbers, Table


class ControllerTable(Table):
    """The linearizing law; adaptive if `adaptation` is given, robust if `robust` is."""

    outer_loop: OuterLoopTable | None = None
    estimate: Estimate = "exact"
    guess: dict[str, Number] = Field(default_factory=dict)  # physical parameters that the controller takes for true
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    robust: RobustTable | None = None
    input_weights: Numbers = 1.0

    def rules(self, model: Model) -> Rules:
        """What follows from other numbers of the loop: c and theta_hat(0) from p, gains and bounds from these."""
        rules: dict[str, Rule] = {"c": lambda n: model.known(n["p"])}
        for table in (self.outer_loop, self.adaptation, self.projection):
            rules |= table.rules() if table is not None else {}
        if self.guess or self.estimate == "exact":
            rules["theta_hat"] = lambda n: model.base_parameters(model.replaced(n["p"], self.guess))
        else:
            estimate = by_name("base parameter", self.estimate, list(model.base_parameter_units))
            rules["theta_hat"] = lambda n: estimate
        return rules


class Knowledge(Fixed):
    """What a controller knows of a robot: its equations, its known constants and a first estimate; never p.

    Raises:
        ShapeError: if the estimate does not fit the model.
        MissingTermError: if the model has no outputs to track.
    """

    def __init__(self, model: Model, known: ArrayLike, theta_hat: ArrayLike) -> None:
        """`known`: c (n_c,); `theta_hat`: the first estimate (n_theta,)."""
        if not model.has("decoupling_matrix"):
            raise MissingTermError(f"model {model.name} has no outputs to track", "derive it with [outputs]")
        self.model = model
        self.known, self.theta_hat = np.array(known, dtype=float), np.array(theta_hat, dtype=float)
        count = len(model.base_parameter_units)
        if self.theta_hat.shape != (count,) or not np.all(np.isfinite(self.theta_hat)):
            names = ", ".join(model.base_parameter_units)
            raise ShapeError(f"the estimate has shape {self.theta_hat.shape}", f"expected ({count},) finite: {names}")
        for array in (self.known, self.theta_hat):
            array.flags.writeable = False


@dataclass(frozen=True)
class Action:
    """What the law commands at one sample, and what its update will need."""

    input: Array  # u [V], (n_u,)
    filtered_error: Array  # E1, (n-m,)
    regularity: Array  # of Dhat: positive if it is regular


class TrackingLaw(Fixed):
    """u = Dhat^-1 (eta - L_f^2 h - L_q L_f h_hat) with theta_hat' = Gamma W^T E1 (25); without adaptation frozen.

    A robust term (71) joins eta (74).

    Raises:
        MissingTermError: if the model cannot be adapted.
    """

    def __init__(
        self,
        knowledge: Knowledge,
        outer_loop: OuterLoop,
        linearizing: LinearizingLaw | None = None,
        adaptation: GradientAdaptation | None = None,
        robust: RobustTerm | None = None,
    ) -> None:
        model = knowledge.model
        if adaptation is not None and not model.has("regressor"):
            raise MissingTermError(
                f"model {model.name} cannot be adapted: its dynamics are not linear in base parameters "
                f"(parametrization {model.parametrization})",
                "leave the adaptation out",
            )
        self.knowledge, self.outer_loop, self.adaptation, self.robust = knowledge, outer_loop, adaptation, robust
        self.linearizing = linearizing or LinearizingLaw(len(model.input_units))
        adapting = adaptation.parts if adaptation else ()
        self.parts: Parts[Part] = Parts((self.outer_loop, self.linearizing, *adapting, self.robust))

    @property
    def values(self) -> dict[str, Floats]:
        """The numbers that may differ between robots of a batch."""
        return {"c": self.knowledge.known, **self.parts.values}

    @property
    def states(self) -> dict[str, Floats]:
        """The law's own states at the start."""
        return {"theta_hat": self.knowledge.theta_hat, **self.parts.states}

    def act(self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, model: Model) -> Action:
        """The command at the measured state x, (25), (27), (74)."""
        error = tracking_error(x, k.c, reference, model)
        filtered_error = self.outer_loop.filtered_error(error, k.outer_loop)
        eta = self.outer_loop.acceleration(error, reference, k.outer_loop)
        if self.robust is not None:
            v = x[model.coordinate_count :]
            eta = eta + self.robust.acceleration(v, filtered_error, z.robust, model.arrays)
        u, regularity = self.linearizing.inputs(x, eta, z.theta_hat, k.c, k.linearizing, model)
        return Action(u, filtered_error, regularity)

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
        following = {"theta_hat": z.theta_hat}
        if self.adaptation is not None:
            seen = applied if self.adaptation.sees_applied else action.input
            regressor = model.regressor(x, seen, k.c)
            following["theta_hat"] = self.adaptation.update(
                regressor, action.filtered_error, z.theta_hat, k, model.arrays, step
            )
        if self.robust is not None:
            v = x[model.coordinate_count :]
            robust = self.robust.update(v, action.filtered_error, z.robust, k.robust, model.arrays, step)
            following |= prefixed(self.robust.name, robust)
        return following
