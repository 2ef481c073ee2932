"""The robot that is controlled: the state equation (15) at its true parameters, under what disturbs it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.arrays import Array
from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.language import Language
from wmr_afl.model import Model, Vector
from wmr_afl.plant.input_limits import InputLimits
from wmr_afl.plant.integrators import INTEGRATORS
from wmr_afl.plant.measurement_noise import MeasurementNoise


class Plant:
    """x' = f + q + g u (15), integrated over one sample with the input held.

    Raises: ShapeError, where the start does not fit; UnknownNameError, where there is no such integrator.
    """

    def __init__(
        self,
        model: Model,
        parameters: ArrayLike,
        start: ArrayLike,
        integrator: str = "euler",
        limits: InputLimits | None = None,
        noise: MeasurementNoise | None = None,
    ) -> None:
        self.parameters = np.asarray(parameters, dtype=float)
        self.start = np.asarray(start, dtype=float)
        if self.start.shape != (len(model.state_units),) or not np.all(np.isfinite(self.start)):
            names = ", ".join(model.state_units)
            raise ShapeError(f"the start has shape {self.start.shape}; expected ({len(model.state_units)},): {names}")
        if integrator not in INTEGRATORS:
            raise UnknownNameError("integrator", integrator, INTEGRATORS)
        self.integrator, self.limits, self.noise = INTEGRATORS[integrator], limits, noise
        self._loads = model.pseudo_velocity_count

    @property
    def values(self) -> dict[str, Vector]:
        """The numbers that may differ between robots of a batch."""
        values = {"p": self.parameters}
        for effect in (self.limits, self.noise):
            values |= effect.values if effect else {}
        return values

    @property
    def states(self) -> dict[str, Vector]:
        return {"x": self.start}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace) -> Array:
        """The state as it is measured; `sample` are standard normal numbers (2n-m,)."""
        return self.noise.measured(x, sample, k) if self.noise else x

    def applied(self, u: Array, k: SimpleNamespace, language: Language) -> Array:
        """The voltages that reach the motors, (n_u,)."""
        return self.limits.applied(u, k, language.arrays) if self.limits else u

    def next_state(self, t: Array, x: Array, u: Array, k: SimpleNamespace, step: Array, language: Language) -> Array:
        """The state one sample later, (2n-m,)."""
        unloaded = np.zeros(self._loads)

        def rate(time: Array, state: Array) -> Array:
            return language.model.state_derivative(state, u, unloaded, k.p)

        return self.integrator(rate, t, x, step)
