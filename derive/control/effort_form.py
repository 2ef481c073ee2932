"""The dynamics as identification needs them: rows of X^T u, regular where X is singular, with any number of motors.

    X^T K1 u = Mbar a + Cbar v                             (14) without load
    R diag(rho) u = Y(x, a, c) pi                          each row over an uncertain factor

R(q, c) is known. rho is one, except where motors of unequal gain act in one row: there it is the ratio of a motor's
torque gain to that of the first motor it acts together with, a base parameter too. It is linear in the same equation,
R_k u_k = Y pi - sum_j rho_j R_j u_j, so that each kind of motors brings one column and not base parameters of its own.

Where the rows of X^T K1 are uncertain factors times known rows, this is the form for adaptation by passivity at
v_r = v, provided that no base parameter becomes superfluous there.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.linear_dependence import dependence
from ..algebra.separation import NotSeparable, Parameters
from ..mechanics.dynamics import Dynamics
from ..mechanics.kinematics import Kinematics
from .passivity_form import (
    PassivityForm,
    factored_rows,
    in_groups,
    is_uncertain,
    names_of_uncertain,
    obstacle_of_lengths,
)


@dataclass(frozen=True)
class EffortForm:
    """The functions of this equation."""

    effort_map: Matrix  # R (n-m, n_u)
    gain_ratios: tuple[Expr, ...]  # rho (n_u,)
    regressor: Matrix  # Y (n-m, n_pi)
    parameters: tuple[Expr, ...]  # pi
    of_passivity: bool  # R, Y and pi are those of adaptation by passivity at v_r = v

    @property
    def has_ratios(self) -> bool:
        """Whether motors of unequal gain act together."""
        return any(ratio != 1 for ratio in self.gain_ratios)


def effort_form(
    kinematics: Kinematics,
    dynamics: Dynamics,
    passivity: PassivityForm | str,
    a: tuple[Symbol, ...],
    parameters: Parameters,
) -> EffortForm | str:
    """The form, or in a sentence why there is none."""
    motors, known_rows = kinematics.robot.motors, None
    if isinstance(passivity, PassivityForm) and passivity.row_map is None:
        own = passivity.regressor_at(kinematics.v)
        if _independent(own, kinematics, parameters):
            ones = (sp.S.One,) * len(motors)
            return EffortForm(passivity.allocation, ones, own, passivity.parameters, of_passivity=True)
        scales, known_rows = passivity.scales, passivity.allocation
        ratios = [sp.S.One] * len(motors)
    if known_rows is None:
        lengths = kinematics.actuator_rates_matrix.T
        rows = factored_rows(lengths, kinematics, parameters)
        if rows is None:
            return obstacle_of_lengths(lengths, kinematics, parameters, factored_rows)
        scales, known_rows, ratios = _with_gains(*rows, kinematics, parameters)
    force = dynamics.inertia_matrix * Matrix(a) + dynamics.coriolis_matrix * Matrix(kinematics.v)
    try:
        blocks, pi, _ = in_groups(force, a, scales, parameters, kinematics)
    except NotSeparable as error:
        unknown = names_of_uncertain(error.factor, parameters)
        return f"{error.factor} mixes the state with parameters that are not known: list {unknown} in `known`"
    regressor = sum((s * slope for s, slope in zip(a, blocks[1:], strict=True)), start=blocks[0])
    return EffortForm(known_rows, tuple(ratios), regressor, tuple(pi), of_passivity=False)


def _independent(regressor: Matrix, kinematics: Kinematics, parameters: Parameters) -> bool:
    """Whether no column is a combination of others."""
    columns = [list(regressor[:, k]) for k in range(regressor.cols)]
    return not dependence(columns, parameters.known, kinematics.terms).combination


def _with_gains(
    lengths: list[Expr], known_rows: Matrix, kinematics: Kinematics, parameters: Parameters
) -> tuple[list[Expr], Matrix, list[Expr]]:
    """Row factors, known rows and ratios of gains of X^T K1, from the factors and known rows of X^T."""
    gains = [motor.torque_gain for motor in kinematics.robot.motors]
    scales, known_rows, ratios = list(lengths), known_rows.copy(), [sp.S.One] * len(gains)
    for rows, motors in _acting_together(known_rows):
        for j in motors:
            ratio = sp.cancel(gains[j] / gains[motors[0]])
            if is_uncertain(ratio, parameters):
                ratios[j] = ratio
            else:
                known_rows[:, j] *= ratio
        for i in rows:
            scales[i] *= gains[motors[0]]
    return scales, known_rows, ratios


def _acting_together(matrix: Matrix) -> list[tuple[list[int], list[int]]]:
    """Rows and columns of a matrix that are connected by entries that are not zero."""
    found: list[tuple[list[int], list[int]]] = []
    for i in range(matrix.rows):
        columns = {j for j in range(matrix.cols) if matrix[i, j] != 0}
        touched = [part for part in found if columns & set(part[1])]
        found = [part for part in found if part not in touched]
        rows = sorted({i, *(row for part in touched for row in part[0])})
        found.append((rows, sorted(columns.union(*(part[1] for part in touched)))))
    return found
