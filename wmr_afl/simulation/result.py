"""The result of one closed loop: signals over time, and their errors in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wmr_afl.errors import SimulationError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.conditions import Condition

UNDETERMINED = 0.5  # of the deviation of the first guess: what is left of it when little was learned


@dataclass(frozen=True)
class Failure:
    """Why a run ended before its time."""

    time: float  # [s]
    cause: str

    def __str__(self) -> str:
        return f"stopped at t = {self.time:g} s: {self.cause}"


@dataclass(frozen=True, repr=False)
class Run:
    """One robot under one controller; T samples, one row each. A run that failed holds what came before."""

    controller: str
    model: Model
    time: Floats  # (T,) [s]
    state: Floats  # (T, 2n-m)
    input: Floats  # (T, n_u) [V], as applied
    command: Floats  # (T, n_u) [V], as the controller wanted it
    error: Floats  # (T, n-m), e = y - yr of the true state
    estimate: Floats  # (T, n_theta)
    reference: Floats  # (T, n-m)
    parameters: Floats  # p (n_p,) of the robot at the start
    known: Floats  # c (n_c,), which the controller knew
    failure: Failure | None = None
    warnings: tuple[str, ...] = ()  # what makes the run doubtful, with remedies
    estimated: str = "base_parameters"  # the generated function of p whose values are estimated
    deviation: Floats | None = None  # (T, n_theta), standard deviation of each estimate, if the law knows it
    unexplained: Floats | None = None  # (T,) [V s^1/2], what the equation of motion left in the last seconds, if known
    observed: Floats | None = None  # (T, 2n-m), the state as an observer tells it from the pose, if there is one
    unexpected: Floats | None = None  # (T, n-m), d^ of the observer: y'' that the law did not expect
    surprise: Floats | None = None  # (T,) [m, rad], by how much the observer missed what was measured, the largest
    slip: Floats | None = None  # (T, k) [m/s], how wheels slip as measured, if there is an observer
    slip_true: Floats | None = None  # (T, k) [m/s], how they slip, if anything makes them
    slip_names: tuple[str, ...] = ()  # (k,), as "right sideways"
    conditions: tuple[Condition, ...] = ()  # of proofs in discrete time, tried along the run

    def __repr__(self) -> str:
        end = str(self.failure) if self.failure else "complete"
        return f"<Run of {self.model.name} under {self.controller}: {len(self.time)} samples, {end}>"

    @property
    def estimate_units(self) -> dict[str, str]:
        """The unit of each estimate, by name."""
        return self.model.units_of(self.estimated)

    @property
    def slip_units(self) -> dict[str, str]:
        """The unit of each speed of slip, by name."""
        return dict.fromkeys(self.slip_names, "m/s")

    @property
    def undetermined(self) -> tuple[str, ...] | None:
        """The parameters of which the run has told little by themselves; None where the law knows no deviation."""
        if self.deviation is None:
            return None
        if not len(self.deviation):
            return ()
        left = self.deviation[-1] / self.deviation[0]
        return tuple(name for name, share in zip(self.estimate_units, left, strict=True) if share > UNDETERMINED)

    @property
    def output(self) -> Floats:
        """y = h(q), (T, n-m)."""
        model = self.model.in_library("numpy")
        return np.asarray(model.output(self.state[:, : model.coordinate_count], self.known))

    @checked
    def rms(self, since: float = 0.0, until: float = np.inf) -> Floats:
        """Root mean square of the tracking error from `since` to `until` [s], (n-m,).

        Raises:
            SimulationError: if the run failed before `until`, or has no sample in between.
        """
        error = self._window(since, until)
        scale = np.exp2(np.frexp(np.abs(error).max(axis=0))[1] - 1.0)  # a power of two changes no digit of the rest
        return scale * np.sqrt(np.mean((error / scale) ** 2, axis=0))

    @checked
    def largest_error(self, since: float = 0.0, until: float = np.inf) -> Floats:
        """Largest absolute tracking error from `since` to `until` [s], (n-m,).

        Raises:
            SimulationError: if the run failed before `until`, or has no sample in between.
        """
        return np.max(np.abs(self._window(since, until)), axis=0)

    def _window(self, since: float, until: float) -> Floats:
        if self.failure is not None and self.failure.time <= until:
            raise SimulationError(f"{self.controller} {self.failure}", "ask for a window before that time")
        rows = (self.time >= since) & (self.time <= until)
        if not rows.any():
            lasts = f"{self.time[-1]:g} s" if len(self.time) else "no sample"
            raise SimulationError(
                f"no sample of {self.controller} between {since:g} s and {until:g} s", f"the run lasts {lasts}"
            )
        return self.error[rows]
