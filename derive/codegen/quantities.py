"""Everything derived, as one list of named expressions. A new quantity is one entry; printers see only these."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sympy import Matrix, Symbol

from ..control.adaptive_form import AdaptiveForm
from ..control.base_parameters import LinearMap
from ..control.effort_form import EffortForm
from ..control.linearization import Linearization
from ..control.passivity_form import PassivityForm
from ..derivation import Derivation
from .arguments import Argument, arguments_of


@dataclass(frozen=True)
class Call:
    """A generated function, and what it is given: arguments, or the last entries of one, as `x[3:]`."""

    function: str
    arguments: tuple[str, ...]


@dataclass(frozen=True)
class Quantity:
    """A named expression: one generated function."""

    name: str
    arguments: tuple[Argument, ...]
    expression: Matrix
    shape: tuple[str, ...]  # in the field's symbols: ("n", "n-m"); one entry for a vector
    equation: str  # the paper's number, or the theory's section
    meaning: str
    call: Call | None = None  # of another generated function that gives the same

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


@dataclass(frozen=True)
class Entry:
    """How a quantity is found in a derivation; `expression` gives None if the robot has no such quantity."""

    name: str
    arguments: str  # names, as in arguments_of
    shape: str  # as in Quantity, separated by spaces
    equation: str
    meaning: str
    expression: Callable[[Derivation], Matrix | None]
    call: Callable[[Derivation], Call | None] = lambda derivation: None

    def of(self, derivation: Derivation, arguments: Mapping[str, Argument]) -> Quantity | None:
        """The quantity of one robot."""
        expression = self.expression(derivation)
        if expression is None:
            return None
        chosen = tuple(arguments[name] for name in self.arguments.split())
        shape, call = tuple(self.shape.split()), self.call(derivation)
        return Quantity(self.name, chosen, expression, shape, self.equation, self.meaning, call)


def _jacobian(derivation: Derivation, variables: Iterable[Symbol]) -> Matrix:
    column, terms, symbols = derivation.state_derivative, derivation.terms, list(variables)
    return Matrix(len(column), len(symbols), lambda i, j: terms.partial(column[i], symbols[j]))


def _outputs(build: Callable[[Linearization, AdaptiveForm], Matrix | None]) -> Callable[[Derivation], Matrix | None]:
    """What robots with outputs have."""
    return lambda d: None if d.control is None else build(d.control.linearization, d.adaptive)


def _inverse(build: Callable[[LinearMap, AdaptiveForm], Matrix]) -> Callable[[Derivation], Matrix | None]:
    """What robots whose inputs are linear in base parameters have."""
    return lambda d: None if d.adaptive.inverse is None else build(d.adaptive.inverse, d.adaptive)


def _passive(build: Callable[[PassivityForm, Derivation], Matrix | None]) -> Callable[[Derivation], Matrix | None]:
    """What robots have whose motors act by uncertain factors on known motions."""
    return lambda d: None if d.passive is None else build(d.passive, d)


def _effort(build: Callable[[EffortForm], Matrix | None]) -> Callable[[Derivation], Matrix | None]:
    """What robots have whose motors act through known lengths."""
    return lambda d: None if d.efforts is None else build(d.efforts)


def _of_passivity(function: str, *arguments: str) -> Callable[[Derivation], Call | None]:
    """The function for adaptation by passivity, where it gives the same; `v` is the end of the state."""

    def call(d: Derivation) -> Call | None:
        if d.efforts is None or not d.efforts.of_passivity:
            return None
        return Call(function, tuple(f"x[{len(d.kinematics.q)}:]" if one == "v" else one for one in arguments))

    return call


QUANTITIES = (
    Entry("constraint_matrix", "q p", "m n", "(2)", "A(q): A(q) q' = 0", lambda d: d.kinematics.constraint_matrix),
    Entry(
        "kinematic_matrix", "q p", "n n-m", "(3), (4)", "S(q): q' = S(q) v, A S = 0",
        lambda d: d.kinematics.kinematic_matrix,
    ),
    Entry(
        "actuator_rates_matrix", "q p", "n_u n-m", "(10)", "X(q): motor rates = X(q) v",
        lambda d: d.kinematics.actuator_rates_matrix,
    ),
    Entry(
        "slip_matrix", "q p", "k n", "(2), (10)", "Z(q): speeds of slip = Z(q) (q' - S(q) v)",
        lambda d: d.kinematics.slip_matrix,
    ),
    Entry(
        "joint_stops", "q p", "n_s", "limits of the joints", "how far each joint is from its lower and its upper limit",
        lambda d: d.kinematics.joint_stops,
    ),
    Entry(
        "joint_stops_matrix", "q p", "n_s n-m", "limits of the joints", "J(q): joint_stops' = J(q) v",
        lambda d: d.kinematics.joint_stops_matrix,
    ),
    Entry(
        "inertia_matrix", "q p", "n-m n-m", "(14)", "Mbar(q), symmetric positive definite",
        lambda d: d.dynamics.inertia_matrix,
    ),
    Entry(
        "coriolis_matrix", "x p", "n-m n-m", "(14)", "Cbar(q, v), back-EMF included",
        lambda d: d.dynamics.coriolis_matrix,
    ),
    Entry("input_matrix", "q p", "n-m n_u", "(14)", "Bbar K1", lambda d: d.dynamics.input_matrix),
    Entry("state_derivative", "x u w p", "2n-m", "(15)", "x' of the robot under load w", lambda d: d.state_derivative),
    Entry(
        "state_jacobian", "x u w p", "2n-m 2n-m", "Jacobian of (15) by x", "dx'/dx",
        lambda d: _jacobian(d, d.state),
    ),
    Entry(
        "input_jacobian", "x u w p", "2n-m n_u", "Jacobian of (15) by u", "dx'/du",
        lambda d: _jacobian(d, d.dynamics.inputs),
    ),
    Entry(
        "base_parameters", "p", "n_theta", "(30), (82)", "theta(p), of the form that PARAMETRIZATION names",
        lambda d: Matrix(len(d.adaptive.theta), 1, list(d.adaptive.base_parameters)),
    ),
    Entry(
        "allocation", "q c", "n-m n_u", "Bbar K1 = L Delta R",
        "R(q): what the motors do, but for uncertain factors Delta(p)", _passive(lambda form, d: form.allocation),
    ),
    Entry(
        "row_map", "q c", "n-m n-m", "Bbar K1 = L Delta R", "L(q): where the motors act, if R is the identity",
        _passive(lambda form, d: form.row_map),
    ),
    Entry(
        "passivity_regressor", "x v_r a c", "n-m n_pi", "(14) over Delta",
        "Y: (L Delta)^-1 (Mbar a + Cbar v_r) = Y pi for all v_r and a; R u = Y pi with v_r = v brings about v' = a",
        _passive(lambda form, d: form.regressor),
    ),
    Entry(
        "momentum_regressor", "x c", "n-m n_pi", "(14) over Delta, integrated", "N: Y at v_r = 0, a = v",
        _passive(lambda form, d: form.momentum_regressor(d.kinematics.v)),
    ),
    Entry(
        "rest_regressor", "x c", "n-m n_pi", "(14) over Delta, integrated", "H: R u = d/dt (N pi) + H pi without load",
        _passive(lambda form, d: form.rest_regressor),
    ),
    Entry(
        "passivity_parameters", "p", "n_pi", "(14) over Delta", "pi(p) of R u = Y pi",
        _passive(lambda form, d: Matrix(len(form.parameters), 1, list(form.parameters))),
    ),
    Entry(
        "effort_map", "q c", "n-m n_u", "(14), rows of X^T u", "R(q): rows of X^T over an uncertain factor",
        _effort(lambda form: form.effort_map), _of_passivity("allocation", "q", "c"),
    ),
    Entry(
        "gain_ratios", "p", "n_u", "(14), rows of X^T u", "rho: torque gains over that of the first motor there",
        _effort(lambda form: Matrix(form.gain_ratios) if form.has_ratios else None),
    ),
    Entry(
        "effort_regressor", "x a c", "n-m n_e", "(14), rows of X^T u",
        "Y: R diag(rho) u = Y pi brings about v' = a", _effort(lambda form: form.regressor),
        _of_passivity("passivity_regressor", "x", "v", "a", "c"),
    ),
    Entry(
        "effort_parameters", "p", "n_e", "(14), rows of X^T u", "pi(p) of R diag(rho) u = Y pi",
        _effort(lambda form: Matrix(len(form.parameters), 1, list(form.parameters))),
        _of_passivity("passivity_parameters", "p"),
    ),
    Entry("output", "q c", "n-m", "(17)", "y = h(q)", _outputs(lambda lin, form: Matrix(list(lin.outputs.values())))),
    Entry("output_jacobian", "q c", "n-m n", "(19)", "J_h = dh/dq", _outputs(lambda lin, form: lin.output_jacobian)),
    Entry("output_map", "q c", "n-m n-m", "(19)", "E = J_h S: y' = E v", _outputs(lambda lin, form: lin.output_map)),
    Entry(
        "output_map_rate", "x c", "n-m n-m", "(19)", "E' along q' = S v: y'' = E v' + E' v",
        _outputs(lambda lin, form: lin.output_map_rate),
    ),
    Entry("output_rate", "x c", "n-m", "(19)", "y' = L_f h = J_h S v", _outputs(lambda lin, form: lin.output_rate)),
    Entry(
        "lie_f2_h", "x c", "n-m", "(21), (86)", "L_f^2 h = d/dq(J_h S v) S v",
        _outputs(lambda lin, form: lin.lie_f2_h),
    ),
    Entry(
        "lie_q_lie_f_h", "x theta c", "n-m", "(21), (87)", "L_q L_f h = J_h S Q",
        _outputs(lambda lin, form: lin.output_map * form.drift),
    ),
    Entry(
        "decoupling_matrix", "x theta c", "n-m n_u", "(22)", "D = L_g L_f h = J_h S G",
        _outputs(lambda lin, form: lin.output_map * form.gain),
    ),
    Entry(
        "regressor", "x u c", "n-m n_theta", "(31), (89)", "Y: y'' = L_f^2 h + Y theta; W of (89) is Y at the control",
        _outputs(lambda lin, form: None if form.regressor is None else lin.output_map * form.regressor),
    ),
    Entry(
        "inverse_regressor", "x a c", "n_u n_pi", "(14) inverted", "Y_u: u = Y_u pi brings about v' = a",
        _inverse(lambda inverse, form: inverse.regressor(form.accelerations)),
    ),
    Entry(
        "inverse_base_parameters", "p", "n_pi", "(14) inverted", "pi(p) of u = Y_u pi",
        _inverse(lambda inverse, form: Matrix(len(inverse.base_parameters), 1, list(inverse.base_parameters))),
    ),
    Entry(
        "constraint_forces", "x u a p", "m", "(7)",
        "lambda: force of the floor along each row of A while v' = a; of wheels that share a row, their sum",
        lambda d: d.forces.constraint_forces,
    ),
    Entry(
        "rolling_forces", "x u a p", "n_w", "(8), (9)",
        "force of the floor on each wheel along its heading, or its rollers' axles, while v' = a",
        lambda d: d.forces.rolling_forces,
    ),
)  # fmt: skip


def quantities(derivation: Derivation, entries: Iterable[Entry] = QUANTITIES) -> list[Quantity]:
    """The generated functions, in the order of `entries`."""
    arguments = arguments_of(derivation)
    found = [entry.of(derivation, arguments) for entry in entries]
    return [quantity for quantity in found if quantity is not None]
