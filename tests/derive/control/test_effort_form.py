"""The form that identification needs, against the equations that it stands for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from derive.control.effort_form import EffortForm
from derive.derivation import Derivation
from tests.derive.control.test_passivity_form import AXLE, FORK, OTHER, knowing, strong
from tests.derive.descriptions import AHEAD, CORNERS, derivation_of, in_numbers, lawful_model, motor, robot, wheel
from tests.derive.descriptions import derived as folder_of
from wmr_afl import load_model

STRONGER = OTHER | {f"k{n}": (0.8 + 0.1 * n, "N m/V") for n in (3, 4)}
ROLLERS = {"fl": "-pi/4", "fr": "pi/4", "rl": "pi/4", "rr": "-pi/4"}
FOUR = tuple(wheel(name, at=CORNERS[name], roller_angle=angle) for name, angle in ROLLERS.items())
ROBOTS = {
    "equal motors": robot(*AXLE, motor("left"), motor("right"), outputs=AHEAD),
    "unequal motors": robot(*AXLE, motor("left"), strong("right"), outputs=AHEAD, parameters=OTHER),
    "four unequal motors for three motions": robot(
        *FOUR, motor("fl"), strong("fr"), strong("rl", "k3"), strong("rr", "k4"), parameters=STRONGER,
    ),
    "two unequal motors drive, a third one steers": robot(
        *FORK, wheel("beside", "fork"), motor("rear"), strong("front"), strong("fork", "k3"),
        angles=("beta",), parameters=STRONGER,
    ),
    "two kinds of motors": robot(
        *FOUR, motor("fl"), strong("fr"), motor("rl"), strong("rr"), parameters=STRONGER,
    ),
}  # fmt: skip


def effort(derivation: Derivation) -> EffortForm:
    assert derivation.efforts is not None, derivation.effort
    return derivation.efforts


@pytest.mark.parametrize("name", ROBOTS)
def test_it_is_the_equation_of_motion_in_fewest_numbers(name: str, tmp_path: Path) -> None:
    """The generated functions obey the laws of every robot, and so do those of robots with odd motors."""
    model = lawful_model(folder_of(ROBOTS[name], tmp_path))
    assert model.has("effort_regressor"), model.metadata["effort_obstacle"]


@pytest.mark.parametrize("name", ROBOTS)
def test_base_parameters_and_ratios_suffice_for_the_forces(name: str) -> None:
    """Mbar a + Cbar v = X^T K1 u for the u whose effort is Y pi: rows differ by a factor that is the same for all a."""
    d = derivation_of(ROBOTS[name])
    form, random = effort(d), np.random.default_rng(3)
    a, v = sp.Matrix(d.adaptive.accelerations), sp.Matrix(d.kinematics.v)
    force = d.dynamics.inertia_matrix * a + d.dynamics.coriolis_matrix * v
    quotients = []
    for _ in range(3):
        symbols = [*d.state, *d.adaptive.accelerations]
        numbers = dict(zip(symbols, random.uniform(0.3, 1.2, len(symbols)), strict=True))
        numbers |= dict(zip(d.kinematics.q, np.full(len(d.kinematics.q), 0.4), strict=True))
        effort_now = in_numbers(d, form.regressor * sp.Matrix(form.parameters), numbers)
        quotients.append(effort_now / in_numbers(d, force, numbers))
    np.testing.assert_allclose(quotients[1:], [quotients[0]] * 2, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "ratios"),
    [
        ("equal motors", "1, 1"),
        ("unequal motors", "1, k2/k"),
        ("four unequal motors for three motions", "1, k2/k, k3/k, k4/k"),
        ("two kinds of motors", "1, k2/k, 1, k2/k"),
    ],
)
def test_ratios_are_of_motors_that_act_together(name: str, ratios: str) -> None:
    """To the first of them."""
    assert ", ".join(map(str, effort(derivation_of(ROBOTS[name])).gain_ratios)) == ratios


def test_a_motor_that_acts_alone_in_its_row_has_a_factor_of_its_own() -> None:
    """Its gain cannot be told from what it moves: no ratio, whatever the other motors are."""
    form = effort(derivation_of(ROBOTS["two unequal motors drive, a third one steers"]))
    assert [str(ratio) for ratio in form.gain_ratios] == ["1", "k2/k", "1"]


def test_unequal_motors_share_base_parameters() -> None:
    """Adaptation by passivity needs each of them twice."""
    made = derivation_of(knowing(ROBOTS["unequal motors"], "b"))
    form = effort(made)
    assert made.passive is not None
    assert len(form.parameters) + 1 < len(made.passive.parameters)
    assert not form.of_passivity


def test_where_it_coincides_with_passivity_it_is_that() -> None:
    """And nothing is derived twice."""
    made = derivation_of(ROBOTS["equal motors"])
    assert made.passive is not None
    assert effort(made).of_passivity
    assert effort(made).parameters == made.passive.parameters
    assert effort(made).effort_map == made.passive.allocation


def test_uncertain_lengths_that_mix_are_named() -> None:
    """Motors of unequal gain at different uncertain distances: one of the two has to be known, and one is enough."""
    odd = robot(
        *AXLE, wheel("third", at=("a", "e"), roller_angle="0"),
        motor("left"), strong("right"), strong("third", "k3"), parameters=STRONGER,
    )  # fmt: skip
    made = derivation_of(odd)
    assert made.effort == "motors of unequal gain act through uncertain lengths: list b, e in `known`"
    assert made.efforts is None
    assert derivation_of(knowing(odd, "b", "e")).efforts is not None


def test_it_is_regular_where_the_motors_matrix_is_singular() -> None:
    """Type (2,1) with its wheel across: the inverse form divides by zero there."""
    model = load_model("type_2_1")
    p = model.parameters()
    x = np.random.default_rng(0).normal(size=len(model.state_units))
    names = list(model.state_units)
    (angle,) = (name for name in names[2 : model.coordinate_count] if name != "phi" and "gamma" in name)
    x[names.index(angle)] = np.pi / 2.0
    a = np.ones(model.pseudo_velocity_count)
    assert np.linalg.cond(model.actuator_rates_matrix(x[: model.coordinate_count], p)) > 1e12
    regressor = model.effort_regressor(x, a, model.known(p))
    assert np.abs(regressor).max() < 1e3
    assert np.abs(model.inverse_regressor(x, a, model.known(p))).max() > 1e12
