"""Internal dynamics: the coordinates that the outputs leave free, under perfect tracking.

With y = yr exactly, v = E^-1 yr' and the free coordinates z move as z' = S_z(q) E(q)^-1 yr'. Along a straight line this
is an autonomous system; its linearization is proportional to the speed, so what is stable forward is unstable backward.
"""

from __future__ import annotations

from dataclasses import dataclass

import mpmath
import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.attempts import Attempts
from ..algebra.linear_solve import adjugate_over_determinant
from ..algebra.named_terms import Terms
from ..algebra.trigonometry import shortest
from ..mechanics.kinematics import Kinematics
from .linearization import Linearization

_READABLE = 100  # operations
_DIGITS = 60
_NOISE = mpmath.mpf("1e-12")  # of the largest eigenvalue; one that is repeated k times keeps 60 / k digits


@dataclass(frozen=True)
class StraightLine:
    """Motion along the root's heading at unit speed, all joints at rest at zero, and what z does near it."""

    pseudo_velocities: Matrix  # v, (n-m, 1)
    matrix: Matrix  # of dz' = speed * matrix dz
    eigenvalues: tuple[Expr, ...]  # [1/m], functions of the parameters
    values: tuple[complex, ...]  # at the default parameters

    @property
    def forward(self) -> str:
        return _verdict([value.real for value in self.values])

    @property
    def backward(self) -> str:
        return _verdict([-value.real for value in self.values])


@dataclass(frozen=True)
class InternalDynamics:
    """z' = S_z E^-1 yr' for the free coordinates z."""

    free: tuple[Symbol, ...]
    equation: Matrix | None  # z' per unit of yr', (len(z), n-m); None where it is too long to be read
    straight_line: StraightLine | None  # None where the robot cannot drive straight with its joints at zero


def internal_dynamics(kinematics: Kinematics, linearization: Linearization, attempts: Attempts) -> InternalDynamics:
    """The internal dynamics of a robot with regular outputs."""
    free = _free_coordinates(kinematics, linearization)
    if not free:
        return InternalDynamics((), None, None)
    equation = attempts("internal_dynamics", lambda: _equation(kinematics, linearization, free), None)
    line = attempts("straight_line", lambda: _straight_line(kinematics, linearization, free), None)
    return InternalDynamics(free, equation, line)


def _equation(kinematics: Kinematics, linearization: Linearization, free: tuple[Symbol, ...]) -> Matrix | None:
    """S_z E^-1, if it is short enough to be read."""
    rows = [kinematics.q.index(z) for z in free]
    scratch = Terms()  # names made here do not belong to the generated code
    kinematic = kinematics.kinematic_matrix.applyfunc(kinematics.terms.expand)
    output_map = linearization.output_map.applyfunc(kinematics.terms.expand)
    if sp.count_ops(output_map) + sp.count_ops(kinematic) >= 100:
        return None
    inverse = adjugate_over_determinant(output_map, scratch, "determinant").applyfunc(scratch.expand)
    equation = (kinematic.extract(rows, list(range(len(kinematics.v)))) * inverse).applyfunc(shortest)
    return equation if sp.count_ops(equation) <= _READABLE else None


def _free_coordinates(kinematics: Kinematics, linearization: Linearization) -> tuple[Symbol, ...]:
    """Coordinates that complete the outputs to a chart, joint angles before positions."""
    terms = kinematics.terms
    rows = linearization.output_jacobian
    chosen = []
    for index, q in reversed(list(enumerate(kinematics.q))):
        unit = Matrix(1, len(kinematics.q), lambda _, j, index=index: int(j == index))
        if terms.rank(Matrix.vstack(rows, unit)) > rows.rows:
            rows = Matrix.vstack(rows, unit)
            chosen.append(q)
    return tuple(q for q in kinematics.q if q in chosen)


