"""The dynamics as a controller may know them: v' = Q + G u in base parameters theta and known constants c, never p.

forward: Q and G are linear in theta, v' = Y(x, u; c) theta; the paper's form.
inverse: u = Y_u(x, a; c) theta brings about v' = a, linear wherever the motors match the pseudo-velocities.
physical: neither form exists, and theta stands for the uncertain physical parameters themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.attempts import Attempts
from ..algebra.linear_solve import adjugate_over_determinant
from ..algebra.separation import NotSeparable, Parameters
from ..algebra.trigonometry import factored
from ..mechanics.dynamics import Dynamics
from ..mechanics.kinematics import Kinematics
from .base_parameters import LinearMap, linear_map
from .nonlinearity import Obstacle, obstacle
from .passivity_form import PassivityForm


@dataclass(frozen=True)
class AdaptiveForm:
    """Base parameters, and the dynamics in them."""

    kind: str  # forward, inverse or physical
    theta: tuple[Symbol, ...]
    base_parameters: tuple[Expr, ...]  # theta as functions of p
    drift: Matrix  # Q(x, theta, c), (n-m, 1)
    gain: Matrix  # G(x, theta, c), (n-m, n_u)
    regressor: Matrix | None  # of v' = Y(x, u, c) theta, (n-m, n_theta), if `forward`
    accelerations: tuple[Symbol, ...]  # a
    inverse: LinearMap | None  # u = Y_u(x, a, c) pi
    obstacle: Obstacle | None  # why there is no forward form


def adaptive_form(
    kinematics: Kinematics,
    dynamics: Dynamics,
    passivity: PassivityForm | None,
    a: tuple[Symbol, ...],
    parameters: Parameters,
    attempts: Attempts,
) -> AdaptiveForm:
    """The form in base parameters that a robot admits."""
    terms, v = kinematics.terms, kinematics.v
    inverse = passivity.inverse(v, terms) if passivity else _inverse_map(kinematics, dynamics, a, parameters)
    unloaded = _without(dynamics.acceleration, dynamics.loads, kinematics)
    try:
        forward = linear_map(unloaded, dynamics.inputs, parameters, terms, kinematics.at_defaults)
    except NotSeparable as error:
        factor = error.factor
        hindered = attempts(
            "parametrization_obstacle",
            lambda: obstacle(factor, unloaded, parameters, terms),
            Obstacle(factor, False, 0, 0),
        )
        if inverse is not None:
            theta = _theta(len(inverse.base_parameters), kinematics)
            drift, gain = _inverted(inverse, theta, kinematics)
            return AdaptiveForm("inverse", theta, inverse.base_parameters, drift, gain, None, a, inverse, hindered)
        theta = tuple(p for p in kinematics.robot.parameters if p in parameters.uncertain)
        drift = _without(unloaded, dynamics.inputs, kinematics)
        gain = Matrix.hstack(*(unloaded.applyfunc(lambda e, u=u: terms.partial(e, u)) for u in dynamics.inputs))
        return AdaptiveForm("physical", theta, theta, drift, gain, None, a, None, hindered)
    theta = _theta(len(forward.base_parameters), kinematics)
    drift = _named([f"{s.name}_drift" for s in v], forward.drift * Matrix(len(theta), 1, theta), kinematics)
    gain = Matrix.hstack(*(slope * Matrix(len(theta), 1, theta) for slope in forward.slopes))
    regressor = forward.regressor(dynamics.inputs)
    return AdaptiveForm("forward", theta, forward.base_parameters, drift, gain, regressor, a, inverse, None)


def _inverse_map(
    kinematics: Kinematics,
    dynamics: Dynamics,
    a: tuple[Symbol, ...],
    parameters: Parameters,
) -> LinearMap | None:
    """u = (Bbar K1)^-1 (Mbar a + Cbar v) in base parameters, where it is linear in any."""
    matrix, terms = dynamics.input_matrix, kinematics.terms
    if matrix.rows != matrix.cols:
        return None
    inverse = matrix.adjugate() / factored(matrix.det(method="berkowitz"))
    force = dynamics.inertia_matrix * Matrix(a) + dynamics.coriolis_matrix * Matrix(kinematics.v)
    try:
        return linear_map(inverse * force, a, parameters, terms, kinematics.at_defaults)
    except NotSeparable:
        return None


def _inverted(inverse: LinearMap, theta: tuple[Symbol, ...], kinematics: Kinematics) -> tuple[Matrix, Matrix]:
    """Q and G from u = n + N a: G = N^-1, Q = -G n."""
    names = [v.name for v in kinematics.v]
    inputs = [motor.input for motor in kinematics.robot.motors]
    effort = Matrix.hstack(*(slope * Matrix(len(theta), 1, theta) for slope in inverse.slopes))
    effort = Matrix(*effort.shape, lambda i, j: kinematics.terms.name(f"{inputs[i]}_per_{names[j]}", effort[i, j]))
    hold = _named([f"{name}_hold" for name in inputs], inverse.drift * Matrix(len(theta), 1, theta), kinematics)
    gain = adjugate_over_determinant(effort, kinematics.terms, "effort_determinant")
    return -gain * hold, gain


def _named(names: list[str], column: Matrix, kinematics: Kinematics) -> Matrix:
    return Matrix([kinematics.terms.name(name, entry) for name, entry in zip(names, column, strict=True)])


def _without(column: Matrix, symbols: tuple[Symbol, ...], kinematics: Kinematics) -> Matrix:
    """`column` with `symbols` set to zero."""
    terms, zero = kinematics.terms, dict.fromkeys(symbols, sp.S.Zero)
    return column.applyfunc(lambda e: terms.resolve(e, lambda s: not terms.atoms(s).isdisjoint(symbols)).xreplace(zero))


def _theta(count: int, kinematics: Kinematics) -> tuple[Symbol, ...]:
    return tuple(kinematics.terms.fresh(f"theta{k}") for k in range(1, count + 1))
