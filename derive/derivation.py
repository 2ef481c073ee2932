"""The whole derivation of one robot, step by step, from its description to what can be printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from math import isnan
from pathlib import Path

from mpmath.libmp.libhyper import NoConvergence
from sympy import Expr, Matrix, Symbol

from wmr_input import InputError

from .algebra.attempts import Attempts, reason, shown
from .algebra.evaluation import NotFinite, rank_in_numbers
from .algebra.finite_field import NotRepresentable
from .algebra.named_terms import Terms
from .algebra.separation import Parameters
from .control.adaptive_form import AdaptiveForm, adaptive_form
from .control.decoupling_determinant import Determinant, decoupling_determinant
from .control.effort_form import EffortForm, effort_form
from .control.internal_dynamics import InternalDynamics, internal_dynamics
from .control.linearization import Linearization, linearize
from .control.passivity_form import PassivityForm, passivity_form
from .description.resolve import read_robot
from .description.robot import Robot
from .mechanics.constraints import constraint_rows
from .mechanics.dynamics import Dynamics, derive_dynamics
from .mechanics.forces import FloorForces, floor_forces
from .mechanics.kinematics import Kinematics
from .mechanics.mobility import Mobility, classify
from .mechanics.over_constraint import check_axles
from .mechanics.pseudo_velocities import choose_kinematics

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Control:
    """What a controller needs to know of a robot's outputs."""

    linearization: Linearization
    determinant: Determinant
    internal: InternalDynamics


@dataclass(frozen=True)
class Derivation:
    """Everything that is known of a robot."""

    robot: Robot
    kinematics: Kinematics
    mobility: Mobility
    dynamics: Dynamics
    parameters: Parameters
    adaptive: AdaptiveForm
    reference_velocities: tuple[Symbol, ...]  # v_r
    passivity: PassivityForm | str  # or in a sentence why there is none
    effort: EffortForm | str  # or in a sentence why there is none
    control: Control | None  # None if the description wants the model alone
    missed: dict[str, str]  # findings that were not found out, and why

    @property
    def passive(self) -> PassivityForm | None:
        """The form for adaptation by passivity, if there is one."""
        return None if isinstance(self.passivity, str) else self.passivity

    @property
    def efforts(self) -> EffortForm | None:
        """The form for identification, if there is one."""
        return None if isinstance(self.effort, str) else self.effort

    @property
    def terms(self) -> Terms:
        return self.kinematics.terms

    @property
    def known(self) -> tuple[Symbol, ...]:
        """c: the known constants, in the order of p."""
        return tuple(p for p in self.robot.parameters if p in self.parameters.known)

    @property
    def state(self) -> tuple[Symbol, ...]:
        """x = [q; v]."""
        return (*self.kinematics.q, *self.kinematics.v)

    @property
    def state_derivative(self) -> Matrix:
        """x' (15), (2n-m, 1)."""
        return Matrix([*self.kinematics.rates.values(), *self.dynamics.acceleration])

    @cached_property
    def forces(self) -> FloorForces:
        """Forces of the floor on the wheels; asked for last, so that its names stand in no other function."""
        return floor_forces(self.kinematics, self.dynamics, self.adaptive.accelerations)

    def at_defaults(self, expression: Expr) -> float:
        """The value of a function of the parameters at the default parameters."""
        return self.kinematics.at_defaults(expression)


def derive_robot(path: Path, progress: Progress = lambda step: None) -> Derivation:
    """Derive the robot described at `path`; `progress` is called with every step.

    Raises:
        InputError: If the description is wrong or too odd to be derived.
    """
    progress("description")
    with mistakes_named(str(path)):
        return _derive(read_robot(path), progress)


@contextmanager
def mistakes_named(file: str) -> Iterator[None]:
    """What the mathematics cannot do becomes a mistake of the description, never a traceback."""
    try:
        yield
    except NotRepresentable as error:
        problem = f"{shown(error.expression)} is not defined at random configurations"
        raise InputError(file, "", problem, "check its roots and quotients") from None
    except (ArithmeticError, ValueError, RecursionError, NoConvergence, NotImplementedError) as error:
        problem = f"cannot be derived ({reason(error)})"
        raise InputError(file, "", problem, "simplify its expressions, or report it with this file") from error


