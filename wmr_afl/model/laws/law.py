"""A law: a statement about every model, and by how much a model breaks it in random situations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.model.model import Model, load_model
from wmr_afl.numerics.arrays import Floats

CLOSE = 30.0  # times the median condition number; above, rounding hides what a law measures


@dataclass(frozen=True)
class Law:
    """`deviation(situation)` is zero except for rounding, at most `tolerance`; `applies` says to which models."""

    name: str
    statement: str
    tolerance: float
    deviation: Callable[[Situation], float]
    applies: Callable[[Model], bool] = lambda model: True


class Situation:
    """A model in both libraries and a batch of random states, inputs, loads and parameters around the defaults."""

    def __init__(self, model: str | Path, count: int = 20, seed: int = 0) -> None:
        self.numpy, self.casadi = load_model(model, "numpy"), load_model(model, "casadi")
        random = np.random.default_rng(seed)
        units = list(self.numpy.state_units.values())
        n = self.numpy.coordinate_count
        spread = np.array([1.2 if unit == "rad" else 3.0 for unit in units[:n]])
        self.q = self._regular(random.uniform(-spread, spread, (5 * count, n)), count)
        self.v = random.normal(size=(count, len(units) - n))
        self.x = np.hstack([self.q, self.v])
        self.u = 5.0 * random.normal(size=(count, len(self.numpy.input_units)))
        self.w = random.normal(size=self.v.shape)
        self.a = random.normal(size=self.v.shape)
        self.eta = random.normal(size=self.v.shape)
        self.p = self.numpy.parameters() * random.uniform(0.7, 1.3, (count, len(self.numpy.parameter_units)))
        self.c = self.numpy.known(self.p)
        self.v_r = random.normal(size=self.v.shape)

    def _regular(self, candidates: Floats, count: int) -> Floats:
        """The first `count` configurations that are not close to a singular S, Mbar or D, where every digit is lost."""
        p = self.numpy.parameters()
        with np.errstate(all="ignore"):
            matrices = [self.numpy.inertia_matrix(candidates, p), self.numpy.kinematic_matrix(candidates, p)]
            if self.numpy.has("decoupling_matrix"):
                x = np.hstack([candidates, np.zeros((len(candidates), self.numpy.pseudo_velocity_count))])
                matrices.append(self.numpy.decoupling_matrix(x, self.numpy.base_parameters(p), self.numpy.known(p)))
            sizes = [condition(matrix) for matrix in matrices]
        conditions = np.prod(sizes, axis=0)
        kept = np.flatnonzero(conditions <= CLOSE * np.median(conditions))
        return candidates[kept[:count]]

    @cached_property
    def theta(self) -> Floats:
        """The base parameters of `p`."""
        return np.asarray(self.numpy.base_parameters(self.p))

    @cached_property
    def arguments(self) -> dict[str, Floats]:
        """Every argument that generated functions take, by name."""
        return {name: getattr(self, name) for name in ("q", "x", "u", "w", "a", "v_r", "p", "theta", "c")}

    @cached_property
    def state_derivative(self) -> Floats:
        """x' without load."""
        return self.numpy.state_derivative(self.x, self.u, 0.0 * self.w, self.p)

    def along(self, term: str, direction: Floats, wrt: str) -> Floats:
        """The derivative of a term along a direction of its argument `wrt`, by CasADi's automatic differentiation."""
        function = self.function(term)
        names = function.name_in()
        symbols = [ca.SX.sym(name, function.size1_in(name)) for name in names]
        tangent = ca.SX.sym("tangent", function.size1_in(wrt))
        value = function(*symbols)
        change = ca.jtimes(ca.vec(value.T), symbols[names.index(wrt)], tangent)
        along = ca.Function("along", [*symbols, tangent], [change])
        given = [self.arguments[name] for name in names]
        rows = [along(*row, d).full() for *row, d in zip(*given, direction, strict=True)]
        return np.array(rows).reshape(len(direction), *value.shape)

    def jacobian(self, term: str, wrt: str) -> Floats:
        """The Jacobian of a vector term by its argument `wrt`, by CasADi's automatic differentiation."""
        size = self.arguments[wrt].shape[1]
        jacobian = np.zeros((len(self.x), self.function(term).numel_out(0), size))
        for column, row in enumerate(np.eye(size)):
            jacobian[:, :, column] = self.along(term, np.tile(row, (len(self.x), 1)), wrt)[:, :, 0]
        return jacobian

    def function(self, term: str) -> ca.Function:
        """The casadi.Function of a term."""
        return self.casadi.functions()[term]


def relative(value: ArrayLike, expected: ArrayLike) -> float:
    """Largest difference over the largest expected entry, or over 1 if all are smaller.

    Raises:
        ValueError: if the shapes differ.
    """
    value, expected = np.asarray(value, dtype=float), np.asarray(expected, dtype=float)
    if value.shape != expected.shape:
        raise ValueError(f"shapes {value.shape} and {expected.shape} differ")
    if not value.size:
        return 0.0
    difference = np.max(np.abs(value - expected))
    return float(difference / max(1.0, float(np.max(np.abs(expected)))))


def largest(*deviations: float) -> float:
    """The largest of deviations; NaN if one of them is, which `max` would hide."""
    return float(np.max(deviations))


def missing_rank(regressor: Floats) -> float:
    """How many columns of the stacked regressor follow from others."""
    stacked = regressor.reshape(-1, regressor.shape[-1])
    sizes = np.linalg.norm(stacked, axis=0)
    if not np.all(np.isfinite(sizes)):
        return np.inf
    scaled = stacked / np.where(sizes > 0.0, sizes, 1.0)  # a column of zeros counts as missing
    return float(scaled.shape[1] - np.linalg.matrix_rank(scaled, tol=1e-9))


def times(matrix: Any, vector: Any) -> Floats:
    """Matrix times vector, over batches."""
    return np.einsum("...ij,...j->...i", matrix, vector)


def transposed(matrix: Floats) -> Floats:
    """The transposed matrix, over batches."""
    return np.swapaxes(matrix, -1, -2)


def condition(matrices: Floats) -> Floats:
    """How far each matrix is from losing rank: largest over smallest singular value; inf if it is not finite."""
    finite: Any = np.isfinite(matrices).all(axis=(-2, -1))
    whole: Any = np.where(finite[..., None, None], matrices, 0.0)
    values: Any = np.linalg.svd(whole, compute_uv=False)
    regular = finite & (values[..., -1] > 0)
    return np.asarray(np.where(regular, values[..., 0] / np.maximum(values[..., -1], 1e-300), np.inf))
