"""The derivation as a whole: its steps, what it asks of defaults and motors, and the command around it."""

from __future__ import annotations

import runpy
import shutil
import sys
from pathlib import Path

import pytest
import sympy as sp
from typer.testing import CliRunner

from derive.__main__ import app
from derive.codegen.write import differences
from derive.derivation import _rank_at, derive_robot
from tests.conftest import DESCRIPTIONS, ROOT
from tests.derive.descriptions import AHEAD, derivation_of, motor, part, robot, wheel
from wmr_input import InputError

AXLE = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")))
MOTORS = (motor("left"), motor("right"))
SMALL = robot(*AXLE, *MOTORS, outputs=AHEAD)
STEPS = ["description", "kinematics", "mobility", "dynamics", "linearization", "base parameters"]


def write(text: str, folder: Path) -> Path:
    path = folder / "small.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("has_outputs", [True, False])
def test_every_step_is_told_in_order(has_outputs: bool, tmp_path: Path) -> None:
    """With outputs there are two more."""
    steps: list[str] = []
    path = write(SMALL if has_outputs else robot(*AXLE, *MOTORS), tmp_path)
    derivation = derive_robot(path, steps.append)
    assert steps == [*STEPS, *(["decoupling matrix", "internal dynamics"] if has_outputs else [])]
    assert (derivation.control is not None) == has_outputs
    assert derivation.missed == {}


@pytest.mark.parametrize(
    ("text", "known"),
    [
        (SMALL, "L"),
        (robot(*AXLE, *MOTORS), ""),
        (SMALL.replace("\n[coordinates]", 'known = ["r", "m"]\n\n[coordinates]', 1), "r L m"),
        (robot(wheel("w", at=("e", "0")), motor("w")), "e"),
    ],
    ids=["in an output", "none", "listed", "in the motion"],
)
def test_known_are_parameters_that_outputs_and_motion_contain_and_those_that_are_listed(text: str, known: str) -> None:
    """In the order of p; all others are uncertain."""
    derivation = derivation_of(text)
    assert [symbol.name for symbol in derivation.known] == known.split()
    assert derivation.parameters.known == frozenset(derivation.known)
    assert derivation.parameters.uncertain == frozenset(derivation.robot.parameters) - derivation.parameters.known
    assert derivation.parameters.all == frozenset(derivation.robot.parameters)
    assert derivation.state == (*derivation.kinematics.q, *derivation.kinematics.v)
    assert len(derivation.state_derivative) == len(derivation.state)


def at(text: str, **defaults: float) -> str:
    """The description with other values of parameters."""
    for name, value in defaults.items():
        begin, end = text.split(f"\n{name} = {{ value = ", 1)
        text = f"{begin}\n{name} = {{ value = {value},{end.split(',', 1)[1]}"
    return text


DEGENERATE = {
    "no look-ahead": (
        at(SMALL, L=0.0),
        "[outputs]: with the default parameters the decoupling matrix is singular everywhere; "
        "change the defaults; zero is the value of L",
    ),
    "no mass": (
        at(SMALL, m=0.0, I=0.0, J_w=0.0),
        "[[bodies]]: with the default parameters some motion has no inertia; "
        "change the defaults; zero is the value of m, I, J_w",
    ),
    "wheels at one place": (
        at(SMALL, b=0.0, I=1.0),
        "[[motors]]: with the default parameters the motors do not reach every pseudo-velocity; "
        "change the defaults; zero is the value of b",
    ),
    "the same, the model alone": (
        at(robot(*AXLE, *MOTORS), b=0.0, I=1.0),
        "[parameters]: a base parameter of the dynamics is not finite with the default parameters; "
        "change the defaults; zero is the value of b",
    ),
    "an output without a value": (
        at(robot(*AXLE, *MOTORS, outputs=AHEAD | {"y1": "a*x/(a - e) + L*cos(phi)"}), a=1.0, e=1.0),
        "[outputs]: with the default parameters the decoupling matrix is singular everywhere; change the defaults",
    ),
}


@pytest.mark.parametrize("case", DEGENERATE)
def test_defaults_at_which_the_model_cannot_be_run_are_refused(case: str, tmp_path: Path) -> None:
    """With the parameters that are zero, if any are."""
    text, told = DEGENERATE[case]
    with pytest.raises(InputError) as caught:
        derive_robot(write(text, tmp_path))
    assert str(caught.value) == f"{tmp_path / 'small.toml'}: {told}"


a, b = sp.symbols("a b", real=True)


@pytest.mark.parametrize(
    ("matrix", "rank"),
    [
        (sp.Matrix([[a, 1], [1, b]]), 2),
        (sp.Matrix([[a, 1], [1, b / 4]]), 1),
        (sp.Matrix([[a - 2, 0], [0, b - 2]]), 0),
        (sp.Matrix([[sp.sqrt(a + b), 1], [0, a]]), 2),
        (sp.Matrix([[sp.sqrt(a + b / 1021), 1], [sp.sqrt(a + b / 1021) * a, a]]), 1),
        (sp.Matrix([[1 / (a - b)]]), 0),
    ],
    ids=str,
)
def test_a_rank_at_given_numbers_is_exact_or_that_of_many_digits(matrix: sp.Matrix, rank: int) -> None:
    """None where it has no value."""
    assert _rank_at(matrix, {a: sp.S(2), b: sp.S(2)}, derivation_of(SMALL).terms) == rank