def _derive(robot: Robot, progress: Progress) -> Derivation:
    attempts = Attempts()
    progress("kinematics")
    constraints = constraint_rows(robot)
    check_axles(robot, constraints)
    kinematics = choose_kinematics(robot, constraints)
    _check_motors(kinematics)
    progress("mobility")
    mobility = classify(kinematics, constraints, attempts)
    progress("dynamics")
    dynamics = derive_dynamics(kinematics)
    progress("linearization")
    linearization = linearize(kinematics) if robot.outputs else None
    _check_defaults(kinematics, dynamics, linearization)
    parameters = _split_parameters(kinematics)
    progress("base parameters")
    a = tuple(kinematics.terms.fresh(f"a_{s.name}") for s in kinematics.v)
    v_r = tuple(kinematics.terms.fresh(f"{s.name}_ref") for s in kinematics.v)
    passivity = passivity_form(kinematics, dynamics, a, v_r, parameters)
    adaptive = adaptive_form(
        kinematics, dynamics, None if isinstance(passivity, str) else passivity, a, parameters, attempts
    )
    effort = effort_form(kinematics, dynamics, passivity, a, parameters)
    _check_base_parameters(kinematics, adaptive, passivity, effort)
    control = None
    if linearization is not None:
        progress("decoupling matrix")
        determinant = decoupling_determinant(kinematics, dynamics, linearization, adaptive)
        progress("internal dynamics")
        control = Control(linearization, determinant, internal_dynamics(kinematics, linearization, attempts))
    return Derivation(
        robot, kinematics, mobility, dynamics, parameters, adaptive, v_r, passivity, effort, control, attempts.missed
    )


def _check_motors(kinematics: Kinematics) -> None:
    """Each motor turns something, and for a controller they reach every pseudo-velocity."""
    robot, wanted, terms = kinematics.robot, len(kinematics.v), kinematics.terms
    matrix = kinematics.actuator_rates_matrix
    for motor, row in zip(robot.motors, range(matrix.rows), strict=True):
        if terms.rank(matrix[row, :]) == 0:
            driven = motor.wheel or motor.joint
            problem = f"drives {driven!r}, which never moves"
            raise robot.reader.mistake(f"[[motors]] {motor.input!r} drives", problem, "drive a part that turns")
    if not robot.outputs:  # the model alone may have any number of motors
        return
    without = "or derive the model without a controller (controller = false at the top)"
    count = len(robot.motors)
    if count < wanted:
        names = ", ".join(v.name for v in kinematics.v)
        problem = f"{count} motors for {wanted} pseudo-velocities ({names}): no control law brings about every motion"
        raise robot.reader.mistake("[[motors]]", problem, f"add {wanted - count}, {without}")
    if terms.rank(matrix) < wanted:
        problem = f"the motors act on {terms.rank(matrix)} of {wanted} pseudo-velocities only"
        raise robot.reader.mistake("[[motors]]", problem, f"let them drive independent wheels or joints, {without}")


def _check_defaults(kinematics: Kinematics, dynamics: Dynamics, linearization: Linearization | None) -> None:
    """The model must not be degenerate at the default parameters, for then it could not be run."""
    robot, terms, wanted = kinematics.robot, kinematics.terms, len(kinematics.v)
    matrices = [(dynamics.inertia_matrix, "[[bodies]]", "some motion has no inertia")]
    if linearization is not None:
        matrices.append((dynamics.input_matrix, "[[motors]]", "the motors do not reach every pseudo-velocity"))
        matrices.append((linearization.output_map, "[outputs]", "the decoupling matrix is singular everywhere"))
    for matrix, table, problem in matrices:
        if _rank_at(matrix, robot.numbers, terms) < wanted:
            raise robot.reader.mistake(table, f"with the default parameters {problem}", _other_defaults(robot))


def _check_base_parameters(
    kinematics: Kinematics, adaptive: AdaptiveForm, passivity: PassivityForm | str, effort: EffortForm | str
) -> None:
    """Base parameters have a value at the default parameters: a length by which they are divided is not zero."""
    inverse = () if adaptive.inverse is None else adaptive.inverse.base_parameters
    forms = [form.parameters for form in (passivity, effort) if not isinstance(form, str)]
    if any(isnan(kinematics.at_defaults(parameter)) for parameter in chain(adaptive.base_parameters, inverse, *forms)):
        problem = "a base parameter of the dynamics is not finite with the default parameters"
        raise kinematics.robot.reader.mistake("[parameters]", problem, _other_defaults(kinematics.robot))


def _other_defaults(robot: Robot) -> str:
    """What to do where the default parameters are at fault."""
    zeros = [symbol.name for symbol, number in robot.defaults.items() if number == 0]
    return f"change the defaults; zero is the value of {', '.join(zeros)}" if zeros else "change the defaults"


def _rank_at(matrix: Matrix, numbers: dict[Symbol, Expr], terms: Terms) -> int:
    """The rank with given numbers: exact, or to many digits if the field lacks a root of these numbers; 0 if none."""
    try:
        return terms.rank(matrix, numbers)
    except NotRepresentable:
        try:
            return rank_in_numbers(matrix, numbers, terms.definitions)
        except NotFinite:
            return 0


def _split_parameters(kinematics: Kinematics) -> Parameters:
    """Known constants are those that appear in S or in h, and those that the description lists."""
    robot, terms = kinematics.robot, kinematics.terms
    geometry = [*kinematics.kinematic_matrix, *robot.outputs.values()]
    appearing = set().union(*(terms.atoms(entry) for entry in geometry)) & set(robot.parameters)
    known = frozenset(appearing) | robot.known
    return Parameters(known, frozenset(robot.parameters) - known)