def _straight_line(
    kinematics: Kinematics, linearization: Linearization, free: tuple[Symbol, ...]
) -> StraightLine | None:
    robot, terms = kinematics.robot, kinematics.terms
    place = dict.fromkeys(kinematics.q, sp.S.Zero)

    def there(matrix: Matrix) -> Matrix:
        return matrix.applyfunc(lambda entry: sp.simplify(terms.expand(entry).xreplace(place)))

    positions = robot.frames[0].at
    if not all(position in kinematics.q for position in positions):
        return None
    kinematic, output_map = there(kinematics.kinematic_matrix), there(linearization.output_map)
    if not kinematic.is_Matrix or kinematic.has(sp.zoo, sp.nan) or shortest(output_map.det()) == 0:
        return None
    v = _translation(kinematic, [kinematics.q.index(position) for position in positions])
    if v is None:
        return None
    rows = [kinematics.q.index(z) for z in free]
    chart = Matrix.vstack(there(linearization.output_jacobian), *(sp.eye(len(kinematics.q))[r, :] for r in rows))
    if chart.has(sp.zoo, sp.nan) or chart.det() == 0:
        return None
    directions = chart.inv()[:, -len(free) :]  # dq/dz with the outputs held
    kinematic_z = kinematic.extract(rows, list(range(len(v))))
    matrix = sp.zeros(len(free), len(free))
    for j in range(len(free)):
        direction = {q: directions[i, j] for i, q in enumerate(kinematics.q) if directions[i, j] != 0}

        def change(source: Matrix, direction: dict[Symbol, Expr] = direction) -> Matrix:
            total = sp.zeros(*source.shape)
            for q, slope in direction.items():
                total += slope * there(source.applyfunc(lambda entry, q=q: terms.partial(entry, q)))
            return total

        rotated = output_map.LUsolve(change(linearization.output_map) * v)
        matrix[:, j] = (
            change(kinematics.kinematic_matrix).extract(rows, list(range(len(v)))) * v - kinematic_z * rotated
        )
    matrix = matrix.applyfunc(sp.simplify)
    return StraightLine(v, matrix, _eigenvalues(matrix), _values(matrix.xreplace(robot.numbers)))


def _translation(kinematic: Matrix, positions: list[int]) -> Matrix | None:
    """v that moves the root at unit speed along its heading (zero here) and nothing else."""
    wanted = sp.zeros(kinematic.rows, 1)
    wanted[positions[0]] = 1
    symbols = sp.symbols(f"v0:{kinematic.cols}")
    solutions = sp.linsolve((kinematic, wanted), *symbols)
    if not solutions:
        return None
    (solution,) = solutions
    return Matrix(solution).xreplace(dict.fromkeys(symbols, sp.S.Zero))


def _eigenvalues(matrix: Matrix) -> tuple[Expr, ...]:
    """In symbols where the matrix is triangular or small, otherwise none."""
    if matrix.is_lower or matrix.is_upper:
        return tuple(matrix.diagonal())
    if matrix.rows <= 2:
        return tuple(value for value, count in matrix.eigenvals().items() for _ in range(count))
    return ()


def _values(numbers: Matrix) -> tuple[complex, ...]:
    """Eigenvalues in numbers, sorted; in mpmath rather than NumPy, so that every machine prints the same digits."""
    with mpmath.workdps(_DIGITS):
        found, _ = mpmath.eig(mpmath.matrix(numbers.evalf(_DIGITS).tolist()))
        size = max(map(abs, found), default=0)
        values = [complex(_chopped(one.real, size), _chopped(one.imag, size)) for one in map(mpmath.mpc, found)]
    return tuple(sorted(values, key=_by_parts))


def _chopped(part: mpmath.mpf, size: mpmath.mpf) -> float:
    """A part of an eigenvalue without what rounding left of zero, or of a repeated eigenvalue's digits."""
    return 0.0 if abs(part) <= _NOISE * size else float(part)


def _by_parts(value: complex) -> tuple[float, float]:
    return value.real, value.imag


def _verdict(real_parts: list[float]) -> str:
    if all(part < -1e-9 for part in real_parts):
        return "stable"
    return "unstable" if any(part > 1e-9 for part in real_parts) else "not decided by the linearization"
