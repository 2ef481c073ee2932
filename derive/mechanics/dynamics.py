"""Dynamics projected on S (14): kinetic energy of every frame in its own axes, DC motors, generalized forces.

A rigid body's kinetic energy in velocities along its own axes has a constant mass matrix M_i, and Lagrange's
equations in these velocities (Kirchhoff's form) are M_i xi' + C_i(omega) xi = force, C_i skew. With xi = J_i(q) v
and virtual power, the motion of all bodies is

    Mbar = sum J_i^T M_i J_i,        Cbar = sum J_i^T (M_i J_i' + C_i J_i) + X^T K2 X,        Bbar = X^T

which is S^T M S and S^T M S' + S^T C S of (14), without the large matrices M(q) and C(q, q') in between.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.linear_solve import solve_positive_definite
from ..algebra.named_terms import Terms
from ..algebra.trigonometry import shortest
from ..description.reader import symbol
from ..description.robot import Robot
from .kinematics import Kinematics


@dataclass(frozen=True)
class Dynamics:
    """Mbar v' + Cbar v + w = Bbar K1 u."""

    inputs: tuple[Symbol, ...]  # u [V]
    loads: tuple[Symbol, ...]  # w = Fbar + taubar_d, generalized forces on v
    inertia_matrix: Matrix  # Mbar(q), (n-m, n-m)
    coriolis_matrix: Matrix  # Cbar(q, v), back-EMF included, (n-m, n-m)
    input_matrix: Matrix  # Bbar K1, (n-m, n_u)
    acceleration: Matrix  # v'(x, u, w), (n-m, 1)


@dataclass(frozen=True)
class MovingFrame:
    """All that is fixed to a frame, in velocities xi = J v along its own axes: M xi' + C xi = force."""

    name: str
    jacobian: Matrix  # J, (3, n-m): forward, lateral, turning
    mass_matrix: Matrix  # M, (3, 3)
    gyration: Matrix  # C, skew, (3, 3)


def derive_dynamics(kinematics: Kinematics) -> Dynamics:
    """The dynamics of a robot with known kinematics.

    Raises:
        InputError: If a motion has no inertia.
    """
    robot, terms, v = kinematics.robot, kinematics.terms, Matrix(kinematics.v)
    inertia = sp.zeros(len(v), len(v))
    coriolis = sp.zeros(len(v), len(v))
    for rigid in moving_frames(kinematics):
        inertia += rigid.jacobian.T * rigid.mass_matrix * rigid.jacobian
        coriolis += rigid.jacobian.T * (
            rigid.mass_matrix * rate(rigid.jacobian, kinematics) + rigid.gyration * rigid.jacobian
        )
    for wheel in robot.wheels:
        if wheel.spin_inertia != 0:
            spin = kinematics.wheel_rates[wheel.name].row(v)
            inertia += wheel.spin_inertia * spin.T * spin
            coriolis += wheel.spin_inertia * spin.T * rate(spin, kinematics)
    rates_matrix = kinematics.actuator_rates_matrix
    gains = sp.diag(*(motor.torque_gain for motor in robot.motors))
    back_emf = sp.diag(*(motor.back_emf for motor in robot.motors))
    coriolis += rates_matrix.T * back_emf * rates_matrix

    def named(matrix: Matrix, kind: str) -> Matrix:
        def entry(i: int, j: int) -> Expr:
            value = terms.simplified(matrix[i, j])
            if terms.is_zero(value):
                return sp.S.Zero
            return terms.name(f"{kind}_{v[i].name}_{v[j].name}", value)

        return Matrix(*matrix.shape, entry)

    inertia = named(inertia, "inertia")
    coriolis = named(coriolis, "coriolis")
    _check_inertia(inertia, robot, terms)
    inputs = tuple(symbol(motor.input) for motor in robot.motors)
    loads = tuple(terms.fresh(f"w_{s.name}") for s in v)
    input_matrix = (rates_matrix.T * gains).applyfunc(shortest)
    force = input_matrix * Matrix(len(inputs), 1, inputs) - coriolis * v - Matrix(loads)
    return Dynamics(
        inputs=inputs,
        loads=loads,
        inertia_matrix=inertia,
        coriolis_matrix=coriolis,
        input_matrix=input_matrix,
        acceleration=solve_positive_definite(inertia, force, [s.name for s in v], terms),
    )


def moving_frames(kinematics: Kinematics) -> Iterator[MovingFrame]:
    """The frames that carry a mass."""
    robot, terms, v = kinematics.robot, kinematics.terms, Matrix(kinematics.v)
    for frame in robot.frames:
        if not _has_mass(robot, frame.name):
            continue
        velocity = kinematics.velocities[frame.name]
        mass, ahead, aside, turn_inertia = _mass_properties(robot, frame.name, velocity.point, terms)
        jacobian = velocity.rows(v)
        turning = terms.name(f"{frame.name}_turning", (jacobian[2, :] * v)[0])
        yield MovingFrame(
            name=frame.name,
            jacobian=jacobian,
            mass_matrix=Matrix([[mass, 0, -aside], [0, mass, ahead], [-aside, ahead, turn_inertia]]),
            gyration=turning * Matrix([[0, -mass, -ahead], [mass, 0, -aside], [ahead, aside, 0]]),
        )


def rate(matrix: Matrix, kinematics: Kinematics) -> Matrix:
    """The rate of change of `matrix` along q' = S v."""
    return matrix.applyfunc(lambda entry: kinematics.terms.rate(entry, kinematics.rates))


def _has_mass(robot: Robot, frame: str) -> bool:
    parts = [part for part in (*robot.bodies, *robot.wheels) if part.frame == frame]
    return any(part.mass != 0 or part.inertia != 0 for part in parts)


def _mass_properties(robot: Robot, frame: str, point: tuple[Expr, Expr], terms: Terms) -> tuple[Expr, ...]:
    """Mass, first moments ahead of and beside `point`, inertia about `point`, of all that is fixed to a frame."""
    mass = ahead = aside = inertia = sp.S.Zero
    for part in (*robot.bodies, *robot.wheels):
        if part.frame == frame:
            x, y = part.at[0] - point[0], part.at[1] - point[1]
            mass += part.mass
            ahead += part.mass * x
            aside += part.mass * y
            inertia += part.inertia + part.mass * (x**2 + y**2)
    return (
        terms.name(f"mass_{frame}", mass),
        terms.name(f"moment_ahead_{frame}", ahead),
        terms.name(f"moment_aside_{frame}", sp.expand(aside)),
        terms.name(f"inertia_{frame}", inertia),
    )


def _check_inertia(inertia: Matrix, robot: Robot, terms: Terms) -> None:
    if terms.rank(inertia) < inertia.rows:
        raise robot.reader.mistake(
            "[[bodies]]", "some motion has no inertia: Mbar is singular", "give every moving part a mass or an inertia"
        )
