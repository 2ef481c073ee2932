"""One text for NumPy and CasADi: the operations that a law may use, on vectors (n,) or columns (n, 1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]  # any shape; NumPy only
Array = Any  # numpy.ndarray or casadi.SX


class Arrays(Protocol):
    """What differs between the two libraries. Arithmetic, indexing, `@` and `.T` are the same in both."""

    def vector(self, entries: Sequence[Array]) -> Array: ...
    def matrix(self, rows: Sequence[Sequence[Array]]) -> Array: ...
    def join(self, parts: Sequence[Array]) -> Array: ...
    def sin(self, value: Array) -> Array: ...
    def cos(self, value: Array) -> Array: ...
    def exp(self, value: Array) -> Array: ...
    def sqrt(self, value: Array) -> Array: ...
    def absolute(self, value: Array) -> Array: ...
    def sign(self, value: Array) -> Array: ...
    def floor(self, value: Array) -> Array: ...
    def maximum(self, a: Array, b: Array) -> Array: ...
    def minimum(self, a: Array, b: Array) -> Array: ...
    def where(self, condition: Array, a: Array, b: Array) -> Array: ...


class NumpyArrays:
    """Vectors of shape (n,)."""

    sin, cos, exp, sqrt = staticmethod(np.sin), staticmethod(np.cos), staticmethod(np.exp), staticmethod(np.sqrt)
    absolute, sign, floor = staticmethod(np.abs), staticmethod(np.sign), staticmethod(np.floor)
    maximum, minimum, where = staticmethod(np.maximum), staticmethod(np.minimum), staticmethod(np.where)

    @staticmethod
    def vector(entries: Sequence[Array]) -> Array:
        return np.array(entries, dtype=float)

    @staticmethod
    def matrix(rows: Sequence[Sequence[Array]]) -> Array:
        return np.array(rows, dtype=float)

    @staticmethod
    def join(parts: Sequence[Array]) -> Array:
        return np.concatenate(parts)


class CasadiArrays:
    """Columns of shape (n, 1)."""

    sin, cos, exp, sqrt = staticmethod(ca.sin), staticmethod(ca.cos), staticmethod(ca.exp), staticmethod(ca.sqrt)
    absolute, sign, floor = staticmethod(ca.fabs), staticmethod(ca.sign), staticmethod(ca.floor)
    maximum, minimum, where = staticmethod(ca.fmax), staticmethod(ca.fmin), staticmethod(ca.if_else)

    @staticmethod
    def vector(entries: Sequence[Array]) -> Array:
        return ca.vertcat(*entries)

    @staticmethod
    def matrix(rows: Sequence[Sequence[Array]]) -> Array:
        return ca.vertcat(*(ca.horzcat(*row) for row in rows))

    @staticmethod
    def join(parts: Sequence[Array]) -> Array:
        return ca.vertcat(*parts)


NUMPY: Arrays = NumpyArrays()
CASADI: Arrays = CasadiArrays()
LIBRARIES: dict[str, Arrays] = {"numpy": NUMPY, "casadi": CASADI}


def norm(vector: Array, arrays: Arrays) -> Array:
    """Euclidean norm."""
    return arrays.sqrt(dot(vector, vector))


def dot(a: Array, b: Array) -> Array:
    """Scalar product, term by term in a fixed order."""
    total = a[0] * b[0]
    for i in range(1, a.shape[0]):
        total = total + a[i] * b[i]
    return total
