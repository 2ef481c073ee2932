"""Laws of the forces that the floor exerts, against d'Alembert's principle along the poses of model.json."""

from __future__ import annotations

import casadi as ca
import numpy as np

from wmr_afl.model.laws.law import Law, Situation, relative, times, transposed
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import casadi_value


def _constraint_forces(s: Situation) -> float:
    """A^T lambda is what inertia, motors, rolling and load leave on q."""
    expected, _ = _witness(s)
    A, forces = s.numpy.constraint_matrix(s.q, s.p), s.numpy.constraint_forces(s.x, s.u, _accelerations(s), s.p)
    return relative(times(transposed(A), forces), expected)


def _rolling_forces(s: Situation) -> float:
    _, expected = _witness(s)
    return relative(s.numpy.rolling_forces(s.x, s.u, _accelerations(s), s.p), expected)


def _accelerations(s: Situation) -> Floats:
    """v' under load."""
    return np.asarray(s.numpy.state_derivative(s.x, s.u, s.w, s.p)[:, s.numpy.coordinate_count :])


def _witness(s: Situation) -> tuple[Floats, Floats]:
    """Forces on q that are left for the constraints, (batch, n), and forces along of all wheels, (batch, wheels)."""
    S = s.numpy.kinematic_matrix(s.q, s.p)
    rates = times(S, s.v)
    second = times(S, _accelerations(s)) + times(s.along("kinematic_matrix", rates, "q"), s.v)
    function = _balance(s.numpy)
    rows = [function(*row) for row in zip(s.q, rates, second, s.u, s.w, s.p, strict=True)]
    left, along = (np.array([one.full()[:, 0] for one in column]) for column in zip(*rows, strict=True))
    return left, along


def _balance(model: Model) -> ca.Function:
    """(q, q', q'', u, w, p) -> inertia - motors - rolling + load on q, and each wheel's force along."""
    coordinates = list(model.state_units)[: model.coordinate_count]
    q, rates, second = (ca.SX.sym(name, len(coordinates)) for name in ("q", "rates", "second"))
    u, w = ca.SX.sym("u", len(model.input_units)), ca.SX.sym("w", model.pseudo_velocity_count)
    p, geometry = ca.SX.sym("p", len(model.parameter_units)), model.metadata["geometry"]
    names = dict(zip(model.parameter_units, ca.vertsplit(p), strict=True)) | dict(
        zip(coordinates, ca.vertsplit(q), strict=True)
    )
    names |= {f"{name}_dot": rates[i] for i, name in enumerate(coordinates)}

    def value(text: str) -> ca.SX:
        return ca.SX(casadi_value(text, names))

    def inertial(rows: ca.SX, mass: ca.SX) -> ca.SX:
        """Force on q of a mass whose velocity is rows q'."""
        return mass * rows.T @ _change(rows, q, rates, second)

    def torque(driven: str, turning: ca.SX) -> ca.SX:
        """Of all motors there."""
        of_motors = zip(model.metadata["motors"].values(), ca.vertsplit(u), strict=True)
        torques = [
            value(m["torque_gain"]) * v - value(m["back_emf"]) * turning for m, v in of_motors if m["drives"] == driven
        ]
        return sum(torques, start=ca.SX(0))

    left, along = ca.SX(len(coordinates), 1), []
    for part in (*geometry["bodies"].values(), *geometry["wheels"].values()):
        left += inertial(ca.jacobian(ca.vertcat(value(part["x"]), value(part["y"])), q), value(part["mass"]))
        left += inertial(ca.jacobian(value(part["heading"]), q), value(part["inertia"]))
    for name, wheel in geometry["wheels"].items():
        roller = value(wheel.get("roller_angle", "0"))
        angle, arm = value(wheel["heading"]) + roller, value(wheel["radius"]) * ca.cos(roller)
        contact = ca.jacobian(ca.vertcat(value(wheel["x"]), value(wheel["y"])), q)
        rolled = ca.horzcat(ca.cos(angle), ca.sin(angle)) @ contact
        spin = rolled / arm
        spinning = value(wheel["spin_inertia"]) * _change(spin, q, rates, second)
        along.append((torque(name, spin @ rates) - spinning) / arm)
        left -= rolled.T @ along[-1]
    for name, frame in geometry["frames"].items():
        if "parent" in frame:
            joint = ca.jacobian(value(frame["angle"]), q)
            left -= joint.T @ torque(name, joint @ rates)
    v = ca.vertcat(*(value(text) for text in model.findings["pseudo_velocities"].values()))
    left += ca.jacobian(v, rates).T @ w
    return ca.Function("balance", [q, rates, second, u, w, p], [ca.densify(left), ca.densify(ca.vertcat(*along))])


def _change(rows: ca.SX, q: ca.SX, rates: ca.SX, second: ca.SX) -> ca.SX:
    """The rate of change of rows q'."""
    return rows @ second + ca.jtimes(rows @ rates, q, rates)


LAWS = (
    Law("constraint forces", "A^T lambda is inertia less motors, rolling and load, on q (7)", 1e-9, _constraint_forces),
    Law("rolling forces", "along, a wheel passes on what spinning it up leaves of its torque", 1e-9, _rolling_forces),
)
