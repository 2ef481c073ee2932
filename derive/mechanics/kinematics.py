"""Motion under the constraints: A (2), S (3), X (10) and every frame's velocity, per pseudo-velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import Terms
from ..algebra.poles import leaves_a_pole
from ..description.robot import Robot
from .constraints import Constraints, constraint_origin, stacked
from .elimination import Equation
from .slip import SlipRow, slip_rows
from .tree_motion import TreeMotion
from .velocities import Form, Velocity, rate_of, rolling_rate


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

    def at_defaults(self, expression: Expr) -> float:
        """The value of a function of the parameters at the default parameters; nan if it has no finite one."""
        value = self.terms.expand(expression).xreplace(self.robot.numbers).evalf()
        return float(value) if value.is_Float or value.is_Rational else nan

    @cached_property
    def singularities(self) -> tuple[Expr, ...]:
        """Factors of what was divided by: S, X or a frame's velocity is not defined if one of them vanishes."""
        parts = [part for e in self.divisors for part in sp.Mul.make_args(sp.factor_terms(e))]
        factors = [part.as_base_exp()[0] for part in parts]
        moving = dict.fromkeys(f for f in factors if not self.terms.atoms(f).isdisjoint(self.q))
        velocities = [part for one in self.velocities.values() for part in (one.forward, one.lateral, one.turning)]
        forms = [*velocities, *self.wheel_rates.values(), *self.joint_rates.values()]
        functions = list(dict.fromkeys([*self.kinematic_matrix, *(c for form in forms for c in form.values())]))
        return tuple(f for f in moving if leaves_a_pole(f, functions, self.q, self.robot.numbers, self.terms))

    @property
    def actuator_rates_matrix(self) -> Matrix:
        """X (10): rates of what the motors drive, (n_u, n-m)."""
        driven = [self.wheel_rates[m.wheel] if m.wheel else self.joint_rates[str(m.joint)] for m in self.robot.motors]
        return stacked(driven, list(self.v))

    @cached_property
    def slip_rows(self) -> tuple[SlipRow, ...]:
        """What slips, row by row of the slip matrix."""
        return slip_rows(self.robot)

    @property
    def slip_matrix(self) -> Matrix:
        """Z(q): speeds of slip = Z (q' - S v), (k, n)."""
        return stacked([row.form for row in self.slip_rows], [self.robot.rate(q) for q in self.q])

    @property
    def joint_stops(self) -> Matrix | None:
        """How far joints with limits are from their lower and their upper one [rad], (n_s, 1); None if none has any."""
        limited = [(frame.angle, *frame.limits) for frame in self.robot.frames if frame.limits]
        distances = [distance for angle, lower, upper in limited for distance in (angle - lower, upper - angle)]
        return Matrix(distances).xreplace(self.robot.constants.values) if distances else None

    @property
    def joint_stops_matrix(self) -> Matrix | None:
        """The rates of these distances per pseudo-velocity, (n_s, n-m)."""
        rates = [self.joint_rates[frame.name] for frame in self.robot.frames if frame.limits]
        return stacked([side for rate in rates for side in (rate, Form() - rate)], list(self.v)) if rates else None


@dataclass(frozen=True)
class Slipping:
    """Motion in which every constraint may be broken: forms in v and in the speeds s = A q', where s = 0 is no slip.

    q' = S v + R s with [A; N] [R, S] = I, so that slip alone changes no pseudo-velocity.
    """

    slips: tuple[Symbol, ...]  # s, (m,), in the order of A's rows
    velocities: dict[str, Velocity]  # of each frame
    wheel_rates: dict[str, Form]  # spin of each wheel [rad/s]
    joint_rates: dict[str, Form]  # rate of each joint's angle [rad/s]


def solve_kinematics(robot: Robot, pseudo_velocities: Mapping[Symbol, Form], constraints: Constraints) -> Kinematics:
    """The kinematics of `robot` in the given pseudo-velocities.

    Raises:
        NotSolvable: If they do not describe the motion that the constraints leave.
    """
    declared = [s.name for s in (*robot.coordinates, *robot.parameters, *pseudo_velocities)]
    terms = Terms(reserved=[*declared, *(motor.input for motor in robot.motors)])
    tree = TreeMotion(robot, terms, frozenset(pseudo_velocities))
    _solve(tree, pseudo_velocities)
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
        wheel_rates=_wheel_rates(tree),
        joint_rates=_joint_rates(tree),
        kept=kept,
        dropped=tree.elimination.dependent,
        divisors=tree.elimination.divisors,
    )


def solve_slipping(kinematics: Kinematics) -> Slipping:
    """How the same robot moves while its constraints are broken."""
    terms, robot = kinematics.terms, kinematics.robot
    slips = {origin: terms.fresh(f"slip_{number}") for number, origin in enumerate(kinematics.kept, 1)}
    tree = TreeMotion(robot, terms, frozenset([*kinematics.v, *slips.values()]), slips)
    _solve(tree, kinematics.pseudo_velocities)
    return Slipping(tuple(slips.values()), tree.velocities, _wheel_rates(tree), _joint_rates(tree))


def _solve(tree: TreeMotion, pseudo_velocities: Mapping[Symbol, Form]) -> None:
    """Everything that moves, in the pseudo-velocities.

    Raises:
        NotSolvable: If they do not describe the motion that the constraints leave.
    """
    for index, row in enumerate(tree.robot.constraints):
        tree.constrain(Form(row), constraint_origin(index))
    tree.elimination.add(
        Equation(form - Form({v: sp.S.One}), f"pseudo-velocity {v.name!r}", is_constraint=False)
        for v, form in pseudo_velocities.items()
    )
    for frame in tree.robot.frames:
        tree.grow(frame)
    tree.finish()


def _wheel_rates(tree: TreeMotion) -> dict[str, Form]:
    named, exact = tree.elimination.named, tree.robot.constants.exact
    return {
        wheel.name: named(f"{wheel.name}_rate", rolling_rate(wheel, tree.velocities[wheel.frame]).map(exact))
        for wheel in tree.robot.wheels
    }


def _joint_rates(tree: TreeMotion) -> dict[str, Form]:
    robot, named = tree.robot, tree.elimination.named
    rates = {q: named(f"{q.name}_dot", Form({robot.rate(q): sp.S.One})) for q in robot.coordinates}
    hung = [frame for frame in robot.frames if frame.parent is not None]
    return {frame.name: named(f"{frame.name}_rate", rate_of(frame.angle, rates)) for frame in hung}
