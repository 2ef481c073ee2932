"""The robot that is controlled: the state equation (15) at its true parameters, under what disturbs it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats, dot
from wmr_afl.numerics.complementarity import stopping_forces
from wmr_afl.numerics.linear_algebra import entries, solve
from wmr_afl.numerics.parts import Fixed, Parts, prefixed
from wmr_afl.plant.integrators import INTEGRATORS
from wmr_afl.plant.joint_stops import JointStops
from wmr_afl.plant.uncertainty import Resistance, Uncertainty


class Plant(Fixed):
    """x' = f + q + g u + xi (15), integrated over one sample with the input held.

    Forces of resistances, as Coulomb friction, are found at the start of a sample, so that they stop what they can stop
    within it, and are held over it as the input is. Euler's method then reverses no rate; what Runge and Kutta's leaves
    is of the order of step^2 and gone in the next samples.

    Raises:
        ShapeError: if the start does not fit.
        UnknownNameError: if there is no such integrator.
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        start: ArrayLike,
        integrator: str = "euler",
        uncertainties: Sequence[Uncertainty] = (),
    ) -> None:
        """`parameters`: p (n_p,); `start`: x (2n-m,); `uncertainties` in the order in which they act."""
        self.parameters, self.start = np.array(parameters, dtype=float), np.array(start, dtype=float)
        if self.start.shape != (len(model.state_units),) or not np.all(np.isfinite(self.start)):
            names = ", ".join(model.state_units)
            raise ShapeError(
                f"the start has shape {self.start.shape}", f"expected ({len(model.state_units)},): {names}"
            )
        if integrator not in INTEGRATORS:
            raise UnknownNameError("integrator", integrator, INTEGRATORS)
        stops = JointStops() if model.has("joint_stops") else None
        self.integrator, self.uncertainties = INTEGRATORS[integrator], Parts((*uncertainties, stops))
        for array in (self.parameters, self.start):
            array.flags.writeable = False

    def integrated(self, model: Model, integrator: str) -> Plant:
        """The same robot, integrated by another method.

        Raises:
            UnknownNameError: if there is no such integrator.
        """
        own = [part for part in self.uncertainties if not isinstance(part, JointStops)]  # added by every plant
        return type(self)(model, self.parameters, self.start, integrator, own)

    @property
    def values(self) -> dict[str, Floats]:
        """The numbers that may differ between robots of a batch."""
        return {"p": self.parameters, **self.uncertainties.values}

    @property
    def states(self) -> dict[str, Floats]:
        """The states at the start."""
        return {"x": self.start, **self.uncertainties.states}

    @property
    def samples(self) -> int:
        """How many standard normal numbers are drawn at every sample time."""
        return sum(part.samples for part in self.uncertainties)

    @property
    def seed(self) -> int:
        """The seed of these numbers."""
        return next((part.seed for part in self.uncertainties if part.samples), 0)

    def measured(self, x: Array, sample: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The state as it is seen, (2n-m,); `sample` are standard normal numbers (samples,)."""
        taken = 0
        for part, own in self.uncertainties.with_values(k):
            x = part.measured(x, sample[taken : taken + part.samples], own, arrays)
            taken += part.samples
        return x

    @property
    def drive(self) -> list[Uncertainty]:
        """What the robot's drive does to commands, in order, which a controller on the robot may know."""
        return [part for part in self.uncertainties if part.is_of_drive]

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The voltages that reach the motors while u is commanded, (n_u,)."""
        for _, part, state, own in self.uncertainties.with_states(z, k):
            u = part.applied(u, state, own, arrays)
        return u

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        """w = Fbar + taubar_d (14), (n-m,)."""
        w = np.zeros(model.pseudo_velocity_count)
        for part, own in self.uncertainties.with_values(k):
            force = part.load(t, x, p, own, model)
            w = w if force is None else force + w
        return w

    def parameters_at(self, t: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """p at time t, (n_p,)."""
        p = k.p
        for part, own in self.uncertainties.with_values(k):
            p = part.parameters(t, p, own, arrays)
        return p

    def resistances(self, x: Array, p: Array, k: SimpleNamespace, model: Model) -> list[Resistance]:
        """What resists the motion in state x."""
        every = (part.resistance(x, p, own, model) for part, own in self.uncertainties.with_values(k))
        return [one for one in every if one is not None]

    def holding(self, t: Array, x: Array, u: Array, k: SimpleNamespace, model: Model, step: Array) -> list[Array]:
        """The forces of all resistances over the sample from time t, (k,)."""
        p = self.parameters_at(t, k, model.arrays)
        found = self.resistances(x, p, k, model)
        if not found:
            return []
        q, v = x[: model.coordinate_count], x[model.coordinate_count :]
        free = v + step * self.rate(t, x, u, k, model)[model.coordinate_count :]
        rows, rates = [], []
        for one in found:
            for i, row in enumerate(self._rows([one], model)):
                allowed = 0.0 if one.distance is None else one.distance[i] / step + dot(row, v)
                rates.append(dot(row, free) + allowed)
                rows.append(row)
        inertia = model.inertia_matrix(q, p)
        answers = [solve(inertia, row, model.arrays) for row in rows]
        effects = [[step * dot(row, answer) for answer in answers] for row in rows]
        least, most = [b for one in found for b in one.least], [b for one in found for b in one.most]
        return stopping_forces(rates, effects, least, most, model.arrays)

    @staticmethod
    def _rows(resistances: Sequence[Resistance], model: Model) -> list[Array]:
        """The rows of J of all of them, each (n-m,)."""
        return [model.arrays.vector(row) for one in resistances for row in entries(one.matrix)]

    def rate(self, t: Array, x: Array, u: Array, k: SimpleNamespace, model: Model, held: Sequence[Array] = ()) -> Array:
        """x' (15) at time t while the motors get u and resistances hold with the forces `held`, (2n-m,)."""
        p = self.parameters_at(t, k, model.arrays)
        w = self.load(t, x, p, k, model)
        if held:
            rows = self._rows(self.resistances(x, p, k, model), model)
            w = w + sum((force * row for force, row in zip(held, rows, strict=True)), start=0.0 * w)
        return sum(self._added(t, x, p, k, model), start=model.state_derivative(x, u, w, p))

    def _added(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Iterator[Array]:
        """What uncertainties add to x', (2n-m,) each."""
        every = (part.rate(t, x, p, own, model) for part, own in self.uncertainties.with_values(k))
        return (added for added in every if added is not None)

    @property
    def slips(self) -> bool:
        """Whether q' may differ from S v."""
        return any(type(part).rate is not Uncertainty.rate for part in self.uncertainties)

    def slip(self, t: Array, x: Array, k: SimpleNamespace, model: Model) -> Array:
        """The speeds of slip Z (q' - S v), (k,) [m/s; rad/s of joints]."""
        p, n = self.parameters_at(t, k, model.arrays), model.coordinate_count
        b = sum((added[:n] for added in self._added(t, x, p, k, model)), start=0.0 * x[:n])
        return model.slip_matrix(x[:n], p) @ b

    def update(
        self, t: Array, u: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> dict[str, Array]:
        """The plant's states one sample later, for the command u."""
        following: dict[str, Array] = {}
        for key, part, state, own in self.uncertainties.with_states(z, k):
            following |= prefixed(key, part.update(u, state, own, model.arrays))
            u = part.applied(u, state, own, model.arrays)
        return {"x": self.moved(t, z.x, u, k, model, step), **following}

    def moved(self, t: Array, x: Array, u: Array, k: SimpleNamespace, model: Model, step: Array) -> Array:
        """x one sample later, for voltages u that reach the motors, (2n-m,)."""
        held = self.holding(t, x, u, k, model, step)
        return self.integrator(lambda time, x: self.rate(time, x, u, k, model, held), t, x, step)
