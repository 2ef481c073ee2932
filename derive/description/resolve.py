"""Description -> robot: names resolved to symbols, texts to expressions, frames to a tree."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import sympy as sp
from sympy import Expr, Symbol

from wmr_input import closest

from ..algebra.finite_field import vanishes
from . import tables as toml
from .frame_tree import parents_first
from .names import check_names
from .plausibility import Plausibility
from .reader import Reader, rational, symbol
from .robot import Body, Frame, Motor, Point2, Robot, Wheel


def read_robot(path: Path) -> Robot:
    """The robot described in the TOML file at `path`.

    Raises:
        InputError: If it is wrong; file, table, key and remedy are named.
    """
    return resolve(toml.read_description(path), Reader(str(path)))


def resolve(description: toml.RobotDescription, reader: Reader) -> Robot:
    """`description` with its names and expressions resolved.

    Raises:
        InputError: If a name, a unit or a value is wrong.
    """
    check_names(description, reader)
    return _exact(_Resolver(description, reader).robot())


class _Resolver:
    """Reads one description, table by table."""

    def __init__(self, description: toml.RobotDescription, reader: Reader) -> None:
        self.description, self.reader = description, reader
        self.q = {name: symbol(name) for name in description.coordinates}
        self.p = {name: symbol(name) for name in description.parameters}
        self.rates = {f"{name}_dot": symbol(f"{name}_dot") for name in description.coordinates}
        defaults = {self.p[name]: rational(parameter.value) for name, parameter in description.parameters.items()}
        self.plausible = Plausibility(
            reader,
            {
                "coordinates": {self.q[name]: unit for name, unit in description.coordinates.items()},
                "parameters": {self.p[name]: parameter.unit for name, parameter in description.parameters.items()},
            },
            defaults,
        )
        reader.kinks_allowed = frozenset(self.p.values())
        self.frame_names = [frame.name for frame in description.frames]
        self.joints = [frame.name for frame in description.frames if frame.parent is not None]

    def robot(self) -> Robot:
        description, parameters = self.description, self.description.parameters
        frames = tuple(self.frame(frame) for frame in parents_first(description.frames, self.reader))
        return Robot(
            name=description.name,
            title=description.title,
            source=description.source,
            units=dict(description.coordinates) | {name: parameter.unit for name, parameter in parameters.items()},
            coordinates=tuple(self.q.values()),
            parameters=tuple(self.p.values()),
            defaults=dict(self.plausible.defaults),
            about={name: parameter.about for name, parameter in parameters.items()},
            known=frozenset(self.known(name) for name in description.known),
            frames=frames,
            bodies=tuple(self.body(body, f"[[bodies]] number {k}") for k, body in enumerate(description.bodies, 1)),
            wheels=tuple(self.wheel(wheel, f"[[wheels]] {wheel.name!r}") for wheel in description.wheels),
            motors=tuple(self.motor(motor, f"[[motors]] {motor.input!r}") for motor in description.motors),
            constraints=tuple(
                self.of_rates(row.expression, f"[[constraints]] number {k} expression")
                for k, row in enumerate(description.constraints, 1)
            ),
            pseudo_velocities=self.pseudo_velocities(),
            outputs=self.outputs(),
            constants=self.reader.constants,
            reader=self.reader,
        )

    def pseudo_velocities(self) -> dict[Symbol, dict[Symbol, Expr]] | None:
        texts = self.description.pseudo_velocities
        if texts is None:
            return None
        return {symbol(name): self.of_rates(text, f"[pseudo_velocities] {name}") for name, text in texts.items()}

    def outputs(self) -> dict[str, Expr]:
        if not self.description.controller:
            return {}
        if not self.description.outputs:
            remedy = "add outputs, or controller = false at the top for a model without a controller"
            raise self.reader.mistake("[outputs]", "missing", remedy)
        outputs = {
            name: self.of_coordinates(text, f"[outputs] {name}") for name, text in self.description.outputs.items()
        }
        for name, output in outputs.items():
            self.plausible.has_one_unit(output, f"[outputs] {name}")
        return outputs

    def known(self, name: str) -> Symbol:
        if name not in self.p:
            raise self.reader.mistake("known", f"unknown parameter {name!r}", closest(name, self.p))
        return self.p[name]

    def frame(self, frame: toml.Frame) -> Frame:
        place = f"[[frames]] {frame.name!r}"
        if frame.position is not None:
            x, y = (self.of_coordinates(text, f"{place} position", "m") for text in frame.position)
            return Frame(frame.name, None, (x, y), self.of_coordinates(frame.heading or "0", f"{place} heading", "rad"))
        angle = self.of_coordinates(frame.angle or "0", f"{place} angle", "rad")
        limits = None if frame.limits is None else self.limits(frame.limits, angle, f"{place} limits")
        return Frame(frame.name, frame.parent, self.point(frame.at or [], f"{place} at"), angle, limits)

    def limits(self, texts: list[str], angle: Expr, place: str) -> Point2:
        lower, upper = (self.of_parameters(text, place, "rad") for text in texts)
        low, high = (self.plausible.value(limit, place) for limit in (lower, upper))
        if low >= high:
            raise self.reader.mistake(place, f"go from {low:g} to {high:g}", "put the smaller one first")
        if angle.free_symbols.isdisjoint(self.q.values()):
            raise self.reader.mistake(place, "of an angle that never changes", "remove limits, or let a joint turn")
        return lower, upper

    def body(self, body: toml.Body | toml.Wheel, place: str) -> Body:
        return Body(
            self.existing_frame(body.frame, f"{place} frame"),
            self.point(body.at, f"{place} at"),
            self.not_negative(body.mass, f"{place} mass", "kg"),
            self.not_negative(body.inertia, f"{place} inertia", "kg m^2"),
        )

    def wheel(self, wheel: toml.Wheel, place: str) -> Wheel:
        radius = self.of_parameters(wheel.radius, f"{place} radius", "m")
        self.plausible.is_positive(radius, f"{place} radius")
        roller = None
        if wheel.roller_angle is not None:
            roller = self.of_parameters(wheel.roller_angle, f"{place} roller_angle", "rad")
            if abs(self.plausible.value(sp.cos(roller), f"{place} roller_angle")) < 1e-9:
                raise self.reader.mistake(
                    f"{place} roller_angle",
                    "the rollers' axles lie along the wheel's axle, so it cannot drive",
                    "measure the angle from the wheel's heading to the roller's axle",
                )
        return Wheel(
            **vars(self.body(wheel, place)),
            name=wheel.name,
            radius=radius,
            heading=self.of_parameters(wheel.heading, f"{place} heading", "rad"),
            roller_angle=roller,
            spin_inertia=self.not_negative(wheel.spin_inertia, f"{place} spin_inertia", "kg m^2"),
        )

    def motor(self, motor: toml.Motor, place: str) -> Motor:
        drivable = [wheel.name for wheel in self.description.wheels] + self.joints
        if motor.drives not in drivable:
            problem = f"unknown wheel or jointed frame {motor.drives!r}"
            raise self.reader.mistake(f"{place} drives", problem, closest(motor.drives, drivable))
        gain: Expr = sp.S.One
        if motor.torque_gain is not None:
            gain = self.of_parameters(motor.torque_gain, f"{place} torque_gain", "N m/V")
            self.plausible.is_positive(gain, f"{place} torque_gain")
        return Motor(
            motor.input,
            None if motor.drives in self.joints else motor.drives,
            motor.drives if motor.drives in self.joints else None,
            gain,
            self.not_negative(motor.back_emf, f"{place} back_emf", "N m s/rad"),
            "N m" if motor.torque_gain is None else "V",
        )

    def existing_frame(self, name: str, place: str) -> str:
        if name not in self.frame_names:
            raise self.reader.mistake(place, f"unknown frame {name!r}", closest(name, self.frame_names))
        return name

    def point(self, texts: list[str], place: str) -> Point2:
        x, y = (self.of_parameters(text, place, "m") for text in texts)
        return x, y

    def of_parameters(self, text: str, place: str, unit: str) -> Expr:
        expression = self.reader.expression(text, self.p, place, "this place takes parameters only")
        expression = self.with_unit(expression, unit, place)
        self.plausible.value(expression, place)
        return expression

    def not_negative(self, text: str, place: str, unit: str) -> Expr:
        expression = self.of_parameters(text, place, unit)
        self.plausible.is_not_negative(expression, place)
        return expression

    def of_coordinates(self, text: str, place: str, unit: str | None = None) -> Expr:
        expression = self.reader.expression(text, {**self.q, **self.p}, place)
        return expression if unit is None else self.with_unit(expression, unit, place)

    def with_unit(self, expression: Expr, unit: str, place: str) -> Expr:
        self.plausible.has_unit(expression, unit, place)
        return self.reader.constants.in_angle(expression) if unit == "rad" else expression

    def of_rates(self, text: str, place: str) -> dict[Symbol, Expr]:
        expression = self.reader.expression(text, {**self.q, **self.p, **self.rates}, place)
        return _linear_in_rates(expression, list(self.rates.values()), text, place, self.reader)


def _exact(robot: Robot) -> Robot:
    """The robot with decimals inside sines and cosines as fractions; angles themselves keep them."""
    exact = robot.constants.exact

    def point(at: Point2) -> Point2:
        return exact(at[0]), exact(at[1])

    def form(row: dict[Symbol, Expr]) -> dict[Symbol, Expr]:
        return {rate: exact(coefficient) for rate, coefficient in row.items()}

    def body(part: Body) -> dict[str, Any]:
        return {"at": point(part.at), "mass": exact(part.mass), "inertia": exact(part.inertia)}

    v = robot.pseudo_velocities
    return replace(
        robot,
        frames=tuple(replace(one, at=point(one.at), angle=exact(one.angle)) for one in robot.frames),
        bodies=tuple(replace(one, **body(one)) for one in robot.bodies),
        wheels=tuple(
            replace(one, **body(one), radius=exact(one.radius), spin_inertia=exact(one.spin_inertia))
            for one in robot.wheels
        ),
        motors=tuple(
            replace(one, torque_gain=exact(one.torque_gain), back_emf=exact(one.back_emf)) for one in robot.motors
        ),
        constraints=tuple(map(form, robot.constraints)),
        pseudo_velocities=None if v is None else {symbol: form(row) for symbol, row in v.items()},
        outputs={name: exact(output) for name, output in robot.outputs.items()},
    )


def _linear_in_rates(
    expression: Expr, rates: list[Symbol], text: str, place: str, reader: Reader
) -> dict[Symbol, Expr]:
    """The coefficients of the rates in `expression`."""
    coefficients = {rate: sp.diff(expression, rate) for rate in rates if expression.has(rate)}
    for rate, coefficient in coefficients.items():
        if any(not vanishes(sp.diff(coefficient, other)) for other in rates):
            raise reader.mistake(place, f"{text!r} is not linear in {rate.name}", "write a sum of terms f(q)*rate")
    rest = expression.xreplace(dict.fromkeys(rates, sp.S.Zero))
    if rest.has(sp.zoo, sp.nan) or not vanishes(rest):
        raise reader.mistake(place, f"{text!r} has a part without a rate, {rest}", "leave only terms f(q)*rate")
    coefficients = {rate: coefficient for rate, coefficient in coefficients.items() if not vanishes(coefficient)}
    if not coefficients:
        known = ", ".join(rate.name for rate in rates)
        raise reader.mistake(place, f"{text!r} contains no rate", f"write it linear in {known}")
    return coefficients
