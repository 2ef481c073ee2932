"""Degrees of mobility and steerability after Campion, Bastin, d'Andrea-Novel (1996)."""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Matrix

from ..algebra.attempts import Attempts
from .constraints import Constraints, slip_origin
from .degenerate_configurations import Conditions, degenerate_configurations
from .kinematics import Kinematics
from .lie_brackets import Growth, annihilates, bracket_growth


@dataclass(frozen=True)
class Mobility:
    """How a robot can move, at a generic configuration."""

    degree_of_mobility: int  # delta_m: dimension of the root's velocities that the wheels allow at once
    degree_of_steerability: int  # delta_s: further pseudo-velocities that turn centred conventional wheels
    growth: Growth | None  # None if it was not found out
    holonomic: tuple[str, ...]  # origins of the constraints that can be integrated
    degenerate: tuple[Conditions, ...] | None  # where the rank of A drops; None where that was not examined

    @property
    def type_name(self) -> str:
        return f"({self.degree_of_mobility},{self.degree_of_steerability})"

    @property
    def integrability(self) -> str:
        if self.growth is None:
            return "integrability not found out"
        if self.growth.controllable:
            return "completely nonholonomic"
        if self.growth.degree_of_nonholonomy == 1:
            return "holonomic"
        return f"nonholonomic with {self.growth.integrable} integrable combination(s)"


def classify(kinematics: Kinematics, constraints: Constraints, attempts: Attempts) -> Mobility:
    """The mobility of a robot."""
    terms, v = kinematics.terms, kinematics.v
    root = kinematics.velocities[kinematics.robot.frames[0].name]
    root_map = Matrix.vstack(*(form.row(v) for form in (root.forward, root.lateral, root.turning)))
    mobility = terms.rank(root_map)
    steering = [kinematics.joint_rates[name].row(v) for name in _steering_joints(kinematics)]
    growth = attempts("growth_vector", lambda: bracket_growth(kinematics), None)
    return Mobility(
        degree_of_mobility=mobility,
        degree_of_steerability=terms.rank(Matrix.vstack(root_map, *steering)) - mobility,
        growth=growth,
        holonomic=() if growth is None else attempts("holonomic_rows", lambda: _holonomic(kinematics, growth), ()),
        degenerate=attempts(
            "degenerate_configurations", lambda: degenerate_configurations(kinematics.robot, constraints), None
        ),
    )


def _holonomic(kinematics: Kinematics, growth: Growth) -> tuple[str, ...]:
    rows = zip(kinematics.kept, range(kinematics.constraint_matrix.rows), strict=True)
    return tuple(o for o, i in rows if annihilates(kinematics.constraint_matrix[i, :], growth, kinematics))


def _steering_joints(kinematics: Kinematics) -> list[str]:
    """Joints that turn a conventional wheel without moving it: its no-slip row knows their angle but not their rate."""
    robot, joints = kinematics.robot, []
    rates = [robot.rate(q) for q in kinematics.q]
    rows = dict(
        zip(kinematics.kept, (kinematics.constraint_matrix[i, :] for i in range(len(kinematics.kept))), strict=True)
    )
    for frame in robot.frames:
        angles = frame.angle.free_symbols & set(kinematics.q)
        for wheel in robot.wheels:
            row = rows.get(slip_origin(wheel.name))
            if frame.parent is None or wheel.frame != frame.name or row is None:
                continue
            centred = all(row[rates.index(robot.rate(angle))] == 0 for angle in angles)
            if centred and not row.free_symbols.isdisjoint(angles) and frame.name not in joints:
                joints.append(frame.name)
    return joints
