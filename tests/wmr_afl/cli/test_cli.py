"""The command line does what it says, or ends in one line if it cannot."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import DESCRIPTIONS, EXPERIMENTS, ROBOTS, ROOT
from tests.wmr_afl.model.sealing import sealed
from wmr_afl.analysis.paper.figures import FIGURES
from wmr_afl.cli.show import loop_text
from wmr_afl.experiments.load import load_experiment


def run(*arguments: object, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "wmr_afl", *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, "COLUMNS": "200", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "verb",
    [
        [],
        ["models"],
        ["show"],
        ["derive"],
        ["check"],
        ["check-reference"],
        ["animate"],
        ["simulate"],
        ["reproduce"],
        ["campaign"],
    ],
)
def test_help_shows_a_newcomer_what_there_is(verb: list[str]) -> None:
    done = run(*verb, "--help")
    assert done.returncode == 0
    assert "Usage: wmr-afl" in done.stdout


def test_a_loop_is_described_and_its_text_is_what_is_built() -> None:
    described = run("show", "study_2", "--loop", "--controller", "robust AFL")
    assert described.returncode == 0, described.stderr
    assert "a_hat (2)" in described.stdout
    lines = int(re.search(r"(\d+) lines for each step and robot", described.stdout)[1])
    operations = int(re.search(r"operations of a step +(\d+)", described.stdout)[1])
    assert 0.5 * operations < lines < operations
    text = run("show", "study_2", "--code", "--controller", "robust AFL").stdout
    loaded = load_experiment("study_2")
    assert text.strip() == loop_text(loaded.loops["robust AFL"]).strip()
    wrong = run("show", "study_2", "--loop", "--controller", "PID")
    assert (wrong.returncode, len(wrong.stderr.splitlines())) == (2, 1)


def test_the_version_is_printed() -> None:
    assert run("--version").stdout.startswith("wmr-afl ")


def test_what_looks_like_markup_is_printed_as_it_stands(tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text()
    text = text.replace("duration = 140.0", "duration = 1.0").replace(
        "[controllers.AFL]", '[controllers."[/red] $a_{"]'
    )
    (tmp_path / "odd.toml").write_text(text.replace('title = "Study 1', 'title = "[bold] $x_{ 1'))
    done = run("simulate", tmp_path / "odd.toml", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "[bold] $x_{ 1" in done.stdout
    assert "[/red] $a_{" in done.stdout


def test_models_lists_the_catalogue() -> None:
    out = run("models").stdout
    for name in [*ROBOTS, "study_1"]:
        assert name in out


def test_show_prints_what_was_found() -> None:
    out = run("show", "type_2_0").stdout
    for word in ("theta6", "2*K2/(r**2*(m_C + 2*m_w))", "completely nonholonomic", "-2*L*theta5*theta6", "look-ahead"):
        assert word in out


def test_check_runs_the_laws_on_a_folder_and_fails_where_one_is_broken(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "generated" / "type_1_1", tmp_path / "mine")
    done = run("check", tmp_path / "mine")
    assert done.returncode == 0, done.stdout
    assert "skew" in done.stdout
    module = tmp_path / "mine" / "numpy_model.py"
    module.write_text(module.read_text().replace("term_1 = ", "term_1 = 1.001*", 1))
    done = run("check", tmp_path / "mine")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "numpy_model.py: is not the one that was derived; derive the robot again" in done.stderr
    done = run("check", sealed(tmp_path / "mine"))
    assert done.returncode == 1
    assert "BROKEN" in done.stdout


def test_simulate_writes_samples_metrics_and_figures(tmp_path: Path) -> None:
    short = tmp_path / "short.toml"
    text = (EXPERIMENTS / "study_1.toml").read_text()
    short.write_text(text.replace("duration = 140.0", "duration = 2.0"))
    done = run("simulate", short, "--out", tmp_path, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "short"
    table = np.genfromtxt(folder / "AFL.csv", delimiter=",", names=True)
    assert table.shape == (101,)
    assert table.dtype.names[:6] == ("time_s", "x_m", "y_m", "phi_rad", "v_ms", "omega_rads")
    found = json.loads((folder / "metrics.json").read_text())
    assert set(found) == {"AFL", "frozen estimates"}
    assert found["AFL"]["samples"] == 101
    pictures = {"path", "errors", "inputs", "estimates_AFL"}
    assert {path.stem for path in folder.glob("*.png")} == pictures == {path.stem for path in folder.glob("*.svg")}


def test_a_failed_run_is_reported_and_keeps_its_samples(tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text()
    wild = tmp_path / "wild.toml"
    wild.write_text(text.replace("lower = 0.1", "lower = 1e-14").replace("duration = 140.0", "duration = 2.0"))
    done = run("simulate", wild, "--out", tmp_path)
    assert done.returncode == 1
    assert "singular" in done.stdout
    assert (tmp_path / "wild" / "AFL.csv").stat().st_size > 1000
    assert "singular" in json.loads((tmp_path / "wild" / "metrics.json").read_text())["AFL"]["failure"]


def test_reproduce_draws_the_figure_that_is_named(tmp_path: Path) -> None:
    done = run("reproduce", "fig5", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "fig5.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "fig4.png").exists()


def test_figures_are_the_same_bytes_every_time(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        run("reproduce", "fig4", "--out", tmp_path / folder)
    for ending in ("png", "svg"):
        first, second = ((tmp_path / folder / f"fig4.{ending}").read_bytes() for folder in ("one", "two"))
        assert first == second


def test_derive_is_the_derivation(tmp_path: Path) -> None:
    done = run("derive", DESCRIPTIONS["type_2_0"], "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert run("show", tmp_path / "type_2_0").returncode == 0


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["show", "type_9"], "type_2_0"),
        (["simulate", "study_9"], "study_1"),
        (["simulate", "study_1", "--backend", "abacus"], "numpy"),
        (["simulate", "study_1", "--controller", "PID"], "AFL"),
        (["reproduce", "fig99"], next(iter(FIGURES))),
        (["simulate", "nowhere.toml"], "no such file"),
        (["derive", "nowhere.toml", "--out", "unused"], "no such file"),
    ],
)
def test_what_there_is_not_ends_in_one_line_and_status_2(arguments: list[str], word: str, tmp_path: Path) -> None:
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith("deriving")]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    assert word in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = run("reproduce", "fig5", "--out", tmp_path / "file")
    assert done.returncode == 2
    assert "cannot be written" in done.stderr
