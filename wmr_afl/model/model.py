"""The one door to generated code: names, units, parameters, and the terms of a robot's equations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from casadi import DM, MX, SX
from numpy.typing import ArrayLike

from wmr_afl.errors import MissingTermError, ShapeError, UnknownNameError
from wmr_afl.model.files import check_module, import_module, model_folder, read_metadata
from wmr_afl.numerics.arrays import CASADI, NUMPY, Arrays, Vector

TERMS = (
    "constraint_matrix",
    "kinematic_matrix",
    "actuator_rates_matrix",
    "inertia_matrix",
    "coriolis_matrix",
    "input_matrix",
    "state_derivative",
    "state_jacobian",
    "input_jacobian",
    "output",
    "output_jacobian",
    "output_rate",
    "lie_f2_h",
    "base_parameters",
    "lie_q_lie_f_h",
    "decoupling_matrix",
    "regressor",
    "inverse_regressor",
    "inverse_base_parameters",
)


Backend = Literal["numpy", "casadi"]


Array = Any  # a NumPy array, or a CasADi matrix where the backend is casadi


def load_model(name: str | Path, backend: Backend = "numpy") -> Model:
    """A shipped model by name, or the model in a folder that `derive` has written.

    Raises: UnknownNameError, where there is neither; InputError, where a file of the folder is missing or damaged.
    """
    return Model(model_folder(name), backend)


class Model:
    """A robot's equations, symbols as in the paper.

    x = [q; v] is the state, u the motor voltages, w generalized forces on v, p the physical parameters, theta the base
    parameters, c the known constants. With backend "numpy" every argument may carry batches in front; with "casadi"
    arguments are columns, and symbolic arguments give symbolic results.
    """

    def __init__(self, folder: Path, backend: Backend = "numpy") -> None:
        if backend not in ("numpy", "casadi"):
            raise UnknownNameError("backend", str(backend), ["numpy", "casadi"])
        metadata, code = read_metadata(folder), folder / f"{backend}_model.py"
        self._module = import_module(code)
        check_module(self._module, code, metadata)
        self.folder, self.metadata, self.backend = folder, metadata, backend
        self.name: str = metadata["name"]
        self.title: str = metadata["title"]
        self.parametrization: str = metadata["parametrization"]
        self.state_units: dict[str, str] = metadata["state"]
        self.input_units: dict[str, str] = metadata["inputs"]
        self.output_units: dict[str, str] = metadata["outputs"]
        self.parameter_units: dict[str, str] = metadata["parameters"]
        self.known_units: dict[str, str] = metadata["known"]
        self.base_parameter_units: dict[str, str] = metadata["base_parameters"]
        self.base_parameter_formulas: dict[str, str] = metadata["base_parameter_formulas"]
        self.findings: dict[str, Any] = metadata["findings"]
        self._known = [list(self.parameter_units).index(name) for name in self.known_units]

    def __repr__(self) -> str:
        return f"<Model {self.name}: {self.title}, {self.parametrization}, backend {self.backend}>"

    @property
    def coordinate_count(self) -> int:
        """n."""
        return len(self.state_units) - len(self.findings["pseudo_velocities"])

    @property
    def pseudo_velocity_count(self) -> int:
        """n-m."""
        return len(self.state_units) - self.coordinate_count

    def with_backend(self, backend: Backend) -> Model:
        """The same model in another language."""
        return self if backend == self.backend else Model(self.folder, backend)

    def parameters(self, **overrides: ArrayLike) -> Vector:
        """p: the default physical parameters, (n_p,), with some replaced; arrays give batches, (..., n_p).

        Raises: UnknownNameError, with the valid names; ShapeError, where a value is not a finite number.
        """
        values = dict(self.metadata["defaults"])
        for name, value in overrides.items():
            if name not in values:
                raise UnknownNameError(f"parameter of {self.name}", name, values)
            try:
                values[name] = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise ShapeError(f"parameter {name} is {value!r}", "expected a number or an array of numbers") from None
            if not np.all(np.isfinite(values[name])):
                raise ShapeError(f"parameter {name} is {value!r}", "expected finite numbers")
        try:
            return np.stack(np.broadcast_arrays(*values.values()), axis=-1).astype(float)
        except ValueError:
            shapes = ", ".join(f"{name} {np.shape(value)}" for name, value in values.items() if np.ndim(value))
            raise ShapeError(f"batches of parameters do not fit each other: {shapes}") from None

    def known(self, p: ArrayLike) -> Vector:
        """c: the known constants, those entries of p that a controller may use, (n_c,)."""
        return self._checked("p", p, list(self.parameter_units))[..., self._known]

    def constraint_matrix(self, q: Array, p: Array) -> Array:
        """A(q) (2): A q' = 0, (m, n)."""
        return self._term("constraint_matrix", q=q, p=p)

    def kinematic_matrix(self, q: Array, p: Array) -> Array:
        """S(q) (3): q' = S v, (n, n-m)."""
        return self._term("kinematic_matrix", q=q, p=p)

    def actuator_rates_matrix(self, q: Array, p: Array) -> Array:
        """X(q) (10): motor rates = X v, (n_u, n-m)."""
        return self._term("actuator_rates_matrix", q=q, p=p)

    def inertia_matrix(self, q: Array, p: Array) -> Array:
        """Mbar(q) (14), (n-m, n-m)."""
        return self._term("inertia_matrix", q=q, p=p)

    def coriolis_matrix(self, x: Array, p: Array) -> Array:
        """Cbar(x) (14), back-EMF included, (n-m, n-m)."""
        return self._term("coriolis_matrix", x=x, p=p)

    def input_matrix(self, q: Array, p: Array) -> Array:
        """Bbar K1 (14), (n-m, n_u)."""
        return self._term("input_matrix", q=q, p=p)

    def state_derivative(self, x: Array, u: Array, w: Array, p: Array) -> Array:
        """x' (15), (2n-m,)."""
        return self._term("state_derivative", x=x, u=u, w=w, p=p)

    def state_jacobian(self, x: Array, u: Array, w: Array, p: Array) -> Array:
        """dx'/dx of (15), (2n-m, 2n-m)."""
        return self._term("state_jacobian", x=x, u=u, w=w, p=p)

    def input_jacobian(self, x: Array, u: Array, w: Array, p: Array) -> Array:
        """dx'/du of (15), (2n-m, n_u)."""
        return self._term("input_jacobian", x=x, u=u, w=w, p=p)

    def output(self, q: Array, c: Array) -> Array:
        """y = h(q) (17), (n-m,)."""
        return self._term("output", q=q, c=c)

    def output_jacobian(self, q: Array, c: Array) -> Array:
        """J_h = dh/dq, (n-m, n)."""
        return self._term("output_jacobian", q=q, c=c)

    def output_rate(self, x: Array, c: Array) -> Array:
        """y' = L_f h (19), (n-m,)."""
        return self._term("output_rate", x=x, c=c)

    def lie_f2_h(self, x: Array, c: Array) -> Array:
        """L_f^2 h (21), (n-m,)."""
        return self._term("lie_f2_h", x=x, c=c)

    def base_parameters(self, p: Array) -> Array:
        """theta(p) (30), (n_theta,)."""
        return self._term("base_parameters", p=p)

    def lie_q_lie_f_h(self, x: Array, theta: Array, c: Array) -> Array:
        """L_q L_f h (21) in base parameters, (n-m,)."""
        return self._term("lie_q_lie_f_h", x=x, theta=theta, c=c)

    def decoupling_matrix(self, x: Array, theta: Array, c: Array) -> Array:
        """D (22) in base parameters, (n-m, n_u)."""
        return self._term("decoupling_matrix", x=x, theta=theta, c=c)

    def regressor(self, x: Array, u: Array, c: Array) -> Array:
        """Y(x, u): y'' = L_f^2 h + Y theta; W of (89) is Y at the control, (n-m, n_theta).

        Raises: MissingTermError, where the dynamics are not linear in base parameters.
        """
        return self._term("regressor", x=x, u=u, c=c)

    def inverse_regressor(self, x: Array, a: Array, c: Array) -> Array:
        """Y_u(x, a): u = Y_u pi brings about v' = a, (n_u, n_pi).

        Raises: MissingTermError, where the motors do not match the pseudo-velocities.
        """
        return self._term("inverse_regressor", x=x, a=a, c=c)

    def inverse_base_parameters(self, p: Array) -> Array:
        """pi(p), (n_pi,)."""
        return self._term("inverse_base_parameters", p=p)

    def functions(self) -> dict[str, Any]:
        """The generated terms by name: plain functions, or each a `casadi.Function`."""
        return {name: getattr(self._module, name) for name in TERMS if self.has(name)}

    def has(self, term: str) -> bool:
        """Whether the model has the term of this name."""
        return term in TERMS and hasattr(self._module, term)

    def _term(self, name: str, **arguments: Array) -> Array:
        function = getattr(self._module, name, None)
        if function is None:
            why = f"its parametrization is {self.parametrization}"
            raise MissingTermError(f"model {self.name} has no {name}: {why}")
        if self.backend == "casadi":  # which would broadcast or transpose a wrong shape
            for argument, value in arguments.items():
                self._check_column(argument, value)
        try:
            return function(*arguments.values())
        except ValueError:
            for argument, value in arguments.items():
                self._checked(argument, value, self._entries(argument))
            shapes = ", ".join(f"{argument} has shape {np.shape(value)}" for argument, value in arguments.items())
            raise ShapeError(f"batches of {self.name}.{name} do not fit each other: {shapes}") from None

    def _entries(self, argument: str) -> list[str]:
        """The names of an argument's entries."""
        state, n = list(self.state_units), self.coordinate_count
        entries = {
            "q": state[:n],
            "x": state,
            "u": list(self.input_units),
            "w": [f"w_{name}" for name in state[n:]],
            "a": [f"a_{name}" for name in state[n:]],
            "p": list(self.parameter_units),
            "theta": list(self.base_parameter_units),
            "c": list(self.known_units),
        }
        return entries[argument]

    def _check_column(self, argument: str, value: Array) -> None:
        size = len(self._entries(argument))
        if not isinstance(value, SX | MX | DM):
            value = self._checked(argument, value, self._entries(argument))
        if tuple(value.shape) not in ((size,), (size, 1)):
            raise ShapeError(f"{argument} of {self.name} has shape {tuple(value.shape)}", f"expected ({size}, 1)")

    def _checked(self, name: str, value: Array, entries: list[str]) -> Vector:
        expected = f"expected (..., {len(entries)}): {', '.join(entries) or 'nothing'}"
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ShapeError(f"{name} is not an array of numbers", expected) from None
        if array.ndim == 0 or array.shape[-1] != len(entries):
            raise ShapeError(f"{name} of {self.name} has shape {array.shape}", expected)
        return array


@dataclass(frozen=True)
class Language:
    """What a law needs to be evaluated or traced."""

    model: Model
    arrays: Arrays

    @classmethod
    def of(cls, model: Model, backend: Backend) -> Language:
        return cls(model.with_backend(backend), NUMPY if backend == "numpy" else CASADI)
