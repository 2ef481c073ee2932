"""Where the parts of a robot are and what they weigh, as expressions: for those who draw it or build it elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr

from ..algebra.formula_text import formula
from ..algebra.trigonometry import shortest
from ..description.robot import Body, Frame, Point2, Robot

Part = dict[str, str | list[str]]


@dataclass(frozen=True)
class Pose:
    """Absolute position [m] and heading [rad]."""

    x: Expr
    y: Expr
    heading: Expr

    def point(self, at: Point2) -> tuple[Expr, Expr]:
        """The absolute position of a point that moves with the pose."""
        c, s = sp.cos(self.heading), sp.sin(self.heading)
        return self.x + c * at[0] - s * at[1], self.y + s * at[0] + c * at[1]

    def child(self, at: Point2, angle: Expr) -> Pose:
        """The pose of what sits at a point of this one, turned by an angle."""
        x, y = self.point(at)
        return Pose(shortest(x), shortest(y), self.heading + angle)


def frame_poses(robot: Robot) -> dict[str, Pose]:
    """Every frame's pose, the root's first."""
    poses: dict[str, Pose] = {}
    for frame in robot.frames:
        if frame.parent is None:
            poses[frame.name] = Pose(*frame.at, frame.angle)
        else:
            poses[frame.name] = poses[frame.parent].child(frame.at, frame.angle)
    return poses


def geometry(robot: Robot) -> dict[str, dict[str, Part]]:
    """Frames, wheels and bodies by name as text; ready for JSON.

    x, y and heading are absolute; `at` and `angle` are in the parent frame, or the own frame of a wheel or a body.
    A wheel's `inertia` is about the vertical, its `spin_inertia` about its axle.
    """
    poses = frame_poses(robot)
    frames = {frame.name: _texts(poses[frame.name]) | _joint(frame) for frame in robot.frames}
    wheels = {
        wheel.name: _texts(poses[wheel.frame].child(wheel.at, wheel.heading))
        | {"frame": wheel.frame, "radius": formula(wheel.radius)}
        | ({} if wheel.is_conventional else {"roller_angle": formula(wheel.roller_angle)})
        | {"angle": formula(wheel.heading), "spin_inertia": formula(wheel.spin_inertia)}
        | _mass(wheel)
        for wheel in robot.wheels
    }
    bodies = {
        f"{body.frame} {number}": _texts(poses[body.frame].child(body.at, sp.S.Zero))
        | {"frame": body.frame}
        | _mass(body)
        for number, body in enumerate(robot.bodies, 1)
    }
    return {"frames": frames, "wheels": wheels, "bodies": bodies}


def _joint(frame: Frame) -> Part:
    if frame.parent is None:
        return {}
    limits: Part = {} if frame.limits is None else {"limits": list(map(formula, frame.limits))}
    at = list(map(formula, frame.at))
    return {"parent": frame.parent, "at": at, "angle": formula(frame.angle), **limits}


def _mass(body: Body) -> Part:
    return {"at": list(map(formula, body.at)), "mass": formula(body.mass), "inertia": formula(body.inertia)}


def _texts(pose: Pose) -> Part:
    return {"x": formula(pose.x), "y": formula(pose.y), "heading": formula(pose.heading)}
