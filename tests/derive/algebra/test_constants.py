"""Angles that are written as decimals make no algebra harder and stay exact to a double's last digit."""

from __future__ import annotations

import subprocess
import sys
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from derive.algebra.constants import Constants, near_fractions_of_pi
from derive.algebra.formula_text import formula, readable
from tests.conftest import ROOT
from tests.derive.descriptions import derived, lawful_model, motor, robot, steered, wheel
from wmr_afl.numerics.formulas import numpy_value

a, x = sp.symbols("a x", real=True)
SECONDS = 60  # what used to run for minutes takes a few


@pytest.mark.parametrize("angle", ["2.094395", "0.5", "1e-3", "3.7", "1.5707963", "6.25"])
def test_a_decimal_has_fractions_on_the_unit_circle(angle: str) -> None:
    constants = Constants()
    c, s = (constants.exact(constants.inside_functions(function(sp.Rational(angle)))) for function in (sp.cos, sp.sin))
    assert c.is_Rational
    assert c**2 + s**2 == 1
    assert float(c) == pytest.approx(cos(float(angle)), abs=4e-16)
    assert float(s) == pytest.approx(sin(float(angle)), abs=4e-16)


def test_decimals_that_are_multiples_of_each_other_keep_their_identities() -> None:
    constants = Constants()
    one, two, three = (constants.inside_functions(sp.cos(sp.Rational(n, 10))) for n in (7, 14, 21))
    assert constants.exact(two - 2 * one**2 + 1) == 0
    assert constants.exact(three - 4 * one**3 + 3 * one) == 0


def test_sums_with_other_angles_are_resolved() -> None:
    constants = Constants()
    resolved = constants.exact(constants.inside_functions(sp.sin(a + sp.Rational("0.3")) + sp.tan(x)))
    assert sp.N(resolved.subs({a: 0.2, x: 0.1}) - sp.sin(0.5) - sp.tan(0.1)) == pytest.approx(0.0, abs=1e-15)


def test_fractions_of_pi_stay_as_they_are() -> None:
    constants = Constants()
    assert constants.in_angle(a + sp.pi / 4) == a + sp.pi / 4
    assert constants.values == {}


def test_a_decimal_close_to_a_fraction_of_pi_is_recognized() -> None:
    constants = Constants()
    for text in ("1.5708", "0.785398", "0.5"):
        constants.in_angle(sp.Rational(text))
    found = {symbol.name: value for symbol, value in near_fractions_of_pi(constants.values, 1e-3).items()}
    assert found == {"1.5708": sp.pi / 2, "0.785398": sp.pi / 4}


def test_numbers_that_no_double_holds_are_printed_as_decimals_and_read_back() -> None:
    huge = sp.Integer(10) ** 200 + 1
    expression = (huge * a + 3 * huge * x) / (huge * 7 + a * sp.Integer(10) ** 190)
    text = formula(expression)
    value = numpy_value(text, {"a": 0.3, "x": 0.7})
    assert value == pytest.approx(float(expression.subs({a: sp.Rational(3, 10), x: sp.Rational(7, 10)})), rel=1e-14)


def test_a_formula_too_long_or_too_deep_is_not_told() -> None:
    deep = a
    for k in range(60):
        deep = sp.sin(x) * (deep + k) + x
    assert readable(a * x + 1) == "a*x + 1"
    assert readable(deep) is None
    assert readable(sp.Add(*(sp.Symbol(f"s{k}") * a**k for k in range(3000)))) is None


KIWI = [wheel(f"w{k}", at=(f"a*cos({t})", f"a*sin({t})"), heading=f"{t} + pi/2", roller_angle="0.785398")
        for k, t in enumerate(("0", "2.094395", "-2.094395"))]  # fmt: skip


def test_rollers_with_decimal_angles_are_derived_in_seconds(tmp_path: Path) -> None:
    """A process of its own, because before this the derivation never ended."""
    path = tmp_path / "kiwi.toml"
    path.write_text(robot(*KIWI, *(motor(f"w{k}") for k in range(3)), outputs={"X": "x", "Y": "y", "P": "phi"}))
    command = [sys.executable, "-m", "derive", str(path), "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=SECONDS)
    assert done.returncode == 0, done.stderr
    model = lawful_model(tmp_path / "small")
    p = model.parameters()
    rates = model.actuator_rates_matrix([0, 0, 0], p)
    expected = [
        [cos(h + r) / (p[0] * cos(r)), sin(h + r) / (p[0] * cos(r)), p[1] / p[0]]
        for h, r in ((t + np.pi / 2, 0.785398) for t in (0.0, 2.094395, -2.094395))
    ]
    np.testing.assert_allclose(rates, expected, rtol=1e-14, atol=1e-14)


def test_decimals_in_joints_outputs_and_headings(tmp_path: Path) -> None:
    parts = (
        steered("fork", ("a", "0"), "beta + 0.3"),
        wheel("rear", heading="0"),
        wheel("front", "fork", heading="-0.3"),
    )
    outputs = {"y1": "x + a*cos(phi) + L*cos(phi + beta + 0.25)", "y2": "y + a*sin(phi) + L*sin(phi + beta + 0.25)"}
    text = robot(*parts, motor("rear"), motor("fork"), angles=("beta",), outputs=outputs)
    model = lawful_model(derived(text, tmp_path))
    q, p = np.array([0.1, -0.2, 0.4, 0.15]), model.parameters()
    expected = [q[0] + 0.3 * cos(0.4) + 0.4 * cos(0.8), q[1] + 0.3 * sin(0.4) + 0.4 * sin(0.8)]
    np.testing.assert_allclose(model.output(q, model.known(p)), expected, rtol=1e-14)
    row = model.constraint_matrix(q, p)[1]
    np.testing.assert_allclose(row[:2], [-sin(0.55), cos(0.55)], rtol=1e-14)  # beta + 0.3 - 0.3
