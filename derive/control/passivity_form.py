"""The dynamics as adaptation by passivity needs them: linear in base parameters pi, and nothing estimated is inverted.

    Bbar K1 = L(q, c) Delta(p) R(q, c)                                  Delta diagonal: uncertain factors
    Delta^-1 L^-1 (Mbar a + Cbar v_r) = Y(x, v_r, a, c) pi              for all v_r and a
    R u = Y(x, v, v', c) pi + Delta^-1 L^-1 w                           the robot's own motion
        = d/dt (N(x, c) pi) + H(x, c) pi + Delta^-1 L^-1 w              the same without v': N = Y(x, 0, v)

Rows whose factors differ by known constants only are a group; groups share no base parameters, so that each may have
its own unknown factor. L is the identity where every row of Bbar K1 is an uncertain factor times a known row, and R
where every column is: motors of unequal gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.named_terms import Terms
from ..algebra.separation import NotSeparable, Parameters, Separation
from ..algebra.trigonometry import factored, shortest
from ..mechanics.dynamics import Dynamics
from ..mechanics.kinematics import Kinematics
from .base_parameters import LinearMap, linear_map


@dataclass(frozen=True)
class Group:
    """Rows that share an uncertain factor, and the base parameters that appear in them only."""

    rows: tuple[int, ...]
    parameters: tuple[int, ...]
    scale: Expr  # Delta of these rows


@dataclass(frozen=True)
class PassivityForm:
    """The functions of these equations."""

    row_map: Matrix | None  # L (n-m, n-m); None if it is the identity
    allocation: Matrix  # R (n-m, n_u)
    accelerations: tuple[Symbol, ...]  # a
    reference_velocities: tuple[Symbol, ...]  # v_r
    slopes: tuple[Matrix, ...]  # of Y in (a, v_r), each (n-m, n_pi)
    rest_regressor: Matrix  # H (n-m, n_pi)
    parameters: tuple[Expr, ...]  # pi
    groups: tuple[Group, ...]

    @property
    def regressor(self) -> Matrix:
        """Y (n-m, n_pi)."""
        return _at((*self.accelerations, *self.reference_velocities), self.slopes)

    def regressor_at(self, v: tuple[Symbol, ...]) -> Matrix:
        """Y at v_r = v, (n-m, n_pi)."""
        return _at((*self.accelerations, *v), self.slopes)

    @property
    def scales(self) -> list[Expr]:
        """Delta (n-m,)."""
        return [next(group.scale for group in self.groups if i in group.rows) for i in range(self.allocation.rows)]

    def momentum_regressor(self, v: tuple[Symbol, ...]) -> Matrix:
        """N (n-m, n_pi)."""
        return _at(v, self.slopes[: len(v)])

    def inverse(self, v: tuple[Symbol, ...], terms: Terms) -> LinearMap | None:
        """u = R^-1 Y(x, v, a, c) pi, if there are as many motors as pseudo-velocities."""
        if not self.allocation.is_square:
            return None
        still, own = _at(v, self.slopes[len(v) :]), self.slopes[: len(v)]
        if self.allocation != sp.eye(len(v)):
            inverse = self.allocation.adjugate() / factored(self.allocation.det(method="berkowitz"))
            still, own = inverse * still, tuple(inverse * slope for slope in own)
        return LinearMap(self.parameters, still.applyfunc(terms.simplified), own)


def passivity_form(
    kinematics: Kinematics,
    dynamics: Dynamics,
    accelerations: tuple[Symbol, ...],
    reference_velocities: tuple[Symbol, ...],
    parameters: Parameters,
) -> PassivityForm | str:
    """The form, or in a sentence why there is none and which parameter would have to be known."""
    scaled = _scaled(dynamics.input_matrix, kinematics, parameters)
    if scaled is None:
        return obstacle_of_lengths(dynamics.input_matrix, kinematics, parameters, _scaled)
    try:
        return _form(scaled, kinematics, dynamics, accelerations, reference_velocities, parameters)
    except NotSeparable as error:
        unknown = names_of_uncertain(error.factor, parameters)
        return f"{error.factor} mixes the state with parameters that are not known: list {unknown} in `known`"


@dataclass(frozen=True)
class _Scaled:
    """Bbar K1 = L Delta R."""

    row_map: Matrix | None
    scales: list[Expr]
    allocation: Matrix


def _form(
    scaled: _Scaled,
    kinematics: Kinematics,
    dynamics: Dynamics,
    a: tuple[Symbol, ...],
    v_r: tuple[Symbol, ...],
    parameters: Parameters,
) -> PassivityForm:
    terms, v = kinematics.terms, kinematics.v
    force = dynamics.inertia_matrix * Matrix(a) + dynamics.coriolis_matrix * Matrix(v_r)
    if scaled.row_map is not None:
        force = scaled.row_map.adjugate() * force / factored(scaled.row_map.det(method="berkowitz"))
    (_, *slopes), pi, groups = in_groups(force, (*a, *v_r), scaled.scales, parameters, kinematics)
    momentum, still = _at(v, slopes[: len(v)]), _at(v, slopes[len(v) :])
    rate = momentum.applyfunc(lambda entry: terms.rate(entry, kinematics.rates))  # of q only: v is held
    return PassivityForm(
        row_map=scaled.row_map,
        allocation=scaled.allocation,
        accelerations=a,
        reference_velocities=v_r,
        slopes=tuple(slopes),
        rest_regressor=(still - rate).applyfunc(terms.simplified),
        parameters=tuple(pi),
        groups=tuple(groups),
    )


def in_groups(
    force: Matrix, symbols: Sequence[Symbol], scales: Sequence[Expr], parameters: Parameters, kinematics: Kinematics
) -> tuple[list[Matrix], list[Expr], list[Group]]:
    """Delta^-1 `force` in base parameters, group by group: what they multiply without and with each of `symbols`.

    Raises:
        NotSeparable: If it is not linear in any.
    """
    blocks = [sp.zeros(force.rows, 0) for _ in (None, *symbols)]
    pi: list[Expr] = []
    groups: list[Group] = []
    for rows in _groups(scales):
        scale = scales[rows[0]]
        function = Matrix([force[i] / scale for i in rows])
        found = linear_map(function, symbols, parameters, kinematics.terms, kinematics.at_defaults)
        blocks = [
            Matrix.hstack(whole, _in_rows(block, rows, force.rows))
            for whole, block in zip(blocks, (found.drift, *found.slopes), strict=True)
        ]
        groups.append(Group(rows, tuple(range(len(pi), len(pi) + len(found.base_parameters))), scale))
        pi.extend(found.base_parameters)
    return blocks, pi, groups


def _at(values: Sequence[Symbol], slopes: Sequence[Matrix]) -> Matrix:
    """sum_k slopes[k] values[k]."""
    return sum((s * slope for s, slope in zip(values[1:], slopes[1:], strict=True)), start=values[0] * slopes[0])


def _in_rows(block: Matrix, rows: tuple[int, ...], count: int) -> Matrix:
    """A block of some rows among `count` rows."""
    whole = sp.zeros(count, block.cols)
    for k, row in enumerate(rows):
        whole[row, :] = block[k, :]
    return whole


def _scaled(matrix: Matrix, kinematics: Kinematics, parameters: Parameters) -> _Scaled | None:
    """`matrix` = L Delta R with L or R the identity; None if it is neither."""
    rows = factored_rows(matrix, kinematics, parameters)
    if rows is not None:
        return _Scaled(None, *rows)
    columns = factored_rows(matrix.T, kinematics, parameters) if matrix.is_square else None
    if columns is None:
        return None
    scales, transposed = columns
    return _Scaled(transposed.T, scales, sp.eye(matrix.rows))


def factored_rows(matrix: Matrix, kinematics: Kinematics, parameters: Parameters) -> tuple[list[Expr], Matrix] | None:
    """Delta and R with `matrix` = Delta R, Delta positive at the defaults; None if there is none."""
    value, rest = kinematics.at_defaults, sp.zeros(*matrix.shape)
    scales: list[Expr] = []
    for i in range(matrix.rows):
        entries = [_products(matrix[i, j], kinematics.terms, parameters) for j in range(matrix.cols)]
        if any(entry is None for entry in entries) or not any(entries):
            return None
        first = next(parameter for entry in entries if entry for parameter in entry.values())
        scale = sp.Mul(*(f for f in sp.Mul.make_args(sp.factor(first)) if f.free_symbols & parameters.uncertain))
        scale = next((s for s in scales if not is_uncertain(s / scale, parameters)), scale)  # one for a group
        scale = -scale if value(scale) < 0 else scale
        for j, entry in enumerate(entries):
            ratios = {state: sp.cancel(parameter / scale) for state, parameter in (entry or {}).items()}
            if any(ratio.free_symbols & parameters.uncertain for ratio in ratios.values()):
                return None
            rest[i, j] = shortest(sum((state * ratio for state, ratio in ratios.items()), start=sp.S.Zero))
        scales.append(scale)
    return scales, rest


def _products(expression: Expr, terms: Terms, parameters: Parameters) -> dict[Expr, Expr] | None:
    """State function -> parameter function; None where a factor is of both."""
    try:
        products = Separation((), parameters, terms).products(expression)
    except NotSeparable:
        return None
    return {state: parameter for (_, state), parameter in products.items() if not terms.is_zero(parameter)}


def is_uncertain(expression: Expr, parameters: Parameters) -> bool:
    return bool(sp.cancel(expression).free_symbols & parameters.uncertain)


def _groups(scales: Sequence[Expr]) -> list[tuple[int, ...]]:
    """Rows with the same factor."""
    return [tuple(i for i, other in enumerate(scales) if other == scale) for scale in dict.fromkeys(scales)]


def obstacle_of_lengths(
    matrix: Matrix,
    kinematics: Kinematics,
    parameters: Parameters,
    factors: Callable[[Matrix, Kinematics, Parameters], object | None],
) -> str:
    """Why `matrix` has no uncertain `factors`, and what would have to be known so that it has some."""
    involved = [p for p in kinematics.robot.parameters if p in parameters.uncertain]
    involved = [p for p in involved if any(p in kinematics.terms.atoms(entry) for entry in matrix)]

    def cure(listed: Iterable[Symbol]) -> bool:
        known = parameters.known | frozenset(listed)
        return factors(matrix, kinematics, Parameters(known, parameters.uncertain - known)) is not None

    needed = list(involved)
    for p in involved:
        if cure(set(needed) - {p}):
            needed.remove(p)
    remedy = " or ".join(p.name for p in involved if cure({p})) or ", ".join(p.name for p in needed)
    return f"motors of unequal gain act through uncertain lengths: list {remedy} in `known`"


def names_of_uncertain(expression: Expr, parameters: Parameters) -> str:
    return ", ".join(sorted(s.name for s in expression.free_symbols & parameters.uncertain)) or "a parameter"
