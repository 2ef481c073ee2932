"""What of a robot belongs together: motors of one kind, and lengths on which its kinematics depend."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


def kinds(formulas: Mapping[str, str], motors: list[str]) -> list[list[int]]:
    """The places of motors with equal formulas, in the order of their first."""
    found: dict[str, list[int]] = {}
    for motor, formula in formulas.items():
        found.setdefault(formula, []).append(motors.index(motor))
    return list(found.values())


def motor_kinds(model: Model) -> list[list[int]]:
    """The places of motors with equal torque gain and back-EMF."""
    motors = model.metadata["motors"]
    formulas = {name: f"{motor['torque_gain']}, {motor['back_emf']}" for name, motor in motors.items()}
    return kinds(formulas, list(model.input_units))


def gain_kinds(model: Model) -> list[list[int]]:
    """The places of motors whose gain is the same number of times that of the first motor beside them; not 1."""
    return kinds(model.metadata["gain_ratio_formulas"], list(model.input_units))


def is_geometry(model: Model, p: Floats) -> tuple[bool, ...]:
    """Whether S or X depends on a parameter, or a controller knows it as c, one entry a parameter."""
    q = np.random.default_rng(0).normal(size=(6, model.coordinate_count))

    def kinematics(p: Floats) -> Floats:
        parts = (model.kinematic_matrix(q, p), model.actuator_rates_matrix(q, p))
        return np.concatenate([np.ravel(part) for part in parts])

    p = np.where(p != 0.0, p, 0.1)  # at zero a length may hide
    own = kinematics(p)

    def moves(k: int) -> bool:
        return not np.allclose(kinematics(p * (1.0 + 0.01 * np.eye(len(p))[k])), own, rtol=1e-12, atol=0.0)

    names = list(model.parameter_units)
    return tuple(name in model.known_units or moves(k) for k, name in enumerate(names))
