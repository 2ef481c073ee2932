"""Loads on wheels, the forces of the floor on each, and the friction that they need."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import DESCRIPTIONS
from wmr_afl import load_model
from wmr_afl.model.grip import friction_along, friction_needed, has_grip, wheel_forces
from wmr_afl.model.laws import Situation
from wmr_afl.model.laws.law import relative, times, transposed
from wmr_afl.model.slip import sideways_rows
from wmr_afl.model.wheel_loads import GRAVITY, wheel_loads
from wmr_afl.numerics.formulas import numpy_value


def test_loads_bear_the_weight_and_no_batch_changes_them(situation: Situation) -> None:
    model, p = situation.numpy, situation.p[0]
    loads = wheel_loads(model, situation.q, p)
    parts = [*model.metadata["geometry"]["wheels"].values(), *model.metadata["geometry"]["bodies"].values()]
    names = dict(zip(model.parameter_units, p, strict=True))
    weight = GRAVITY * sum(numpy_value(part["mass"], names) for part in parts)
    np.testing.assert_allclose(loads.sum(axis=1), weight, rtol=1e-12)
    assert np.all(loads > 0.0)
    np.testing.assert_allclose(loads, [wheel_loads(model, q, p) for q in situation.q], rtol=1e-9)


def test_loads_do_not_depend_on_where_the_robot_stands(robot: str) -> None:
    model = load_model(robot)
    q, far = np.zeros(model.coordinate_count), np.zeros(model.coordinate_count)
    far[:3] = 1e3, -2e3, 2.0
    p = model.parameters()
    np.testing.assert_allclose(wheel_loads(model, far, p), wheel_loads(model, q, p), rtol=1e-6)


def test_side_forces_of_wheels_are_those_of_the_constraints(situation: Situation) -> None:
    """A_w^T f = A^T lambda, and wheels with equal rows share by load."""
    model, rows = situation.numpy, sideways_rows(situation.numpy)
    if not rows:
        pytest.skip("no wheel is kept from slipping sideways")
    loads = np.abs(np.random.default_rng(2).normal(size=(len(situation.q), len(model.metadata["geometry"]["wheels"]))))
    forces = wheel_forces(model, situation.x, situation.u, situation.a, situation.p, loads)[:, list(rows), 1]
    multipliers = model.constraint_forces(situation.x, situation.u, situation.a, situation.p)
    A, every = (f(situation.q, situation.p) for f in (model.constraint_matrix, model.slip_matrix))
    own = every[:, list(rows.values())]
    assert relative(times(transposed(own), forces), times(transposed(A), multipliers)) < 1e-10
    for i in range(len(rows)):
        for j in range(i):
            if np.allclose(own[:, i], own[:, j], atol=1e-12):
                shares = loads[:, list(rows)]
                np.testing.assert_allclose(
                    forces[:, i] * shares[:, j], forces[:, j] * shares[:, i], rtol=1e-7, atol=1e-9
                )


def test_forces_of_constraints_that_no_wheel_makes_are_not_told() -> None:
    assert all(has_grip(load_model(robot)) for robot in DESCRIPTIONS)
    model = load_model("type_2_0")
    model.metadata = model.metadata | {"further_constraints": 1}
    assert not has_grip(model)


def test_friction_along_a_motion_is_that_of_its_accelerations(situation: Situation) -> None:
    """At the start of a step, whatever load acts: to second order of it."""
    model, p, u = situation.numpy, situation.p[0], situation.u
    a = model.state_derivative(situation.x, u, situation.w, p)[:, model.coordinate_count :]
    expected, errors = friction_needed(model, situation.x, u, a, p), []
    for step in (2e-4, 1e-4):
        k1 = model.state_derivative(situation.x, u, situation.w, p)
        following = situation.x + step * model.state_derivative(situation.x + 0.5 * step * k1, u, situation.w, p)
        found = friction_along(model, situation.x, following, u, p, step)
        errors.append(np.median(np.abs(found - expected)) / np.median(expected))
    assert errors[0] < 1e-3
    assert errors[1] < 0.6 * errors[0] or errors[1] < 1e-9


@pytest.mark.parametrize("name", list(DESCRIPTIONS))
def test_friction_is_what_an_engine_measures(name: str) -> None:
    """The largest of each wheel over a drive in MuJoCo, which knows of friction alone."""
    pytest.importorskip("mujoco")
    from wmr_afl.validation.drive import EVERY, HELD, SETTLED, drive
    from wmr_afl.validation.mechanism import Mechanism
    from wmr_afl.validation.voltages import Waves

    model, seconds = load_model(name), 2.0
    mechanism = Mechanism(model, model.parameters())
    start = np.zeros(model.coordinate_count)
    driven = drive(mechanism, start, seconds)
    k = np.arange(0, round(seconds / HELD), EVERY)
    k = k[HELD * k > SETTLED]
    x, u = driven.model[k + 1], Waves.of(mechanism).at(HELD * np.arange(round(seconds / HELD)))[k]
    a = model.state_derivative(x, u, np.zeros(model.pseudo_velocity_count), mechanism.p)[:, len(start) :]
    loads = np.broadcast_to(wheel_loads(model, start, mechanism.p), (len(k), len(mechanism.wheels)))
    needed = np.linalg.norm(wheel_forces(model, x, u, a, mechanism.p, loads), axis=-1) / loads
    np.testing.assert_allclose(needed.max(axis=0), driven.grip.friction, rtol=0.01, atol=1e-3)
