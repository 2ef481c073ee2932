"""The robot as it is: its true parameters, and one uncertainty a file."""

from wmr_afl.plant.input_limits import InputLimits
from wmr_afl.plant.integrators import INTEGRATORS
from wmr_afl.plant.measurement_noise import MeasurementNoise
from wmr_afl.plant.plant import Plant

__all__ = ["INTEGRATORS", "InputLimits", "MeasurementNoise", "Plant"]
