"""The model that is meant is the one that is loaded, and its code is the one that was derived with its metadata."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import wmr_afl
from derive.codegen.write import Files, generate, write
from tests.conftest import DESCRIPTIONS, EXPERIMENTS, ROOT
from tests.wmr_afl.model.sealing import sealed
from wmr_afl import InputError, UnknownNameError, load_model
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.model.packages import shipped_models

TROUBLE = "raise SystemExit('the code of a folder that nobody meant')\n"


@pytest.fixture(scope="module")
def look_ahead(tmp_path_factory: pytest.TempPathFactory) -> list[Files]:
    """The files of one robot whose output lies 2 L ahead, then 3 L: of the same sizes, as code is."""
    text, folder = DESCRIPTIONS["type_2_0"].read_text(), tmp_path_factory.mktemp("descriptions")
    found = []
    for factor in (2, 3):
        path = folder / f"{factor}.toml"
        path.write_text(text.replace("+ L*cos(phi)", f"+ {factor}*L*cos(phi)").replace("+ L*sin", f"+ {factor}*L*sin"))
        found.append(generate([path], lambda path: lambda step: None))
    return found


def ahead(folder: Path, backend: str = "numpy") -> float:
    model = load_model(folder, backend)
    return round(float(model.output([0.0, 0.0, 0.0], model.known(model.parameters()))[0]), 12)


def test_a_robot_derived_again_within_a_second_runs_its_new_code(look_ahead: list[Files], tmp_path: Path) -> None:
    for _ in range(5):
        for files, expected in zip(look_ahead, (0.2, 0.3), strict=True):
            write(files, tmp_path)
            assert [ahead(tmp_path / "type_2_0", library) for library in ("numpy", "casadi")] == [expected] * 2


def test_what_python_has_compiled_is_not_run(look_ahead: list[Files], tmp_path: Path) -> None:
    """Code written into the file within a second, of the same size, as an editor may do it."""
    write(look_ahead[0], tmp_path)
    folder = tmp_path / "type_2_0"
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
    script = f"import sys; sys.path.insert(0, {str(folder)!r}); import numpy_model"
    subprocess.run([sys.executable, "-c", script], env=environment, check=True)
    file = folder / "numpy_model.py"
    before = file.stat()
    file.write_text(look_ahead[1]["type_2_0/numpy_model.py"])
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert ahead(sealed(folder)) == 0.3


@pytest.mark.parametrize("file", ["numpy_model.py", "casadi_model.py", "trusted_values.json", "model.json"])
def test_a_mixture_of_two_derivations_is_refused(look_ahead: list[Files], tmp_path: Path, file: str) -> None:
    write(look_ahead[0], tmp_path)
    folder = tmp_path / "type_2_0"
    (folder / file).write_text(look_ahead[1][f"type_2_0/{file}"])
    with pytest.raises(InputError, match=r"is not the one that was derived; derive the robot again") as caught:
        load_model(folder, "casadi" if "casadi" in file else "numpy").trusted_values()
    assert "\n" not in str(caught.value)


def test_a_model_in_memory_is_never_mixed_with_one_derived_later(look_ahead: list[Files], tmp_path: Path) -> None:
    write(look_ahead[0], tmp_path)
    model = load_model(tmp_path / "type_2_0")
    write(look_ahead[1], tmp_path)
    with pytest.raises(InputError, match="holds another model than when it was loaded; load it again"):
        model.in_library("casadi")
    with pytest.raises(InputError, match="not the one that was derived"):
        model.trusted_values()


def test_an_experiment_follows_its_model_when_that_is_derived_again(look_ahead: list[Files], tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 0.1")
    (tmp_path / "mine.toml").write_text(text.replace('robot = "type_2_0"', 'robot = "./type_2_0"'))
    for files, expected in zip(look_ahead * 2, (0.2, 0.3) * 2, strict=True):
        write(files, tmp_path)
        run = wmr_afl.run(tmp_path / "mine.toml", controllers="AFL")["AFL"]
        assert run.output[0, 0] - run.state[0, 0] == pytest.approx(expected)


def test_what_a_user_keeps_in_a_models_folder_stays(look_ahead: list[Files], tmp_path: Path) -> None:
    write(look_ahead[0], tmp_path)
    (tmp_path / "type_2_0" / "notes.md").write_text("mine")
    write(look_ahead[1], tmp_path)
    assert (tmp_path / "type_2_0" / "notes.md").read_text() == "mine"
    assert json.loads((tmp_path / "type_2_0" / "model.json").read_text())["name"] == "type_2_0"


@pytest.fixture
def crowded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a model and experiments that are called as shipped ones, and one that is not."""
    for name in ("type_2_0", "mine"):
        shutil.copytree(shipped_models() / "type_2_0", tmp_path / name)
        for file in ("numpy_model.py", "casadi_model.py"):
            (tmp_path / name / file).write_text(TROUBLE)
        sealed(tmp_path / name)
    for name in ("study_1", "my_study", "other.toml"):
        (tmp_path / name).write_text("this is no experiment")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_shipped_name_means_what_is_shipped(crowded: Path) -> None:
    assert load_model("type_2_0").folder == shipped_models() / "type_2_0"
    assert find_experiment("study_1") == EXPERIMENTS / "study_1.toml"
    assert wmr_afl.run_batch("study_1", start={"x": [15.0]}).failed.tolist() == [False]


def test_a_model_beside_an_experiment_does_not_stand_in_for_a_shipped_one(crowded: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 0.1")
    (crowded / "short.toml").write_text(text)
    assert wmr_afl.run("short.toml")["AFL"].model.folder == shipped_models() / "type_2_0"


def test_a_path_means_the_folder_or_file_there(crowded: Path) -> None:
    for path in ("./type_2_0", crowded / "type_2_0", Path("type_2_0"), f"type_2_0{os.sep}"):
        with pytest.raises(SystemExit, match="nobody meant"):
            load_model(path)
    for path in ("./study_1", crowded / "study_1", Path("study_1")):
        assert find_experiment(path) == Path(path)
    shutil.copy(crowded / "other.toml", crowded / "study_1.toml")
    assert find_experiment("study_1.toml") == Path("study_1.toml")


def test_a_name_that_is_neither_says_how_to_write_the_path(crowded: Path) -> None:
    for find, name, words in (
        (load_model, "mine", "unknown model or model folder 'mine'; write ./mine for the folder here"),
        (find_experiment, "my_study", "unknown experiment 'my_study'; write ./my_study for the file here"),
        (find_experiment, "other", "unknown experiment 'other'; write other.toml for the file here"),
    ):
        with pytest.raises(UnknownNameError) as caught:
            find(name)
        assert str(caught.value).startswith(words)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b", "a\nb", "", ".", "..", "/" * 5000])
def test_a_name_of_any_kind_ends_in_one_line(name: str, tmp_path: Path) -> None:
    file = tmp_path / "odd.toml"
    text = (EXPERIMENTS / "study_1.toml").read_text()
    file.write_text(text.replace('robot = "type_2_0"', f"robot = {json.dumps(name).replace(chr(127), '')}"))
    for act in (load_model, find_experiment, wmr_afl.run, lambda _: wmr_afl.run(file)):
        with pytest.raises((UnknownNameError, InputError)) as caught:
            act(name)
        assert len(str(caught.value)) < 1000
        assert "\n" not in str(caught.value)


def test_the_working_directory_of_the_command_line_is_no_place_of_models(crowded: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "wmr_afl", "show", "type_2_0"],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
