"""What a new part costs: one new file and one line in a list (with its import), and it runs everywhere."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import EXPERIMENTS, ROOT

HEADWIND = '''
"""Air that resists motion, (n-m,) proportional to the square of each pseudo-velocity."""

from types import SimpleNamespace

import numpy as np

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.fields import NotNegative


class HeadwindTable(UncertaintyTable):
    push: NotNegative

    def build(self, surroundings: Surroundings) -> "Headwind":
        return Headwind(self.push)


class Headwind(Uncertainty):
    name = "headwind"

    def __init__(self, push: float) -> None:
        self.push = np.array([push])

    @property
    def values(self) -> dict[str, Floats]:
        return {"push": self.push}

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        v = x[model.coordinate_count :]
        return k.push[0] * model.arrays.absolute(v) * v
'''

DEAD_ZONE = '''
"""No adaptation while the filtered error is small."""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.modification import Modification
from wmr_afl.numerics.arrays import Array, Arrays, Floats, norm


class DeadZone(Modification):
    name = "dead_zone"

    def __init__(self, width: float) -> None:
        self.width = np.array([width])

    @classmethod
    def from_setting(cls, setting: float, parameters: Sequence[str]) -> "DeadZone":
        return cls(setting)

    @property
    def values(self) -> dict[str, Floats]:
        return {"width": self.width}

    def modify(
        self, direction: Array, regressor: Array, filtered_error: Array, theta_hat: Array, k: SimpleNamespace,
        arrays: Arrays,
    ) -> Array:
        return arrays.where(norm(filtered_error, arrays) > k.width[0], direction, 0.0 * direction)
'''

PROGRAM = """
import json, sys
import numpy as np
import wmr_afl
from wmr_afl.experiments.load import load_experiment

path, gain = sys.argv[1:]
runs = {backend: wmr_afl.run(path, backend, "AFL")["AFL"] for backend in ("numpy", "casadi", "compiled")}
one = runs["numpy"]
worst = max(float(np.max(np.abs(run.state - one.state))) for run in runs.values())
batch = wmr_afl.run_batch(path, "AFL", scale={gain: [1.0, 0.5]})
controller = wmr_afl.Controller.from_experiment(path, "AFL")
inputs = np.array([controller.update(t, x) for t, x in zip(one.time, one.state)])
print(json.dumps({
    "file": wmr_afl.__file__,
    "disagreement": worst,
    "real_time": float(np.max(np.abs(inputs - one.command))),
    "rms": batch.rms.tolist(),
    "single": one.rms().tolist(),
    "end": one.state[-1].tolist(),
    "numbers": sorted(load_experiment(path).loops["AFL"].values),
}))
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of the packages, to which a part is added."""
    for folder in ("wmr_afl", "wmr_input", "generated"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def insert(file: Path, after: str, line: str) -> None:
    """One line behind another one."""
    text = file.read_text()
    assert text.count(after) == 1, after
    file.write_text(text.replace(after, f"{after}{line}\n"))


def result(tree: Path, experiment: str, gain: str) -> dict:
    """What the program finds with the copied packages."""
    path = tree / "one.toml"
    path.write_text(experiment)
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, path, gain], cwd=tree, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert Path(found["file"]).is_relative_to(tree)
    return found


def study_1(uncertainty: str = "", adaptation: str = "") -> str:
    """Two seconds of study 1 with something added."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 2.0")
    text = text.replace("[shared]", f"[uncertainties]\n{uncertainty}\n\n[shared]", 1)
    text = text.replace("1.0, 10.0] }", f"1.0, 10.0]{adaptation} }}", 1).split("[campaign]")[0]
    return text.replace("lower = 0.1", "lower = 0.5")


def check(found: dict, plain: dict, name: str) -> None:
    assert name in found["numbers"]
    assert found["disagreement"] < 1e-9
    assert found["real_time"] < 1e-9
    assert found["rms"][0] == pytest.approx(found["single"], rel=1e-9)
    assert found["rms"][1] != pytest.approx(found["single"], rel=1e-6)
    assert max(abs(a - b) for a, b in zip(found["end"], plain["end"], strict=True)) > 1e-4


def test_a_new_uncertainty_is_one_file_and_one_line(tree: Path) -> None:
    plain = result(tree, study_1(), "Gamma")
    (tree / "wmr_afl" / "plant" / "headwind.py").write_text(HEADWIND)
    table = tree / "wmr_afl" / "plant" / "order.py"
    insert(
        table, "from wmr_afl.plant.friction import FrictionTable\n", "from wmr_afl.plant.headwind import HeadwindTable"
    )
    insert(table, "    payload: PayloadTable | None = None\n", "    headwind: HeadwindTable | None = None")
    found = result(tree, study_1("headwind = { push = 30.0 }"), "headwind.push")
    check(found, plain, "headwind.push")


def test_a_new_modification_of_the_adaptation_is_one_file_and_one_line(tree: Path) -> None:
    plain = result(tree, study_1(), "Gamma")
    (tree / "wmr_afl" / "controllers" / "dead_zone.py").write_text(DEAD_ZONE)
    table = tree / "wmr_afl" / "controllers" / "adaptation.py"
    imported = "from wmr_afl.controllers.leakage import Leakage\n"
    insert(table, imported, "from wmr_afl.controllers.dead_zone import DeadZone")
    insert(
        table,
        "    leakage: Annotated[Named | None, Leakage] = None\n",
        "    dead_zone: Annotated[Positive | None, DeadZone] = None",
    )
    found = result(tree, study_1(adaptation=", dead_zone = 1.5"), "dead_zone.width")
    check(found, plain, "dead_zone.width")
