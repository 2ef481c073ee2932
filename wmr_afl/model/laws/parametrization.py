"""Laws of the base parameters."""

from __future__ import annotations

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, missing_rank, relative, times
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


def _is_forward(model: Model) -> bool:
    return model.has("regressor")


def _has_inverse(model: Model) -> bool:
    return model.has("inverse_regressor")


def _regressor(s: Situation) -> float:
    regressor = s.numpy.regressor(s.x, s.u, s.c)
    acceleration = s.along("output_rate", s.state_derivative, "x")[:, :, 0]
    return relative(times(regressor, s.theta), acceleration - s.numpy.lie_f2_h(s.x, s.c))


def _inverse_regressor(s: Situation) -> float:
    u = times(s.numpy.inverse_regressor(s.x, s.a, s.c), s.numpy.inverse_base_parameters(s.p))
    n = s.numpy.coordinate_count
    return relative(s.numpy.state_derivative(s.x, u, 0.0 * s.w, s.p)[:, n:], s.a)


def _minimal(s: Situation) -> float:
    return missing_rank(s.numpy.regressor(*_many(s, s.u.shape[1])))


def _inverse_minimal(s: Situation) -> float:
    return missing_rank(s.numpy.inverse_regressor(*_many(s, s.v.shape[1])))


def _many(s: Situation, inputs: int) -> tuple[Floats, Floats, Floats]:
    """Many states and inputs for the same known constants: x (count, 2n-m), (count, inputs), c (n_c,)."""
    random, count = np.random.default_rng(1), 400
    x = random.normal(size=(count, s.x.shape[1]))
    generic = np.where(s.c[0] == 0.0, random.uniform(0.5, 1.5, s.c[0].shape), s.c[0])  # at zero columns may vanish
    return x, random.normal(size=(count, inputs)), generic


LAWS = (
    Law("regressor", "Y theta = y'' - L_f^2 h (31)", 1e-10, _regressor, _is_forward),
    Law("minimal base parameters", "the stacked regressor has full column rank", 0.0, _minimal, _is_forward),
    Law("inverse regressor", "u = Y_u pi brings about v' = a", 1e-9, _inverse_regressor, _has_inverse),
    Law("minimal inverse parameters", "the stacked Y_u has full column rank", 0.0, _inverse_minimal, _has_inverse),
)
