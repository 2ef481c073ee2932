"""The files of an export, before any of them is compiled."""

import io
import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENTS
from wmr_afl import ArgumentError, Controller, UnknownNameError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard import cosimulation
from wmr_afl.onboard import export as module
from wmr_afl.onboard.export import _of_the_library, export, onboard, vectors


def exported(experiment: str | Path = "study_1", controller: str | None = "AFL", **options: Any) -> dict[str, str]:
    """The texts of two samples."""
    return {**export(experiment, controller, **{"is_unlimited": True, "samples": 2, **options})}  # type: ignore[dict-item]


@pytest.mark.parametrize("has_reference", [True, False])
@pytest.mark.parametrize("layout", ["cmake", "platformio"])
def test_which_files_there_are_follows_from_the_options(has_reference: bool, layout: str) -> None:
    """Names by the prefix; the reference and PlatformIO's file only if they are wanted."""
    files = exported(prefix="my", has_reference=has_reference, layout=layout)
    usual = {"my.h", "my.c", "my_buffer.h", "my_buffer.c", "main.c", "vectors.txt", "README.md", "CMakeLists.txt"}
    reference = {"my_reference.h", "my_reference.c"} if has_reference else set()
    assert set(files) == usual | reference | ({"library.json"} if layout == "platformio" else set())
    sources = [name for name in files if name.endswith(".c") and name != "main.c"]
    for text in (files["CMakeLists.txt"], files["README.md"]):
        assert set(re.findall(r"\bmy\w*\.c\b", text)) == set(sources)
    for name, text in files.items():
        assert "controller_" not in text, name
        for include in re.findall(r'#include "(\w+\.h)"', text):
            assert include in {*files, "measure.h"}


def test_what_platformio_wants_to_know_is_of_this_export() -> None:
    library = json.loads(exported(prefix="my", layout="platformio")["library.json"])
    assert (library["name"], library["headers"], library["license"]) == ("my", "my.h", "MIT")
    assert "AFL" in library["description"]
    assert load_experiment("study_1").loops["AFL"].model.title in library["description"]
    assert library["build"]["srcFilter"] == ["+<*.c>", "-<main.c>"]
    assert "-ffp-contract=off" in library["build"]["flags"]


@pytest.mark.parametrize("is_single", [False, True])
def test_a_replay_holds_what_python_was_given_and_gave(is_single: bool) -> None:
    """Rows of dt, x, yr, yr', yr'', u and states, read back to the bit; the first line counts them."""
    loop = load_experiment("study_1").loops["AFL"]
    sampled = onboard(loop)
    files = exported(samples=7, is_single=is_single)
    count, *rows = files["vectors.txt"].splitlines()
    assert int(count) == len(rows) == 7
    found = np.array([row.split() for row in rows], dtype=float)
    expected, tolerance = vectors(loop, sampled, 7, is_single)
    np.testing.assert_array_equal(found, expected)
    assert found.shape[1] == 1 + 5 + 3 * 2 + 2 + sampled.states.size
    assert f"{tolerance:.2g}" in files["README.md"]
    assert ("single" if is_single else "double") in files["README.md"].partition(" precision")[0]
    controller = Controller.from_experiment("study_1", "AFL", is_live=True)
    times = 0.02 * np.arange(7)
    for row, t in zip(found, times, strict=True):
        x, setpoint = row[1:6], row[6:12].reshape(3, 2)
        if not is_single:
            np.testing.assert_allclose(setpoint, [one[0] for one in loop.reference.over(np.array([t]))], rtol=1e-12)
        np.testing.assert_allclose(controller.update(t, x, tuple(setpoint)), row[12:14], rtol=1e-12)
        np.testing.assert_allclose(controller.states, row[14:], rtol=1e-12)
        assert row[0] == 0.02


def test_a_gate_is_exported_with_its_controller() -> None:
    """Its bound is one of the gains, and its states are states."""
    plain, gated = exported(is_tunable=True), exported(is_tunable=True, gate=0.25)
    assert "gate_bound" not in plain["controller.c"] + plain["controller.h"]
    assert re.search(r"\{ 0\.25 \}, /\* gate_bound \*/", gated["controller.c"])
    assert "CONTROLLER_Z_gate_y_0" in gated["controller.h"]
    assert exported(gate=0.5)["controller.c"] != exported(gate=0.25)["controller.c"]
    sampled = onboard(load_experiment("study_1").loops["AFL"], 0.25)
    assert sampled.gate is not None
    assert sampled.gate.bound.tolist() == [0.25]


