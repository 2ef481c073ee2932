"""Voltages to play, as a file and on a robot; logs from the command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from wmr_afl import WmrError, load_model
from wmr_afl.cli import app
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.log_file import read_log
from wmr_afl.identification.recording import Sensors, record
from wmr_afl.identification.voltages import Loop, Voltages, read_voltages

CAR = load_model("car")
TIME = 0.05 * np.arange(60)
PLAYED = Voltages(
    TIME,
    np.column_stack([6.0 + np.sin(TIME), np.zeros(60)]),
    (Loop(1, 3, np.full(60, 25.0), 0.2 * np.sin(TIME)),),
)


def test_voltages_are_held_from_row_to_row() -> None:
    """With what the loop adds at the angle that is now; the last row stays."""
    x = np.zeros(6)
    x[3] = 0.1
    for t, row in ((0.0, 0), (0.049, 0), (0.05, 1), (1.02, 20), (99.0, 59)):
        expected = PLAYED.u[row] + [0.0, 25.0 * (0.2 * np.sin(TIME[row]) - 0.1)]
        np.testing.assert_allclose(PLAYED(t, x), expected, rtol=1e-12)


def test_a_file_of_voltages_is_read_back(tmp_path: Path) -> None:
    """To the bit."""
    (tmp_path / "voltages.csv").write_text(PLAYED.text(CAR))
    again = read_voltages(CAR, tmp_path / "voltages.csv")
    np.testing.assert_array_equal(again.time, PLAYED.time)
    np.testing.assert_array_equal(again.u, PLAYED.u)
    (one,), (other,) = again.loops, PLAYED.loops
    assert (one.motor, one.coordinate) == (other.motor, other.coordinate)
    np.testing.assert_array_equal(one.reference, other.reference)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t,u_drive\n0,1\n1,1\n", "column u_steer: is missing"),
        ("t,u_drive,u_steer,odd\n0,1,1,1\n1,1,1,1\n", "column odd: is unknown"),
        ("t,u_drive,u_steer,gain:u_steer:beta\n0,1,1,1\n1,1,1,1\n", "column angle_reference:beta: is missing"),
        ("t,u_drive,u_steer\n0,1,1\n", "fewer than two rows"),
        ("t,u_drive,u_steer\n0,1,1\n0,1,1\n", "line 3: time does not go on"),
        ("t,u_drive,u_steer\n0,1,x\n1,1,1\n", "line 2, column u_steer: holds 'x'"),
    ],
)
def test_a_wrong_file_of_voltages_is_told(text: str, told: str, tmp_path: Path) -> None:
    """In one line: where, what, and what would be right."""
    (tmp_path / "voltages.csv").write_text(text)
    with pytest.raises(WmrError) as error:
        read_voltages(CAR, tmp_path / "voltages.csv")
    assert told in str(error.value)


def test_a_loop_holds_the_angle() -> None:
    """The robot of an experiment steers as the reference says."""
    log = record("track_car", commands=PLAYED)
    segment = log.segments[0]
    assert segment.time[-1] == pytest.approx(TIME[-1], abs=0.06)
    beta = segment.z[:, [one.name for one in log.channels].index("beta")]
    wanted = np.interp(segment.time, TIME, 0.2 * np.sin(TIME))
    assert np.abs(beta - wanted)[len(beta) // 2 :].max() < 0.08


def test_a_log_is_recorded_from_the_command_line(tmp_path: Path) -> None:
    """With the sensors as named; a second time the same bytes; a wrong one in one line, and no file."""
    options = ["record", "track_type_2_0", "--seconds", "2", "--encoder", "512", "--gyro", "0", "--seed", "3"]
    for name in ("one.csv", "two.csv"):
        done = CliRunner().invoke(app, [*options, "--out", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()
    log = read_log(load_model("type_2_0"), tmp_path / "one.csv")
    assert [one.name for one in log.channels] == ["angle:u_r", "angle:u_l", "rate:phi"]
    steps = log.segments[0].z[:, 0] / (2.0 * np.pi / 512.0)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    for wrong, told in (
        (["--measured", "angle:odd"], "unknown column 'angle:odd'"),
        (
            ["--measured", "u_r"],
            "unknown column 'u_r'; it is a voltage; did you mean 'angle:u_r'? (there is",
        ),
        (["--encoder", "-1"], "encoder is -1"),
        (["--every", "0"], "a row every 0 samples"),
        (["--seconds", "0"], "has 0 samples"),
        (["--voltages", str(tmp_path / "none.csv")], "cannot be read"),
    ):
        done = CliRunner().invoke(app, [*options, *wrong, "--out", str(tmp_path / "wrong.csv")])
        assert done.exit_code == 2, done.output
        assert done.output.count("\n") == 1
        assert told in done.output
        assert not (tmp_path / "wrong.csv").exists()


def test_a_recorded_robot_is_integrated_exactly_whatever_the_experiment_says() -> None:
    """Euler's method, by which the paper's studies go, is no robot's; SciPy's is the witness."""
    loop = load_experiment("study_1").loops["AFL"]
    model, p, u = loop.model.in_library("numpy"), loop.plant.parameters, np.array([3.0, 5.0])
    sensors = Sensors(encoder=0.0, joint=0.0, gyro=0.0, measured=("x", "y", "phi", "angle:u_r"))
    (segment,) = record("study_1", commands=lambda t, x: u, seconds=1.0, sensors=sensors).segments
    exact = solve_ivp(
        lambda t, x: model.state_derivative(x, u, np.zeros(2), p),
        (0.0, 1.0), loop.plant.start, t_eval=segment.time, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(segment.z[:, :3], exact.y[:3].T, atol=1e-6)
