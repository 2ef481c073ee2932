"""Tables of what disturbs a robot: each uncertainty has one."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from wmr_afl.schema.kinds import Named, NotNegative, Number, Numbers, Positive, Table, either


class MeasurementNoiseTable(Table):
    """White noise on the measured state, standard deviation in the units of the state."""

    deviation: Named
    seed: Annotated[int, Field(ge=0)] = 0


class InputLimitsTable(Table):
    """|u| <= volts"""

    volts: Numbers


class InputDelayTable(Table):
    """Commands reach the motors late, by whole samples."""

    seconds: Positive


class FrictionTable(Table):
    """Fv r + Kd sgn r (95), acting on the pseudo-velocities or on the motors' shafts ("wheels").

    `of` = "pseudo_velocities" with `on` = "wheels" is the literal reading of (7), (13).
    """

    viscous: Numbers = 0.0
    coulomb: Numbers = 0.0
    on: Literal["pseudo_velocities", "wheels"]
    of: Literal["pseudo_velocities", "wheels"] | None = None


class DisturbanceTable(Table):
    """Expressions of time t: one for all channels, or by the name of a pseudo-velocity or of a motor's input."""

    expression: Annotated[str | dict[str, str], either("an expression, or a table channel = expression")]
    on: Literal["pseudo_velocities", "wheels"]


class LateralSlipTable(Table):
    """rU(t) of (96) [m/s], an expression of time t."""

    speed: str


class PayloadTable(Table):
    """Physical parameters of the plant that change at a time [s]."""

    time: NotNegative
    parameters: Annotated[dict[str, Number], Field(min_length=1)]


class UncertaintiesTable(Table):
    """What the controller does not know of."""

    measurement_noise: MeasurementNoiseTable | None = None
    input_limits: InputLimitsTable | None = None
    input_delay: InputDelayTable | None = None
    friction: FrictionTable | None = None
    disturbance: DisturbanceTable | None = None
    lateral_slip: LateralSlipTable | None = None
    payload: PayloadTable | None = None