@pytest.mark.parametrize("prefix", ["a", "A9_b", "my_robot"])
def test_a_prefix_is_a_name_in_c(prefix: str) -> None:
    """Letters first; no keyword, no sign, no letter of another alphabet."""
    assert f"{prefix}.h" in exported(prefix=prefix)
    for wrong in (
        f"9{prefix}",
        f"_{prefix}",
        f"{prefix}-",
        f"{prefix} ",
        f"é{prefix}",
        f"{prefix}\n",
        "",
        "int",
        "volatile",
    ):
        with pytest.raises(ArgumentError, match="is no name in C"):
            exported(prefix=wrong)


@pytest.mark.parametrize("samples", [0, -1, 1_000_001])
def test_one_sample_is_enough_to_replay_and_there_are_most(samples: int) -> None:
    with pytest.raises(ArgumentError, match=f"{samples} samples to replay; choose 1 to 1000000"):
        exported(samples=samples)
    assert exported(samples=1)["vectors.txt"].startswith("1\n")


def test_unless_told_otherwise_a_thousand_samples_are_replayed_in_double_precision() -> None:
    """With the experiment's reference, gains built in, and nothing for other simulators."""
    files = export("study_2")
    assert str(files["vectors.txt"]).splitlines()[0] == "1000"
    assert {name.partition("_")[0] for name in files if name.endswith(".c")} == {"controller", "controller.c", "main.c"}
    assert "typedef double controller_real;" in str(files["controller.h"])
    assert "controller_reference.c" in files
    assert "controller_gains" not in str(files["controller.h"])
    assert not [name for name in files if name.endswith(".fmu")]


@pytest.mark.parametrize(
    ("options", "words"), [({"layout": "maven"}, "unknown layout 'maven'"), ({"fmu": 4}, "unknown version of FMI '4'")]
)
def test_what_is_not_known_is_refused_before_anything_is_read(options: dict[str, Any], words: str) -> None:
    with pytest.raises(UnknownNameError, match=words):
        exported("no such experiment", **options)


def test_without_limits_one_has_to_say_so(tmp_path: Path) -> None:
    """Limits of commands or of the drive do; the README tells which there are."""
    with pytest.raises(WmrError, match="nothing limits the voltages of 'AFL'; add command_limits or input_limits"):
        exported(is_unlimited=False)
    assert "none. Whatever is computed goes to the motors" in exported()["README.md"]
    text = (EXPERIMENTS / "study_1.toml").read_text()
    for limits, told in (
        ("command_limits = { most = 9.0, least = -4.0 }", "command_limits.most = [9.0, 9.0] V, command_limits.least"),
        ("input_limits = { volts = 7.0 }", "input_limits.volts = [7.0, 7.0] V"),
    ):
        file = tmp_path / "limited.toml"
        file.write_text(text.replace("[shared]", f"[uncertainties]\n{limits}\n\n[shared]", 1))
        readme = exported(file, is_unlimited=False)["README.md"]
        assert told in readme
        assert "experiment limited" in readme
        assert "gains" not in readme.partition("Limits of the voltages:")[2].partition("\n")[0]


def test_a_folder_is_written_whole_and_only_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = export("study_1", "AFL", tmp_path / "a" / "b", is_unlimited=True, samples=1)
    assert {path.name: path.read_text() for path in (tmp_path / "a" / "b").iterdir()} == files
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    for there in (tmp_path / "a", tmp_path / "link"):
        with pytest.raises(WmrError, match="exists; choose the name of a new folder"):
            export("study_1", "AFL", there, is_unlimited=True, samples=1)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "write_folder", full)
    with pytest.raises(WmrError, match=r"c cannot be written .No space left on device.; choose another folder"):
        export("study_1", "AFL", tmp_path / "c", is_unlimited=True, samples=1)


def test_the_first_controller_is_exported_unless_one_is_named() -> None:
    first, other = exported(controller=None), exported(controller="frozen estimates")
    assert 'controller "AFL" of experiment study_1, written by wmr-afl' in first["controller.h"]
    assert 'controller "frozen estimates" of' in other["controller.h"]


@pytest.mark.parametrize(
    ("calls", "found"),
    [
        ([], set()), (["fabs", "my_helper"], {"fabs"}), (["sqrtf"], {"sqrtf"}), (["my_sincos_of"], {"fabs", "floor"}),
        (["my_exp_of", "sqrt"], {"floor", "ldexp", "sqrt"}),
    ],
)  # fmt: skip
def test_of_the_c_library_those_are_told_that_are_called(calls: list[str], found: set[str]) -> None:
    """Also by the project's own functions."""
    assert _of_the_library(calls) == found


