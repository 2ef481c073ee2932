"""A robot in numbers, as an engine wants it: frames on joints, bodies, wheels, motors; nothing of constraints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.model.wheel_loads import stands, wheel_loads
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import casadi_value, numpy_value


@dataclass(frozen=True)
class Body:
    """A mass that is fixed to a frame."""

    frame: str
    at: Floats  # (2,) [m], in its frame
    mass: float  # [kg]
    inertia: float  # [kg m^2], about the vertical through its centre


@dataclass(frozen=True)
class Wheel(Body):
    """A mass that rolls besides."""

    name: str
    radius: float  # [m]
    angle: float  # [rad], of its heading in its frame
    spin_inertia: float  # [kg m^2], about its axle
    roller_angle: float | None  # [rad], from the heading to the rollers' axles; None for a conventional wheel


@dataclass(frozen=True)
class Frame:
    """The root, or what hangs on its parent by a joint about the vertical."""

    name: str
    parent: str | None
    at: Floats  # (2,) [m], in its parent
    is_joint: bool  # whether its angle follows a coordinate


@dataclass(frozen=True)
class Motor:
    """torque = gain u - back_emf rate, on a wheel's axle or a joint."""

    name: str
    drives: str
    gain: float  # [N m/V]
    back_emf: float  # [N m s/rad]