FIXED = part("frames", name="mast", parent="body", at=["a", "0"], angle="pi/4")
STANDING = robot(*AXLE, FIXED, *MOTORS, motor("mast"))
CASES = {
    "a joint that is fixed": (STANDING, "[[motors]] 'u_mast' drives: drives 'mast', which never moves"),
    "a wheel about which all turns": (
        robot(wheel("across", heading="pi/2"), wheel("along", at=("0", "b")), motor("across"),
              v={"omega": "phi_dot"}),
        "[[motors]] 'u_across' drives: drives 'across', which never moves",
    ),
    "too few": (
        robot(*AXLE, motor("left"), outputs=AHEAD),
        "[[motors]]: 1 motors for 2 pseudo-velocities (body_forward, body_turning)",
    ),
    "two of one motion": (
        robot(*AXLE, motor("left"), motor("left").replace("u_left", "u_again"), outputs=AHEAD),
        "[[motors]]: the motors act on 1 of 2 pseudo-velocities only",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_motors_that_cannot_do_their_work_are_named(case: str, tmp_path: Path) -> None:
    text, told = CASES[case]
    with pytest.raises(InputError) as caught:
        derive_robot(write(text, tmp_path))
    assert told in str(caught.value)


ROBOT = "type_2_0"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files of one robot."""
    shutil.copytree(ROOT / "generated" / ROBOT, tmp_path / "out" / ROBOT)
    return tmp_path / "out"


def test_check_says_whether_a_folder_is_up_to_date(folder: Path) -> None:
    """And writes nothing: the difference stands in the output, all else beside it."""
    command = [str(DESCRIPTIONS[ROBOT]), "--out", str(folder), "--check"]
    done = CliRunner().invoke(app, command)
    assert (done.exit_code, done.stdout) == (0, "")
    said = " ".join(done.stderr.split())
    assert said.startswith(f"deriving {ROBOT}.toml")
    assert said.endswith("is up to date: 5 files")
    file = folder / ROBOT / "model.json"
    file.write_text(before := file.read_text().replace('"title"', '"titel"'))
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1
    assert '-  "titel"' in done.stdout
    assert "not up to date" not in done.stdout
    assert "is not up to date; run the same without --check" in " ".join(done.stderr.split())
    assert file.read_text() == before


@pytest.mark.parametrize("name", ["small/old_model.py", "gone/model.json", "notes.txt"])
@pytest.mark.parametrize("hidden", [".notes", "small/.swap", "small/__pycache__/model.pyc", ".git/info/exclude"])
def test_a_difference_is_what_is_missing_and_what_is_left_over_in_plain_sight(
    name: str, hidden: str, tmp_path: Path
) -> None:
    """Not what is hidden, or in a hidden folder, or compiled by Python."""
    for place in ("small/model.json", name, hidden):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_text("{}")
    is_left = f"left over: {tmp_path / name} is not generated from the robots named\n"
    assert differences({"small/model.json": "{}", name: "{}"}, tmp_path) == ""
    assert differences({"small/model.json": "{}"}, tmp_path) == is_left
    missing = f"missing: {tmp_path / 'z.py'}\n"
    assert differences({"small/model.json": "{}", "z.py": ""}, tmp_path) == is_left + missing


def test_the_command_writes_the_files_of_a_robot(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = CliRunner().invoke(app, [str(write(SMALL, tmp_path)), "--out", str(out)])
    assert (done.exit_code, done.stdout) == (0, "")
    assert len(list((out / "small").iterdir())) == 5
    assert "wrote 5 files below" in " ".join(done.stderr.split())


def test_the_command_ends_with_2_for_a_mistake(tmp_path: Path) -> None:
    """In one line each, and nothing is written."""
    out = tmp_path / "out"
    path = write(SMALL.replace('heading = "phi"', 'heading = "phii"'), tmp_path)
    done = CliRunner().invoke(app, [str(path), "--out", str(out)])
    assert (done.exit_code, done.stdout) == (2, "")
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert "unknown name 'phii'" in errors[0]
    assert not out.exists()


def test_the_command_without_sympy_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "derive.codegen.write", None)
    done = CliRunner().invoke(app, [str(write(SMALL, tmp_path)), "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert 'is not installed; pip install "wmr-afl[derive]"' in done.stderr


@pytest.mark.filterwarnings("ignore:.*found in sys.modules")
def test_the_package_is_run_as_its_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Under the name by which it is called, with its arguments."""
    monkeypatch.setattr(sys, "argv", ["derive", "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("derive", run_name="__main__")
    assert not ended.value.code
    assert "Usage: python -m derive " in capsys.readouterr().out