def test_the_reference_in_c_is_one_of_time(tmp_path: Path) -> None:
    """In double precision whatever the law's; functions that it calls are told; a place at rest reads no time."""
    text, circle = (
        (EXPERIMENTS / "study_1.toml").read_text(),
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
    )
    assert circle in text
    found = {}
    for name, formulas in (("still", ("15", "25")), ("moves", ("15 + tanh(t)", "25*sqrt(1 + t)"))):
        table = 'expressions = {{ y1 = "{}", y2 = "{}" }}'.format(*formulas)
        (tmp_path / f"{name}.toml").write_text(text.replace(circle, table))
        found[name] = exported(tmp_path / f"{name}.toml", is_single=True)
    for name, files in found.items():
        code = files["controller_reference.c"]
        assert ("(void)t;" in code) == (name == "still")
        assert ("`tanh`" in files["README.md"], "`sqrt`" in files["README.md"]) == (name == "moves", name == "moves")
        for field in ("position", "velocity", "acceleration"):
            for i in (0, 1):
                assert f"setpoint->{field}[{i}] = " in code
        assert not re.search(r"\d\.\d+f\b", code.partition("void controller_reference(")[2])
    assert "setpoint->position[1] = (controller_real)(25.0);" in found["still"]["controller_reference.c"]


@pytest.mark.parametrize(("experiment", "name"), [("track_car", "composite"), ("track_mecanum", "AFL")])
def test_a_replay_in_single_precision_may_differ_by_what_rounded_inputs_make_many_times(
    experiment: str, name: str
) -> None:
    """Thirty times, of the largest size of each number; the inputs that are replayed are rounded already."""
    loop = load_experiment(experiment).loops[name]
    sampled = onboard(loop)
    (exact, none), (rounded, tolerance) = (vectors(loop, sampled, 80, is_single) for is_single in (False, True))
    inputs = 1 + len(sampled.measured) + 3 * len(loop.model.output_units)
    np.testing.assert_array_equal(rounded[:, 1:inputs], exact[:, 1:inputs].astype(np.float32))
    worst = 0.0
    for column in range(inputs, exact.shape[1]):
        size = max(abs(value) for value in exact[:, column])
        off = max(abs(a - b) for a, b in zip(exact[:, column], rounded[:, column], strict=True))
        worst = max(worst, off / size if size else off)
    assert none == 1e-12
    assert tolerance == pytest.approx(max(2e-5, 30.0 * worst), rel=1e-12)


@pytest.mark.parametrize("options", [{}, {"is_single": True, "is_tunable": True, "has_reference": False}])
def test_files_are_clean_texts(options: dict[str, Any]) -> None:
    """Each ends with one newline; no line ends with blanks, and templates leave no gaps and no marks of other texts."""
    for name, text in exported(**options).items():
        assert text.endswith("\n"), name
        assert not text.endswith("\n\n"), name
        assert not text.startswith("\n"), name
        assert all(line == line.rstrip() for line in text.split("\n")), name
        assert text.count("\n\n\n") <= 1, name  # between the functions of its own and the rest
        assert not re.search(r"&(amp|lt|gt|#\d+);|\{\{|\{%", text), name


@pytest.mark.parametrize("version", [2, 3])
def test_fmus_stand_beside_the_texts(version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of controller and robot, with the reference inside and the experiment's duration; the README tells of them."""
    monkeypatch.setattr(cosimulation, "binary", lambda name, text, version: {})
    files, plain = (
        export("study_1", "AFL", is_unlimited=True, samples=2, prefix="my", fmu=version),
        exported(prefix="my"),
    )
    assert set(files) - set(plain) == {"my.fmu", "my_plant.fmu"}
    assert {name: text for name, text in files.items() if name in plain and name != "README.md"} == {
        name: text for name, text in plain.items() if name != "README.md"
    }
    readme = str(files["README.md"])
    assert f"FMI {version}.0" in readme
    assert "`my_plant.fmu`" in readme
    assert "FMI" not in plain["README.md"]
    for name in ("my.fmu", "my_plant.fmu"):
        content = files[name]
        assert isinstance(content, bytes)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            assert ("sources/my_reference.c" in archive.namelist()) == (name == "my.fmu")
            description = archive.read("modelDescription.xml").decode()
        assert f'fmiVersion="{version}.0"' in description
        assert 'stopTime="140.0" stepSize="0.02"' in description
