"""Drives of simulated robots for the tests: short, lively, and of every shape."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from wmr_afl import list_models
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.log import Log
from wmr_afl.identification.recording import Drive, Sensors, drive
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value
from wmr_afl.plant.friction import Friction
from wmr_afl.plant.plant import Plant

ROBOTS = sorted(list_models())
STEERED = {
    "car": {"u_steer": "beta"},
    "type_1_1": {"u_steer": "beta"},
    "type_1_2": {"u_front": "beta1", "u_rear": "beta2"},
    "type_2_1": {"u_steer": "beta"},
}
VOLTS, RUBS = 8.0, 0.4  # [V], amplitude and Coulomb friction


def effort_of(robot: str, coulomb: str = "each", **changes: float) -> Effort:
    """A shipped robot, as its description has it but for some parameters."""
    model = next(iter(load_experiment(f"track_{robot}").loops.values())).model.in_library("numpy")
    return Effort(model, model.parameters(**changes), coulomb)  # type: ignore[arg-type]


def gains(effort: Effort) -> Floats:
    """Torque per volt of each motor [N m/V]."""
    values = dict(zip(effort.model.parameter_units, effort.p, strict=True))
    motors = effort.model.metadata["motors"].values()
    return np.array([float(numpy_value(motor["torque_gain"], values)) for motor in motors])


@cache
def driven(robot: str, seconds: float = 12.0, seed: int = 0, rubs: float = RUBS, step: float = 0.02) -> Drive:
    """Multisine voltages from rest; joints that motors turn are held about zero."""
    loop = next(iter(load_experiment(f"track_{robot}").loops.values()))
    effort, random = effort_of(robot), np.random.default_rng(seed)
    model, names = effort.model, list(effort.model.state_units)
    friction = Friction(model, 0.0, rubs * gains(effort), "wheels")
    plant = Plant(model, effort.p, np.zeros(len(names)), "rk4", [friction])
    turned = STEERED.get(robot, {})
    passive = any(names[i] not in turned.values() and not free for i, free in enumerate(effort.cyclic))
    phases = random.uniform(0.0, 2.0 * np.pi, (len(model.input_units), 4))
    rates = 2.0 * np.pi * np.array([0.15, 0.4, 0.9, 1.7])

    def commands(t: float, x: Floats) -> Floats:
        u = 0.45 * VOLTS * np.sin(rates * t + phases).sum(axis=1)
        for i, motor in enumerate(model.input_units):
            if motor in turned:
                u[i] = 0.2 * u[i] + 20.0 * (0.6 * np.sin((2.0 + 0.7 * i) * t) - x[names.index(turned[motor])])
            elif turned or passive:
                u[i] = 0.4 * u[i] + 0.6 * VOLTS  # ahead: backwards a trailer folds
        return u

    return drive(dataclasses.replace(loop, plant=plant, sample_time=step), commands, round(seconds / step))


def logged(robot: str, seconds: float = 12.0, **sensors: float) -> Log:
    """Its log."""
    return driven(robot, seconds).log(Sensors(**sensors))  # type: ignore[arg-type]


def truth(robot: str, coulomb: str = "each", rubs: float = RUBS) -> Floats:
    """Base parameters, ratios and friction; friction of a motor of another gain counts in volts of the first one."""
    effort = effort_of(robot, coulomb)
    friction = np.array([rubs * volts for volts in _first_volts(effort)])
    return np.concatenate([effort.base(effort.p), friction])


def _first_volts(effort: Effort) -> list[float]:
    ratios = dict.fromkeys(range(len(effort.model.input_units)), 1.0)
    if effort.ratio_groups:
        own = np.asarray(effort.model.gain_ratios(effort.p))
        ratios = dict(enumerate(own.tolist()))
    return [ratios[group[0]] for group in effort.friction_groups.values()]
