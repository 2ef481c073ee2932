"""The arguments of the generated functions: their entries, with units."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from ..algebra.units import Units, UnknownUnit, parse_unit, product
from ..derivation import Derivation

_INPUTS = {frozenset(("V",)): "motor voltages", frozenset(("N m",)): "motor torques"}


@dataclass(frozen=True)
class Argument:
    """An argument of the generated functions: a vector, its entries and their units."""

    name: str
    meaning: str
    entries: tuple[Symbol, ...]
    units: tuple[str, ...]


def arguments_of(derivation: Derivation) -> dict[str, Argument]:
    """The arguments by name."""
    d, units = derivation, units_of(derivation)

    def argument(name: str, meaning: str, entries: tuple[Symbol, ...]) -> Argument:
        return Argument(name, meaning, entries, tuple(unit_text(entry, units, d) for entry in entries))

    return {
        one.name: one
        for one in (
            argument("q", "generalized coordinates", d.kinematics.q),
            argument("x", "state [q; v]", d.state),
            argument(
                "u", _INPUTS.get(frozenset(motor.unit for motor in d.robot.motors), "motor inputs"), d.dynamics.inputs
            ),
            argument("w", "generalized forces on v, Fbar + taubar_d", d.dynamics.loads),
            argument("a", "accelerations v'", d.adaptive.accelerations),
            argument("v_r", "reference pseudo-velocities", d.reference_velocities),
            argument("p", "physical parameters", d.robot.parameters),
            argument("theta", "base parameters", d.adaptive.theta),
            argument("c", "known constants", d.known),
        )
    }


def units_of(derivation: Derivation) -> Units:
    """The units of all symbols, as far as they are declared or follow."""
    d, robot = derivation, derivation.robot
    declared = {s: parse_unit(robot.units[s.name]) for s in (*robot.coordinates, *robot.parameters)}
    units = Units(declared, d.terms.definitions)
    for q in robot.coordinates:
        units.declare(robot.rate(q), parse_unit(f"{robot.units[q.name]}/s"))
    for u, motor in zip(d.dynamics.inputs, robot.motors, strict=True):
        units.declare(u, parse_unit(motor.unit))
    for v, form in d.kinematics.pseudo_velocities.items():
        velocity = units.text(sum((c * rate for rate, c in form.items()), sp.S.Zero))
        if velocity == "?":
            continue
        unit = parse_unit(velocity)
        place = d.kinematics.v.index(v)
        units.declare(v, unit)
        units.declare(d.reference_velocities[place], unit)
        units.declare(d.dynamics.loads[place], product(parse_unit("W"), unit, -1))
        units.declare(d.adaptive.accelerations[place], product(unit, parse_unit("s"), -1))
    for theta, expression in zip(d.adaptive.theta, d.adaptive.base_parameters, strict=True):
        with suppress(UnknownUnit):
            units.declare(theta, units.of(expression))
    return units


def unit_text(expression: Expr, units: Units, derivation: Derivation) -> str:
    """The unit as its reader expects it: declared ones as they were declared, angles in rad."""
    d = derivation
    if expression in (*d.robot.coordinates, *d.robot.parameters):
        return d.robot.units[expression.name]
    if expression in d.dynamics.inputs:
        return d.robot.motors[d.dynamics.inputs.index(expression)].unit
    text = units.text(expression)
    angles = {q for q in d.kinematics.q if d.robot.units[q.name] == "rad"}
    if text == "1/s" and expression in d.kinematics.v:
        form = d.kinematics.pseudo_velocities[expression]
        return "rad/s" if form.keys() <= {d.robot.rate(q) for q in angles} else text
    if text == "1" and expression.free_symbols and expression.free_symbols <= angles and expression.is_polynomial():
        return "rad"
    return text
