"""Type (2,0) against the paper's closed forms (81)-(91), which stand here and nowhere else."""

import numpy as np
import pytest

from wmr_afl import Model, load_model
from wmr_afl.model.laws import Situation

STUDY_1 = {"r": 0.15, "b": 0.75, "d": 0.3, "L": 0.1, "m_C": 36, "m_w": 1, "I_m": 0.0025, "I_C": 15.625,
           "K1": 7.2, "K2": 2.59}  # fmt: skip
STUDY_2 = {"r": 0.05, "b": 0.3, "d": 0.15, "L": 0.2, "m_C": 10, "m_w": 0.2, "I_m": 0.006, "I_C": 3,
           "K1": 0.261, "K2": 0.267}  # fmt: skip


def paper_parameters(r, b, d, L, m_C, m_w, I_m, I_C, K1, K2):
    """(82), in the paper's order."""
    m, inertia = m_C + 2 * m_w, I_C + 2 * I_m + m_C * d**2 + 2 * m_w * b**2
    return np.array([
        2 * K2 / (m * r**2),
        m_C * d / m,
        m_C * d / inertia,
        2 * b**2 * K2 / (inertia * r**2),
        K1 / (m * r),
        K1 * b / (inertia * r),
    ])  # fmt: skip


@pytest.fixture
def model() -> Model:
    return load_model("type_2_0")


@pytest.fixture
def order(model: Model) -> list[int]:
    """Where the paper's six stand among the derived base parameters."""
    derived = model.base_parameters(model.parameters(**STUDY_1))
    return [int(np.argmin(np.abs(derived - value))) for value in paper_parameters(**STUDY_1)]


def test_the_search_finds_the_papers_six(model: Model, order: list[int]) -> None:
    assert sorted(order) == list(range(6))
    random = np.random.default_rng(0)
    for _ in range(20):
        numbers = {name: value * random.uniform(0.5, 2.0) for name, value in STUDY_1.items()}
        derived = model.base_parameters(model.parameters(**numbers))
        np.testing.assert_allclose(derived[order], paper_parameters(**numbers), rtol=1e-13)


@pytest.mark.parametrize(
    ("numbers", "printed"),
    [
        (STUDY_1, ["6.06", "0.284", "0.54", "6.48", "1.26", "1.8"]),
        (STUDY_2, ["20.54", "0.144", "0.46", "5.87", "0.5", "0.48"]),  # the paper prints 20.52: a slip
    ],
    ids=["study 1", "study 2"],
)
def test_base_parameters_equal_the_printed_ones_to_their_digits(model, order, numbers, printed) -> None:
    derived = model.base_parameters(model.parameters(**numbers))[order]
    for value, text in zip(derived, printed, strict=True):
        digits = len(text.split(".")[1])
        assert round(value, digits) == pytest.approx(float(text), abs=1e-12), text


def test_the_default_parameters_are_those_of_study_1(model: Model) -> None:
    np.testing.assert_array_equal(model.parameters(), list(STUDY_1.values()))


@pytest.fixture
def situation() -> Situation:
    return Situation("type_2_0", count=50, seed=7)


def test_kinematics_and_dynamics_equal_81(situation: Situation) -> None:
    s = situation
    r, b, d, _, m_C, m_w, I_m, I_C, K1, K2 = s.p.T
    phi, omega, zero, one = s.q[:, 2], s.v[:, 1], 0 * s.q[:, 0], 1 + 0 * s.q[:, 0]
    m, inertia = m_C + 2 * m_w, I_C + 2 * I_m + m_C * d**2 + 2 * m_w * b**2
    close = {"rtol": 1e-12, "atol": 1e-12}
    S = _matrix([[np.cos(phi), zero], [np.sin(phi), zero], [zero, one]])
    np.testing.assert_allclose(s.numpy.kinematic_matrix(s.q, s.p), S, **close)
    np.testing.assert_allclose(
        s.numpy.actuator_rates_matrix(s.q, s.p), _matrix([[1 / r, b / r], [1 / r, -b / r]]), **close
    )
    np.testing.assert_allclose(s.numpy.inertia_matrix(s.q, s.p), _matrix([[m, zero], [zero, inertia]]), **close)
    C = _matrix([[2 * K2 / r**2, -m_C * d * omega], [m_C * d * omega, 2 * b**2 * K2 / r**2]])
    np.testing.assert_allclose(s.numpy.coriolis_matrix(s.x, s.p), C, **close)
    B = _matrix([[K1 / r, K1 / r], [K1 * b / r, -K1 * b / r]])
    np.testing.assert_allclose(s.numpy.input_matrix(s.q, s.p), B, **close)


