"""The equation by which a log is read, against the robot's own equations."""

from __future__ import annotations

import numpy as np
import pytest

from tests.wmr_afl.identification.rehearsed import ROBOTS, effort_of, gains
from wmr_afl.identification.effort import Effort, blocks


def situation(effort: Effort, count: int = 6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, voltages, friction in volts of the first motor."""
    random = np.random.default_rng(1)
    x = random.uniform(-0.5, 0.5, (count, effort.n + effort.n_v))
    inputs = len(effort.model.input_units)
    return x, 6.0 * random.normal(size=(count, inputs)), random.normal(size=(count, inputs))


def first_gains(effort: Effort) -> np.ndarray:
    """The torque gain [N m/V] that a motor's friction is counted with."""
    own = gains(effort)
    return own / np.asarray(effort.model.gain_ratios(effort.p)) if effort.ratio_groups else own


@pytest.mark.parametrize("robot", ROBOTS)
def test_base_parameters_alone_move_the_robot(robot: str) -> None:
    """q' and v' are those of the physical parameters, under friction as a load; and X v."""
    effort = effort_of(robot)
    x, u, friction = situation(effort)
    unknown = np.concatenate([effort.base(effort.p), np.zeros(len(effort.friction_groups))])
    rates = effort.motor_rates(x[:, : effort.n])
    load = np.einsum("tji,tj->ti", rates, first_gains(effort) * friction)
    expected = np.asarray(effort.model.state_derivative(x, u, load, effort.p))
    for k in range(len(x)):
        q_rate, v_rate, motor_rates = (
            np.asarray(one).ravel() for one in effort.motion(x[k], u[k], unknown, friction[k])
        )
        np.testing.assert_allclose(np.concatenate([q_rate, v_rate]), expected[k], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(motor_rates, rates[k] @ x[k, effort.n :], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_integrands_are_the_equation(robot: str) -> None:
    """psi (a pi - R_1 u_1) - psi' b pi is the rate of -psi b pi along every motion: here at psi = 1, differentiated."""
    effort = effort_of(robot, "none")
    x, u, _ = situation(effort)
    unknown = effort.base(effort.p)
    rate = np.asarray(effort.model.state_derivative(x, u, np.zeros((len(x), effort.n_v)), effort.p))

    def momentum(states: np.ndarray) -> np.ndarray:
        return blocks(effort.weak_terms.map(len(x))(states.T, u.T)[1], len(x)) @ unknown

    step = 1e-6
    slope = (momentum(x + step * rate) - momentum(x - step * rate)) / (2.0 * step)
    a, _, first, _ = effort.weak_terms.map(len(x))(x.T, u.T)
    left = blocks(a, len(x)) @ unknown + slope
    np.testing.assert_allclose(left, np.asarray(first).T, rtol=1e-6, atol=1e-6 * np.abs(left).max())


@pytest.mark.parametrize("robot", ["type_2_0", "type_2_0_uneven", "mecanum", "car"])
def test_friction_holds_what_is_pushed_by_less(robot: str) -> None:
    """At rest a motor stays if its voltage is below its friction, and goes if it is well above."""
    effort = effort_of(robot)
    unknown = np.concatenate([effort.base(effort.p), np.full(len(effort.friction_groups), 1.0)])
    x, inputs = np.zeros(effort.n + effort.n_v), len(effort.model.input_units)
    for volts, moves in ((0.5, False), (4.0, True)):
        held = effort.holding(x, np.full(inputs, volts), unknown, 1e-3)
        v_rate = np.asarray(effort.motion(x, np.full(inputs, volts), unknown, held)[1]).ravel()
        assert bool(np.abs(v_rate).max() > 1e-6) == moves
        assert np.all(np.abs(np.asarray(held)) <= 1.0 + 1e-12)


def test_friction_over_a_step_is_what_it_is_on_average() -> None:
    """Motors that pass through rest: with all of it, one way or the other, the speed would be off by 6 mm/s."""
    effort = effort_of("type_2_0")
    unknown = np.concatenate([effort.base(effort.p), np.full(2, 1.5)])
    u = np.full(2, -9.0)

    def end(count: int) -> np.ndarray:
        x, step = np.array([0.0, 0.0, 0.0, 0.02, 0.0]), 0.02 / count
        for _ in range(count):
            held = effort.holding(x, u, unknown, step)
            rates = [np.asarray(one).ravel() for one in effort.motion(x, u, unknown, held)[:2]]
            middle = x + 0.5 * step * np.concatenate(rates)
            rates = [np.asarray(one).ravel() for one in effort.motion(middle, u, unknown, held)[:2]]
            x = x + step * np.concatenate(rates)
        return x

    exact = end(2000)
    assert exact[3] < 0.0  # it has passed
    errors = [np.abs(end(count) - exact)[3] for count in (1, 2, 4, 8, 16)]
    assert errors[0] < 1e-3
    assert errors[1] < 2e-4
    assert max(errors[2:]) < 5e-5


def test_coordinates_that_do_not_matter_are_told() -> None:
    """A robot goes the same everywhere, whatever its heading; not so with its joints at an angle."""
    assert effort_of("type_2_0").cyclic == (True, True, True)
    assert effort_of("car").cyclic == (True, True, True, False)
    assert effort_of("tractor_trailer").cyclic == (True, True, True, False)


def test_what_is_known_is_not_asked_for() -> None:
    """Lengths of the wheels are geometry, and numbers that follow from what is given are known."""
    model = effort_of("type_2_0").model
    names = list(model.parameter_units)
    assert {names[k] for k in effort_of("type_2_0").sought} == {"d", "m_C", "m_w", "I_m", "I_C", "K1", "K2"}
    level = Effort(model, model.parameters(d=0.0), "grouped", frozenset({"d"}))
    own = level.base(level.p)
    assert (~level.is_free).sum() == np.sum(own == 0.0) == 2
    assert Effort(model, model.parameters(), "grouped").is_free.all()
    sure = Effort(model, model.parameters(), "none", frozenset(names))
    assert not sure.is_free.any()


@pytest.mark.parametrize(("coulomb", "count"), [("none", 0), ("grouped", 2), ("each", 3)])
def test_motors_of_a_kind_rub_alike(coulomb: str, count: int) -> None:
    """One number for each kind, or for each motor, or none."""
    effort = effort_of("type_1_2", coulomb)
    assert len(effort.friction_groups) == count
    assert sorted(j for group in effort.friction_groups.values() for j in group) == ([] if count == 0 else [0, 1, 2])


def test_a_robot_without_inertia_is_none() -> None:
    """A first estimate whose inertia is negative somewhere is told."""
    effort = effort_of("car")
    own = np.concatenate([effort.base(effort.p), np.zeros(len(effort.friction_groups))])
    x = np.random.default_rng(0).uniform(-0.4, 0.4, (20, effort.n + effort.n_v))
    assert effort.can_be(own, own, x)
    other = own.copy()
    other[0] *= -1.0
    assert not effort.can_be(other, own, x)
