"""Wheels that forbid each other's motion: their axles have no common centre, exactly or but for a misprint."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp
from sympy import Matrix

from wmr_input import InputError

from ..algebra.constants import near_fractions_of_pi
from ..algebra.named_terms import Terms
from ..description.robot import Robot
from .constraints import Constraints, plane_velocities, slip_origin, stacked
from .numeric_motion import Floats, matrix_values
from .velocities import Form

_NEARLY = 2e-3  # of a row's length: each of two axles may be off by a thousandth
_PLACES = 5  # random configurations that all say so

REMEDY = (
    "let one steering angle follow from another (angle = a formula of the same coordinate), let a wheel slide sideways "
    "(roller_angle = 0), or give skid steering a fixed centre of rotation ([[constraints]]); see docs/robots.md"
)


def check_axles(robot: Robot, constraints: Constraints) -> None:
    """Fail if the wheels leave the robot no motion, or none that its description speaks of.

    Raises:
        InputError: If axles have no common centre, or have one but for a misprint.
    """
    rows = {wheel.name: constraints.rows[slip_origin(wheel.name)] for wheel in robot.wheels if wheel.is_conventional}
    if not rows:
        return
    _check_nearly_dependent(robot, rows)
    axles = _Axles(robot, rows)
    axles.check_the_robot_moves()
    left = len(robot.coordinates) - constraints.rank
    if left == 0:
        count = len(constraints.rows)
        raise robot.reader.mistake(
            "[[wheels]]",
            f"the {count} constraints leave no motion: their rank is that of the {len(robot.coordinates)} coordinates",
            "align axles, put a wheel on a jointed frame, or give it rollers (roller_angle)",
        )
    meant = [len(one) for one in (robot.pseudo_velocities, robot.outputs) if one]
    if left in meant:  # the description speaks of the motion that is left
        return
    axles.check_frames_turn()
    if meant and max(meant) > left:
        axles.check_the_robot_turns()


class _Axles:
    """What the rows of the wheels that must not slip allow."""

    def __init__(self, robot: Robot, rows: Mapping[str, Form]) -> None:
        self.robot, self.rows = robot, rows
        self.rates = [robot.rate(q) for q in robot.coordinates]
        self.velocities = plane_velocities(robot)
        self.root = self.velocities[robot.frames[0].name]

    def check_the_robot_moves(self) -> None:
        """Fail with InputError if wheels hold the root."""
        motion = [self.root.forward, self.root.lateral, self.root.turning]
        self._check(list(self.rows), motion, "they leave no motion")

    def check_the_robot_turns(self) -> None:
        """Fail with InputError if wheels keep the root from turning."""
        self._check(list(self.rows), [self.root.turning], "the robot cannot turn")

    def check_frames_turn(self) -> None:
        """Fail with InputError if the wheels on one frame keep it from turning, or let it turn about one point only."""
        for frame in self.robot.frames:
            fixed = [w.name for w in self.robot.wheels if w.frame == frame.name and w.name in self.rows]
            self._check(fixed, [self.velocities[frame.name].turning], f"frame {frame.name!r} cannot turn")
            other = next((w for w in fixed if self._rank([fixed[0], w], []) > 1), None)
            if other is not None:
                raise self._mistake([fixed[0], other], f"frame {frame.name!r} can only turn about one point")

    def _check(self, wheels: list[str], motion: list[Form], consequence: str) -> None:
        if self._freedom(wheels, motion) > 0:
            return
        kept = list(wheels)
        for wheel in reversed(wheels):
            fewer = [other for other in kept if other != wheel]
            if self._freedom(fewer, motion) == 0:
                kept = fewer
        raise self._mistake(kept, consequence)

    def _freedom(self, wheels: list[str], motion: list[Form]) -> int:
        """In how many independent ways `motion` is possible under the rows of `wheels`."""
        return self._rank(wheels, motion) - self._rank(wheels, [])

    def _rank(self, wheels: list[str], motion: list[Form]) -> int:
        return Terms().rank(stacked([*(self.rows[wheel] for wheel in wheels), *motion], self.rates))

    def _mistake(self, wheels: list[str], consequence: str) -> InputError:
        names = ", ".join(map(repr, wheels))
        problem = f"the axles of {names} have no common centre at almost every configuration, so that {consequence}"
        return self.robot.reader.mistake("[[wheels]]", problem, REMEDY)


def _check_nearly_dependent(robot: Robot, rows: Mapping[str, Form]) -> None:
    """Rows that are independent, but at the default parameters by less than anyone means to say."""
    rates = [robot.rate(q) for q in robot.coordinates]
    names = list(rows)
    matrix = stacked(list(rows.values()), rates)
    values = _scaled(matrix, robot)
    basis: list[int] = []
    for i in range(len(names)):
        chosen = [*basis, i]
        if Terms().rank(matrix.extract(chosen, list(range(matrix.cols)))) == len(basis):
            continue  # it follows exactly
        distance, partner = _distance(values, basis, i)
        if distance < _NEARLY:
            raise _misprint(robot, [names[partner], names[i]], distance)
        basis.append(i)


def _distance(values: Floats, basis: list[int], row: int) -> tuple[float, int]:
    """How far a row is from the span of others, at most over the places; and which of them it is closest to."""
    farthest, partner = 0.0, row
    for there in values:
        here, others = there[row], there[basis]
        coefficients = np.linalg.lstsq(others.T, here, rcond=1e-9)[0] if basis else np.zeros(0)
        rest = here - coefficients @ others if basis else here
        size = float(np.linalg.norm(rest) / max(float(np.linalg.norm(here)), 1e-300))
        if size >= farthest:
            farthest = size
            partner = basis[int(np.argmax(np.abs(coefficients)))] if basis else row
    return farthest, partner


def _scaled(matrix: Matrix, robot: Robot) -> Floats:
    """The rows at random configurations, turning rates times a length: of the part of the robot that turns."""
    random = np.random.default_rng(0)
    places = random.uniform(-1.2, 1.2, (_PLACES, len(robot.coordinates)))
    values = matrix_values(matrix.xreplace(robot.numbers), robot.coordinates, places)
    lengths = np.array([_length(robot, index) for index in range(len(robot.coordinates))])
    return values / lengths


def _length(robot: Robot, index: int) -> float:
    """What a coordinate's rate is multiplied with to be compared with a speed [m]: the size of what it turns."""
    q = robot.coordinates[index]
    turned = {frame.name for frame in robot.frames if q in frame.angle.free_symbols}
    if not turned:
        return 1.0
    for frame in robot.frames:  # parents first
        if frame.parent in turned:
            turned.add(frame.name)
    hung = [frame.at for frame in robot.frames if frame.parent in turned]
    points = hung + [wheel.at for wheel in robot.wheels if wheel.frame in turned]
    numbers = [abs(float(sp.sympify(part).xreplace(robot.numbers).evalf(20))) for at in points for part in at]
    return max(numbers, default=0.0) or 1.0


def _misprint(robot: Robot, wheels: list[str], distance: float) -> InputError:
    first, second = wheels
    hints = [
        f"write {fraction} for {symbol}"
        for symbol, fraction in near_fractions_of_pi(robot.constants.values, _NEARLY).items()
    ]
    problem = (
        f"the axles of {first!r} and {second!r} differ by {distance:.1e} only, but they differ, so that these wheels "
        "have no common centre"
    )
    remedy = ", ".join(hints) or "make headings and positions agree exactly, with pi and the same parameters"
    return robot.reader.mistake(f"[[wheels]] {second!r}", problem, remedy)