@dataclass(frozen=True)
class Mechanism:
    """A model at physical parameters p (n_p,).

    Raises:
        WmrError: if an engine cannot have what the description says.
    """

    model: Model
    p: Floats

    def __post_init__(self) -> None:
        if self.model.metadata["further_constraints"]:
            problem = f"{self.model.name} has constraints that no wheel makes, which an engine cannot have"
            raise WmrError(problem, "validate a robot whose constraints are wheels and joints")
        root, hung = self._turning[:3].any(axis=0), self._turning[3:]
        for frame, own in zip(self.frames[1:], hung, strict=True):
            if own.sum() > 1 or np.any(own & root):
                text = self._parts["frames"][frame.name]["angle"]
                problem = f"joint {frame.name} of {self.model.name} turns by {text}, not by one coordinate of its own"
                raise WmrError(problem, "let each joint's angle be a formula of a coordinate that moves no root frame")

    @property
    def _parts(self) -> dict[str, dict[str, Any]]:
        return dict(self.model.metadata["geometry"])

    @cached_property
    def _values(self) -> dict[str, float]:
        return dict(zip(self.model.parameter_units, np.asarray(self.p, dtype=float).tolist(), strict=True))

    @property
    def _coordinates(self) -> list[str]:
        return list(self.model.state_units)[: self.model.coordinate_count]

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """Parents first."""
        turns = np.concatenate([[False], self._turning[3:].any(axis=1)])
        return tuple(
            Frame(name, frame.get("parent"), self._point(frame.get("at", ("0", "0"))), bool(is_joint))
            for (name, frame), is_joint in zip(self._parts["frames"].items(), turns, strict=True)
        )

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Without wheels."""
        return tuple(
            Body(part["frame"], self._point(part["at"]), self._number(part["mass"]), self._number(part["inertia"]))
            for part in self._parts["bodies"].values()
        )

    @cached_property
    def wheels(self) -> tuple[Wheel, ...]:
        """In the description's order."""
        return tuple(
            Wheel(
                frame=part["frame"],
                at=self._point(part["at"]),
                mass=self._number(part["mass"]),
                inertia=self._number(part["inertia"]),
                name=name,
                radius=self._number(part["radius"]),
                angle=self._number(part["angle"]),
                spin_inertia=self._number(part["spin_inertia"]),
                roller_angle=self._number(part["roller_angle"]) if "roller_angle" in part else None,
            )
            for name, part in self._parts["wheels"].items()
        )

    @cached_property
    def motors(self) -> tuple[Motor, ...]:
        """In the order of inputs."""
        return tuple(
            Motor(name, one["drives"], self._number(one["torque_gain"]), self._number(one["back_emf"]))
            for name, one in self.model.metadata["motors"].items()
        )

    @cached_property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        return sum(part.mass for part in (*self.bodies, *self.wheels))

    @property
    def axle_height(self) -> float:
        """Of the largest wheel [m]."""
        return max(wheel.radius for wheel in self.wheels)

    @property
    def has_rollers(self) -> bool:
        """Whether any wheel is a Swedish one."""
        return any(wheel.roller_angle is not None for wheel in self.wheels)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Frames that turn on their parents."""
        return tuple(frame.name for frame in self.frames if frame.is_joint)

    @cached_property
    def place(self) -> ca.Function:
        """q -> x, y and heading of the root and the angles of all joints (3+joints,), and their Jacobian."""
        q, every = self._angles
        found = every[[0, 1, 2, *(i for i, frame in enumerate(self.frames[1:], 3) if frame.is_joint)]]
        return ca.Function("place", [q], [found, ca.jacobian(found, q)])

    @cached_property
    def is_linear(self) -> bool:
        """Whether `place` is: its Jacobian then is the same everywhere."""
        q, every = self._angles
        return bool(ca.jacobian(ca.vec(ca.jacobian(every, q)), q).nnz() == 0)

    @cached_property
    def couplings(self) -> dict[str, tuple[str, float, float]]:
        """Joint -> an earlier one that follows the same coordinate, and angle = offset + slope (the other's)."""
        first: dict[int, int] = {}
        found = {}
        q, every = self._angles
        names = [frame.name for frame in self.frames[1:]]
        for i, own in enumerate(self._turning[3:]):
            if not own.any():
                continue
            one = int(np.flatnonzero(own)[0])
            if one not in first:
                first[one] = i
                continue
            both = ca.Function("both", [q], [every[3 + i], every[3 + first[one]]])
            unit = np.eye(q.numel())[one]
            own, others = np.array(
                [[float(value) for value in both.call([angle * unit])] for angle in (0.0, 0.5, 1.0)]
            ).T
            line = np.polyfit(others[[0, 2]], own[[0, 2]], 1)
            if not np.isclose(np.polyval(line, others[1]), own[1], rtol=0.0, atol=1e-9):
                problem = f"joints {names[first[one]]} and {names[i]} follow one coordinate, not in proportion"
                raise WmrError(problem, "let their angles be linear in it")
            found[names[i]] = (names[first[one]], float(line[1]), float(line[0]))
        return found

    @cached_property
    def _angles(self) -> tuple[ca.SX, ca.SX]:
        """q, and x, y and heading of the root with the angles of all other frames."""
        q = ca.SX.sym("q", len(self._coordinates))
        names, frames = self._names(q), list(self._parts["frames"].values())
        texts = [frames[0]["x"], frames[0]["y"], frames[0]["heading"], *(frame["angle"] for frame in frames[1:])]
        return q, ca.vertcat(*(ca.SX(casadi_value(text, names)) for text in texts))

    @cached_property
    def _turning(self) -> NDArray[np.bool_]:
        """(3+frames-1, n), which of these depends on which coordinate."""
        q, every = self._angles
        return np.asarray(ca.DM(ca.jacobian(every, q).sparsity(), 1.0)) != 0.0

    @cached_property
    def pseudo_velocities(self) -> ca.Function:
        """(q, q') -> v as the description names them, whether or not wheels slip."""
        q, rates = (ca.SX.sym(name, len(self._coordinates)) for name in ("q", "rates"))
        names = self._names(q) | {f"{name}_dot": rates[i] for i, name in enumerate(self._coordinates)}
        texts = self.model.findings["pseudo_velocities"].values()
        found = ca.vertcat(*(ca.SX(casadi_value(text, names)) for text in texts))
        return ca.Function("pseudo_velocities", [q, rates], [found])

    def fixed_angle(self, frame: str) -> float:
        """Of a frame that does not turn on its parent [rad]."""
        return self._number(self._parts["frames"][frame].get("angle", "0"))

    def loads(self, q: ArrayLike) -> Floats:
        """The weight on each wheel at q (n,), (wheels,) [N].

        Least squares among the loads that balance the weight; equal shares where none do: the robot would tip.
        """
        return wheel_loads(self.model, q, self.p)

    def stands(self, q: ArrayLike) -> bool:
        """Whether the robot stands on three wheels or more at q (n,), its centre of mass well within them."""
        return bool(stands(self.model, q, self.p))

    def _point(self, at: Any) -> Floats:
        return np.array([self._number(one) for one in at])

    def _number(self, text: str) -> float:
        return float(numpy_value(text, self._values))

    def _names(self, q: ca.SX) -> dict[str, Any]:
        return self._values | {name: q[i] for i, name in enumerate(self._coordinates)}
