"""The constraint matrix A(q) (2): one row a wheel that must not slip sideways, one a further constraint."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Matrix

from ..algebra.named_terms import Terms
from ..description.robot import Robot
from .velocities import ORIGIN, Form, Velocity, rate_of, side_slip


@dataclass(frozen=True)
class Constraints:
    """The rows of A, dependent ones included: a form in the coordinates' rates for each origin."""

    rows: dict[str, Form]
    basis: list[Form]  # as many of them as are independent at almost every configuration

    @property
    def rank(self) -> int:
        return len(self.basis)


def constraint_rows(robot: Robot) -> Constraints:
    """The constraints on the motion of `robot`."""
    velocities = plane_velocities(robot)
    rows = {
        slip_origin(wheel.name): side_slip(wheel, velocities[wheel.frame]).map(robot.constants.exact)
        for wheel in robot.wheels
        if wheel.is_conventional
    }
    rows |= {constraint_origin(number): Form(row) for number, row in enumerate(robot.constraints)}
    rates = [robot.rate(q) for q in robot.coordinates]
    basis: list[Form] = []
    for row in rows.values():
        if Terms().rank(stacked([*basis, row], rates)) > len(basis):
            basis.append(row)
    return Constraints(rows, basis)


def slip_origin(wheel: str) -> str:
    return f"wheel {wheel!r} does not slip sideways"


def constraint_origin(index: int) -> str:
    return f"constraint number {index + 1}"


def stacked(forms: list[Form], symbols: list[sp.Symbol]) -> Matrix:
    """The forms as rows of a matrix, (forms, symbols); without forms it has no row."""
    return Matrix(len(forms), len(symbols), lambda i, j: forms[i].get(symbols[j], sp.S.Zero))


def plane_velocities(robot: Robot) -> dict[str, Velocity]:
    """Every frame's velocity as a form in the coordinates' rates, in closed form with the frames' absolute headings.

    Nothing is solved or eliminated here: these give the constraint matrix A as a person would write it.
    """
    rates = {q: Form({robot.rate(q): sp.S.One}) for q in robot.coordinates}
    heading: dict[str, Expr] = {}
    origin_terms: dict[str, list[tuple[Expr, Form, Form]]] = {}  # (angle, x part, y part) of the origin's velocity
    turning: dict[str, Form] = {}
    velocities = {}
    for frame in robot.frames:
        if frame.parent is None:
            heading[frame.name] = frame.angle
            origin_terms[frame.name] = [(sp.S.Zero, rate_of(frame.at[0], rates), rate_of(frame.at[1], rates))]
            turning[frame.name] = rate_of(frame.angle, rates)
        else:
            heading[frame.name] = heading[frame.parent] + frame.angle
            arm = (-frame.at[1] * turning[frame.parent], frame.at[0] * turning[frame.parent])
            origin_terms[frame.name] = [*origin_terms[frame.parent], (heading[frame.parent], *arm)]
            turning[frame.name] = turning[frame.parent] + rate_of(frame.angle, rates)
        forward, lateral = Form(), Form()
        for angle, x_part, y_part in origin_terms[frame.name]:
            turned = heading[frame.name] - angle
            forward = forward + sp.cos(turned) * x_part + sp.sin(turned) * y_part
            lateral = lateral - sp.sin(turned) * x_part + sp.cos(turned) * y_part
        velocity = Velocity(forward, lateral, turning[frame.name], ORIGIN)
        velocities[frame.name] = velocity.map(lambda _, form: form.map(robot.constants.exact))
    return velocities
