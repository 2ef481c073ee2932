"""The robot that is controlled: the state equation (15) at its true parameters, under what disturbs it."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import ShapeError, UnknownNameError
from wmr_afl.model.model import Language, Model
from wmr_afl.numerics.arrays import Array, Vector
from wmr_afl.plant.input_delay import InputDelay
from wmr_afl.plant.input_limits import InputLimits
from wmr_afl.plant.integrators import INTEGRATORS
from wmr_afl.plant.lateral_slip import LateralSlip
from wmr_afl.plant.loads import Load
from wmr_afl.plant.measurement_noise import MeasurementNoise
from wmr_afl.plant.payload_change import PayloadChange


class Plant:
    """x' = f + q + g u + xi (15), integrated over one sample with the input held.

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
        loads: Sequence[Load] = (),
        slip: LateralSlip | None = None,
        payload: PayloadChange | None = None,
        delay: InputDelay | None = None,
    ) -> None:
        self.parameters = np.asarray(parameters, dtype=float)
        self.start = np.asarray(start, dtype=float)
        if self.start.shape != (len(model.state_units),) or not np.all(np.isfinite(self.start)):
            names = ", ".join(model.state_units)
            raise ShapeError(
                f"the start has shape {self.start.shape}", f"expected ({len(model.state_units)},): {names}"
            )
        if integrator not in INTEGRATORS:
            raise UnknownNameError("integrator", integrator, INTEGRATORS)
        self.integrator, self.limits, self.noise = INTEGRATORS[integrator], limits, noise
        self.loads, self.slip, self.payload, self.delay = tuple(loads), slip, payload, delay
        self._n, self._velocities = model.coordinate_count, model.pseudo_velocity_count

    @property
    def values(self) -> dict[str, Vector]:
        """The numbers that may differ between robots of a batch."""
        effects = (self.limits, self.noise, self.payload, *self.loads)
        return {"p": self.parameters} | {name: v for effect in effects if effect for name, v in effect.values.items()}

    @property
    def states(self) -> dict[str, Vector]:
        return {"x": self.start, **(self.delay.states if self.delay else {})}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace) -> Array:
        """The state as it is measured; `sample` are standard normal numbers (2n-m,)."""
        return self.noise.measured(x, sample, k) if self.noise else x

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, language: Language) -> Array:
        """The voltages that reach the motors while u is commanded, (n_u,)."""
        arriving = self.delay.arriving(z) if self.delay else u
        return self.limits.applied(arriving, k, language.arrays) if self.limits else arriving

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, language: Language) -> Array:
        """w = Fbar + taubar_d (14), (n-m,)."""
        total = np.zeros(self._velocities)
        for load in self.loads:
            total = load.force(t, x[: self._n], x[self._n :], p, k, language) + total
        return total

    def parameters_at(self, t: Array, k: SimpleNamespace, language: Language) -> Array:
        """p at time t, (n_p,)."""
        return self.payload.now(t, k.p, k, language.arrays) if self.payload else k.p

    def update(
        self,
        t: Array,
        command: Array,
        applied: Array,
        z: SimpleNamespace,
        k: SimpleNamespace,
        step: Array,
        language: Language,
    ) -> dict[str, Array]:
        """The plant's state one sample later."""

        def rate(time: Array, x: Array) -> Array:
            p = self.parameters_at(time, k, language)
            w = self.load(time, x, p, k, language)
            derivative = language.model.state_derivative(x, applied, w, p)
            return derivative + self.slip.rate(time, x, language.arrays) if self.slip else derivative

        following = {"x": self.integrator(rate, t, z.x, step)}
        if self.delay is not None:
            following |= self.delay.update(command, z, language.arrays)
        return following
