"""The examples run as their pages say."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.conftest import ROOT


def test_the_loop_in_python_follows_its_planner_and_stops_when_it_falls_silent(tmp_path: Path) -> None:
    """In real time; the log holds every sample with its numbers by name."""
    program = ROOT / "examples/python_loop/loop.py"
    log = tmp_path / "log.csv"
    done = subprocess.run(
        [sys.executable, program, "--seconds", "1.5", "--log", log],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert "stopped" in done.stdout
    with log.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:9] == ["t", "x", "y", "phi", "v", "omega", "u_r", "u_l", "e1"]
    times = np.array([float(row["t"]) for row in rows])
    assert np.all(np.diff(times) > 0.0)
    assert {row["state"] for row in rows} >= {"fresh", "holding", "stopping", "stopped"}
    assert abs(float(rows[-1]["v"])) < 0.05
    assert max(abs(float(row[name])) for row in rows for name in ("u_r", "u_l")) < 24.0
