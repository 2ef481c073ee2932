"""Laws of input-output linearization."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, largest, relative, times, transposed
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.formulas import numpy_value
from wmr_afl.numerics.linear_algebra import least_norm


def _output_map(s: Situation) -> Floats:
    return s.numpy.output_jacobian(s.q, s.c) @ s.numpy.kinematic_matrix(s.q, s.p)


def _acceleration(s: Situation, derivative: Floats) -> Floats:
    """y'' along x', by automatic differentiation of y' (19)."""
    return s.along("output_rate", derivative, "x")[:, :, 0]


def _output_jacobian(s: Situation) -> float:
    return relative(s.numpy.output_jacobian(s.q, s.c), s.jacobian("output", "q"))


def _output_rate(s: Situation) -> float:
    return relative(s.numpy.output_rate(s.x, s.c), times(_output_map(s), s.v))


def _drift_of_the_kinematics(s: Situation) -> float:
    kinematic = np.hstack([times(s.numpy.kinematic_matrix(s.q, s.p), s.v), 0.0 * s.v])
    return relative(s.numpy.lie_f2_h(s.x, s.c), _acceleration(s, kinematic))


def _output_acceleration(s: Situation) -> float:
    predicted = (
        s.numpy.lie_f2_h(s.x, s.c)
        + s.numpy.lie_q_lie_f_h(s.x, s.theta, s.c)
        + times(s.numpy.decoupling_matrix(s.x, s.theta, s.c), s.u)
    )
    return relative(predicted, _acceleration(s, s.state_derivative))


def _decoupling_matrix(s: Situation) -> float:
    slopes = s.jacobian("output_rate", "x") @ s.jacobian("state_derivative", "u")
    return relative(s.numpy.decoupling_matrix(s.x, s.theta, s.c), slopes)


def _exact_cancellation(s: Situation) -> float:
    right = s.eta - s.numpy.lie_f2_h(s.x, s.c) - s.numpy.lie_q_lie_f_h(s.x, s.theta, s.c)
    matrices = s.numpy.decoupling_matrix(s.x, s.theta, s.c)
    weights = np.ones(s.u.shape[1])
    u = np.array([least_norm(matrix, row, weights, NUMPY) for matrix, row in zip(matrices, right, strict=True)])
    derivative = s.numpy.state_derivative(s.x, u, 0.0 * s.w, s.p)
    return relative(_acceleration(s, derivative), s.eta)


def _known_parameters(s: Situation) -> float:
    """The certainty-equivalent law (25) at the true base parameters is the exact one, from the matrices of (14)."""
    inertia = s.numpy.inertia_matrix(s.q, s.p)
    by_inertia = _output_map(s) @ np.linalg.inv(inertia)
    gain = by_inertia @ s.numpy.input_matrix(s.q, s.p)
    drift = -times(by_inertia, times(s.numpy.coriolis_matrix(s.x, s.p), s.v))
    worst = relative(s.numpy.decoupling_matrix(s.x, s.theta, s.c), gain)
    return largest(worst, relative(s.numpy.lie_q_lie_f_h(s.x, s.theta, s.c), drift))


def _determinant(s: Situation) -> float:
    """det D, or for more motors than outputs det(D D^T), equals the reported product."""
    matrix = s.numpy.decoupling_matrix(s.x, s.theta, s.c)
    if s.numpy.findings["determinant_of"] == "D D^T":
        matrix = matrix @ transposed(matrix)
    names = [*s.numpy.state_units, *s.numpy.known_units, *s.numpy.base_parameter_units]
    columns = np.hstack([s.x, s.c, s.theta]).T
    values = dict(zip(names, columns, strict=True))
    denominator = s.numpy.findings["det_denominator"]
    if denominator is not None:
        values["Delta"] = numpy_value(denominator, values)
    reported = numpy_value(s.numpy.findings["det_decoupling_matrix"], values)
    return relative(np.linalg.det(matrix) / reported, np.ones(len(s.x)))


def _reports_determinant(model: Model) -> bool:
    """False if the determinant, or its denominator Delta, is too long to be reported."""
    found = model.findings
    if "det_decoupling_matrix" in found.get("not_found_out", {}):
        return False
    return "Delta" not in found["det_decoupling_matrix"] or found["det_denominator"] is not None


_OF_OUTPUTS = (
    Law("output Jacobian", "J_h = dh/dq", 1e-12, _output_jacobian),
    Law("output rate", "J_h S v = L_f h (19)", 1e-12, _output_rate),
    Law("drift of the kinematics", "L_f^2 h = y'' with v held", 1e-11, _drift_of_the_kinematics),
    Law("output acceleration", "y'' = L_f^2 h + L_q L_f h + D u (21)", 1e-10, _output_acceleration),
    Law("decoupling matrix", "D = dy''/du (22)", 1e-10, _decoupling_matrix),
    Law(
        "exact cancellation",
        "u = D^-1 (eta - L_f^2 h - L_q L_f h) gives y'' = eta (23), (24)",
        1e-9,
        _exact_cancellation,
    ),
    Law("known parameters", "with known parameters adaptive and exact control coincide", 1e-10, _known_parameters),
    Law("determinant", "det D is the reported product of factors", 1e-9, _determinant, _reports_determinant),
)


def _needs_outputs(law: Law) -> Law:
    def applies(model: Model) -> bool:
        return model.has("output") and law.applies(model)

    return replace(law, applies=applies)


LAWS = tuple(map(_needs_outputs, _OF_OUTPUTS))
