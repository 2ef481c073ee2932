"""Result files: numbers to the bit, columns with units, nothing left of other runs, nothing half written."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from tests.wmr_afl.cli.test_cli import run as command
from wmr_afl import WmrError
from wmr_afl.analysis import files as files_module
from wmr_afl.analysis import plots
from wmr_afl.analysis.files import columns, keep_only, write_results
from wmr_afl.simulation.result import Run

STUDY_1 = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 2.0")
UTM = (
    STUDY_1.replace("x = 15.0", "x = 500015.0", 1)
    .replace("y = 25.0", "y = 4000025.0", 1)
    .replace("center = [10.0, 25.0]", "center = [500010.0, 4000025.0]")
)


@pytest.fixture
def runs(tmp_path: Path) -> dict[str, Run]:
    """Study 1 at a place that is given in UTM coordinates: millimetres are the tenth digit."""
    (tmp_path / "utm.toml").write_text(UTM)
    return wmr_afl.run(tmp_path / "utm.toml")


def table(file: Path) -> tuple[list[str], np.ndarray]:
    with open(file, newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, dtype=float)


def test_samples_are_read_back_to_the_bit(runs: dict[str, Run], tmp_path: Path) -> None:
    write_results(runs, tmp_path / "out")
    run = runs["AFL"]
    header, numbers = table(tmp_path / "out" / "AFL.csv")
    expected = (run.time[:, None], run.state, run.input, run.command, run.reference, run.error, run.estimate)
    np.testing.assert_array_equal(numbers, np.hstack(expected))
    assert header == columns(run)
    assert header[:8] == ["time [s]", "x [m]", "y [m]", "phi [rad]", "v [m/s]", "omega [rad/s]", "u_r [V]", "u_l [V]"]
    assert header[8:12] == ["command_u_r [V]", "command_u_l [V]", "reference_y1 [m]", "reference_y2 [m]"]
    assert header[12:15] == ["error_y1 [m]", "error_y2 [m]", "estimate_theta1 [1/s]"]


def test_a_speed_from_differences_of_written_positions_is_smooth(runs: dict[str, Run], tmp_path: Path) -> None:
    """Ten digits of a northing are steps of a millimetre: 5 cm/s at samples of 20 ms."""
    write_results(runs, tmp_path / "out")
    _, numbers = table(tmp_path / "out" / "AFL.csv")
    speed, true = (
        np.diff(y) / np.diff(t) for t, y in (numbers[:, [0, 2]].T, (runs["AFL"].time, runs["AFL"].state[:, 1]))
    )
    assert np.max(np.abs(speed - true)) < 1e-9


def test_what_another_controller_left_is_removed_and_what_a_user_keeps_is_not(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(STUDY_1)
    folder = tmp_path / "short"
    assert command("simulate", tmp_path / "short.toml", "--out", tmp_path).returncode == 0
    (folder / "notes.txt").write_text("mine")
    frozen = folder / "frozen_estimates.csv"
    assert frozen.exists()
    assert command("simulate", tmp_path / "short.toml", "--out", tmp_path, "--controller", "AFL").returncode == 0
    assert not frozen.exists()
    assert (folder / "notes.txt").read_text() == "mine"
    assert list(json.loads((folder / "metrics.json").read_text())) == ["AFL"]
    command("simulate", tmp_path / "short.toml", "--out", tmp_path)
    frozen.write_text("edited by hand")
    command("simulate", tmp_path / "short.toml", "--out", tmp_path, "--controller", "AFL")
    assert frozen.read_text() == "edited by hand"
    names = {path.stem for path in folder.iterdir()}
    assert names == {
        "AFL", "frozen_estimates", "metrics", "written", "notes", "path", "errors", "inputs", "estimates_AFL",
    }  # fmt: skip


@pytest.mark.parametrize(
    "note", ["", "[]", '{"sha256": 3}', '{"sha256": {"../precious.txt": "0"}}', "[" * 100_000, '{"sha256": {"a": {}}}']
)
def test_a_damaged_note_removes_nothing(runs: dict[str, Run], tmp_path: Path, note: str) -> None:
    (tmp_path / "precious.txt").write_text("precious")
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "written.json").write_text(note)
    keep_only(write_results(runs, folder), folder)
    assert (tmp_path / "precious.txt").read_text() == "precious"
    assert len(json.loads((folder / "written.json").read_text())["sha256"]) == 3


def test_a_full_disk_leaves_the_results_that_were_there(
    runs: dict[str, Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "out"
    files = write_results(runs, folder)
    files += plots.save(plots.overview(runs, "a title")["errors"], folder / "errors")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wmr_input.whole_files.os.fsync", full)
    for act in (
        lambda: write_results(runs, folder),
        lambda: keep_only(files, folder),
        lambda: plots.save(plots.overview(runs, "another title")["errors"], folder / "errors"),
    ):
        with pytest.raises(WmrError, match=r"cannot be written \(No space left on device\)"):
            act()
    names = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert names == before


def test_samples_of_a_link_are_not_written_through(runs: dict[str, Run], tmp_path: Path) -> None:
    (tmp_path / "precious.csv").write_text("precious")
    (tmp_path / "AFL.csv").symlink_to(tmp_path / "precious.csv")
    write_results(runs, tmp_path)
    assert (tmp_path / "precious.csv").read_text() == "precious"


def test_many_samples_are_written_in_parts(runs: dict[str, Run], tmp_path: Path, monkeypatch) -> None:
    write_results(runs, tmp_path / "whole")
    monkeypatch.setattr(files_module, "SAMPLES", 7)
    write_results(runs, tmp_path / "parts")
    assert (tmp_path / "whole" / "AFL.csv").read_bytes() == (tmp_path / "parts" / "AFL.csv").read_bytes()
