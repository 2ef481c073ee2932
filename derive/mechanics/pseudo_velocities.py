"""Which pseudo-velocities v describe the motion: the description's own, or a smooth choice (3), (4)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, islice

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.finite_field import FIELD, NotRepresentable, Point
from ..algebra.named_terms import Terms
from ..description.reader import symbol
from ..description.robot import Robot
from .constraints import Constraints, plane_velocities, stacked
from .elimination import NotSolvable
from .kinematics import Kinematics, solve_kinematics
from .velocities import Form, Velocity

_LOOKED_AT = 2000  # combinations of candidates whose determinant is looked at


_SOLVED = 3  # combinations that are solved, where none is smooth everywhere


_CONFIGURATIONS = 4  # at which the determinant of a smooth choice has the same value


PseudoVelocities = dict[Symbol, Form]


def choose_kinematics(robot: Robot, constraints: Constraints) -> Kinematics:
    """The kinematics in the pseudo-velocities that the description names, or else in the first smooth choice.

    Raises:
        InputError: If the named ones do not describe the motion.
    """
    wanted = len(robot.coordinates) - constraints.rank
    if robot.pseudo_velocities is not None:
        named = {v: Form(form) for v, form in robot.pseudo_velocities.items()}
        _check(named, wanted, robot, constraints)
        return solve_kinematics(robot, named, constraints)
    best: Kinematics | None = None
    for choice in _choices(robot, constraints, wanted):
        try:
            kinematics = solve_kinematics(robot, choice, constraints)
        except NotSolvable:
            continue
        if best is None or len(kinematics.singularities) < len(best.singularities):
            best = kinematics
        if not kinematics.singularities:
            break
    if best is None:
        raise robot.reader.mistake("pseudo_velocities", "no choice was found", "name them in [pseudo_velocities]")
    return best


def _check(named: PseudoVelocities, wanted: int, robot: Robot, constraints: Constraints) -> None:
    place = "[pseudo_velocities]"
    if len(named) != wanted:
        problem = (
            f"{len(named)} pseudo-velocities, but {len(robot.coordinates)} coordinates under "
            f"{constraints.rank} independent constraints leave {wanted}"
        )
        raise robot.reader.mistake(place, problem, f"name {wanted}")
    try:
        if not _describe_motion(named, robot, constraints):
            names = ", ".join(v.name for v in named)
            problem = f"{names} do not determine the motion: with the constraints their rank is deficient"
            raise robot.reader.mistake(place, problem, "choose velocities that are independent under the constraints")
    except NotRepresentable:
        raise robot.reader.mistake(place, "are not defined at a random configuration", "check quotients") from None


def _describe_motion(choice: PseudoVelocities, robot: Robot, constraints: Constraints) -> bool:
    """Whether [A; N] has full rank at a random configuration."""
    rates = [robot.rate(q) for q in robot.coordinates]
    rows = stacked([*constraints.rows.values(), *choice.values()], rates)
    return Terms().rank(rows) == len(rates)


def _choices(robot: Robot, constraints: Constraints, wanted: int) -> Iterator[PseudoVelocities]:
    """Combinations of candidates: those that are smooth everywhere first, then those that fail least."""
    fallible = []
    for chosen in islice(combinations(_candidates(robot).items(), wanted), _LOOKED_AT):
        choice = dict(sorted(chosen, key=lambda item: item[0].name.endswith("_rate")))  # velocities in front
        matrix = stacked([*constraints.basis, *choice.values()], [robot.rate(q) for q in robot.coordinates])
        determinants = _determinants(matrix, robot)
        if 0 in determinants:
            continue
        if len(determinants) == 1:
            yield choice
        fallible.append((_failures(matrix, robot), choice))
    fallible.sort(key=lambda failures_and_choice: failures_and_choice[0])
    yield from (choice for _, choice in fallible[:_SOLVED])


def _candidates(robot: Robot) -> PseudoVelocities:
    """The root's velocities in its own axes, then rates of joints, then the other frames' velocities."""
    velocities = plane_velocities(robot)
    root, *others = velocities
    found = _of_frame(root, velocities[root])
    placed = set().union(*(e.free_symbols for e in (*robot.frames[0].at, robot.frames[0].angle)))
    for q in robot.coordinates:
        if q not in placed:
            found[symbol(f"{q.name}_rate")] = Form({robot.rate(q): sp.S.One})
    for name in others:
        found |= _of_frame(name, velocities[name])
    return found


def _of_frame(name: str, velocity: Velocity) -> PseudoVelocities:
    parts = {"forward": velocity.forward, "lateral": velocity.lateral, "turning": velocity.turning}
    return {symbol(f"{name}_{part}"): form for part, form in parts.items()}


def _determinants(matrix: Matrix, robot: Robot) -> set[int]:
    """Values of det [A; N] at random configurations with the same parameters: one value, not 0, where S is smooth."""
    parameters = Point(0)
    values: set[int] = set()
    for seed in range(100):
        point = Point(seed, values={p: parameters(p) for p in robot.parameters})
        try:
            values.add(point.determinant(matrix))
        except NotRepresentable:
            continue
        if len(values) > 1 or 0 in values or seed >= _CONFIGURATIONS:
            return values
    raise NotRepresentable(matrix)


def _failures(matrix: Matrix, robot: Robot) -> tuple[bool, int, int]:
    """Whether det [A; N] vanishes at zero, on how many joints it depends, at how many quarter turns it vanishes."""

    def vanishes_at(place: dict[Symbol, Expr]) -> bool:
        try:
            return Point(0).determinant(matrix.xreplace(place)) == 0
        except NotRepresentable:
            return True

    joints = [q for q in robot.coordinates if any(q in frame.angle.free_symbols for frame in robot.frames[1:])]
    quarters = [{q: sign * sp.pi / 2} for q in joints for sign in (1, -1)]
    moving = sum(_depends_on(q, matrix) for q in joints)
    return vanishes_at(dict.fromkeys(robot.coordinates, sp.S.Zero)), moving, sum(map(vanishes_at, quarters))


def _depends_on(q: Symbol, matrix: Matrix) -> bool:
    """Whether det [A; N] differs at two random configurations that differ in q only."""
    try:
        here, there = (Point(0, values={q: FIELD(number)}).determinant(matrix) for number in (3, 5))
    except NotRepresentable:
        return True
    return here != there
