"""Laws of motion: constraints, inertia, power."""

from __future__ import annotations

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, condition, largest, relative, times, transposed
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value


def _constraints_hold(s: Situation) -> float:
    product = s.numpy.constraint_matrix(s.q, s.p) @ s.numpy.kinematic_matrix(s.q, s.p)
    return relative(product, np.zeros_like(product))


def _full_rank(s: Situation) -> float:
    """Zero if every matrix has full rank with a margin."""
    matrices = s.numpy.kinematic_matrix(s.q, s.p), transposed(s.numpy.constraint_matrix(s.q, s.p))
    worst = max(float(condition(matrix).max()) for matrix in matrices if matrix.shape[-1])
    return max(0.0, 1e-6 - 1.0 / worst)


def _coordinates_move_as_kinematics_say(s: Situation) -> float:
    n = s.numpy.coordinate_count
    return relative(s.state_derivative[:, :n], times(s.numpy.kinematic_matrix(s.q, s.p), s.v))


def _inertia_is_symmetric(s: Situation) -> float:
    inertia = s.numpy.inertia_matrix(s.q, s.p)
    return relative(inertia, transposed(inertia))


def _inertia_is_positive(s: Situation) -> float:
    values = np.linalg.eigvalsh(s.numpy.inertia_matrix(s.q, s.p))
    return largest(0.0, 1e-9 - float(np.min(values[:, 0] / np.abs(values).max(axis=1))))


def _inertia_rate(s: Situation) -> Floats:
    return s.along("inertia_matrix", times(s.numpy.kinematic_matrix(s.q, s.p), s.v), "q")


def _damping(s: Situation) -> Floats:
    """Back-EMF's share in Cbar: what remains at v = 0, because all else is linear in v."""
    return s.numpy.coriolis_matrix(np.hstack([s.q, 0.0 * s.v]), s.p)


def _coriolis_is_skew(s: Situation) -> float:
    difference = _inertia_rate(s) - 2.0 * (s.numpy.coriolis_matrix(s.x, s.p) - _damping(s))
    return relative(difference, -transposed(difference))


def _damping_dissipates(s: Situation) -> float:
    damping = _damping(s)
    lowest = np.min(np.linalg.eigvalsh((damping + transposed(damping)) / 2.0))
    return relative(damping, transposed(damping)) + largest(0.0, -float(lowest))


def _power_balance(s: Situation) -> float:
    n, inertia = s.numpy.coordinate_count, s.numpy.inertia_matrix(s.q, s.p)
    acceleration = s.numpy.state_derivative(s.x, s.u, s.w, s.p)[:, n:]
    energy_rate = np.sum(s.v * (times(inertia, acceleration) + 0.5 * times(_inertia_rate(s), s.v)), axis=1)
    force = times(s.numpy.input_matrix(s.q, s.p), s.u) - times(_damping(s), s.v) - s.w
    return relative(energy_rate, np.sum(s.v * force, axis=1))


def _motors_act_where_they_turn(s: Situation) -> float:
    """Bbar K1 = X^T K1, and the back-EMF's share in Cbar is X^T K2 X."""
    rates = s.numpy.actuator_rates_matrix(s.q, s.p)
    torque_gain, back_emf = (_of_motors(s, key)[:, None, :] for key in ("torque_gain", "back_emf"))
    worst = relative(s.numpy.input_matrix(s.q, s.p), transposed(rates) * torque_gain)
    return largest(worst, relative(_damping(s), (transposed(rates) * back_emf) @ rates))


def _stops_move_as_their_joints(s: Situation) -> float:
    rates = s.along("joint_stops", times(s.numpy.kinematic_matrix(s.q, s.p), s.v), "q")[..., 0]
    return relative(times(s.numpy.joint_stops_matrix(s.q, s.p), s.v), rates)


def _slip_is_zero_without_slip(s: Situation) -> float:
    """Z S: nothing sideways, and of motors what they turn, times the radius of a wheel."""
    product = s.numpy.slip_matrix(s.q, s.p) @ s.numpy.kinematic_matrix(s.q, s.p)
    shafts, expected = s.numpy.actuator_rates_matrix(s.q, s.p), np.zeros_like(product)
    motors = [row.get("motor") for row in s.numpy.metadata["slip_rows"]]
    for row, motor in enumerate(s.numpy.input_units):
        expected[:, motors.index(motor)] = _arm(s, motor)[:, None] * shafts[:, row]
    return relative(product, expected)


