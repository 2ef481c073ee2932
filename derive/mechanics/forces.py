"""What the floor does to the wheels: multipliers of the constraints (7), and forces along which wheels roll.

Nothing new is solved for. While a constraint is broken at a unit speed s_i and v stays, the robot moves as R e_i with
[A; N] [R, S] = I (`Slipping`); by virtual power the multiplier is what is left of all forces along that motion:

    lambda_i = sum of frames (J_i^T (M xi' + C xi)) - sum of wheels (force along, times speed along)
             - sum of joints (motor torque times rate),        xi' = J v' + J' v

A wheel's force along is what its motor's torque leaves when the wheel has been spun up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..description.robot import Wheel
from .dynamics import Dynamics, MovingFrame, moving_frames, rate
from .kinematics import Kinematics, solve_slipping


@dataclass(frozen=True)
class FloorForces:
    """Forces of the floor on the wheels while v' = a and the motors get u."""

    constraint_forces: Matrix  # lambda, (m, 1): force on the robot along each row of A
    rolling_forces: Matrix  # (n_w, 1) [N], along each wheel's heading, of a Swedish wheel along its rollers' axles


def floor_forces(kinematics: Kinematics, dynamics: Dynamics, accelerations: Sequence[Symbol]) -> FloorForces:
    """What holds the wheels on their way; loads w act on v alone, so that N^T w does no work while a wheel slips."""
    robot, terms = kinematics.robot, kinematics.terms
    a, v = Matrix(accelerations), Matrix(kinematics.v)
    slipping = solve_slipping(kinematics)
    slips = slipping.slips
    torques = _torques(kinematics, dynamics)
    rolling: list[Expr] = []
    forces = sp.zeros(len(slips), 1)
    for wheel in robot.wheels:
        arm = robot.constants.exact(_arm(wheel))
        spin = kinematics.wheel_rates[wheel.name].row(v)
        spinning = wheel.spin_inertia * (spin * a + rate(spin, kinematics) * v)[0]
        rolling.append(terms.name(f"{wheel.name}_force_along", (torques.get(wheel.name, sp.S.Zero) - spinning) / arm))
        forces -= slipping.wheel_rates[wheel.name].row(slips).T * arm * rolling[-1]
    for frame in robot.frames:
        if frame.name in torques:
            forces -= slipping.joint_rates[frame.name].row(slips).T * torques[frame.name]
    for moving in moving_frames(kinematics):
        forces += slipping.velocities[moving.name].rows(slips).T * _inertial_force(moving, kinematics, a)
    return FloorForces(forces.applyfunc(terms.simplified), Matrix(len(rolling), 1, rolling))


def _inertial_force(frame: MovingFrame, kinematics: Kinematics, a: Matrix) -> Matrix:
    """M xi' + C xi of a frame, (3, 1)."""
    J, v = frame.jacobian, Matrix(kinematics.v)

    def named(kind: str, column: Matrix) -> Matrix:
        parts = zip(("forward", "lateral", "turning"), column, strict=True)
        return Matrix([kinematics.terms.name(f"{frame.name}_{part}{kind}", entry) for part, entry in parts])

    velocity, change = named("", J * v), named("_dot", J * a + rate(J, kinematics) * v)
    return named("_force", frame.mass_matrix * change + frame.gyration * velocity)


def _torques(kinematics: Kinematics, dynamics: Dynamics) -> dict[str, Expr]:
    """Torque of the motors on each wheel or joint that has any [N m]."""
    rates = kinematics.actuator_rates_matrix * Matrix(kinematics.v)
    torques: dict[str, Expr] = {}
    for motor, u, turning in zip(kinematics.robot.motors, dynamics.inputs, rates, strict=True):
        driven = str(motor.wheel or motor.joint)
        torques[driven] = torques.get(driven, sp.S.Zero) + motor.torque_gain * u - motor.back_emf * turning
    return {driven: kinematics.terms.name(f"{driven}_torque", torque) for driven, torque in torques.items()}


def _arm(wheel: Wheel) -> Expr:
    """Speed along per rate of spin [m]."""
    return wheel.radius * sp.cos(wheel.roller_angle or 0)
