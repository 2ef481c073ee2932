"""NumPy or CasADi: the arrays that a law computes with, and the robot's terms in the same library."""

from __future__ import annotations

from dataclasses import dataclass

from wmr_afl.arrays import CASADI, NUMPY, Arrays
from wmr_afl.model import Backend, Model


@dataclass(frozen=True)
class Language:
    """What a law needs to be evaluated or traced."""

    model: Model
    arrays: Arrays

    @classmethod
    def of(cls, model: Model, backend: Backend) -> Language:
        return cls(model.with_backend(backend), NUMPY if backend == "numpy" else CASADI)
