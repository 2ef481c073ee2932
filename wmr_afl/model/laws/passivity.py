"""Laws of the form in which adaptation by passivity knows a robot."""

from __future__ import annotations

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, largest, missing_rank, relative, times
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value


def _is_passive(model: Model) -> bool:
    return model.has("passivity_regressor")


def _has_outputs(model: Model) -> bool:
    return model.has("output_map")


def _row_map(s: Situation) -> Floats:
    """L, the identity where rows of Bbar K1 have uncertain factors."""
    if s.numpy.has("row_map"):
        return np.asarray(s.numpy.row_map(s.q, s.c))
    return np.broadcast_to(np.eye(s.v.shape[1]), (len(s.v), s.v.shape[1], s.v.shape[1]))


def _scales(s: Situation) -> Floats:
    """Delta, (batch, rows)."""
    names = dict(zip(s.numpy.parameter_units, s.p.T, strict=True))
    scales = np.zeros(s.v.shape)
    for group in s.numpy.metadata["passivity_groups"]:
        scales[:, group["rows"]] = np.reshape(numpy_value(group["scale"], names) * np.ones(len(s.v)), (-1, 1))
    return scales


def _on_v(s: Situation, rows: Floats) -> Floats:
    """L Delta rows."""
    return times(_row_map(s), _scales(s) * rows)


def _parameters(s: Situation) -> Floats:
    return np.asarray(s.numpy.passivity_parameters(s.p))


def _motors_have_uncertain_factors(s: Situation) -> float:
    product = _row_map(s) @ (_scales(s)[..., None] * s.numpy.allocation(s.q, s.c))
    return relative(product, s.numpy.input_matrix(s.q, s.p))


def _regressor(s: Situation) -> float:
    effort = _on_v(s, times(s.numpy.passivity_regressor(s.x, s.v_r, s.a, s.c), _parameters(s)))
    force = times(s.numpy.inertia_matrix(s.q, s.p), s.a) + times(s.numpy.coriolis_matrix(s.x, s.p), s.v_r)
    return relative(effort, force)


def _momentum(s: Situation) -> float:
    """Along the robot's own motion, under load."""
    motion = s.numpy.state_derivative(s.x, s.u, s.w, s.p)
    rate = s.along("momentum_regressor", motion, "x") + s.numpy.rest_regressor(s.x, s.c)
    effort = times(s.numpy.allocation(s.q, s.c), s.u)
    return relative(_on_v(s, times(rate, _parameters(s))) + s.w, _on_v(s, effort))


def _minimal(s: Situation) -> float:
    random, count = np.random.default_rng(1), 400
    v = random.normal(size=(3, count, s.v.shape[1]))
    q = random.normal(size=(count, s.q.shape[1]))
    generic = np.where(s.c[0] == 0.0, random.uniform(0.5, 1.5, s.c[0].shape), s.c[0])  # at zero columns may vanish
    return missing_rank(s.numpy.passivity_regressor(np.hstack([q, v[0]]), v[1], v[2], generic))


def _groups_share_nothing(s: Situation) -> float:
    """Outside its group a parameter has no effect."""
    outside = np.array(s.numpy.passivity_regressor(s.x, s.v_r, s.a, s.c))
    names = list(s.numpy.metadata["passivity_parameters"])
    for group in s.numpy.metadata["passivity_groups"]:
        own = [names.index(name) for name in group["parameters"]]
        for row in group["rows"]:
            outside[:, row, own] = 0.0
    return float(np.abs(outside).max(initial=0.0))


def _output_map(s: Situation) -> float:
    E, rate = s.numpy.output_map(s.q, s.c), s.numpy.output_map_rate(s.x, s.c)
    worst = relative(times(E, s.v), s.numpy.output_rate(s.x, s.c))
    return largest(worst, relative(times(rate, s.v), s.numpy.lie_f2_h(s.x, s.c)))


def _output_map_rate(s: Situation) -> float:
    along = s.along("output_map", times(s.numpy.kinematic_matrix(s.q, s.p), s.v), "q")
    return relative(s.numpy.output_map_rate(s.x, s.c), along)


LAWS = (
    Law("motor factors", "Bbar K1 = L Delta R", 1e-12, _motors_have_uncertain_factors, _is_passive),
    Law("passivity regressor", "L Delta Y pi = Mbar a + Cbar v_r for all v_r and a", 1e-10, _regressor, _is_passive),
    Law("momentum", "d/dt (N pi) + H pi + (L Delta)^-1 w = R u along every motion", 1e-9, _momentum, _is_passive),
    Law("minimal passivity parameters", "the stacked Y has full column rank", 0.0, _minimal, _is_passive),
    Law("groups", "a base parameter acts in the rows of its group only", 0.0, _groups_share_nothing, _is_passive),
    Law("output map", "E v = L_f h and E' v = L_f^2 h (19)", 1e-11, _output_map, _has_outputs),
    Law("output map rate", "E' is the rate of E along q' = S v", 1e-11, _output_map_rate, _has_outputs),
)
