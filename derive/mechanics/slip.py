"""How wheels slip: speeds of contacts that rolling holds at zero, and what motors turn, in the coordinates' rates."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp
from sympy import Expr

from ..description.robot import Motor, Robot
from .constraints import plane_velocities
from .velocities import Form, Velocity, rate_of, rolling_rate, side_slip


@dataclass(frozen=True)
class SlipRow:
    """A row of Z(q): a form in the coordinates' rates, and in words of `model.json` what slips."""

    form: Form
    about: dict[str, str]


def slip_rows(robot: Robot) -> tuple[SlipRow, ...]:
    """Of each conventional wheel its sideways speed [m/s]; then of each motor what it drives.

    That is of a wheel the speed at which it rolls [m/s], radius times rate, and of a joint its rate [rad/s]. Nothing is
    left out that follows from others: a row is dependent for a robot that does not slip, and not for one that does.
    """
    velocities = plane_velocities(robot)
    sideways = [
        SlipRow(side_slip(wheel, velocities[wheel.frame]), {"wheel": wheel.name, "direction": "sideways"})
        for wheel in robot.wheels
        if wheel.is_conventional
    ]
    rows = [*sideways, *(_of_motor(robot, motor, velocities) for motor in robot.motors)]
    return tuple(SlipRow(row.form.map(robot.constants.exact).map(_shorter), row.about) for row in rows)


def _shorter(coefficient: Expr) -> Expr:
    """Multiplied out where that is shorter: a roller's angle often cancels."""
    return min(coefficient, sp.expand(coefficient), key=sp.count_ops)


def _of_motor(robot: Robot, motor: Motor, velocities: dict[str, Velocity]) -> SlipRow:
    for wheel in robot.wheels:
        if wheel.name == motor.wheel:
            form = wheel.radius * rolling_rate(wheel, velocities[wheel.frame])
            return SlipRow(form, {"wheel": wheel.name, "direction": "along", "motor": motor.input})
    frame = next(frame for frame in robot.frames if frame.name == motor.joint)
    rates = {q: Form({robot.rate(q): sp.S.One}) for q in robot.coordinates}
    return SlipRow(rate_of(frame.angle, rates), {"joint": frame.name, "motor": motor.input})
