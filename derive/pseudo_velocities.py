"""Which pseudo-velocities v describe the motion: the description's own, or a smooth choice (3), (4)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, islice

import sympy as sp
from sympy import Symbol

from derive.constraints import Constraints, plane_velocities, stacked
from derive.elimination import NotSolvable
from derive.exact import NotRepresentable
from derive.kinematics import Kinematics, solve_kinematics
from derive.motion import Form
from derive.robot import Robot
from derive.symbols import symbol
from derive.terms import Terms

_TRIED = 200  # combinations of candidates looked at

PseudoVelocities = dict[Symbol, Form]


def choose_kinematics(robot: Robot, constraints: Constraints) -> Kinematics:
    """The kinematics in the pseudo-velocities that the description names, or else in the first smooth choice.

    Raises: InputError, where the named ones do not describe the motion.
    """
    wanted = len(robot.coordinates) - constraints.rank
    if robot.pseudo_velocities is not None:
        named = {v: Form(form) for v, form in robot.pseudo_velocities.items()}
        _check(named, wanted, robot, constraints)
        return solve_kinematics(robot, named, constraints)
    best: Kinematics | None = None
    for choice in islice(_choices(robot, constraints, wanted), _TRIED):
        try:
            kinematics = solve_kinematics(robot, choice, constraints)
        except NotSolvable:
            continue
        if best is None or len(kinematics.divisors) < len(best.divisors):
            best = kinematics
        if not kinematics.divisors:
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
    """Combinations of frames' velocities along their own axes and joint rates, the root's first."""
    candidates: PseudoVelocities = {}
    for name, velocity in plane_velocities(robot).items():
        for part, form in {
            "forward": velocity.forward,
            "lateral": velocity.lateral,
            "turning": velocity.turning,
        }.items():
            candidates[symbol(f"{name}_{part}")] = form
    for q in robot.coordinates:
        if all(q not in position.free_symbols for position in robot.frames[0].at):
            candidates[symbol(f"{q.name}_rate")] = Form({robot.rate(q): sp.S.One})
    for chosen in combinations(candidates.items(), wanted):
        choice = dict(chosen)
        if _describe_motion(choice, robot, constraints):
            yield choice
