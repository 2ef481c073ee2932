"""Poses of a robot's parts over time, from the formulas in its `model.json`, and the lines that draw them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import InputError, WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value

WIDTH = 0.6  # of a wheel, over its radius; a drawing's choice, because a description gives no width

# Corners of an arrow of length one along x.
_ARROW = np.array([[0, 0.02], [0.75, 0.02], [0.75, 0.1], [1, 0], [0.75, -0.1], [0.75, -0.02], [0, -0.02]])


@dataclass(frozen=True)
class Shapes:
    """A robot as seen from above at T times: lines and polygons by their corners x, y [m], each (T, corners, 2)."""

    hulls: list[Floats]  # of every frame that joins two parts or more
    links: list[Floats]  # from every frame's origin to its wheels, its bodies and what hangs on it
    wheels: list[Floats]
    rollers: list[Floats]  # of Swedish wheels, the axles of those on the ground, three a wheel
    arrow: list[Floats]  # along the heading of the root, the frame that carries all others
    joints: Floats  # where the other frames hang, (T, joints, 2)

    @property
    def points(self) -> Floats:
        """Every point that is drawn, (T, points, 2)."""
        return np.concatenate([*self.links, *self.wheels, *self.arrow, self.joints], axis=1)


class Geometry:
    """Poses of frames, wheels and bodies for physical parameters p (n_p,).

    Raises:
        InputError: if the model's geometry is damaged.
    """

    def __init__(self, model: Model, parameters: ArrayLike) -> None:
        self._file = str(model.folder / "model.json")
        self._coordinates = list(model.state_units)[: model.coordinate_count]
        p = np.asarray(parameters, dtype=float)
        self._parameters = dict(zip(model.parameter_units, p, strict=True))
        self._parts: dict[str, dict[str, dict[str, str]]] = model.metadata["geometry"]
        for kind in ("frames", "wheels", "bodies"):
            if not isinstance(self._parts.get(kind), dict) or not self._parts["frames"]:
                raise InputError(self._file, f"geometry {kind}", "is missing or damaged", "derive the robot again")

    def frames(self, states: ArrayLike) -> dict[str, Floats]:
        """x [m], y [m] and heading [rad] of every frame, the root first, at states (T, 2n-m) or q (T, n), (T, 3)."""
        return self._poses("frames", states)

    def wheels(self, states: ArrayLike) -> dict[str, Floats]:
        """As `frames`, of every wheel's hub and its rolling direction."""
        return self._poses("wheels", states)

    def bodies(self, states: ArrayLike) -> dict[str, Floats]:
        """As `frames`, of every body's centre of mass."""
        return self._poses("bodies", states)

    def shapes(self, states: ArrayLike) -> Shapes:
        """What to draw at states (T, 2n-m)."""
        frames, wheels, bodies = self.frames(states), self.wheels(states), self.bodies(states)
        parents = {name: frame["parent"] for name, frame in self._parts["frames"].items() if "parent" in frame}
        root = next(iter(frames.values()))
        hulls, links, rectangles, rollers = [], [], [], []
        for name, pose in frames.items():
            parts = [wheels[wheel] for wheel in wheels if self._parts["wheels"][wheel].get("frame") == name]
            parts += [bodies[body] for body in bodies if self._parts["bodies"][body].get("frame") == name]
            parts += [frames[child] for child, parent in parents.items() if parent == name]
            points = np.stack([pose, *parts], axis=1)[..., :2]
            links += [points[:, [0, k]] for k in range(1, len(parts) + 1)]
            corners = _hull(points[0])
            if len(corners) > 1:
                hulls.append(points[:, corners])
        for name, pose in wheels.items():
            radius, angle = self.radius(name), self.roller_angle(name)
            rectangles.append(_placed(pose, _rectangle(radius)))
            if angle is not None:
                rollers += [_placed(pose, line) for line in _roller_lines(radius, angle)]
        reach = float(np.max(np.hypot(*(hulls[0][0] - root[0, :2]).T))) if hulls else 1.0
        return Shapes(
            hulls=hulls,
            links=links,
            wheels=rectangles,
            rollers=rollers,
            arrow=[_placed(root, 0.5 * reach * _ARROW)],
            joints=np.stack([root, *(frames[name] for name in parents)], axis=1)[:, 1:, :2],
        )

    def radius(self, wheel: str) -> float:
        """The radius of a wheel [m]."""
        return float(self._value("wheels", wheel, "radius", self._parameters))

    def roller_angle(self, wheel: str) -> float | None:
        """From a Swedish wheel's heading to its rollers' axles [rad]; None for a conventional wheel."""
        if "roller_angle" not in self._parts["wheels"][wheel]:
            return None
        return float(self._value("wheels", wheel, "roller_angle", self._parameters))

    def _poses(self, kind: str, states: ArrayLike) -> dict[str, Floats]:
        q = np.asarray(states, dtype=float)
        names = self._parameters | dict(zip(self._coordinates, q.T, strict=False))
        poses = {}
        for part in self._parts[kind]:
            values = [self._value(kind, part, key, names) for key in ("x", "y", "heading")]
            poses[part] = np.stack(np.broadcast_arrays(*values, q[:, 0])[:3], axis=-1)
        return poses

    def _value(self, kind: str, part: str, key: str, names: dict[str, Any]) -> Any:
        try:
            return numpy_value(self._parts[kind][part][key], names)
        except (KeyError, TypeError, WmrError) as error:
            problem = f"cannot be read ({error})"
            raise InputError(self._file, f"geometry {kind} {part} {key}", problem, "derive the robot again") from None


