"""The robot that is controlled: the state equation (15) at its true parameters, under what disturbs it."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Fixed, Parts, prefixed
from wmr_afl.plant.integrators import INTEGRATORS
from wmr_afl.plant.uncertainty import Uncertainty


class Plant(Fixed):
    """x' = f + q + g u + xi (15), integrated over one sample with the input held.

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
        self.integrator, self.uncertainties = INTEGRATORS[integrator], Parts(uncertainties)
        for array in (self.parameters, self.start):
            array.flags.writeable = False

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

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The voltages that reach the motors while u is commanded, (n_u,)."""
        for _, part, state, own in self.uncertainties.with_states(z, k):
            u = part.applied(u, state, own, arrays)
        return u

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        """w = Fbar + taubar_d (14), (n-m,)."""
        total = np.zeros(model.pseudo_velocity_count)
        for part, own in self.uncertainties.with_values(k):
            force = part.load(t, x, p, own, model)
            total = total if force is None else force + total
        return total

    def parameters_at(self, t: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """p at time t, (n_p,)."""
        p = k.p
        for part, own in self.uncertainties.with_values(k):
            p = part.parameters(t, p, own, arrays)
        return p

    def rate(self, t: Array, x: Array, u: Array, k: SimpleNamespace, model: Model) -> Array:
        """x' (15) at time t while the motors get u, (2n-m,)."""
        p = self.parameters_at(t, k, model.arrays)
        x_dot = model.state_derivative(x, u, self.load(t, x, p, k, model), p)
        for part, own in self.uncertainties.with_values(k):
            added = part.rate(t, x, own, model)
            x_dot = x_dot if added is None else x_dot + added
        return x_dot

    def update(
        self, t: Array, u: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array
    ) -> dict[str, Array]:
        """The plant's states one sample later, for the command u."""
        following: dict[str, Array] = {}
        for key, part, state, own in self.uncertainties.with_states(z, k):
            following |= prefixed(key, part.update(u, state, own, model.arrays))
            u = part.applied(u, state, own, model.arrays)
        return {"x": self.integrator(lambda time, x: self.rate(time, x, u, k, model), t, z.x, step), **following}
