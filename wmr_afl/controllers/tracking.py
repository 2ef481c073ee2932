"""The tracking controller: outer loop, linearizing law and adaptation put together (Theorem 1)."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.arrays import Array
from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.outer_loop import OuterLoop, tracking_error
from wmr_afl.controllers.projection import Projection
from wmr_afl.errors import MissingTermError, ShapeError
from wmr_afl.language import Language
from wmr_afl.model import Model, Vector
from wmr_afl.references import Point


@dataclass(frozen=True)
class Action:
    """What the controller commands at one sample, and what its update will need."""

    input: Array  # u [V], (n_u,)
    filtered_error: Array  # E1, (n-m,)
    regularity: Array  # of Dhat: 0 singular, 1 orthogonal


class TrackingController:
    """u = Dhat^-1 (eta - L_f^2 h - L_q L_f h_hat) with theta_hat' = Gamma W^T E1 (25); without adaptation frozen.

    It knows estimates and known constants c, never the physical parameters.
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
    ) -> None:
        if not model.has("decoupling_matrix"):
            raise MissingTermError(f"model {model.name} has no outputs to track; derive it with [outputs]")
        count = len(model.base_parameter_units)
        self.known = np.asarray(known, dtype=float)
        self.estimate = np.asarray(estimate, dtype=float)
        if self.estimate.shape != (count,) or not np.all(np.isfinite(self.estimate)):
            names = ", ".join(model.base_parameter_units)
            raise ShapeError(f"the estimate has shape {self.estimate.shape}; expected ({count},) finite: {names}")
        if adaptation is not None and not model.has("regressor"):
            raise MissingTermError(
                f"model {model.name} cannot be adapted: its dynamics are not linear in base parameters "
                f"(parametrization {model.parametrization}); leave the adaptation out"
            )
        self.outer_loop, self.adaptation = outer_loop, adaptation
        self.law = law or LinearizingLaw(len(model.input_units))
        self.projection = projection or Projection(count)

    @property
    def values(self) -> dict[str, Vector]:
        """The numbers that may differ between robots of a batch."""
        adapted = self.adaptation.values if self.adaptation else {}
        return {"c": self.known, **self.outer_loop.values, **self.law.values, **self.projection.values, **adapted}

    @property
    def states(self) -> dict[str, Vector]:
        """The controller's own state at the start."""
        return {"theta_hat": self.estimate}

    def act(self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, language: Language) -> Action:
        """The command at the measured state x, (25), (27)."""
        error = tracking_error(x, k.c, reference, language)
        eta = self.outer_loop.acceleration(error, reference, k)
        u, regularity = self.law.inputs(x, eta, z.theta_hat, k, language)
        return Action(u, self.outer_loop.filtered_error(error, k), regularity)

    def update(
        self, x: Array, action: Action, z: SimpleNamespace, k: SimpleNamespace, step: Array, language: Language
    ) -> dict[str, Array]:
        """The controller's state one sample later."""
        if self.adaptation is None:
            return {"theta_hat": z.theta_hat}
        regressor = language.model.regressor(x, action.input, k.c)
        rate = self.adaptation.rate(regressor, action.filtered_error, k)
        return {"theta_hat": self.projection.project(z.theta_hat + step * rate, k, language.arrays)}
