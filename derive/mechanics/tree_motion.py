"""Velocities of a robot's frames, solved frame by frame from the root outwards."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import sympy as sp
from sympy import Symbol

from ..algebra.named_terms import Terms, sorted_symbols
from ..algebra.trigonometry import shortest
from ..description.reader import symbol
from ..description.robot import Frame, Point2, Robot, Wheel
from .constraints import slip_origin
from .elimination import Elimination, Equation
from .velocities import ORIGIN, Form, Velocity, child_velocity, rate_of, side_slip


class TreeMotion:
    """Velocities of a robot's frames, and the rates of its coordinates, in its pseudo-velocities.

    The unknowns are the speeds of the root in its own axes and the turning rates of the frames: in them no velocity
    depends on the root's heading, and a trailer's no-slip condition gives its turning rate at once.
    """

    def __init__(
        self, robot: Robot, terms: Terms, given: frozenset[Symbol], slips: Mapping[str, Symbol] | None = None
    ) -> None:
        """`slips`: speeds at which constraints are broken, by their origins; only these constraints are then made."""
        self.robot, self._exact, self._slips = robot, robot.constants.exact, slips
        coordinates = set(robot.coordinates)
        self.elimination = Elimination(terms, given, lambda e: terms.atoms(e).isdisjoint(coordinates))
        self.rates = {q: Form({robot.rate(q): sp.S.One}) for q in robot.coordinates}
        self.unmet = list(robot.coordinates)  # coordinates whose rates no frame's velocity contained so far
        self.velocities: dict[str, Velocity] = {}

    def grow(self, frame: Frame) -> None:
        """Add a frame with its wheels, and solve what can be solved."""
        velocity = self._root_velocity(frame) if frame.parent is None else self._child_velocity(frame)
        rolling = [w for w in self.robot.wheels if w.frame == frame.name and w.is_conventional]
        if rolling:  # at the axle, where the lateral speed will be zero
            x, y = map(self._exact, _foot_on_axle(rolling[0]))
            velocity = velocity.moved((shortest(x), shortest(y)))
        for wheel in rolling:
            self.constrain(side_slip(wheel, velocity).map(self._exact), slip_origin(wheel.name))
        self.velocities[frame.name] = velocity
        self._reduce()

    def constrain(self, form: Form, origin: str) -> None:
        """Add the equation that a constraint makes: `form` vanishes, or is its speed of slip."""
        if self._slips is None:
            self.elimination.add([Equation(form, origin, is_constraint=True)])
        elif origin in self._slips:
            slip = Form({self._slips[origin]: sp.S.One})
            self.elimination.add([Equation(form - slip, origin, is_constraint=False)])

    def finish(self) -> None:
        """Solve what no frame's velocity contains.

        Raises:
            NotSolvable: If an unknown or an equation is left.
        """
        self._introduce(self.unmet)
        self._reduce()
        self.elimination.finish()

    def _root_velocity(self, frame: Frame) -> Velocity:
        cosine, sine = self._exact(sp.cos(frame.angle)), self._exact(sp.sin(frame.angle))
        x, y = frame.at
        turning = self._turning(frame, Form())
        if x in self.unmet and y in self.unmet and x != y and frame.angle.free_symbols.isdisjoint({x, y}):
            forward, lateral = self._unknown(frame, "forward"), self._unknown(frame, "lateral")
            self._define(x, cosine * forward - sine * lateral)
            self._define(y, sine * forward + cosine * lateral)
            return Velocity(forward, lateral, turning, ORIGIN)
        self._introduce([q for q in self.unmet if q in (x.free_symbols | y.free_symbols)])
        x_rate, y_rate = rate_of(x, self.rates), rate_of(y, self.rates)
        return Velocity(cosine * x_rate + sine * y_rate, cosine * y_rate - sine * x_rate, turning, ORIGIN)

    def _child_velocity(self, frame: Frame) -> Velocity:
        parent = self.velocities[str(frame.parent)]
        velocity = child_velocity(parent, frame, self._turning(frame, parent.turning))
        return velocity.map(lambda _, form: form.map(self._exact))

    def _turning(self, frame: Frame, parent_turning: Form) -> Form:
        """The frame's turning rate: an unknown of its own if its angle is a coordinate of its own."""
        coordinates = sorted_symbols(frame.angle.free_symbols & set(self.unmet))
        slopes = [sp.diff(frame.angle, q) for q in coordinates]
        if len(coordinates) == 1 and slopes[0] in (1, -1) and len(rate_of(frame.angle, self.rates)) == 1:
            turning = self._unknown(frame, "turning")
            self._define(coordinates[0], slopes[0] * (turning - parent_turning))
            return turning
        self._introduce(coordinates)
        return parent_turning + rate_of(frame.angle, self.rates)

    def _unknown(self, frame: Frame, part: str) -> Form:
        rate = symbol(f"{frame.name} {part}")  # a name that no description can hold
        self.elimination.introduce([rate])
        return Form({rate: sp.S.One})

    def _define(self, coordinate: Symbol, form: Form) -> None:
        self.elimination.define(self.robot.rate(coordinate), form)
        self.unmet.remove(coordinate)

    def _introduce(self, coordinates: list[Symbol]) -> None:
        self.elimination.introduce(self.robot.rate(q) for q in coordinates)
        self.unmet = [q for q in self.unmet if q not in coordinates]

    def _reduce(self) -> None:
        self.elimination.reduce()
        for name, velocity in self.velocities.items():
            self.velocities[name] = velocity.map(partial(self._named, name))

    def _named(self, frame: str, part: str, form: Form) -> Form:
        return self.elimination.named(f"{frame}_{part}", form)


def _foot_on_axle(wheel: Wheel) -> Point2:
    """The point of the wheel's axle line that is nearest to the frame's origin."""
    direction = (sp.cos(wheel.heading), sp.sin(wheel.heading))
    ahead = wheel.at[0] * direction[0] + wheel.at[1] * direction[1]
    return ahead * direction[0], ahead * direction[1]
