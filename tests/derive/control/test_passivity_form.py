"""The form that adaptation by passivity needs, against the equations that it stands for, in numbers."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from derive.algebra.separation import NotSeparable
from derive.control import passivity_form
from derive.control.passivity_form import PassivityForm
from derive.derivation import Derivation
from tests.derive.descriptions import AHEAD, derivation_of, in_numbers, motor, part, robot, steered, wheel

AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))
OTHER = {"k2": (0.9, "N m/V"), "b2": (0.2, "m")}


def strong(drives: str, gain: str = "k2") -> str:
    """A motor with another gain."""
    return part("motors", input=f"u_{drives}", drives=drives, torque_gain=gain, back_emf="c")


def knowing(text: str, *names: str) -> str:
    """The description with parameters that a controller knows."""
    listed = ", ".join(f'"{name}"' for name in names)
    return text.replace("\n[coordinates]", f"known = [{listed}]\n\n[coordinates]", 1)


FORK = (steered("fork", ("a", "0"), "beta"), wheel("rear"), wheel("front", "fork"))
ROBOTS = {
    "each row has its factor": robot(*AXLE, motor("left"), motor("right"), outputs=AHEAD),
    "each column has its factor": knowing(
        robot(*AXLE, motor("left"), strong("right"), outputs=AHEAD, parameters=OTHER), "b"
    ),
    "more motors than motions": robot(
        *AXLE, wheel("third", at=("a", "b"), roller_angle="0"),
        motor("left"), motor("right"), motor("third"), outputs=AHEAD,
    ),
    "an angle in all": robot(*FORK, motor("rear"), motor("fork"), angles=("beta",)),
}  # fmt: skip


@pytest.fixture(params=ROBOTS)
def made(request: pytest.FixtureRequest) -> Derivation:
    return derivation_of(ROBOTS[request.param])


def at_random(derivation: Derivation, seed: int) -> dict[sp.Symbol, float]:
    """A state, accelerations and reference velocities."""
    symbols = [*derivation.state, *derivation.adaptive.accelerations, *derivation.reference_velocities]
    return dict(zip(symbols, np.random.default_rng(seed).uniform(0.3, 1.2, len(symbols)), strict=True))


def passive(derivation: Derivation) -> PassivityForm:
    assert derivation.passive is not None, derivation.passivity
    return derivation.passive


def test_what_the_motors_do_is_taken_apart(made: Derivation) -> None:
    """Bbar K1 = L Delta R, each row in one group, and the base parameters of a group are no other one's."""
    form, count = passive(made), len(made.kinematics.v)
    scales = {row: group.scale for group in form.groups for row in group.rows}
    assert sorted(row for group in form.groups for row in group.rows) == list(range(count))
    assert [k for group in form.groups for k in group.parameters] == list(range(len(form.parameters)))
    numbers = at_random(made, 0)
    delta = in_numbers(made, sp.diag(*(scales[row] for row in range(count))), numbers)
    left = np.eye(count) if form.row_map is None else in_numbers(made, form.row_map, numbers)
    expected = in_numbers(made, made.dynamics.input_matrix, numbers)
    np.testing.assert_allclose(left @ delta @ in_numbers(made, form.allocation, numbers), expected, rtol=1e-12)
    assert np.all(np.diag(delta) > 0.0)
    for group in form.groups:
        for row in set(range(count)) - set(group.rows):
            assert form.regressor[row, list(group.parameters)].is_zero_matrix
            assert form.rest_regressor[row, list(group.parameters)].is_zero_matrix


