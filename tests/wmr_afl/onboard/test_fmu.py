"""Controller and robot as units for co-simulation are what the simulator runs, in another simulator's hands."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sysconfig
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl import BackendWarning, CompilerError, UnknownNameError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard import cosimulation
from wmr_afl.onboard.export import export
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.kernels.c_compiler import compiler

fmpy = pytest.importorskip("fmpy")
HEADERS = Path(fmpy.__file__).parent / "c-code"  # those of the standard, of both versions
SAMPLE_TIME = 0.02
NOISY = """
[uncertainties]
measurement_noise = { deviation = { x = 0.002, phi = 0.001 }, seed = 3 }
input_limits = { volts = 12.0 }
friction = { viscous = 0.1, coulomb = [0.2, 0.1], on = "wheels" }
payload = { time = 0.5, parameters = { m_C = 50.0 } }

[shared] """

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


@dataclass
class Unit:
    """A unit in the hands of a simulator: values by name."""

    path: Path
    folder: Path
    values: dict[str, float | bool] = field(default_factory=dict)  # set before it begins
    messages: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.folder.exists():
            fmpy.extract(str(self.path), str(self.folder))
        self.description = fmpy.read_model_description(str(self.folder))
        self.variables = {one.name: one for one in self.description.modelVariables}
        self.is_old = self.description.fmiVersion == "2.0"
        self.fmu = fmpy.instantiate_fmu(str(self.folder), self.description, "CoSimulation", **self._logger())
        for name, value in self.values.items():
            self.put({name: value})
        self.begin()

    def _logger(self) -> dict[str, Any]:
        def old(environment: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
            self.messages.append(message.decode())

        def new(environment: Any, status: int, category: bytes, message: bytes) -> None:
            self.messages.append(message.decode())

        return {"logger": old if self.is_old else new}

    def begin(self) -> None:
        if self.is_old:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.put({name: value for name, value in self.values.items() if name.startswith("noise.")})
        self.fmu.exitInitializationMode()

    def names(self, group: str) -> list[str]:
        return [name for name in self.variables if name.startswith(f"{group}.")]

    def get(self, names: str | Iterable[str]) -> np.ndarray:
        chosen = self.names(names) if isinstance(names, str) and names not in self.variables else names
        chosen = [chosen] if isinstance(chosen, str) else list(chosen)
        return np.array([self._call("get", self.variables[name])[0] for name in chosen])

    def put(self, values: Mapping[str, float | bool]) -> None:
        for name, value in values.items():
            self._call("set", self.variables[name], [value])

    def _call(self, verb: str, variable: Any, *values: list[float | bool]) -> list[Any]:
        return getattr(self.fmu, f"{verb}{variable.type}")([variable.valueReference], *values)

    def step(self, t: float, h: float = SAMPLE_TIME) -> None:
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def saved(self) -> Any:
        return self.fmu.getFMUstate() if self.is_old else self.fmu.getFMUState()

    def restore(self, state: Any) -> None:
        (self.fmu.setFMUstate if self.is_old else self.fmu.setFMUState)(state)

    def written(self, state: Any) -> bytes:
        return bytes((self.fmu.serializeFMUstate if self.is_old else self.fmu.serializeFMUState)(state))

    def read(self, content: bytes) -> Any:
        return (self.fmu.deSerializeFMUstate if self.is_old else self.fmu.deserializeFMUState)(content)


class Exports:
    """Exported once a session."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.make = cache(self._make)

    def _make(self, experiment: str, controller: str, version: int, **options: Any) -> Path:
        folder = self.folder / f"{Path(experiment).stem}_{version}_{'_'.join(options)}"
        export(experiment, controller, folder, is_unlimited=True, samples=1, fmu=version, **options)
        return folder

    def pair(self, experiment: str, controller: str, version: int, **options: Any) -> tuple[Unit, Unit]:
        folder = self.make(experiment, controller, version, **options)
        return (
            Unit(folder / "controller.fmu", folder / "controller_unit"),
            Unit(folder / "plant.fmu", folder / "plant_unit"),
        )


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Exports:
    return Exports(tmp_path_factory.mktemp("fmu"))


def wired(source: Unit, group: str, target: Unit) -> None:
    """One unit's outputs to another one's inputs, which have the same names."""
    target.put(dict(zip(source.names(group), source.get(group), strict=True)))


def driven(controller: Unit, plant: Unit, count: int, row: Any = None) -> dict[str, np.ndarray]:
    """A sequential master: the controller first, then the robot. `row(k)` are normal numbers for sample k."""
    found: dict[str, list[np.ndarray]] = {"state": [], "voltage": [], "estimate": []}
    for k in range(count):
        t = k * SAMPLE_TIME
        wired(plant, "measured", controller)
        found["state"].append(plant.get("state"))
        controller.step(t)
        found["voltage"].append(controller.get("voltage"))
        found["estimate"].append(controller.get("estimate"))
        assert controller.get("status")[0] == 0
        wired(controller, "voltage", plant)
        if row is not None:
            plant.put(dict(zip(plant.names("noise"), row(k + 1), strict=True)))
        plant.step(t)
    return {name: np.array(rows) for name, rows in found.items()}


def agree(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-12) -> None:
    """To a share of the largest size of each column."""
    size = np.abs(expected).max(axis=0)
    assert np.max(np.abs(found - expected) / np.where(size > 0.0, size, 1.0)) < tolerance


def run_of(experiment: str, controller: str, count: int) -> Any:
    return wmr_afl.simulation.simulate.simulate(load_experiment(experiment).loops[controller], count * SAMPLE_TIME)


@pytest.mark.parametrize(
    ("experiment", "controller", "version", "count"),
    [
        ("study_1", "AFL", 2, 500),
        ("study_1", "AFL", 3, 500),
        ("track_tractor_3_trailers", "composite", 3, 300),
    ],
)
def test_one_after_the_other_they_do_what_a_run_does(
    exports: Exports, experiment: str, controller: str, version: int, count: int
) -> None:
    law, plant = exports.pair(experiment, controller, version)
    run = run_of(experiment, controller, count)
    found = driven(law, plant, count)
    agree(found["state"], run.state[:count])
    agree(found["voltage"], run.input[:count])
    agree(found["estimate"], run.estimate[1 : count + 1])
