"""The robot and what disturbs it: one uncertainty a file, none knowing the controller."""

from wmr_afl.plant.disturbance import Disturbance
from wmr_afl.plant.friction import Friction
from wmr_afl.plant.input_delay import InputDelay
from wmr_afl.plant.input_limits import InputLimits
from wmr_afl.plant.lateral_slip import LateralSlip
from wmr_afl.plant.measurement_noise import MeasurementNoise
from wmr_afl.plant.payload_change import PayloadChange
from wmr_afl.plant.plant import Plant
from wmr_afl.plant.uncertainty import Uncertainty
from wmr_afl.plant.wheel_slip import WheelSlip

__all__ = [
    "Disturbance",
    "Friction",
    "InputDelay",
    "InputLimits",
    "LateralSlip",
    "MeasurementNoise",
    "PayloadChange",
    "Plant",
    "Uncertainty",
    "WheelSlip",
]