def _slip_is_how_contacts_move(s: Situation) -> float:
    """Z q' for random q', against differences of the poses of wheels and joints."""
    rates = np.hstack([s.v, s.a, s.eta])[:, : s.q.shape[1]]
    found, worst = times(s.numpy.slip_matrix(s.q, s.p), rates), 0.0
    for row, about in enumerate(s.numpy.metadata["slip_rows"]):
        if "joint" in about:
            parent = s.numpy.metadata["geometry"]["frames"][about["joint"]]["parent"]
            child, other = (_motion(s, rates, "frames", frame)[2] for frame in (about["joint"], parent))
            expected = child - other
        else:
            wheel = s.numpy.metadata["geometry"]["wheels"][about["wheel"]]
            east, north, _ = _motion(s, rates, "wheels", about["wheel"])
            roller = _value(s, wheel.get("roller_angle", "0"), s.q)
            angle = _value(s, wheel["heading"], s.q) + (np.pi / 2.0 if about["direction"] == "sideways" else roller)
            expected = (np.cos(angle) * east + np.sin(angle) * north) / np.cos(roller)
        worst = largest(worst, relative(found[:, row], expected))
    return worst


def _arm(s: Situation, motor: str) -> Floats:
    """The radius of the wheel that a motor drives, or 1 where it drives a joint, (batch,)."""
    wheels = s.numpy.metadata["geometry"]["wheels"]
    driven = s.numpy.metadata["motors"][motor]["drives"]
    return _value(s, wheels[driven]["radius"] if driven in wheels else "1", s.q)


def _motion(s: Situation, rates: Floats, kind: str, part: str) -> list[Floats]:
    """How fast x, y and heading of a part change while q moves at `rates`, by differences of order 4, (batch,) each."""
    texts = [s.numpy.metadata["geometry"][kind][part][key] for key in ("x", "y", "heading")]

    def change(text: str, step: float) -> Floats:
        return (_value(s, text, s.q + step * rates) - _value(s, text, s.q - step * rates)) / (2.0 * step)

    return [(4.0 * change(text, 1e-3) - change(text, 2e-3)) / 3.0 for text in texts]


def _value(s: Situation, text: str, q: Floats) -> Floats:
    """The value of a formula of coordinates and parameters, (batch,)."""
    names = [*s.numpy.state_units][: q.shape[1]]
    numbers = dict(zip(names, q.T, strict=True)) | dict(zip(s.numpy.parameter_units, s.p.T, strict=True))
    return numpy_value(text, numbers) + np.zeros(len(q))


def _of_motors(s: Situation, key: str) -> Floats:
    """A motor constant of every motor, from its formula in the physical parameters, (batch, n_u)."""
    names = dict(zip(s.numpy.parameter_units, s.p.T, strict=True))
    values = [numpy_value(motor[key], names) for motor in s.numpy.metadata["motors"].values()]
    columns = np.zeros((len(s.x), len(values)))
    for k, value in enumerate(values):
        columns[:, k] = value
    return columns


LAWS = (
    Law("constraints hold", "A S = 0 (3)", 1e-12, _constraints_hold),
    Law("full rank", "S has full column rank and A full row rank", 0.0, _full_rank),
    Law("kinematics", "q' = S v (4) in the state derivative", 1e-12, _coordinates_move_as_kinematics_say),
    Law("symmetric inertia", "Mbar is symmetric", 1e-12, _inertia_is_symmetric),
    Law("positive inertia", "Mbar is positive definite", 0.0, _inertia_is_positive),
    Law("skew symmetry", "Mbar' - 2 Cbar is skew without back-EMF", 1e-10, _coriolis_is_skew),
    Law("dissipation", "back-EMF damps: its share in Cbar is symmetric, not negative", 1e-10, _damping_dissipates),
    Law("power balance", "kinetic energy changes by motor work minus dissipation", 1e-10, _power_balance),
    Law("virtual power", "motors act on v as their shafts turn: Bbar = X^T", 1e-12, _motors_act_where_they_turn),
    Law("no slip", "Z S is zero sideways, and the motors' radius or 1 times X", 1e-12, _slip_is_zero_without_slip),
    Law("speeds of slip", "Z q' is how contacts and joints move", 1e-8, _slip_is_how_contacts_move),
    Law(
        "stops of joints", "their distances change by J v", 1e-10, _stops_move_as_their_joints,
        lambda model: model.has("joint_stops"),
    ),
)  # fmt: skip
