"""The walls of the house: who may import whom, and what runs without SymPy."""

import ast
import subprocess
import sys
from pathlib import Path

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
