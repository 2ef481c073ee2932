"""The determinant of the decoupling matrix, and where it is said to vanish, against numbers, for every robot."""

import numpy as np
import pytest
import sympy as sp

from derive.control.decoupling_determinant import Determinant
from derive.derivation import Derivation


def value(derivation: Derivation, expression: sp.Matrix | sp.Expr, numbers: dict[sp.Symbol, float]) -> np.ndarray:
    """At these numbers and the default parameters."""
    expand = derivation.terms.expand
    whole = expression.applyfunc(expand) if isinstance(expression, sp.MatrixBase) else expand(expression)
    found = whole.xreplace({**derivation.robot.defaults, **numbers})
    return np.array(found.tolist() if isinstance(found, sp.MatrixBase) else found, dtype=float)


def at_random(derivation: Derivation) -> dict[sp.Symbol, float]:
    """A state and base parameters."""
    symbols = [*derivation.state, *derivation.adaptive.theta]
    numbers = np.random.default_rng(0).uniform(0.3, 1.2, len(symbols))
    return dict(zip(symbols, map(sp.Float, numbers), strict=True))


def test_the_determinant_is_that_of_d_or_of_its_square(derivation: Derivation) -> None:
    """det(E G), or det(E G G^T E^T) with more motors than outputs."""
    numbers, control = at_random(derivation), derivation.control
    D = value(derivation, control.linearization.output_map, numbers) @ value(
        derivation, derivation.adaptive.gain, numbers
    )
    expected = np.linalg.det(D if control.determinant.is_square else D @ D.T)
    assert control.determinant.is_square == (D.shape[0] == D.shape[1])
    assert value(derivation, control.determinant.whole, numbers) == pytest.approx(expected, rel=1e-9)


def test_angles_at_which_the_motors_lose_a_motion_are_named(derivation: Derivation) -> None:
    """Every angle in turn is put at zero and at a quarter turn."""
    reach, named = derivation.dynamics.input_matrix, derivation.control.determinant.singular_where
    conditions = [sp.sympify(one.removesuffix(" = 0"), locals={s.name: s for s in derivation.state}) for one in named]
    for angle in derivation.kinematics.q[2:]:
        for place in (sp.S.Zero, sp.pi / 2):
            numbers = {**at_random(derivation), angle: place}
            try:
                bound = np.linalg.matrix_rank(value(derivation, reach, numbers), tol=1e-9)
            except TypeError:  # not finite there
                continue
            if bound < reach.rows:
                assert any(one.xreplace({angle: place}) == 0 for one in conditions), (angle, place)
                if derivation.adaptive.kind != "forward":
                    assert derivation.control.determinant.actuation.xreplace({angle: place}) == 0


def test_where_the_motors_fail_is_named_though_the_gain_does_not_show_it() -> None:
    """A gain that is too long to be factored hides it."""
    length, theta, gamma = sp.symbols("L theta1 gamma")
    hidden = Determinant(True, length, 1 / theta, sp.cos(gamma))
    assert hidden.singular_where == ["L = 0", "cos(gamma) = 0"]
