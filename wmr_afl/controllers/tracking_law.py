"""The tracking controller: outer loop, linearizing law and adaptation put together (Theorem 1)."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from wmr_afl.controllers.adaptation import AdaptationTable, GradientAdaptation
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.outer_loop import OuterLoop, OuterLoopTable, tracking_error
from wmr_afl.controllers.projection import Projection, ProjectionTable
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.robust_term import RobustTable, RobustTerm
from wmr_afl.errors import MissingTermError, ShapeError
from wmr_afl.model.model import Language, Model
from wmr_afl.numerics.arrays import Array, Vector
from wmr_input.fields import Estimate, Number, Numbers, Table


@dataclass(frozen=True)
class Action:
    """What the controller commands at one sample, and what its update will need."""

    input: Array  # u [V], (n_u,)
    filtered_error: Array  # E1, (n-m,)
    regularity: Array  # of Dhat: positive where it is regular


class TrackingController:
    """u = Dhat^-1 (eta - L_f^2 h - L_q L_f h_hat) with theta_hat' = Gamma W^T E1 (25); without adaptation frozen.

    A robust term (71) joins eta (74). It knows estimates and known constants c, never the physical parameters.
    Raises: ShapeError, where the estimate does not fit; MissingTermError, where the model cannot be adapted.
    """

    def __init__(
        self,
        model: Model,
        known: ArrayLike,
        estimate: ArrayLike,
        outer_loop: OuterLoop,
        law: LinearizingLaw | None = None,
        adaptation: GradientAdaptation | None = None,
        projection: Projection | None = None,
        robust: RobustTerm | None = None,
    ) -> None:
        if not model.has("decoupling_matrix"):
            raise MissingTermError(f"model {model.name} has no outputs to track", "derive it with [outputs]")
        count = len(model.base_parameter_units)
        self.known = np.asarray(known, dtype=float)
        self.estimate = np.asarray(estimate, dtype=float)
        if self.estimate.shape != (count,) or not np.all(np.isfinite(self.estimate)):
            names = ", ".join(model.base_parameter_units)
            raise ShapeError(f"the estimate has shape {self.estimate.shape}", f"expected ({count},) finite: {names}")
        if adaptation is not None and not model.has("regressor"):
            raise MissingTermError(
                f"model {model.name} cannot be adapted: its dynamics are not linear in base parameters "
                f"(parametrization {model.parametrization})",
                "leave the adaptation out",
            )
        self.outer_loop, self.adaptation, self.robust = outer_loop, adaptation, robust
        self._coordinates = model.coordinate_count
        self.law = law or LinearizingLaw(len(model.input_units))
        self.projection = projection or Projection(count)

    @property
    def values(self) -> dict[str, Vector]:
        """The numbers that may differ between robots of a batch."""
        parts = (self.outer_loop, self.law, self.projection, self.adaptation, self.robust)
        return {"c": self.known} | {name: value for part in parts if part for name, value in part.values.items()}

    @property
    def states(self) -> dict[str, Vector]:
        """The controller's own state at the start."""
        return {"theta_hat": self.estimate, **(self.robust.states if self.robust else {})}

    def act(self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, language: Language) -> Action:
        """The command at the measured state x, (25), (27), (74)."""
        error = tracking_error(x, k.c, reference, language)
        filtered_error = self.outer_loop.filtered_error(error, k)
        eta = self.outer_loop.acceleration(error, reference, k)
        if self.robust is not None:
            eta = eta + self.robust.acceleration(x[self._coordinates :], filtered_error, z, language.arrays)
        u, regularity = self.law.inputs(x, eta, z.theta_hat, k, language)
        return Action(u, filtered_error, regularity)

    def update(
        self,
        x: Array,
        action: Action,
        applied: Array,
        z: SimpleNamespace,
        k: SimpleNamespace,
        step: Array,
        language: Language,
    ) -> dict[str, Array]:
        """The controller's state one sample later; `applied` is what reached the motors of the command."""
        following = {"theta_hat": z.theta_hat}
        if self.adaptation is not None:
            seen = applied if self.adaptation.sees_applied else action.input
            regressor = language.model.regressor(x, seen, k.c)
            change = self.adaptation.change(regressor, action.filtered_error, z.theta_hat, k, step)
            following["theta_hat"] = self.projection.project(z.theta_hat + change, k, language.arrays)
        if self.robust is not None:
            v = x[self._coordinates :]
            following |= self.robust.update(v, action.filtered_error, z, k, step, language.arrays)
        return following


class ControllerTable(Table):
    """The linearizing law; adaptive where `adaptation` is given, robust where `robust` is."""

    outer_loop: OuterLoopTable | None = None
    estimate: Estimate = "exact"
    guess: dict[str, Number] = Field(
        default_factory=dict
    )  # physical parameters as the controller believes them, in the place of `estimate`
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    robust: RobustTable | None = None
    input_weights: Numbers = 1.0
