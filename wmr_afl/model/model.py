"""A robot's equations: names, units, parameters, and the terms that `derive` generated."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import InputError, MissingTermError, ShapeError, UnknownNameError
from wmr_afl.model.files import AGAIN, model_folder, open_model, read_trusted_values
from wmr_afl.model.term import SAME_SHAPE, Term, checked_vector
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import LIBRARIES, Arrays, Floats
from wmr_input import closest
from wmr_input.errors import plain, shown

Library = Literal["numpy", "casadi"]


@checked
def load_model(name: str | Path, backend: Library = "numpy") -> Model:
    """A shipped model by its name, or the model in a folder that `derive` has written by its path, as `./mine`.

    `backend` is the array library of its terms: "numpy" or "casadi".

    Raises:
        UnknownNameError: if there is no such model, or no such library.
        InputError: if a file of the folder is missing or damaged, or not the one that was derived.
    """
    return Model(model_folder(name), backend)


class Model:
    """A robot's equations, symbols as in the paper.

    x = [q; v] is the state, u the motor voltages, w generalized forces on v, p the physical parameters, theta the base
    parameters, c the known constants. Every generated function is an attribute: `model.decoupling_matrix(x, theta, c)`;
    `model.functions()` lists them and `help(model.decoupling_matrix)` shows arguments, shape and equation. In NumPy
    every argument may carry batches in front; in CasADi arguments are columns, and symbols give symbols. What is not
    finite goes through: NumPy warns of what overflows or has no value.
    """

    @checked
    def __init__(self, folder: Path, library: Library = "numpy") -> None:
        if library not in LIBRARIES:
            raise UnknownNameError("backend", str(library), LIBRARIES)
        metadata, module = open_model(folder, f"{library}_model.py")
        self.folder, self.metadata, self.library = folder, metadata, library
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
        self._functions: dict[str, Any] = {}
        for function in metadata["functions"]:
            if hasattr(type(self), function) or function in vars(self):
                raise InputError(str(folder / "model.json"), f"functions {function}", "is missing or damaged", AGAIN)
            self._add(function, getattr(module, function))

    def _add(self, name: str, function: Any) -> None:
        """Make a generated function a term of this model."""
        meaning, entries = self.metadata["functions"][name], self._entries()
        self._functions[name] = function
        arguments = {argument: entries[argument] for argument in meaning["arguments"]}
        setattr(self, name, Term(self.name, name, function, arguments, meaning))

    def __getattr__(self, name: str) -> Any:
        """Called by Python only for attributes that the model does not have.

        Raises:
            MissingTermError: if a term is missing; it is an AttributeError, too.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        problem = f"model {self.name} has no {plain(name)}: its parametrization is {self.parametrization}"
        raise MissingTermError(problem, closest(name, self._functions))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._functions]

    def __repr__(self) -> str:
        return f"<Model {self.name}: {self.title}, {self.parametrization}, backend {self.library}>"

    def __reduce__(self) -> tuple[type[Model], tuple[Path, str]]:
        """A copy is the model of the same folder."""
        return Model, (self.folder, self.library)

    @property
    def arrays(self) -> Arrays:
        """The operations of the library that the terms compute with."""
        return LIBRARIES[self.library]

    @property
    def coordinate_count(self) -> int:
        """n."""
        return len(self.state_units) - len(self.findings["pseudo_velocities"])

    @property
    def pseudo_velocity_count(self) -> int:
        """n-m."""
        return len(self.state_units) - self.coordinate_count

    def units_of(self, parameters: str) -> dict[str, str]:
        """The units of what `base_parameters` or `passivity_parameters` gives, by name.

        Raises:
            MissingTermError: if the model has no such parameters.
        """
        if not self.has(parameters):
            getattr(self, parameters)
        return dict(self.metadata[parameters])

    def formulas_of(self, parameters: str) -> dict[str, str]:
        """What each number of `base_parameters` or `passivity_parameters` is in physical parameters, by name.

        Raises:
            MissingTermError: if the model has no such parameters.
        """
        if not self.has(parameters):
            getattr(self, parameters)
        return dict(self.metadata[parameters.removesuffix("s") + "_formulas"])

    def functions(self) -> dict[str, Any]:
        """The generated functions by name: plain ones, or each a `casadi.Function`."""
        return dict(self._functions)

    def has(self, term: str) -> bool:
        """Whether the model has the generated function of this name."""
        return isinstance(term, str) and term in self._functions

    def trusted_values(self) -> dict[str, Any]:
        """Arguments, and what every function gives there, computed from SymPy's expressions when it was derived.

        Raises:
            InputError: if the file is missing or damaged, or not the one that was derived.
        """
        sizes = {argument: len(names) for argument, names in self._entries().items()}
        return read_trusted_values(self.folder, self.metadata, sizes)

    @checked
    def in_library(self, library: Library) -> Model:
        """The same model in NumPy or in CasADi.

        Raises:
            InputError: if the folder holds another model by now.
        """
        if library == self.library:
            return self
        model = Model(self.folder, library)
        if model.metadata != self.metadata:
            raise InputError(str(self.folder), "", "holds another model than when it was loaded", "load it again")
        return model

    def parameters(self, **overrides: ArrayLike) -> Floats:
        """p: the default physical parameters, (n_p,), with some replaced; arrays give batches, (..., n_p).

        Raises:
            UnknownNameError: if there is no such parameter; the text lists them.
            ShapeError: if a value is not a finite number, or batches do not fit each other.
        """
        defaults = np.array(list(self.metadata["defaults"].values()), dtype=float)
        return self.replaced(defaults, overrides)

    @checked
    def replaced(self, p: ArrayLike, changes: Mapping[str, ArrayLike]) -> Floats:
        """p (..., n_p) with some parameters replaced.

        Raises:
            UnknownNameError: if there is no such parameter.
            ShapeError: if a value is not a finite number, or batches do not fit each other.
        """
        p = checked_vector("p", self.name, p, list(self.parameter_units))
        columns = dict(zip(self.parameter_units, np.moveaxis(p, -1, 0), strict=True))
        for name, value in changes.items():
            if name not in columns:
                raise UnknownNameError(f"parameter of {self.name}", name, columns)
            columns[name] = real_numbers(f"parameter {name}", value, "give a number or an array of numbers")
            if not np.all(np.isfinite(columns[name])):
                raise ShapeError(f"parameter {name} is {shown(value)}", "give finite numbers")
        try:
            return np.stack(np.broadcast_arrays(*columns.values()), axis=-1).astype(float)
        except ValueError:
            shapes = ", ".join(f"{name} {np.shape(value)}" for name, value in columns.items() if np.ndim(value))
            raise ShapeError(f"batches of parameters do not fit each other: {shapes}", SAME_SHAPE) from None

    def known(self, p: ArrayLike) -> Floats:
        """c: the known constants, those entries of p that a controller may use, (..., n_c).

        Raises:
            ShapeError: if p has the wrong shape.
        """
        return checked_vector("p", self.name, p, list(self.parameter_units))[..., self._known]

    def _entries(self) -> dict[str, list[str]]:
        """The names of each argument's entries."""
        state, n = list(self.state_units), self.coordinate_count
        return {
            "q": state[:n],
            "x": state,
            "u": list(self.input_units),
            "w": [f"w_{name}" for name in state[n:]],
            "a": [f"a_{name}" for name in state[n:]],
            "v_r": [f"{name}_ref" for name in state[n:]],
            "p": list(self.parameter_units),
            "theta": list(self.base_parameter_units),
            "c": list(self.known_units),
        }
