"""The law that adapts any robot: the inputs that the estimated robot needs, nothing estimated inverted."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.direct_adaptation import DirectAdaptation
from wmr_afl.controllers.law import Action, Knowledge, Law
from wmr_afl.controllers.least_squares import LeastSquares
from wmr_afl.controllers.outer_loop import TrackingError
from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.controllers.sight import Sight
from wmr_afl.errors import MissingTermError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.linear_algebra import least_norm, regularity, solve
from wmr_afl.numerics.parts import NOTHING, Fault, Part, Parts, prefixed
from wmr_afl.numerics.vectors import per_entry, told


class Effort(Part):
    """From R u = Y pi_hat to voltages: the ones with the least sum of weights u^2, all alike within the limit.

    Where one of them is beyond `limit` [V], all are lessened by the same factor, which keeps the direction.

    Raises:
        WmrError: if a weight or the limit is not positive.
    """

    name = "effort"

    def __init__(self, inputs: int, weights: ArrayLike = 1.0, limit: float | None = None) -> None:
        self.weights = per_entry("input weights", weights, inputs)
        self.limit = None if limit is None else np.array([float(limit)])
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"input_weights": self.weights} | ({} if self.limit is None else {"limit": self.limit})

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        wrong = np.any(k.input_weights <= 0, axis=-1)
        yield wrong, lambda k: (f"input weights are {told(k.input_weights)}", "choose positive ones")
        if self.limit is not None:
            wrong = ~np.all(k.limit > 0, axis=-1)
            yield wrong, lambda k: (f"the limit is {k.limit[0]:g} V", "choose a positive one")

    def inputs(self, allocation: Array, wanted: Array, k: SimpleNamespace, model: Model) -> tuple[Array, Array]:
        """u (n_u,), and by how much it was lessened, 1 or more."""
        u, arrays = least_norm(allocation, wanted, k.input_weights, model.arrays), model.arrays
        beyond = 1.0
        if self.limit is not None:
            for i in range(u.shape[0]):
                beyond = arrays.maximum(beyond, arrays.absolute(u[i]) / k.limit[0])
        return u / beyond, beyond


class ErrorDynamics(Part):
    """e and s fade at the rate lambda [1/s].

    Raises:
        WmrError: if it is not positive.
    """

    name = "error"

    def __init__(self, rate: float) -> None:
        self.rate = np.array([float(rate)])
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"rate": self.rate}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.rate) & (k.rate > 0), axis=-1),
            lambda k: (f"the rate of the loop is {k.rate[0]:g}", "choose a positive number [1/s]"),
        )


class PassivityLaw(Law):
    """R u = Y(x, v_r, a, c) pi_hat: what the robot with the estimates needs, so that e = y - yd fades.

        v_r = E^-1 (yd' - lambda e)        s = v - v_r        a = E^-1 (yd'' - lambda e' - E' v_r) - lambda s

    With an observer v = v^ from the pose, and a less g E^-1 d^: what is not modelled meets the estimated inertia.
    yd is the reference behind a reference model. pi_hat moves by `direct` adaptation, by `least_squares`, by both
    (composite) or not at all, and stays within the box of `projection`. E and R are known: nothing that is estimated is
    inverted.

    Raises:
        MissingTermError: if the robot's motors do not act by uncertain factors on known motions.
    """

    def __init__(
        self,
        knowledge: Knowledge,
        rate: float,
        reference_rate: float,
        effort: Effort | None = None,
        direct: DirectAdaptation | None = None,
        least_squares: LeastSquares | None = None,
        projection: Projection | None = None,
        sight: Sight | None = None,
    ) -> None:
        model = knowledge.model
        if knowledge.estimated != "passivity_parameters":
            raise MissingTermError("this law estimates passivity_parameters", "give a first estimate of these")
        self.knowledge, self.direct, self.least_squares = knowledge, direct, least_squares
        self.adapts = direct is not None or least_squares is not None
        self.knows_deviation = least_squares is not None
        self.limits_inputs = effort is not None and effort.limit is not None
        self.learning = tuple(part.name for part in (direct, least_squares) if part is not None)
        self.error, self.effort = ErrorDynamics(rate), effort or Effort(len(model.input_units))
        self.reference_model = ReferenceModel(len(model.output_units), reference_rate)
        self.projection = projection or Projection(len(knowledge.theta_hat))
        self.sight = sight or Sight()
        self.observes, self.lead = self.sight.observer is not None, self.sight.lead
        self.measurement = self.sight.measurement
        self.slip_names = self.sight.slip_names
        own = (self.error, self.reference_model, self.effort, direct, least_squares, self.projection)
        self.parts: Parts[Part] = Parts((*own, *self.sight.parts))

    @property
    def bounds(self) -> Projection:
        return self.projection

    def act(
        self, x: Array, reference: Point, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> Action:
        """First learn from the sample that has ended, then command with what was learned."""
        arrays, n, rate = model.arrays, model.coordinate_count, k.error.rate[0]
        view = self.sight.look(x, z, k, model, step)
        x = view.x
        q, v, E_rate = x[:n], x[n:], model.output_map_rate(x, k.c)
        E = model.output_map(q, k.c) if view.E is None else view.E
        from_reference = view.error(reference, k.c, model)
        d = self.reference_model.distance(from_reference, z.reference_model, k.reference_model, arrays, step)
        error, wanted = self.reference_model.seen_from(from_reference, d, reference, k.reference_model, model)
        v_r = solve(E, wanted.velocity - rate * error.e, arrays)
        s = v - v_r
        a = solve(E, wanted.acceleration - rate * error.e_dot - E_rate @ v_r, arrays) - rate * s
        passed = arrays.where(step > 0.0, step, 1.0)  # a second look at the same sample teaches nothing
        pi_hat, following = self._learned(view.now, s, z, k, model, passed)
        pi_hat = arrays.where(step > 0.0, pi_hat, z.theta_hat)
        regressor, allocation = model.passivity_regressor(x, v_r, a, k.c), model.allocation(q, k.c)
        wanted_effort, removed = regressor @ pi_hat, 0.0 * s
        if view.cancelled is not None:
            inertia = self._inertia(x, pi_hat, k.c, model)
            wanted_effort, removed, a = (
                wanted_effort - inertia @ view.cancelled,
                inertia @ view.fast,
                a - view.cancelled,
            )
        u, beyond = self.effort.inputs(allocation, wanted_effort, k.effort, model)
        regular = arrays.minimum(regularity(E, arrays), regularity(allocation, arrays))
        for sound in self.sight.sound(view, k):
            regular = arrays.minimum(regular, sound)
        memory = {
            "theta_hat": pi_hat, "following": following, "distance": d, "regressor": regressor,
            "allocation": allocation, "is_free": arrays.where(beyond > 1.0, 0.0, 1.0),
            "view": view, "error": from_reference, "filtered_error": error.e_dot + rate * error.e,
            "unlimited": u * beyond, "asked": a / beyond, "removed": removed / beyond,
        }  # fmt: skip
        return Action(u, regular, memory)

    def _inertia(self, x: Array, pi_hat: Array, c: Array, model: Model) -> Array:
        """Delta^-1 Mbar of the estimated robot, (n-m, n-m): column by column, for Y is linear in (v_r, a)."""
        count, arrays = model.pseudo_velocity_count, model.arrays
        unit = np.eye(count)
        columns = [
            model.passivity_regressor(x, arrays.vector([0.0] * count), arrays.vector(list(unit[j])), c) @ pi_hat
            for j in range(count)
        ]
        return arrays.matrix([[column[i] for column in columns] for i in range(count)])

    def _learned(
        self, x: Array, s: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> tuple[Array, dict[str, Array]]:
        """pi_hat from the sample that has just ended, and the states of the least squares."""
        pi_hat, following = z.theta_hat, dict[str, Array]()
        on_rows = model.row_map(x[: model.coordinate_count], k.c).T @ s if model.has("row_map") else s
        if self.direct is not None:
            blocks = None
            if self.least_squares is not None:
                blocks = [P for _, P in self.least_squares.groups.blocks_of(z.least_squares.covariance)]
            pi_hat = self.direct.learn(pi_hat, on_rows, k.error.rate[0], blocks, z.direct, k.direct, model.arrays, step)
        if self.least_squares is not None:
            pi_hat, following = self.least_squares.learn(x, pi_hat, z.least_squares, k.least_squares, k.c, model, step)
        return self.projection.project(pi_hat, getattr(k, self.projection.name, NOTHING), model.arrays), following

    def deviation(self, z: SimpleNamespace, arrays: Arrays) -> Array:
        if self.least_squares is None:
            raise MissingTermError("a law without least squares knows no deviation", "add least_squares")
        return self.least_squares.deviation(z.least_squares, arrays)

    def unexplained(self, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array) -> Array:
        if self.least_squares is None:
            raise MissingTermError("a law without least squares explains nothing", "add least_squares")
        return self.least_squares.unexplained(z.least_squares, k.least_squares, arrays, step)

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
        known, arrays = action.memory, model.arrays
        distance: TrackingError = known["distance"]
        following = {
            "theta_hat": known["theta_hat"],
            **prefixed("reference_model", self.reference_model.update(distance, arrays)),
        }
        if self.direct is not None:
            seen = self.direct.update(known["regressor"], known["is_free"], z.direct, k.direct, arrays)
            following |= prefixed("direct", seen)
        asked = known["asked"], known["removed"]
        expected, removed = self.sight.acting(known["view"], asked, z, k.c, model)
        if self.least_squares is not None:
            data = {**known["following"], **self.least_squares.applied(applied, known["allocation"], removed)}
            following |= prefixed("least_squares", data)
        return following | self.sight.update(known["view"], expected, asked, z, k, model, step)
