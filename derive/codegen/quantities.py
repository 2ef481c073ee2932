"""Everything derived, as an ordered list of named expressions. A new quantity is one entry; printers see only these."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.units import Units, UnknownUnit, parse_unit, product
from ..control.linearization import Linearization
from ..derivation import Derivation


@dataclass(frozen=True)
class Argument:
    """An argument of the generated functions: a vector, its entries and their units."""

    name: str
    meaning: str
    entries: tuple[Symbol, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class Quantity:
    """A named expression: one generated function."""

    name: str
    arguments: tuple[Argument, ...]
    expression: Matrix
    shape: tuple[str, ...]  # in the field's symbols: ("n", "n-m"); one entry for a vector
    equation: str  # the paper's number, or the theory's section
    meaning: str

    @property
    def is_vector(self) -> bool:
        return len(self.shape) == 1

    @property
    def size(self) -> tuple[int, ...]:
        """`shape` in numbers."""
        return (self.expression.rows,) if self.is_vector else self.expression.shape

    @property
    def signature(self) -> dict[str, Any]:
        """What a caller needs to know of the function, ready for JSON."""
        return {
            "arguments": [argument.name for argument in self.arguments],
            "shape": self.shape,
            "size": self.size,
            "equation": self.equation,
            "meaning": self.meaning,
        }


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
            argument("u", "motor voltages", d.dynamics.inputs),
            argument("w", "generalized forces on v, Fbar + taubar_d", d.dynamics.loads),
            argument("a", "accelerations v'", d.adaptive.accelerations),
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
    for u in d.dynamics.inputs:
        units.declare(u, parse_unit("V"))
    for v, form in d.kinematics.pseudo_velocities.items():
        velocity = units.text(sum((c * rate for rate, c in form.items()), sp.S.Zero))
        if velocity == "?":
            continue
        unit = parse_unit(velocity)
        place = d.kinematics.v.index(v)
        units.declare(v, unit)
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
    text = units.text(expression)
    angles = {q for q in d.kinematics.q if d.robot.units[q.name] == "rad"}
    if text == "1/s" and expression in d.kinematics.v:
        form = d.kinematics.pseudo_velocities[expression]
        return "rad/s" if form.keys() <= {d.robot.rate(q) for q in angles} else text
    if text == "1" and expression.free_symbols and expression.free_symbols <= angles and expression.is_polynomial():
        return "rad"
    return text


def quantities(derivation: Derivation) -> list[Quantity]:
    """The generated functions, in the order of the derivation."""
    return list(_Quantities(derivation).entries())


class _Quantities:
    def __init__(self, derivation: Derivation) -> None:
        self.d = derivation
        self.arguments = arguments_of(derivation)

    def entries(self) -> Iterator[Quantity]:
        yield from self.model()
        yield from self.base_parameters()
        if self.d.control is not None:
            yield from self.outputs(self.d.control.linearization)
        yield from self.inverse()

    def entry(self, name: str, arguments: str, expression: Matrix, shape: str, equation: str, meaning: str) -> Quantity:
        return Quantity(
            name,
            tuple(self.arguments[argument] for argument in arguments.split()),
            expression,
            tuple(shape.split()),
            equation,
            meaning,
        )

    def partial(self, column: Matrix, variables: tuple[Symbol, ...]) -> Matrix:
        terms = self.d.terms
        return Matrix(len(column), len(variables), lambda i, j: terms.partial(column[i], variables[j]))

    def model(self) -> Iterator[Quantity]:
        d, k, dyn = self.d, self.d.kinematics, self.d.dynamics
        yield self.entry("constraint_matrix", "q p", k.constraint_matrix, "m n", "(2)", "A(q): A(q) q' = 0")
        yield self.entry(
            "kinematic_matrix", "q p", k.kinematic_matrix, "n n-m", "(3), (4)", "S(q): q' = S(q) v, A S = 0"
        )
        yield self.entry(
            "actuator_rates_matrix", "q p", k.actuator_rates_matrix, "n_u n-m", "(10)", "X(q): motor rates = X(q) v"
        )
        yield self.entry(
            "inertia_matrix", "q p", dyn.inertia_matrix, "n-m n-m", "(14)", "Mbar(q), symmetric positive definite"
        )
        yield self.entry(
            "coriolis_matrix", "x p", dyn.coriolis_matrix, "n-m n-m", "(14)", "Cbar(q, v), back-EMF included"
        )
        yield self.entry("input_matrix", "q p", dyn.input_matrix, "n-m n_u", "(14)", "Bbar K1")
        derivative = d.state_derivative
        yield self.entry("state_derivative", "x u w p", derivative, "2n-m", "(15)", "x' of the robot under load w")
        yield self.entry(
            "state_jacobian", "x u w p", self.partial(derivative, d.state), "2n-m 2n-m", "d(15)/dx", "dx'/dx"
        )
        yield self.entry(
            "input_jacobian", "x u w p", self.partial(derivative, dyn.inputs), "2n-m n_u", "d(15)/du", "dx'/du"
        )

    def base_parameters(self) -> Iterator[Quantity]:
        form = self.d.adaptive
        parameters = Matrix(len(form.base_parameters), 1, list(form.base_parameters))
        yield self.entry("base_parameters", "p", parameters, "n_theta", "(30), (82)", f"theta(p), {form.kind} form")

    def outputs(self, lin: Linearization) -> Iterator[Quantity]:
        form, h = self.d.adaptive, Matrix(list(lin.outputs.values()))
        yield self.entry("output", "q c", h, "n-m", "(17)", "y = h(q)")
        yield self.entry("output_jacobian", "q c", lin.output_jacobian, "n-m n", "(19)", "J_h = dh/dq")
        yield self.entry("output_rate", "x c", lin.output_rate, "n-m", "(19)", "y' = L_f h = J_h S v")
        yield self.entry("lie_f2_h", "x c", lin.lie_f2_h, "n-m", "(21), (86)", "L_f^2 h = d/dq(J_h S v) S v")
        yield self.entry(
            "lie_q_lie_f_h", "x theta c", lin.output_map * form.drift, "n-m", "(21), (87)", "L_q L_f h = J_h S Q"
        )
        yield self.entry(
            "decoupling_matrix", "x theta c", lin.output_map * form.gain, "n-m n_u", "(22)", "D = L_g L_f h = J_h S G"
        )
        if form.regressor is not None:
            yield self.entry(
                "regressor",
                "x u c",
                lin.output_map * form.regressor,
                "n-m n_theta",
                "(31), (89)",
                "Y: y'' = L_f^2 h + Y theta; W of (89) is Y at the control",
            )

    def inverse(self) -> Iterator[Quantity]:
        form = self.d.adaptive
        if form.inverse is None:
            return
        regressor = form.inverse.regressor(form.accelerations)
        meaning = "Y_u: u = Y_u pi brings about v' = a"
        yield self.entry("inverse_regressor", "x a c", regressor, "n_u n_pi", "(14) inverted", meaning)
        pi = Matrix(len(form.inverse.base_parameters), 1, list(form.inverse.base_parameters))
        yield self.entry("inverse_base_parameters", "p", pi, "n_pi", "(14) inverted", "pi(p) of u = Y_u pi")
