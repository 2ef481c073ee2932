"""What is measured, and what of the state follows from it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import ROBOTS
from wmr_afl import WmrError, load_model
from wmr_afl.errors import UnknownNameError
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.model.observability import remedies, undetermined
from wmr_afl.numerics.arrays import Floats

KNOWN = {  # what is known from the literature of each robot: flat outputs determine all, casters nothing that matters
    ("type_2_0", "x y"): "",
    ("type_2_0", "u_r u_l"): "x y phi",
    ("type_2_0", "x u_r u_l"): "y",
    ("mecanum", "x y"): "phi platform_forward platform_lateral platform_turning",
    ("mecanum", "x y phi"): "",
    ("mecanum", "phi u_fl u_fr u_rl u_rr"): "x y",
    ("car", "x y"): "",
    ("car", "x y phi"): "",
    ("car", "phi beta sigma"): "x y",
    ("type_2_0_caster", "x y phi"): "beta",
    ("type_2_0_caster", "x y beta"): "",
    ("tractor_trailer", "x y phi"): "beta",
    ("tractor_3_trailers", "x y phi"): "beta1 beta2 beta3",
    ("tractor_3_trailers", "x y phi beta1"): "beta2 beta3",
    ("tractor_3_trailers", "x y beta3"): "",
    ("type_2_1", "x y phi"): "gamma",
}


@pytest.mark.parametrize(("robot", "measured"), KNOWN, ids=str)
def test_what_is_left_undetermined_is_known_of_these_robots(robot: str, measured: str) -> None:
    model = load_model(robot)
    assert undetermined(model, measured.split(), model.parameters()) == tuple(KNOWN[robot, measured].split())


def coordinates(model: Model) -> list[str]:
    return list(model.state_units)[: model.coordinate_count]


def test_all_of_q_tells_all_and_motors_tell_no_place(robot: str) -> None:
    model = load_model(robot)
    p = model.parameters()
    assert undetermined(model, coordinates(model), p) == ()
    if model.input_units:
        assert {"x", "y"} <= set(undetermined(model, list(model.input_units), p))


def test_a_remedy_is_one_and_the_smallest(robot: str) -> None:
    """With what is proposed all is determined, with less of it not; and more that is measured never tells less."""
    model = load_model(robot)
    p, measured = model.parameters(), ["x"]
    left = undetermined(model, measured, p)
    proposed = remedies(model, measured, p)
    assert proposed
    for more in proposed:
        assert set(more) <= set(left)
        assert not undetermined(model, [*measured, *more], p)
        for one in more:
            fewer = [name for name in more if name != one]
            still = undetermined(model, [*measured, *fewer], p)
            assert still
            assert set(still) <= set(left)


def driven(model: Model, q: Floats, v: Floats) -> Floats:
    """q at the samples of v (T, n-m), 10 ms apart."""
    p, rows = model.parameters(), [q]
    for rates in v:
        middle = rows[-1] + 0.005 * (model.kinematic_matrix(rows[-1], p) @ rates)
        rows.append(rows[-1] + 0.01 * (model.kinematic_matrix(middle, p) @ rates))
    return np.array(rows)


@pytest.mark.parametrize(("robot", "joint"), [("type_2_0_caster", "beta"), ("tractor_trailer", "beta")])
def test_a_joint_that_is_not_determined_may_differ_and_nothing_shows(robot: str, joint: str) -> None:
    """The same drive from two angles of it: x, y and phi are alike; told of the last joint they are not."""
    model = load_model(robot)
    v = np.random.default_rng(1).uniform(0.2, 1.0, (100, model.pseudo_velocity_count))
    place = coordinates(model).index(joint)
    one = np.array([0.1, -0.2, 0.4, 0.3])
    other = one.copy()
    other[place] += 0.5
    first, second = driven(model, one, v), driven(model, other, v)
    np.testing.assert_allclose(first[:, :3], second[:, :3], atol=1e-12)
    assert abs(first[20, place] - second[20, place]) > 0.05


def test_encoders_measure_what_motors_turn(robot: str) -> None:
    """z of a motor is X(q) v (10), of an entry the entry; rows give the same."""
    model = load_model(robot)
    p, random = model.parameters(), np.random.default_rng(2)
    x = random.uniform(0.2, 0.9, len(model.state_units))
    names = [*reversed(model.input_units), "y", list(model.state_units)[-1]]
    measurement = Measurement(model, names)
    q, v = x[: model.coordinate_count], x[model.coordinate_count :]
    expected = [*(model.actuator_rates_matrix(q, p) @ v)[::-1], x[1], x[-1]]
    np.testing.assert_allclose(measurement.of(x, p, model), expected, rtol=1e-14)
    for row, value in zip(measurement.rows(q, p, model), expected, strict=True):
        assert abs(sum(weight * x[i] for i, weight in row.items()) - value) < 1e-12
    assert measurement.coordinates == {1: len(model.input_units)}


def test_a_state_is_put_together_of_what_is_measured(robot: str) -> None:
    """v as measured, or what fits the rates of all motors; zero where neither is there."""
    model = load_model(robot)
    p, random = model.parameters(), np.random.default_rng(3)
    x, names, n = random.uniform(0.2, 0.9, len(model.state_units)), list(model.state_units), model.coordinate_count
    shuffled = list(random.permutation(names))
    for measured, tells in ((shuffled, True), ([*reversed(model.input_units), *names[:n]], True), (names[:n], False)):
        measurement = Measurement(model, measured)
        assert measurement.tells_q
        assert measurement.tells_v == tells
        expected = x if tells else [*x[:n], *np.zeros(len(x) - n)]
        np.testing.assert_allclose(measurement.state(measurement.of(x, p, model), p, model), expected, rtol=1e-9)
    assert not Measurement(model, names[1:]).tells_q
    assert not Measurement(model, names[:-1]).tells_v
    assert not Measurement(model, [*names[:n], next(iter(model.input_units))]).tells_v


def test_noise_is_told_by_name_or_follows_from_what_is_measured() -> None:
    measurement = Measurement(load_model("type_2_0"), ["x", "phi", "u_r", "omega"])
    assert measurement.deviations(None, 0.1, 7.0) == [0.1, 0.1, 7.0, 7.0]
    assert measurement.deviations({"u_r": 3.0}, 0.1, 7.0) == [0.1, 0.1, 3.0, 7.0]
    assert measurement.deviations(0.5, 0.1, 7.0) == [0.5] * 4
    assert measurement.is_angle == [False, True, False, False]
    with pytest.raises(UnknownNameError, match="measured entry"):
        measurement.deviations({"y": 3.0}, 0.1, 7.0)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], "nothing is measured"),
        (["x", "y", "x"], "x is measured twice"),
        (["z"], "unknown entry of the state"),
    ],
)
def test_what_cannot_be_measured_is_refused(names: list[str], words: str) -> None:
    with pytest.raises(WmrError, match=words):
        Measurement(load_model(ROBOTS[0]), names)
