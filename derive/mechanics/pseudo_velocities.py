"""Which pseudo-velocities v describe the motion: the description's own, or a smooth choice (3), (4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice

import sympy as sp
from sympy import Symbol
from sympy.polys.matrices import DomainMatrix

from ..algebra.finite_field import FIELD, TRIED_POINTS, Element, NotRepresentable, Point, with_constants
from ..algebra.named_terms import Terms
from ..description.reader import symbol
from ..description.robot import Robot
from .constraints import Constraints, plane_velocities, stacked
from .elimination import NotSolvable
from .kinematics import Kinematics, solve_kinematics
from .numeric_motion import Poles
from .velocities import Form, Velocity

_LOOKED_AT = 2000  # combinations of candidates whose determinant is looked at


_SOLVED = 3  # combinations that are solved, where no determinant shows that one is smooth everywhere


_CONFIGURATIONS = 5  # at which the determinant of a smooth choice has the same value


_FAR = 1000  # between the seeds of two draws


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
    """Combinations of candidates: those that are smooth everywhere first, then those with the fewest poles."""
    candidates = _candidates(robot)
    determinants = _Determinants(robot, constraints, candidates)
    fallible = []
    for chosen in islice(combinations(candidates, wanted), _LOOKED_AT):
        values = determinants(chosen)
        if 0 in values:
            continue
        in_order = sorted(chosen, key=lambda v: v.name.endswith("_rate"))  # velocities in front
        choice = {v: candidates[v] for v in in_order}
        if len(values) == 1:
            yield choice
        fallible.append((chosen, choice))
    poles = Poles(robot, constraints, candidates)
    fallible.sort(key=lambda both: poles(both[0]))
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


class _Determinants:
    """Values of det [A; N] at random configurations with the same parameters: one value, not 0, where S is smooth."""

    def __init__(self, robot: Robot, constraints: Constraints, candidates: PseudoVelocities) -> None:
        self.rates = [robot.rate(q) for q in robot.coordinates]
        forms = [*constraints.basis, *candidates.values()]
        matrix = stacked(forms, self.rates)
        self.places = {v: len(constraints.basis) + k for k, v in enumerate(candidates)}
        self.basis = list(range(len(constraints.basis)))

        def values(draw: int, seed: int) -> list[list[Element]]:
            drawn = Point(_FAR * draw)
            point = Point(_FAR * draw + seed, values={p: drawn(p) for p in robot.parameters})
            return [[point(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]

        self.values = with_constants(values, _CONFIGURATIONS, TRIED_POINTS)

    def __call__(self, chosen: Sequence[Symbol]) -> set[int]:
        found: set[int] = set()
        rows = [*self.basis, *(self.places[v] for v in chosen)]
        for values in self.values:
            matrix = DomainMatrix([values[row] for row in rows], (len(rows), len(self.rates)), FIELD)
            found.add(int(matrix.det()))
            if len(found) > 1 or 0 in found:
                break
        return found
