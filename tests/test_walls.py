"""The walls of the house: who may import whom, and what runs without SymPy."""

import ast
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import wmr_afl
from tests.conftest import ROBOTS, ROOT

WITHOUT_SYMPY = """
import sys
for name in ("sympy",):
    sys.modules[name] = None  # importing it now raises ImportError
import wmr_afl, wmr_afl.cli, wmr_afl.analysis.paper.figures, wmr_afl.analysis.plots
for name in wmr_afl.list_models():
    for backend in ("numpy", "casadi"):
        model = wmr_afl.load_model(name, backend)
        model.base_parameters(model.parameters())
run = wmr_afl.run("study_1", controllers=["AFL"])["AFL"]
assert run.rms(since=100.0).max() < 1e-3
"""


def test_the_runtime_runs_where_sympy_is_not_installed() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_SYMPY], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_derive_verb_says_what_is_missing() -> None:
    program = (
        "import sys; sys.modules['sympy'] = None; sys.argv = ['wmr-afl', 'derive', 'robot.toml', '--out', 'unused']\n"
        "from wmr_afl.cli import app; app()"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == 'error: sympy is not installed; pip install "wmr-afl[derive]"\n'


def test_import_contracts_hold() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_generated_code_imports_numpy_or_casadi_and_nothing_else(robot: str) -> None:
    for library in ("numpy", "casadi"):
        tree = ast.parse((ROOT / "generated" / robot / f"{library}_model.py").read_text())
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        imported |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        assert imported - sys.stdlib_module_names == {library}


def test_generated_holds_what_the_derivation_wrote() -> None:
    assert sorted(path.name for path in (ROOT / "generated").iterdir() if not path.name.startswith("_")) == ROBOTS


def test_the_runtime_knows_no_robot_by_name() -> None:
    for path in (ROOT / "wmr_afl").rglob("*.py"):
        text = path.read_text()
        if path.name == "__init__.py":
            text = text.partition('"""\n\nfrom')[2]  # the package's docstring shows an example
        assert not any(f'"{robot}"' in text for robot in ROBOTS), path


def test_nothing_stands_at_the_root_of_the_runtime_but_its_doors() -> None:
    files = {path.name for path in (ROOT / "wmr_afl").iterdir() if path.is_file()}
    assert files == {"__init__.py", "__main__.py", "errors.py", "py.typed"}


def test_no_public_name_is_a_modules_name_as_well() -> None:
    """`import wmr_afl.run` must not give something else than `wmr_afl.run`; `generated` is a package on purpose."""
    assert [name for name in wmr_afl.__all__ if find_spec(f"wmr_afl.{name}") is not None] == ["generated"]


def test_no_two_files_of_a_folder_differ_by_an_ending_only() -> None:
    """Such as run and running, kernel and kernels."""
    for folder in {path.parent for top in ("derive", "wmr_afl", "wmr_input") for path in (ROOT / top).rglob("*.py")}:
        stems = [re.sub(r"(ies|ing|s|y|e)$", "", path.stem) for path in folder.iterdir() if path.suffix == ".py"]
        assert sorted(set(stems)) == sorted(stems), folder


def test_the_name_of_a_test_is_the_same_in_every_process(request: pytest.FixtureRequest) -> None:
    """Else tests that run side by side are not the same tests: no set in an order of its own, no address."""
    for item in request.session.items:
        assert " at 0x" not in item.nodeid
        for value in getattr(item, "callspec", None).params.values() if hasattr(item, "callspec") else ():
            for some in value if isinstance(value, list | tuple) else [value]:
                assert not (isinstance(some, set | frozenset) and len(some) > 1 and str(some) in item.nodeid), (
                    item.nodeid
                )
