"""One name on a user's machine: an installed wheel is `wmr_afl` and `wmr_input`, whatever else is called `derive`."""

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import DESCRIPTIONS, ROOT

TROUBLE = "raise RuntimeError('this is not the derivation of wmr-afl')\n"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=ROOT, check=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment that holds the wheel, and what it depends on by a path."""
    environment = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (packages,) = environment.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")  # its own .pth files are not read
    return environment / "bin" / "python"


@pytest.fixture
def crowded(python: Path, tmp_path: Path) -> Iterator[Path]:
    """A working directory with folders, files and installed distributions called `derive` and `generated`."""
    (packages,) = python.parents[1].glob("lib/python*/site-packages")
    for folder in (tmp_path, packages):
        for name in ("derive", "generated"):
            (folder / name).mkdir()
            (folder / name / "__init__.py").write_text(TROUBLE)
            (folder / f"{name}.py").write_text(TROUBLE)
    yield tmp_path
    for name in ("derive", "generated"):
        shutil.rmtree(packages / name)
        (packages / f"{name}.py").unlink()


def run(python: Path, place: Path, *arguments: object) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [python, *map(str, arguments)], cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_holds_two_packages(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {"wmr_afl", "wmr_input"}
    assert "wmr_afl/py.typed" in names
    assert {f"wmr_afl/_derive/robots/{robot}.toml" for robot in DESCRIPTIONS} <= set(names)


def test_nothing_else_can_be_imported(python: Path, tmp_path: Path) -> None:
    program = "import importlib.util as u; print([n for n in ('derive', 'generated', 'tests') if u.find_spec(n)])"
    assert run(python, tmp_path, "-c", program) == "[]\n"


def test_commands_and_doors_work_whatever_stands_beside(python: Path, crowded: Path) -> None:
    assert "type_2_0" in run(python, crowded, "-m", "wmr_afl", "models")
    run(python, crowded, "-m", "wmr_afl", "derive", DESCRIPTIONS["type_2_0"], "--out", crowded / "models")
    assert "Differential drive" in run(python, crowded, "-m", "wmr_afl", "show", crowded / "models" / "type_2_0")
    for written in sorted((crowded / "models" / "type_2_0").iterdir()):
        assert written.read_bytes() == (ROOT / "generated" / "type_2_0" / written.name).read_bytes()
    program = (
        "import sys, wmr_afl\n"
        "from wmr_afl.generated.type_2_0 import numpy_model\n"
        "assert wmr_afl.__file__.startswith(sys.prefix)\n"
        f"found = wmr_afl.derive({str(DESCRIPTIONS['type_2_0'])!r}, 'mine')\n"
        "model = wmr_afl.load_model('mine/type_2_0')\n"
        "print(found.kinematics.kinematic_matrix.shape, numpy_model.NAME, len(model.functions()) > 10)\n"
    )
    assert run(python, crowded, "-c", program) == "(3, 2) type_2_0 True\n"