def _hull(points: Floats) -> list[int]:
    """Which points are corners of the convex hull, counter-clockwise; one point if all coincide."""
    nearly = 1e-9 * float(np.max(np.ptp(points, axis=0), initial=0.0))
    order = sorted(range(len(points)), key=lambda k: (points[k, 0], points[k, 1]))

    def chain(indices: list[int]) -> list[int]:
        kept: list[int] = []
        for k in indices:
            while len(kept) > 1:
                one, other = points[kept[-1]] - points[kept[-2]], points[k] - points[kept[-2]]
                if one[0] * other[1] - one[1] * other[0] > nearly * np.hypot(*other):
                    break
                kept.pop()
            kept.append(k)
        return kept

    lower, upper = chain(order), chain(order[::-1])
    corners = lower[:-1] + upper[:-1]
    return corners if nearly > 0.0 else corners[:1]


def _rectangle(radius: float) -> Floats:
    """Corners of a wheel about its hub, (4, 2) [m]."""
    return np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * [radius, WIDTH * radius / 2.0]


def _roller_lines(radius: float, angle: float) -> list[Floats]:
    """Three lines at `angle` [rad] through a wheel's rectangle, each (2, 2) [m]."""
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    half = np.array([radius, WIDTH * radius / 2.0])
    lines = []
    for share in (-0.5, 0.0, 0.5):
        middle = share * float(np.abs(across) @ half) * across
        with np.errstate(divide="ignore"):
            crossings = np.sort((np.array([[-1.0], [1.0]]) * half - middle) / along, axis=0)
        start, end = np.max(crossings[0]), np.min(crossings[1])
        lines.append(np.array([middle + start * along, middle + end * along]))
    return lines


def _placed(pose: Floats, points: Floats) -> Floats:
    """Points (k, 2) of a part, in the plane at poses (T, 3), (T, k, 2)."""
    c, s = np.cos(pose[:, 2, None]), np.sin(pose[:, 2, None])
    x = pose[:, 0, None] + c * points[:, 0] - s * points[:, 1]
    y = pose[:, 1, None] + s * points[:, 0] + c * points[:, 1]
    return np.stack([x, y], axis=-1)