def test_terms_equal_83_to_88(situation: Situation, order: list[int]) -> None:
    s = situation
    t1, t2, t3, t4, t5, t6 = s.theta[:, order].T
    (x, y, phi), (v, omega), L = s.q.T, s.v.T, s.c[:, 0]
    sin, cos = np.sin(phi), np.cos(phi)
    close = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(s.numpy.output(s.q, s.c), _vector([x + L * cos, y + L * sin]), **close)
    lie_f2_h = _vector([-v * omega * sin - L * omega**2 * cos, v * omega * cos - L * omega**2 * sin])
    np.testing.assert_allclose(s.numpy.lie_f2_h(s.x, s.c), lie_f2_h, **close)
    drift = -t1 * v + t2 * omega**2, -t3 * v * omega - t4 * omega
    lie_q_lie_f_h = _vector([cos * drift[0] - L * sin * drift[1], sin * drift[0] + L * cos * drift[1]])
    np.testing.assert_allclose(s.numpy.lie_q_lie_f_h(s.x, s.theta, s.c), lie_q_lie_f_h, **close)
    D = _matrix([
        [cos * t5 - L * sin * t6, cos * t5 + L * sin * t6],
        [sin * t5 + L * cos * t6, sin * t5 - L * cos * t6],
    ])  # fmt: skip
    np.testing.assert_allclose(s.numpy.decoupling_matrix(s.x, s.theta, s.c), D, **close)
    np.testing.assert_allclose(np.linalg.det(D), -2 * L * t5 * t6, **close)


def test_the_papers_regressor_is_ours_at_the_control(situation: Situation, order: list[int]) -> None:
    """(89)-(91): W, which the paper writes with eta and the estimates, is Y at u = Dhat^-1 (eta - ...)."""
    s = situation
    random = np.random.default_rng(3)
    estimate = random.uniform(0.5, 2.0, s.theta.shape)
    h1, h2, h3, h4, h5, h6 = estimate[:, order].T
    phi, (v, omega), L = s.q[:, 2], s.v.T, s.c[:, 0]
    sin, cos = np.sin(phi), np.cos(phi)
    right = s.eta - s.numpy.lie_f2_h(s.x, s.c) - s.numpy.lie_q_lie_f_h(s.x, estimate, s.c)
    u = np.linalg.solve(s.numpy.decoupling_matrix(s.x, estimate, s.c), right[..., None])[..., 0]
    w11, w12, w13, w14 = -v * cos, omega**2 * cos, omega * v * L * sin, omega * L * sin
    w21, w22, w23, w24 = -v * sin, omega**2 * sin, -omega * v * L * cos, -omega * L * cos
    lie_f2_h = s.numpy.lie_f2_h(s.x, s.c)
    F1 = s.eta[:, 0] - lie_f2_h[:, 0] - w11 * h1 - w12 * h2 - w13 * h3 - w14 * h4
    F2 = s.eta[:, 1] - lie_f2_h[:, 1] - w21 * h1 - w22 * h2 - w23 * h3 - w24 * h4
    w15, w16 = (F1 * cos**2 + F2 * sin * cos) / h5, (F1 * sin**2 - F2 * sin * cos) / h6
    w25, w26 = (F1 * sin * cos + F2 * sin**2) / h5, (-F1 * sin * cos + F2 * cos**2) / h6
    W = _matrix([[w11, w12, w13, w14, w15, w16], [w21, w22, w23, w24, w25, w26]])
    np.testing.assert_allclose(s.numpy.regressor(s.x, u, s.c)[..., order], W, rtol=1e-12, atol=1e-11)


def test_internal_dynamics_are_stable_forward_only(model: Model) -> None:
    """Remark 4."""
    assert model.findings["internal_coordinates"] == ["phi"]
    assert model.findings["straight_line"]["forward"] == "stable"
    assert model.findings["straight_line"]["backward"] == "unstable"


def test_classification(model: Model) -> None:
    found = model.findings
    assert (found["degree_of_mobility"], found["degree_of_steerability"]) == (2, 0)
    assert found["degree_of_nonholonomy"] == 2
    assert found["controllable"]
    assert found["relative_degree"] == {"y1": 2, "y2": 2}
    assert found["det_decoupling_matrix"] == "-2*L*theta5*theta6"
    assert len(found["dropped_rows"]) == 1
    assert list(model.known_units) == ["L"]


def _vector(entries):
    return np.stack(np.broadcast_arrays(*entries), axis=-1)


def _matrix(rows):
    return np.stack([_vector(row) for row in rows], axis=-2)
