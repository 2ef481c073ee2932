"""The tracking law: outer loop, linearizing law, adaptation and robust term put together (Theorem 1)."""

from __future__ import annotations

from types import SimpleNamespace

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.law import Action, Knowledge, Law
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.outer_loop import OuterLoop, tracking_error
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.robust_term import RobustTerm
from wmr_afl.errors import MissingTermError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array
from wmr_afl.numerics.parts import Part, Parts, prefixed


class TrackingLaw(Law):
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
        self.adapts = adaptation is not None
        self.linearizing = linearizing or LinearizingLaw(len(model.input_units))
        adapting = adaptation.parts if adaptation else ()
        self.parts: Parts[Part] = Parts((self.outer_loop, self.linearizing, *adapting, self.robust))

    def act(
        self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> Action:
        """The command at the measured state x, (25), (27), (74)."""
        error = tracking_error(x, k.c, reference, model)
        filtered_error = self.outer_loop.filtered_error(error, k.outer_loop)
        eta = self.outer_loop.acceleration(error, reference, k.outer_loop)
        if self.robust is not None:
            v = x[model.coordinate_count :]
            eta = eta + self.robust.acceleration(v, filtered_error, z.robust, model.arrays)
        u, regularity = self.linearizing.inputs(x, eta, z.theta_hat, k.c, k.linearizing, model)
        return Action(u, regularity, {"filtered_error": filtered_error})

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
        filtered_error = action.memory["filtered_error"]
        following = {"theta_hat": z.theta_hat}
        if self.adaptation is not None:
            seen = applied if self.adaptation.sees_applied else action.input
            regressor = model.regressor(x, seen, k.c)
            following["theta_hat"] = self.adaptation.update(
                regressor, filtered_error, z.theta_hat, k, model.arrays, step
            )
        if self.robust is not None:
            v = x[model.coordinate_count :]
            robust = self.robust.update(v, filtered_error, z.robust, k.robust, model.arrays, step)
            following |= prefixed(self.robust.name, robust)
        return following
