"""Named arrays <-> flat vectors: how states, numbers and signals of a loop lie one after the other."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part


class Layout:
    """Named arrays one after the other in a flat vector, matrices by row."""

    def __init__(self, example: Mapping[str, Floats]) -> None:
        self.shapes = {name: np.shape(value) for name, value in example.items()}
        self.sizes = {name: int(np.prod(shape)) for name, shape in self.shapes.items()}

    @property
    def size(self) -> int:
        """The length of the flat vector."""
        return sum(self.sizes.values())

    @functools.cached_property
    def places(self) -> dict[str, slice]:
        """Where each name lies."""
        ends = np.cumsum([0, *self.sizes.values()])
        return {name: slice(int(a), int(b)) for name, a, b in zip(self.sizes, ends[:-1], ends[1:], strict=True)}

    def pack(self, values: Mapping[str, Any]) -> Floats:
        """Named NumPy arrays -> flat vector (size,)."""
        return np.concatenate([np.zeros(0), *(np.ravel(values[name]) for name in self.shapes)])

    def unpack(self, flat: Floats) -> dict[str, Floats]:
        """Flat vector -> named NumPy arrays."""
        return {name: flat[place].reshape(self.shapes[name]) for name, place in self.places.items()}

    def pack_symbols(self, values: Mapping[str, Any]) -> ca.SX:
        """Named columns -> flat column."""
        return ca.vertcat(*(values[name] for name in self.shapes))

    def unpack_symbols(self, flat: ca.SX) -> SimpleNamespace:
        """Flat column -> columns and matrices, by part and name."""
        return by_part({name: self.symbols(flat, name) for name in self.places})

    def symbols(self, flat: ca.SX, name: str) -> ca.SX:
        """Of a flat column the column or matrix of this name."""
        shape, found = self.shapes[name], flat[self.places[name]]
        return ca.reshape(found, *shape[::-1]).T if len(shape) == 2 else found
