"""The command with a mistake in a description: exit status 2, no file written or changed."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.conftest import DESCRIPTIONS, ROOT
from wmr_afl.model.model import load_model

GOOD = DESCRIPTIONS["type_2_0"].read_text()


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "derive", *map(str, arguments)], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_the_command_ends_with_2_and_writes_nothing(tmp_path: Path) -> None:
    """Also the good robot beside the bad one is not written."""
    bad = tmp_path / "bad.toml"
    bad.write_text(GOOD.replace('"type_2_0"', '"bad"', 1).replace('heading = "phi"', 'heading = "phii"', 1))
    out = tmp_path / "out"
    done = run(DESCRIPTIONS["type_2_0"], bad, "--out", out)
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if not line.startswith("deriving")]
    assert errors == [f"error: {bad}: [[frames]] 'platform' heading: unknown name 'phii'; did you mean 'phi'?"]
    assert not out.exists()


def test_an_earlier_result_is_left_as_it_was(tmp_path: Path) -> None:
    good, out = tmp_path / "robot.toml", tmp_path / "out"
    good.write_text(GOOD)
    assert run(good, "--out", out).returncode == 0
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    good.write_text(GOOD.replace('heading = "phi"', 'heading = "phii"', 1))
    assert run(good, "--out", out).returncode == 2
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_two_robots_of_one_name_are_refused(tmp_path: Path) -> None:
    twin = tmp_path / "twin.toml"
    twin.write_text(GOOD)
    done = run(DESCRIPTIONS["type_2_0"], twin, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "twin.toml: name: 'type_2_0' is the name of" in done.stderr


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file, not a folder")
    done = run(DESCRIPTIONS["type_2_0"], "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "cannot be written" in done.stderr
    assert "Traceback" not in done.stderr


def test_names_and_titles_that_generated_code_would_trip_over(tmp_path: Path) -> None:
    """Inputs named as the generator names its own terms, and a title that would end a docstring."""
    path = tmp_path / "robot.toml"
    title = 'title = \'a """ b \\ {{ c }}\''
    text = GOOD.replace('"u_r"', '"cos_phi"').replace('"u_l"', '"theta1"').replace('"type_2_0"', '"odd"')
    path.write_text(text.replace('title = "Differential drive, type (2,0)"', title))
    done = run(path, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    odd, plain = load_model(tmp_path / "odd"), load_model("type_2_0")
    assert odd.title == 'a """ b \\ {{ c }}'
    x, u, w, p = np.arange(5.0), np.array([1.0, 2.0]), np.zeros(2), plain.parameters()
    np.testing.assert_array_equal(odd.state_derivative(x, u, w, p), plain.state_derivative(x, u, w, p))
