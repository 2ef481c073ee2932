"""Tables of what disturbs a robot: each uncertainty has one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.vectors import by_name
from wmr_afl.plant import Disturbance, Friction, InputDelay, InputLimits, LateralSlip, MeasurementNoise, PayloadChange
from wmr_afl.plant.disturbance import DisturbanceTable
from wmr_afl.plant.friction import FrictionTable
from wmr_afl.plant.input_delay import InputDelayTable
from wmr_afl.plant.input_limits import InputLimitsTable
from wmr_afl.plant.lateral_slip import LateralSlipTable
from wmr_afl.plant.loads import Load
from wmr_afl.plant.measurement_noise import MeasurementNoiseTable
from wmr_afl.plant.payload_change import PayloadTable
from wmr_input.fields import Table


class UncertaintiesTable(Table):
    """What the controller does not know of."""

    measurement_noise: MeasurementNoiseTable | None = None
    input_limits: InputLimitsTable | None = None
    input_delay: InputDelayTable | None = None
    friction: FrictionTable | None = None
    disturbance: DisturbanceTable | None = None
    lateral_slip: LateralSlipTable | None = None
    payload: PayloadTable | None = None


At = Callable[[str], AbstractContextManager[None]]


def build_effects(experiment: Any, model: Model, at: At) -> dict[str, Any]:
    """The effects by the names of the plant's arguments; `at` tells where a mistake stands.

    Raises: InputError.
    """
    return _Effects(experiment, model, at).all()


class _Effects:
    def __init__(self, experiment: Any, model: Model, at: At) -> None:
        self.experiment, self.model, self.at = experiment, model, at
        self.table = experiment.uncertainties

    def all(self) -> dict[str, Any]:
        loads = [load for load in (self.friction(), self.disturbance()) if load is not None]
        return {
            "limits": self.limits(),
            "noise": self.noise(),
            "loads": loads,
            "slip": self.slip(),
            "payload": self.payload(),
            "delay": self.delay(),
        }

    def limits(self) -> InputLimits | None:
        with self.at("[uncertainties.input_limits] volts"):
            table = self.table.input_limits
            return None if table is None else InputLimits(len(self.model.input_units), table.volts)

    def noise(self) -> MeasurementNoise | None:
        states, table = list(self.model.state_units), self.table.measurement_noise
        with self.at("[uncertainties.measurement_noise] deviation"):
            if table is None:
                return None
            deviation = by_name("state", table.deviation, states, missing=0.0)
            return MeasurementNoise(len(states), deviation, table.seed)

    def friction(self) -> Load | None:
        table = self.table.friction
        with self.at("[uncertainties.friction]"):
            if table is None:
                return None
            if table.of == "wheels" and table.on != "wheels":
                raise WmrError("friction of the wheels acts on the wheels", 'write on = "wheels"')
            return Friction(self.model, table.viscous, table.coulomb, table.on, table.of == "pseudo_velocities")

    def disturbance(self) -> Load | None:
        table = self.table.disturbance
        with self.at("[uncertainties.disturbance] expression"):
            return None if table is None else Disturbance(self.model, table.expression, table.on)

    def slip(self) -> LateralSlip | None:
        table = self.table.lateral_slip
        with self.at("[uncertainties.lateral_slip] speed"):
            return None if table is None else LateralSlip(self.model, table.speed)

    def payload(self) -> PayloadChange | None:
        table = self.table.payload
        with self.at("[uncertainties.payload] parameters"):
            if table is None:
                return None
            for name in table.parameters:
                if name in self.model.known_units:
                    raise WmrError(
                        f"{name} is a known constant, not part of the payload", "change uncertain parameters"
                    )
            return PayloadChange(
                self.model, table.time, self.model.parameters(**{**self.experiment.parameters, **table.parameters})
            )

    def delay(self) -> InputDelay | None:
        table, step = self.table.input_delay, self.experiment.simulation.sample_time
        with self.at("[uncertainties.input_delay] seconds"):
            if table is None:
                return None
            samples = round(table.seconds / step)
            if samples < 1 or abs(samples * step - table.seconds) > 1e-9 * table.seconds:
                raise WmrError(f"{table.seconds:g} s are no whole number of samples of {step:g} s", "choose a multiple")
            return InputDelay(len(self.model.input_units), samples)
