"""Motion under the constraints: S (3), X (10) and every frame's velocity, per pseudo-velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import Terms, sorted_symbols
from ..algebra.trigonometry import shortest
from ..description.reader import symbol
from ..description.robot import Frame, Point2, Robot, Wheel
from .constraints import Constraints, constraint_origin, slip_origin, stacked
from .elimination import Elimination, Equation
from .velocities import ORIGIN, Form, Velocity, child_velocity, rate_of, rolling_rate, side_slip


@dataclass(frozen=True)
class Kinematics:
    """What holds of a robot's motion, in its pseudo-velocities v."""

    robot: Robot
    terms: Terms
    pseudo_velocities: dict[Symbol, Form]  # v in the coordinates' rates
    constraint_matrix: Matrix  # A(q), (m, n)
    kinematic_matrix: Matrix  # S(q), (n, n-m)
    velocities: dict[str, Velocity]  # of each frame, as forms in v
    wheel_rates: dict[str, Form]  # spin of each wheel [rad/s]
    joint_rates: dict[str, Form]  # rate of each joint's angle [rad/s]
    kept: list[str]  # origins of A's rows
    dropped: list[str]  # origins of the constraints that follow from these
    divisors: list[Expr]  # what was divided by and depends on the configuration

    @property
    def q(self) -> tuple[Symbol, ...]:
        return self.robot.coordinates

    @property
    def v(self) -> tuple[Symbol, ...]:
        return tuple(self.pseudo_velocities)

    @property
    def rates(self) -> dict[Symbol, Expr]:
        """q' = S v (4)."""
        rates = self.kinematic_matrix * Matrix(self.v)
        return {q: self.terms.name(f"{q.name}_dot", rate) for q, rate in zip(self.q, rates, strict=True)}

    @property
    def singularities(self) -> tuple[Expr, ...]:
        """Factors of what was divided by: where one of them vanishes, S is not defined."""
        factors = [base for e in self.divisors for base, _ in (f.as_base_exp() for f in sp.Mul.make_args(e))]
        return tuple(dict.fromkeys(f for f in factors if not self.terms.atoms(f).isdisjoint(self.q)))

    @property
    def actuator_rates_matrix(self) -> Matrix:
        """X (10): rates of what the motors drive, (n_u, n-m)."""
        driven = [self.wheel_rates[m.wheel] if m.wheel else self.joint_rates[str(m.joint)] for m in self.robot.motors]
        return stacked(driven, list(self.v))


def solve_kinematics(robot: Robot, pseudo_velocities: Mapping[Symbol, Form], constraints: Constraints) -> Kinematics:
    """The kinematics of `robot` in the given pseudo-velocities.

    Raises: NotSolvable, where they do not describe the motion that the constraints leave.
    """
    declared = [s.name for s in (*robot.coordinates, *robot.parameters, *pseudo_velocities)]
    terms = Terms(reserved=[*declared, *(motor.input for motor in robot.motors)])
    tree = TreeMotion(robot, terms, frozenset(pseudo_velocities))
    tree.elimination.add(
        Equation(Form(row), constraint_origin(index), is_constraint=True) for index, row in enumerate(robot.constraints)
    )
    tree.elimination.add(
        Equation(form - Form({v: sp.S.One}), f"pseudo-velocity {v.name!r}", is_constraint=False)
        for v, form in pseudo_velocities.items()
    )
    for frame in robot.frames:
        tree.grow(frame)
    tree.finish()
    named = tree.elimination.named
    rates = {q: named(f"{q.name}_dot", Form({robot.rate(q): sp.S.One})) for q in robot.coordinates}
    kept = [origin for origin in constraints.rows if origin in tree.elimination.independent]
    return Kinematics(
        robot=robot,
        terms=terms,
        pseudo_velocities={v: Form(form) for v, form in pseudo_velocities.items()},
        constraint_matrix=stacked([constraints.rows[o] for o in kept], [robot.rate(q) for q in robot.coordinates]),
        kinematic_matrix=stacked(list(rates.values()), list(pseudo_velocities)),
        velocities=tree.velocities,
        wheel_rates={
            wheel.name: named(f"{wheel.name}_rate", rolling_rate(wheel, tree.velocities[wheel.frame]))
            for wheel in robot.wheels
        },
        joint_rates={
            frame.name: named(f"{frame.name}_rate", rate_of(frame.angle, rates))
            for frame in robot.frames
            if frame.parent is not None
        },
        kept=kept,
        dropped=tree.elimination.dependent,
        divisors=tree.elimination.divisors,
    )


