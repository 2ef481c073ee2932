"""Linear forms in the rates, and how velocities pass from frame to frame and on to wheels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from ..algebra.named_terms import sorted_symbols
from ..description.robot import Frame, Point2, Wheel

ORIGIN: Point2 = (sp.S.Zero, sp.S.Zero)


class Form(dict[Symbol, Expr]):
    """A linear form: sum of coefficient times rate; absent symbols have coefficient zero."""

    def __add__(self, other: Form) -> Form:
        total = Form(self)
        for symbol, coefficient in other.items():
            total[symbol] = total.get(symbol, sp.S.Zero) + coefficient
        return total.without_zeros(lambda coefficient: bool(coefficient == 0))

    def __mul__(self, factor: Expr) -> Form:
        return Form({symbol: factor * coefficient for symbol, coefficient in self.items() if factor != 0})

    __rmul__ = __mul__

    def __sub__(self, other: Form) -> Form:
        return self + other * sp.S.NegativeOne

    def substitute(self, solved: Mapping[Symbol, Form]) -> Form:
        total = Form()
        for symbol, coefficient in self.items():
            total = total + (coefficient * solved[symbol] if symbol in solved else Form({symbol: coefficient}))
        return total

    def without_zeros(self, is_zero: Callable[[Expr], bool]) -> Form:
        return Form({symbol: coefficient for symbol, coefficient in self.items() if not is_zero(coefficient)})

    def map(self, function: Callable[[Expr], Expr]) -> Form:
        return Form({symbol: function(coefficient) for symbol, coefficient in self.items()})

    def map_items(self, function: Callable[[Symbol, Expr], Expr]) -> Form:
        return Form({symbol: function(symbol, coefficient) for symbol, coefficient in self.items()})

    def row(self, symbols: Iterable[Symbol]) -> sp.Matrix:
        """The coefficients as a row matrix over `symbols`."""
        return sp.Matrix([[self.get(symbol, sp.S.Zero) for symbol in symbols]])


@dataclass(frozen=True)
class Velocity:
    """Velocity of a frame in its own axes: forward and lateral speed at `point` [m/s], and turning rate [rad/s]."""

    forward: Form
    lateral: Form
    turning: Form
    point: Point2  # of the frame, in its axes [m]

    def map(self, function: Callable[[str, Form], Form]) -> Velocity:
        """The same with `function` applied to the name and form of each part."""
        return Velocity(
            function("forward", self.forward),
            function("lateral", self.lateral),
            function("turning", self.turning),
            self.point,
        )

    def rows(self, symbols: Iterable[Symbol]) -> sp.Matrix:
        """The coefficients of forward, lateral and turning as rows over `symbols`."""
        return sp.Matrix.vstack(*(form.row(symbols) for form in (self.forward, self.lateral, self.turning)))

    def symbols(self) -> set[Symbol]:
        return {*self.forward, *self.lateral, *self.turning}

    def at(self, point: Point2) -> tuple[Form, Form]:
        """Forward and lateral speed of the frame's material point `point`."""
        ahead, aside = point[0] - self.point[0], point[1] - self.point[1]
        return self.forward - aside * self.turning, self.lateral + ahead * self.turning

    def along(self, point: Point2, angle: Expr) -> Form:
        """The component of the velocity at `point` in the direction `angle`."""
        forward, lateral = self.at(point)
        return sp.cos(angle) * forward + sp.sin(angle) * lateral

    def moved(self, point: Point2) -> Velocity:
        """The same motion, stated at another point of the frame."""
        return Velocity(*self.at(point), self.turning, point)


def rate_of(expression: Expr, rates: Mapping[Symbol, Form]) -> Form:
    """The rate of an expression of coordinates as a linear form, given the rates of the coordinates."""
    total = Form()
    for symbol in sorted_symbols(expression.free_symbols & rates.keys()):
        total = total + sp.diff(expression, symbol) * rates[symbol]
    return total


def child_velocity(parent: Velocity, frame: Frame, turning: Form) -> Velocity:
    """Velocity of a frame hung at `frame.at` of its parent and turned by `frame.angle`, at the joint."""
    return Velocity(
        forward=parent.along(frame.at, frame.angle),
        lateral=parent.along(frame.at, frame.angle + sp.pi / 2),
        turning=turning,
        point=ORIGIN,
    )


def side_slip(wheel: Wheel, velocity: Velocity) -> Form:
    """Speed of a conventional wheel along its axle, which rolling without slipping holds at zero [m/s]."""
    return velocity.along(wheel.at, wheel.heading + sp.pi / 2)


def rolling_rate(wheel: Wheel, velocity: Velocity) -> Form:
    """Spin of a wheel about its axle [rad/s].

    For a Swedish wheel, roller axle . velocity = r rate cos(roller angle).
    """
    if wheel.roller_angle is None:
        return (1 / wheel.radius) * velocity.along(wheel.at, wheel.heading)
    along_roller = velocity.along(wheel.at, wheel.heading + wheel.roller_angle)
    return (1 / (wheel.radius * sp.cos(wheel.roller_angle))) * along_roller
