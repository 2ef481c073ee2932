"""Laws of the form in which identification knows a robot."""

from __future__ import annotations

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, missing_rank, relative, times
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


def _has_effort(model: Model) -> bool:
    return model.has("effort_regressor")


def _reaches_every_motion(model: Model) -> bool:
    """Fewer motors than pseudo-velocities bring about too few motions to tell all numbers apart."""
    return _has_effort(model) and len(model.input_units) >= model.pseudo_velocity_count


def _ratios(s: Situation, p: Floats) -> Floats:
    """rho, one where motors have equal gains."""
    return np.asarray(s.numpy.gain_ratios(p)) if s.numpy.has("gain_ratios") else np.ones((*p.shape[:-1], s.u.shape[1]))


def _regressor(s: Situation) -> float:
    a = s.state_derivative[:, s.numpy.coordinate_count :]
    effort = times(s.numpy.effort_map(s.q, s.c), _ratios(s, s.p) * s.u)
    return relative(times(s.numpy.effort_regressor(s.x, a, s.c), s.numpy.effort_parameters(s.p)), effort)


def _rows_of_the_motors(s: Situation) -> float:
    """A row of R diag(rho) and of X^T K1 point the same way."""
    own = np.asarray(s.numpy.effort_map(s.q, s.c)) * _ratios(s, s.p)[:, None, :]
    motors = np.asarray(s.numpy.input_matrix(s.q, s.p))
    factors = (own * motors).sum(-1, keepdims=True) / (own * own).sum(-1, keepdims=True)
    return relative(factors * own, motors)


def _minimal(s: Situation) -> float:
    """Along motions that voltages bring about: in these, ratios of gains must be told apart from the rest as well."""
    model, random, count = s.numpy, np.random.default_rng(1), 400
    n, n_v = s.q.shape[1], s.v.shape[1]
    p = np.where(s.p[0] == 0.0, random.uniform(0.5, 1.5, s.p[0].shape), s.p[0])  # at zero columns may vanish
    c = model.known(p)
    x, u = random.normal(size=(count, n + n_v)), 5.0 * random.normal(size=(count, s.u.shape[1]))
    x[:, n:] *= 3.0
    a = model.state_derivative(x, u, np.zeros((count, n_v)), p)[:, n:]
    effort = np.asarray(model.effort_map(x[:, :n], c)) * u[:, None, :]
    kinds: dict[str, Floats] = {}
    for motor, formula in model.metadata["gain_ratio_formulas"].items():
        column = effort[..., list(model.input_units).index(motor)]
        kinds[formula] = kinds.get(formula, np.zeros_like(column)) - column
    columns = [model.effort_regressor(x, a, c), *(column[..., None] for column in kinds.values())]
    return missing_rank(np.concatenate(columns, axis=-1))


LAWS = (
    Law("effort", "R diag(rho) u = Y pi along every motion without load", 1e-9, _regressor, _has_effort),
    Law(
        "effort map", "each row of X^T K1 is a factor times one of R diag(rho)", 1e-12, _rows_of_the_motors, _has_effort
    ),
    Law("minimal effort parameters", "the stacked Y and u have full column rank", 0.0, _minimal, _reaches_every_motion),
)
