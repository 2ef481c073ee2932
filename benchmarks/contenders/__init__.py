"""Who takes part in the closed-loop contest: one way to run a loop a file.

A module gives `one(work)`, a call that runs one robot and gives a Trajectory, or `many(work)`, a call that runs all
robots and gives a Summary, or both. What happens once, compiling or tracing, is done before the call.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from benchmarks.contenders.work import Work


@dataclass(frozen=True)
class Contender:
    """A module of this package, with options."""

    name: str
    module: str
    needs: str = ""  # a package that may be missing
    options: Mapping[str, Any] = field(default_factory=dict)
    robots: int | None = None  # at most so many at a time, where more would take too long and cost the same each

    @property
    def installed(self) -> bool:
        return not self.needs or find_spec(self.needs) is not None

    def prepared(self, kind: str, work: Work) -> Callable[[], Any]:
        """The call to be timed; `kind` is "one" or "many"."""
        return getattr(import_module(f"{__name__}.{self.module}"), kind)(work, **self.options)


OWN = Contender("this project, compiled", "own")
OWN_CASADI = Contender("this project, casadi", "own", options={"backend": "casadi"}, robots=16)
OWN_NUMPY = Contender("this project, numpy", "own", options={"backend": "numpy"})
OWN_THREADS = Contender("this project, compiled, 2 threads", "own", options={"threads": 2})
LITERAL = Contender("C by hand, literal", "literal")
BEST = Contender("C by hand, best", "best")
NUMPY = Contender("NumPy by hand, vectorized", "numpy_vectorized")
NUMBA = Contender("Numba", "numba_loops", "numba")
JAX = Contender("JAX", "jax_vmap", "jax")
CONTROL = Contender("python-control", "python_control", "control")
GENERATED = Contender("CasADi, generated C", "casadi_generated", robots=64)
MAPACCUM = Contender("CasADi, mapaccum", "casadi_mapaccum", robots=16)

ONE_ROBOT = (OWN, LITERAL, BEST, NUMBA, GENERATED, JAX, MAPACCUM, OWN_CASADI, CONTROL, OWN_NUMPY)
MANY_ROBOTS = (OWN, OWN_THREADS, LITERAL, BEST, NUMBA, GENERATED, JAX, NUMPY, MAPACCUM, OWN_CASADI)
ANY_LOOP = (OWN, GENERATED, MAPACCUM, OWN_CASADI)  # those that run any robot of the catalogue
