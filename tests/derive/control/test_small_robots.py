"""What a controller is given of small robots, one of each kind of adaptive form, against the dynamics in numbers."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from derive.derivation import Derivation
from tests.derive.descriptions import AHEAD, derivation_of, in_numbers, motor, part, robot, wheel
from wmr_input import InputError

AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))
SLIDING = wheel("third", at=("a", "b"), roller_angle="0")
CASTER = (part("frames", name="arm", parent="body", at=["a", "0"], angle="g"), wheel("w", "arm", ("-e", "0")))
LEVER = part("bodies", frame="body", at=["a", "0"], mass="m", inertia="I")
ROBOTS = {
    "forward": robot(*AXLE, LEVER, motor("left"), motor("right"), outputs=AHEAD),
    "forward, more motors than motions": robot(
        *AXLE, SLIDING, motor("left"), motor("right"), motor("third"), outputs=AHEAD
    ),
    "inverse": robot(*AXLE, *CASTER, motor("left"), motor("right"), angles=("g",), outputs=AHEAD),
    "physical, more motors than motions": robot(
        *AXLE, *CASTER, SLIDING, motor("left"), motor("right"), motor("third"), angles=("g",), outputs=AHEAD
    ),
}


@pytest.fixture(params=ROBOTS)
def made(request: pytest.FixtureRequest) -> Derivation:
    derivation = derivation_of(ROBOTS[request.param])
    assert derivation.adaptive.kind == request.param.split(",")[0]
    return derivation


def at_random(derivation: Derivation, seed: int) -> dict[sp.Symbol, float]:
    """A state, inputs, accelerations, no loads, and the base parameters that belong to the defaults."""
    d = derivation
    symbols = [*d.state, *d.dynamics.inputs, *d.adaptive.accelerations]
    numbers = dict(zip(symbols, np.random.default_rng(seed).uniform(0.3, 1.2, len(symbols)), strict=True))
    theta = in_numbers(d, sp.Matrix(d.adaptive.base_parameters), {})[:, 0]
    return numbers | dict.fromkeys(d.dynamics.loads, 0.0) | dict(zip(d.adaptive.theta, theta, strict=True))


@pytest.mark.parametrize("seed", range(2))
def test_the_dynamics_in_base_parameters_are_the_dynamics(made: Derivation, seed: int) -> None:
    """Q + G u = v', and Y theta where there is a regressor; theta is positive."""
    form, numbers = made.adaptive, at_random(made, seed)
    u = sp.Matrix(made.dynamics.inputs)
    expected = in_numbers(made, made.dynamics.acceleration, numbers)
    np.testing.assert_allclose(in_numbers(made, form.drift + form.gain * u, numbers), expected, rtol=1e-11)
    assert (form.regressor is not None) == (form.kind == "forward") == (form.obstacle is None)
    if form.regressor is not None:
        found = in_numbers(made, form.regressor * sp.Matrix(form.theta), numbers)
        np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert all(numbers[theta] > 0.0 for theta in form.theta)
    if form.inverse is not None:
        effort = form.inverse.regressor(form.accelerations) * sp.Matrix(form.inverse.base_parameters)
        reached = numbers | dict(zip(u, in_numbers(made, effort, numbers)[:, 0], strict=True))
        wanted = in_numbers(made, sp.Matrix(form.accelerations), numbers)
        np.testing.assert_allclose(in_numbers(made, made.dynamics.acceleration, reached), wanted, rtol=1e-11)


def test_outputs_move_as_the_linearization_says(made: Derivation) -> None:
    """y' = J_h q' = E v, and E' is its rate along q' = S v."""
    assert made.control is not None
    linear, numbers, step = made.control.linearization, at_random(made, 0), 1e-6
    rates = in_numbers(made, sp.Matrix(list(made.kinematics.rates.values())), numbers)[:, 0]
    shifted = [
        numbers | {q: numbers[q] + sign * step * rate for q, rate in zip(made.kinematics.q, rates, strict=True)}
        for sign in (1, -1)
    ]
    outputs = sp.Matrix(list(linear.outputs.values()))
    for function, rate in (
        (outputs, linear.output_rate),
        (linear.output_map, linear.output_map_rate),
        (linear.output_rate, linear.lie_f2_h),
    ):
        ahead, behind = (in_numbers(made, function, place) for place in shifted)
        np.testing.assert_allclose(in_numbers(made, rate, numbers), (ahead - behind) / (2 * step), atol=1e-8)
    jacobian = in_numbers(made, linear.output_jacobian, numbers)
    np.testing.assert_allclose(jacobian @ rates[:, None], in_numbers(made, linear.output_rate, numbers), rtol=1e-12)


@pytest.mark.parametrize("seed", range(2))
def test_the_determinant_is_that_of_the_decoupling_matrix(made: Derivation, seed: int) -> None:
    """det(E G), or of its product with its transpose; what stands apart of it is its denominator."""
    assert made.control is not None
    numbers, told = at_random(made, seed), made.control.determinant
    D = in_numbers(made, made.control.linearization.output_map * made.adaptive.gain, numbers)
    assert told.is_square == (D.shape[0] == D.shape[1])
    expected = np.linalg.det(D if told.is_square else D @ D.T)
    assert in_numbers(made, sp.Matrix([told.whole]), numbers) == pytest.approx(expected, rel=1e-9)


WRONG = {
    "too many": (AHEAD | {"y3": "phi"}, r"3 outputs for 2 pseudo-velocities \(body_forward, body_turning\); keep 2"),
    "too few": ({"y1": "x + L*cos(phi)"}, "1 outputs for 2 pseudo-velocities; add 1"),
    "of no coordinate": (AHEAD | {"y2": "L + a"}, "y2: depends on no coordinate"),
    "of each other": (AHEAD | {"y2": "2*x + 2*L*cos(phi)"}, "y1, y2 depend on each other; choose independent outputs"),
    "on the axle": ({"y1": "x", "y2": "y"}, "the outputs do not see body_turning, so their relative degree is not 2"),
    "beside the axle": ({"y1": "x - a*sin(phi)", "y2": "y + a*cos(phi)"}, "do not see body_forward or body_turning"),
    "of the heading alone": ({"y1": "phi", "y2": "L*phi**2"}, "y1, y2 depend on each other"),
    "defined nowhere": (AHEAD | {"y2": "y/(sin(phi)**2 + cos(phi)**2 - 1)"}, "are not defined at a random state"),
}


@pytest.mark.parametrize("case", WRONG)
def test_outputs_that_cannot_be_tracked_are_refused(case: str) -> None:
    """As many as there are motions, which they see, in a sentence."""
    outputs, told = WRONG[case]
    with pytest.raises(InputError, match=told):
        derivation_of(robot(*AXLE, motor("left"), motor("right"), outputs=outputs))
