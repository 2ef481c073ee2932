"""Where the parts of a robot are, as expressions of coordinates and parameters: for those who draw it."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr

from ..algebra.formula_text import formula
from ..algebra.trigonometry import shortest
from ..description.robot import Frame, Point2, Robot


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


def geometry(robot: Robot) -> dict[str, dict[str, dict[str, str | list[str]]]]:
    """Frames, wheels and bodies by name, each with x, y and heading as text; ready for JSON.

    A joint with limits has its angle besides, and the smallest and the largest value of this angle.
    """
    poses = frame_poses(robot)
    frames = {
        frame.name: _texts(poses[frame.name]) | ({"parent": frame.parent} if frame.parent else {}) | _limits(frame)
        for frame in robot.frames
    }
    wheels = {
        wheel.name: _texts(poses[wheel.frame].child(wheel.at, wheel.heading))
        | {"frame": wheel.frame, "radius": formula(wheel.radius)}
        | ({} if wheel.is_conventional else {"roller_angle": formula(wheel.roller_angle)})
        for wheel in robot.wheels
    }
    bodies = {
        f"{body.frame} {number}": _texts(poses[body.frame].child(body.at, sp.S.Zero)) | {"frame": body.frame}
        for number, body in enumerate(robot.bodies, 1)
    }
    return {"frames": frames, "wheels": wheels, "bodies": bodies}


def _limits(frame: Frame) -> dict[str, str | list[str]]:
    if frame.limits is None:
        return {}
    return {"angle": formula(frame.angle), "limits": list(map(formula, frame.limits))}


def _texts(pose: Pose) -> dict[str, str | list[str]]:
    return {"x": formula(pose.x), "y": formula(pose.y), "heading": formula(pose.heading)}
