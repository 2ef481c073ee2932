"""kS, kV and kA as base parameters give them, and as a motion under voltage shows them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.wmr_afl.identification.logs import FRICTION, SMALL, effort_of
from wmr_afl.identification.effort import Coulomb, Effort
from wmr_afl.identification.estimate import Estimate
from wmr_afl.identification.feedforward import Feedforward, feedforward
from wmr_afl.identification.simulated import Simulated

DRIVES = ("type_2_0", "type_2_0_caster", "tractor_trailer", "tractor_3_trailers")
OTHERS = ("car", "type_1_1", "type_1_2", "type_2_0_uneven", "type_2_1", "type_3_0", "mecanum")


def exact(effort: Effort, friction: float = FRICTION) -> Estimate:
    """An estimate that is the robot's own."""
    unknown = np.concatenate([effort.base(effort.p), np.full(len(effort.friction_groups), friction)])
    return Estimate("by hand", unknown, np.zeros((len(unknown), len(unknown))))


def gains(effort: Effort, estimate: Estimate) -> dict[str, Feedforward]:
    found = feedforward(effort, estimate)
    assert found is not None
    return {one.motion: one for one in found}


def test_the_gains_are_base_parameters_by_half() -> None:
    effort = effort_of("type_2_0", **SMALL)
    pi, b = effort.base(effort.p), SMALL["b"]
    found = gains(effort, exact(effort))
    assert list(found) == ["driving", "turning"]
    assert found["driving"].kV == pytest.approx(pi[1] / 2)
    assert found["driving"].kA == pytest.approx(pi[0] / 2)
    assert found["turning"].kV == pytest.approx(pi[5] / (2 * b))
    assert found["turning"].kA == pytest.approx(pi[3] / (2 * b))
    assert {one.kS for one in found.values()} == {FRICTION}


@pytest.mark.parametrize("robot", DRIVES)
@pytest.mark.parametrize(("motion", "ways"), [("driving", (1.0, 1.0)), ("turning", (1.0, -1.0))])
def test_a_motor_under_the_voltage_of_a_motion_moves_like_that(
    robot: str, motion: str, ways: tuple[float, float]
) -> None:
    """From rest without friction the wheels begin with a = u/kA, and, where nothing turns, end at v = u/kV."""
    effort = effort_of(robot)
    estimate = exact(effort, 0.0)
    found, volts = gains(effort, estimate)[motion], 2.0 * np.array(ways)
    radius, step = effort.p[list(effort.model.parameter_units).index("r")], 1e-3
    simulated, x0 = Simulated(effort, step), np.zeros((1, effort.n + effort.n_v))
    states = simulated.states(estimate.unknown[None], x0, np.tile(volts, (1, 2, 1)))[..., 0]
    rates = effort.rates(states[:, : effort.n + effort.n_v])
    assert radius * np.diff(rates[:2], axis=0)[0] / step == pytest.approx(volts / found.kA, rel=0.02)
    if motion == "driving":
        slow = Simulated(effort, 0.02)
        states = slow.states(estimate.unknown[None], x0, np.tile(volts, (1, 2000, 1)))[-1:, :, 0]
        assert radius * effort.rates(states[:, : effort.n + effort.n_v])[0] == pytest.approx(volts / found.kV, rel=1e-3)


@pytest.mark.parametrize("robot", OTHERS)
def test_other_robots_have_none(robot: str) -> None:
    effort = effort_of(robot)
    assert feedforward(effort, exact(effort)) is None


@pytest.mark.parametrize(("coulomb", "expected"), [("each", 0.35), ("grouped", 0.3), ("none", 0.0)])
def test_friction_is_the_mean_of_both_motors(coulomb: Coulomb, expected: float) -> None:
    effort = replace(effort_of("type_2_0"), coulomb=coulomb)
    friction = {"each": [0.3, 0.4], "grouped": [0.3], "none": []}[coulomb]
    unknown = np.concatenate([effort.base(effort.p), friction])
    found = gains(effort, Estimate("by hand", unknown, np.zeros((len(unknown),) * 2)))
    assert found["turning"].kS == pytest.approx(expected)


def test_the_text_has_units() -> None:
    assert str(Feedforward("driving", 0.1, 2.25, 0.3333333, (0.01, 0.02, 0.123))) == (
        "driving: kS 0.1 ± 0.01 V, kV 2.25 ± 0.02 V s/m, kA 0.3333 ± 0.1 V s^2/m"
    )


def test_intervals_are_those_of_the_base_parameters_by_half() -> None:
    effort = effort_of("type_2_0", **SMALL)
    deviations = np.arange(1.0, 8.0)
    found = gains(effort, replace(exact(effort), covariance=np.diag(deviations**2)))
    assert found["driving"].interval == pytest.approx((2.0 * 7.0, 2.0, 1.0))
    assert found["turning"].interval == pytest.approx((2.0 * 7.0, 6.0 / SMALL["b"], 4.0 / SMALL["b"]))
