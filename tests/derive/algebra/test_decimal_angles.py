"""Robots whose angles are written as decimals are derived in seconds and obey every law."""

from __future__ import annotations

import subprocess
import sys
from math import cos, sin
from pathlib import Path

import numpy as np

from tests.conftest import ROOT
from tests.derive.descriptions import derived, lawful_model, motor, robot, steered, wheel

SECONDS = 60  # what used to run for minutes takes a few

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