def test_the_regressors_give_the_dynamics(made: Derivation) -> None:
    """L Delta Y pi = Mbar a + Cbar v_r; and Y(x, v, v') pi is d/dt (N pi) + H pi with N held to q's motion and v's."""
    form, d = passive(made), made
    scales = {row: group.scale for group in form.groups for row in group.rows}
    a, v, v_r = (sp.Matrix(one) for one in (form.accelerations, d.kinematics.v, form.reference_velocities))
    own = form.regressor.xreplace(dict(zip(v_r, v, strict=True)))
    momentum = form.momentum_regressor(tuple(v))
    for seed in range(2):
        numbers = at_random(d, seed)
        delta = in_numbers(d, sp.diag(*(scales[row] for row in range(len(v)))), numbers)
        left = np.eye(len(v)) if form.row_map is None else in_numbers(d, form.row_map, numbers)
        pi = in_numbers(d, sp.Matrix(form.parameters), numbers)
        force = in_numbers(d, d.dynamics.inertia_matrix * a + d.dynamics.coriolis_matrix * v_r, numbers)
        np.testing.assert_allclose(left @ delta @ in_numbers(d, form.regressor, numbers) @ pi, force, rtol=1e-12)
        step, shifted = 1e-6, []
        rates = in_numbers(d, sp.Matrix(list(d.kinematics.rates.values())), numbers)[:, 0]
        for sign in (1, -1):
            moved = dict(numbers)
            for q, rate in zip(d.kinematics.q, rates, strict=True):
                moved[q] += sign * step * rate
            for s, slope in zip(v, a, strict=True):
                moved[s] += sign * step * numbers[slope]
            shifted.append(in_numbers(d, momentum, moved))
        expected = (shifted[0] - shifted[1]) / (2 * step) + in_numbers(d, form.rest_regressor, numbers)
        np.testing.assert_allclose(in_numbers(d, own, numbers), expected, rtol=1e-7, atol=1e-8)


def test_its_inverse_brings_about_the_acceleration(made: Derivation) -> None:
    """Bbar K1 u = Mbar a + Cbar v for u = R^-1 Y(x, v, a) pi, where there are as many motors as motions."""
    form, d = passive(made), made
    inverse = form.inverse(d.kinematics.v, d.terms)
    if len(d.robot.motors) != len(d.kinematics.v):
        assert inverse is None
        return
    assert inverse is not None
    for seed in range(2):
        numbers = at_random(d, seed)
        u = in_numbers(d, inverse.regressor(form.accelerations) * sp.Matrix(inverse.base_parameters), numbers)
        force = d.dynamics.inertia_matrix * sp.Matrix(form.accelerations)
        force += d.dynamics.coriolis_matrix * sp.Matrix(d.kinematics.v)
        reached = in_numbers(d, d.dynamics.input_matrix, numbers) @ u
        np.testing.assert_allclose(reached, in_numbers(d, force, numbers), rtol=1e-12)


UNEQUAL = robot(*AXLE, motor("left"), strong("right"), outputs=AHEAD, parameters=OTHER)
OFF_CENTRE = robot(
    wheel("left", at=("0", "b")), wheel("right", at=("0", "-b2")), motor("left"), strong("right"),
    outputs=AHEAD, parameters=OTHER,
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (UNEQUAL, "list b in `known`"),
        (OFF_CENTRE, "list b, b2 in `known`"),
        (knowing(OFF_CENTRE, "r"), "list b, b2 in `known`"),
        (knowing(OFF_CENTRE, "b"), "list b2 in `known`"),
    ],
    ids=["one length", "two lengths", "the radius is known", "one of two lengths is known"],
)
def test_the_parameters_are_named_that_would_have_to_be_known(text: str, told: str) -> None:
    """One that is enough, or as many as are needed; and nothing but these."""
    assert str(derivation_of(text).passivity).endswith(f": {told}")


m, k, c, L, phi = (sp.Symbol(name, real=True) for name in ("m", "k", "c", "L", "phi"))


@pytest.mark.parametrize(
    ("factor", "named"),
    [(1 / (m + L * sp.cos(phi)), "m"), (sp.sqrt(k * phi + c), "c, k"), (sp.sqrt(L + phi), "a parameter")],
    ids=str,
)
def test_what_mixes_state_and_parameters_names_those_that_are_uncertain(
    factor: sp.Expr, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The look-ahead L is known."""

    def fails(*arguments: object) -> None:
        raise NotSeparable(factor)

    d = derivation_of(ROBOTS["each row has its factor"])
    monkeypatch.setattr(passivity_form, "linear_map", fails)
    told = passivity_form.passivity_form(
        d.kinematics, d.dynamics, d.adaptive.accelerations, d.reference_velocities, d.parameters
    )
    assert str(told).startswith(f"{factor} mixes the state")
    assert str(told).endswith(f": list {named} in `known`")
