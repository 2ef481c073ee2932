"""The tracking law: outer loop, linearizing law, adaptation and robust term put together (Theorem 1)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.law import Action, Knowledge, Law
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.controllers.robust_term import RobustTerm
from wmr_afl.controllers.sight import Sight, View
from wmr_afl.errors import MissingTermError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Part, Parts, prefixed


class LastRegressor(Part):
    """W (n-m, n_theta) of the last sample, for an adaptation in the late order."""

    name = "last_regressor"

    def __init__(self, outputs: int, count: int) -> None:
        self.shape = outputs, count

    @property
    def states(self) -> dict[str, Floats]:
        return {"W": np.zeros(self.shape[0] * self.shape[1])}

    def matrix(self, z: SimpleNamespace, arrays: Arrays) -> Array:
        """W, (n-m, n_theta)."""
        rows, columns = self.shape
        return arrays.matrix([[z.W[i * columns + j] for j in range(columns)] for i in range(rows)])


class TrackingLaw(Law):
    """u = Dhat^-1 (eta - L_f^2 h - L_q L_f h_hat) with theta_hat' = Gamma W^T E1 (25); without adaptation frozen.

    A robust term (71) joins eta (74). With a reference model the reference begins where the robot is. With an observer
    v comes from the pose, and what is not modelled is taken out of eta.

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
        reference_model: ReferenceModel | None = None,
        sight: Sight | None = None,
    ) -> None:
        model = knowledge.model
        if adaptation is not None and not model.has("regressor"):
            raise MissingTermError(
                f"model {model.name} cannot be adapted: its dynamics are not linear in base parameters "
                f"(parametrization {model.parametrization})",
                "leave the adaptation out",
            )
        self.knowledge, self.outer_loop, self.adaptation, self.robust = knowledge, outer_loop, adaptation, robust
        self.adapts = adaptation is not None
        self.linearizing = linearizing or LinearizingLaw(len(model.input_units))
        adapting = adaptation.parts if adaptation else ()
        self.reference_model = reference_model
        is_late = adaptation is not None and adaptation.is_late
        self.last = LastRegressor(len(model.output_units), len(knowledge.units)) if is_late else None
        self.learning = () if self.last is None else (self.last.name,)
        self.sight = sight or Sight()
        self.observes, self.lead = self.sight.observer is not None, self.sight.lead
        self.measurement = self.sight.measurement
        self.slip_names = self.sight.slip_names
        own = (self.outer_loop, self.linearizing, *adapting, self.robust, self.reference_model, self.last)
        self.parts: Parts[Part] = Parts((*own, *self.sight.parts))

    @property
    def bounds(self) -> Projection | None:
        return None if self.adaptation is None else self.adaptation.projection

    def act(
        self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> Action:
        """The command at the measured state x, (25), (27), (74)."""
        view = self.sight.look(x, z, k, model, step)
        x, error = view.x, view.error(reference, k.c, model)
        memory: dict[str, Any] = {"view": view, "error": error}
        if self.reference_model is not None:
            memory["distance"] = self.reference_model.distance(
                error, z.reference_model, k.reference_model, model.arrays, step
            )
            error, reference = self.reference_model.seen_from(
                error, memory["distance"], reference, k.reference_model, model
            )
        filtered_error = self.outer_loop.filtered_error(error, k.outer_loop)
        eta = self.outer_loop.acceleration(error, reference, k.outer_loop)
        if self.robust is not None:
            v = x[model.coordinate_count :]
            eta = eta + self.robust.acceleration(v, filtered_error, z.robust, model.arrays)
        if view.cancelled is not None:
            eta = eta - view.E @ view.cancelled
        theta_hat = z.theta_hat
        if self.last is not None:
            theta_hat = self._adapted(
                self.last.matrix(z.last_regressor, model.arrays), filtered_error, z, k, model, step
            )
        u, regularity = self.linearizing.inputs(x, eta, theta_hat, k.c, k.linearizing, model)
        for sound in self.sight.sound(view, k):
            regularity = model.arrays.minimum(regularity, sound)
        return Action(u, regularity, {**memory, "filtered_error": filtered_error, "theta_hat": theta_hat})

    def _adapted(
        self, regressor: Array, error: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> Array:
        """theta_hat one step on (25)."""
        if self.adaptation is None:
            return z.theta_hat
        return self.adaptation.update(regressor, error, z.theta_hat, k, model.arrays, step)

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
        """(25), (72), (73)."""
        filtered_error, view = action.memory["filtered_error"], action.memory.get("view", View(x, x))
        x = view.now
        following = {"theta_hat": action.memory.get("theta_hat", z.theta_hat)}
        if self.adaptation is not None:
            seen = applied if self.adaptation.sees_applied else action.input
            regressor = model.regressor(x, seen, k.c)
            if self.last is None:
                following["theta_hat"] = self._adapted(regressor, filtered_error, z, k, model, step)
            else:
                rows, columns = self.last.shape
                entries = [regressor[i, j] for i in range(rows) for j in range(columns)]
                following |= prefixed(self.last.name, {"W": model.arrays.vector(entries)})
        if self.robust is not None:
            v = x[model.coordinate_count :]
            robust = self.robust.update(v, filtered_error, z.robust, k.robust, model.arrays, step)
            following |= prefixed(self.robust.name, robust)
        if self.reference_model is not None:
            moved = self.reference_model.update(action.memory["distance"], model.arrays)
            following |= prefixed(self.reference_model.name, moved)
        if view.seen is not None:
            expected = self.linearizing.acceleration(x, applied, action.memory["theta_hat"], k.c, model)
            following |= self.sight.update(view, expected + view.seen.unexpected, None, z, k, model, step)
        return following