class TreeMotion:
    """Velocities of a robot's frames, and the rates of its coordinates, in its pseudo-velocities.

    The unknowns are the speeds of the root in its own axes and the turning rates of the frames: in them no velocity
    depends on the root's heading, and a trailer's no-slip condition gives its turning rate at once.
    """

    def __init__(self, robot: Robot, terms: Terms, given: frozenset[Symbol]) -> None:
        self.robot = robot
        coordinates = set(robot.coordinates)
        self.elimination = Elimination(terms, given, lambda e: terms.atoms(e).isdisjoint(coordinates))
        self.rates = {q: Form({robot.rate(q): sp.S.One}) for q in robot.coordinates}
        self.unmet = list(robot.coordinates)  # coordinates whose rates no frame's velocity contained so far
        self.velocities: dict[str, Velocity] = {}

    def grow(self, frame: Frame) -> None:
        """Adds a frame with its wheels, and solves what can be solved."""
        velocity = self._root_velocity(frame) if frame.parent is None else self._child_velocity(frame)
        rolling = [w for w in self.robot.wheels if w.frame == frame.name and w.roller_angle is None]
        if rolling:  # told at the axle, lateral speed will be zero
            velocity = velocity.moved(_foot_on_axle(rolling[0]))
        self.elimination.add(
            Equation(side_slip(wheel, velocity), slip_origin(wheel.name), is_constraint=True) for wheel in rolling
        )
        self.velocities[frame.name] = velocity
        self._reduce()

    def finish(self) -> None:
        """Solves what no frame's velocity contains, and checks that nothing is left.

        Raises: NotSolvable.
        """
        self._introduce(self.unmet)
        self._reduce()
        self.elimination.finish()

    def _introduce(self, coordinates: list[Symbol]) -> None:
        self.elimination.introduce(self.robot.rate(q) for q in coordinates)
        self.unmet = [q for q in self.unmet if q not in coordinates]

    def _define(self, coordinate: Symbol, form: Form) -> None:
        self.elimination.define(self.robot.rate(coordinate), form)
        self.unmet.remove(coordinate)

    def _unknown(self, frame: Frame, part: str) -> Form:
        rate = symbol(f"{frame.name} {part}")  # a name that no description can hold
        self.elimination.introduce([rate])
        return Form({rate: sp.S.One})

    def _reduce(self) -> None:
        self.elimination.reduce()
        for name, velocity in self.velocities.items():
            self.velocities[name] = velocity.map(partial(self._named, name))

    def _named(self, frame: str, part: str, form: Form) -> Form:
        return self.elimination.named(f"{frame}_{part}", form)

    def _root_velocity(self, frame: Frame) -> Velocity:
        cosine, sine = sp.cos(frame.angle), sp.sin(frame.angle)
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
        return child_velocity(parent, frame, self._turning(frame, parent.turning))

    def _turning(self, frame: Frame, parent_turning: Form) -> Form:
        """The frame's turning rate: an unknown of its own where its angle is a coordinate of its own."""
        coordinates = sorted_symbols(frame.angle.free_symbols & set(self.unmet))
        slopes = [sp.diff(frame.angle, q) for q in coordinates]
        if len(coordinates) == 1 and slopes[0] in (1, -1) and len(rate_of(frame.angle, self.rates)) == 1:
            turning = self._unknown(frame, "turning")
            self._define(coordinates[0], slopes[0] * (turning - parent_turning))
            return turning
        self._introduce(coordinates)
        return parent_turning + rate_of(frame.angle, self.rates)


def _foot_on_axle(wheel: Wheel) -> Point2:
    """The point of the wheel's axle line that is nearest to the frame's origin."""
    direction = (sp.cos(wheel.heading), sp.sin(wheel.heading))
    ahead = wheel.at[0] * direction[0] + wheel.at[1] * direction[1]
    return shortest(ahead * direction[0]), shortest(ahead * direction[1])
