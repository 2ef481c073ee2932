"""Controller and robot as FMUs are what the simulator runs, in another simulator's hands."""

from __future__ import annotations

import io
import os
import sysconfig
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.conftest import EXPERIMENTS
from wmr_afl import BackendWarning, CompilerError, UnknownNameError
from wmr_afl.cli import app
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard import cosimulation
from wmr_afl.onboard.export import export
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.kernels import c_compiler
from wmr_afl.simulation.simulate import simulate

fmpy = pytest.importorskip("fmpy")
build, validation = (pytest.importorskip(f"fmpy.{name}") for name in ("build", "validation"))
SAMPLE_TIME = 0.02
NOISY = """
[uncertainties]
measurement_noise = { deviation = { x = 0.002, phi = 0.001 }, seed = 3 }
input_delay = { seconds = 0.02 }
input_limits = { volts = 12.0 }
friction = { viscous = 0.1, coulomb = [0.2, 0.1], on = "wheels" }
payload = { time = 0.5, parameters = { m_C = 50.0 } }

[shared] """

pytestmark = pytest.mark.skipif(c_compiler.compiler() is None, reason="there is no C compiler")


@dataclass
class Slave:
    """An FMU in the hands of a simulator: values by name."""

    path: Path
    folder: Path
    values: dict[str, float | bool] = field(default_factory=dict)  # set before it begins
    messages: list[str] = field(default_factory=list)  # FMPy gives those of FMI 2.0 to the one made last

    def __post_init__(self) -> None:
        if not self.folder.exists():
            fmpy.extract(str(self.path), str(self.folder))
        self.description = fmpy.read_model_description(str(self.folder))
        self.variables = {one.name: one for one in self.description.modelVariables}
        self.is_old = self.description.fmiVersion == "2.0"
        self.fmu = fmpy.instantiate_fmu(str(self.folder), self.description, "CoSimulation", **self._logger())
        self.put(self.values)
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
        self.fmu.exitInitializationMode()

    def names(self, group: str) -> list[str]:
        """What belongs to a group, or the one value of this name."""
        return [name for name in self.variables if name == group or name.startswith(f"{group}.")]

    def get(self, group: str) -> np.ndarray:
        chosen = [self.variables[name] for name in self.names(group)]
        return np.array(self._call("get", chosen))

    def put(self, values: Mapping[str, float | bool]) -> None:
        for kind in {self.variables[name].type for name in values}:
            chosen = [name for name in values if self.variables[name].type == kind]
            self._call("set", [self.variables[name] for name in chosen], [values[name] for name in chosen])

    def _call(self, verb: str, chosen: list[Any], *values: list[float | bool]) -> list[Any]:
        return getattr(self.fmu, f"{verb}{chosen[0].type}")([one.valueReference for one in chosen], *values)

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
        with patch.object(c_compiler, "PORTABLE", (*c_compiler.PORTABLE, "-O0")):  # the same bits, sooner
            export(experiment, controller, folder, is_unlimited=True, samples=1, fmu=version, **options)
        return folder

    def pair(self, experiment: str, controller: str, version: int, **options: Any) -> tuple[Slave, Slave]:
        folder = self.make(experiment, controller, version, **options)
        return (
            Slave(folder / "controller.fmu", folder / "controller_fmu"),
            Slave(folder / "plant.fmu", folder / "plant_fmu"),
        )


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Exports:
    return Exports(tmp_path_factory.mktemp("fmu"))


def wired(source: Slave, group: str, target: Slave) -> None:
    """Outputs of one to the inputs of another, which have the same names."""
    target.put(dict(zip(source.names(group), source.get(group), strict=True)))


def driven(controller: Slave, plant: Slave, count: int, row: Any = None) -> dict[str, np.ndarray]:
    """A sequential master: the controller first, then the robot. `row(k)` are normal numbers for sample k."""
    found: dict[str, list[np.ndarray]] = {"state": [], "voltage": [], "estimate": []}
    for k in range(count):
        t = k * SAMPLE_TIME
        wired(plant, "measured", controller)
        found["state"].append(plant.get("state"))
        controller.step(t)
        assert controller.get("status")[0] == 0
        found["voltage"].append(controller.get("voltage"))
        found["estimate"].append(controller.get("estimate"))
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
    return simulate(load_experiment(experiment).loops[controller], count * SAMPLE_TIME)


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


def test_under_disturbances_they_do_what_a_run_does(exports: Exports, tmp_path: Path) -> None:
    """A master draws the normal numbers of the run, one row a sample. A drive that is late counts whole samples."""
    file, count = tmp_path / "noisy.toml", 60
    file.write_text((EXPERIMENTS / "study_1.toml").read_text().replace("[shared] ", NOISY))
    folder = exports.make(str(file), "AFL", 2)
    run = run_of(str(file), "AFL", count)
    rows = normal_samples(np.random.Generator(np.random.Philox(3)), count + 1, 5)
    law = Slave(folder / "controller.fmu", folder / "controller_fmu")
    names = [f"noise.{name}" for name in ("x", "y", "phi", "v", "omega")]
    plant = Slave(folder / "plant.fmu", folder / "plant_fmu", dict(zip(names, rows[0], strict=True)))
    found = driven(law, plant, count, lambda k: rows[k])
    agree(found["state"], run.state[:count])
    agree(found["voltage"], run.command[:count])
    with pytest.raises(Exception, match="failed"):
        plant.step(count * SAMPLE_TIME, 0.5 * SAMPLE_TIME)
    assert plant.messages[-1].endswith("a step is a whole number of sample times")
    assert not plant.description.coSimulation.canHandleVariableCommunicationStepSize
    assert plant.get("friction.viscous").tolist() == [0.1, 0.1]
    assert plant.get("payload.parameters.m_C") == [50.0]
    units = {name: plant.variables[name].unit for name in plant.variables}
    assert units["friction.coulomb.u_l"] == "N m"
    assert units["friction.viscous.u_l"] == "N m s/rad"
    assert units["input_limits.volts.u_r"] == "V"
    assert units["payload.time"] == "s"


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", ["controller", "plant"])
def test_the_description_is_sound(exports: Exports, version: int, name: str) -> None:
    path = exports.make("study_1", "AFL", version) / f"{name}.fmu"
    assert validation.validate_fmu(str(path)) == []
    described = {one.name: one for one in fmpy.read_model_description(str(path)).modelVariables}
    if name == "plant":
        assert described["parameters.m_C"].unit == "kg"
        assert described["parameters.m_C"].description == "mass of the platform without wheels and rotors"
        assert float(described["start.x"].start) == 15.0
    else:
        assert described["reference_rate.y1"].unit == "m/s"
        assert described["estimate.theta5"].unit == "m/(V s^2)"


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_measured_and_not_finite_gives_no_voltage(exports: Exports, version: int) -> None:
    law, plant = exports.pair("study_1", "AFL", version)
    driven(law, plant, 3)
    before = law.get("estimate")
    law.put({"measured.phi": np.nan})
    law.step(3 * SAMPLE_TIME)
    assert law.get("status") == [1]
    assert law.get("voltage").tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(law.get("estimate"), before)
    wired(plant, "measured", law)
    law.step(4 * SAMPLE_TIME)
    assert law.get("status") == [0]
    assert np.all(law.get("voltage") != 0.0)


@pytest.mark.parametrize("version", [2, 3])
def test_from_a_saved_state_it_goes_on_with_the_same_bits(exports: Exports, version: int) -> None:
    """Also another instance, from the bytes of the state; a state of another FMU is refused."""
    pair = exports.pair("study_1", "AFL", version)
    driven(*pair, 5)
    states = [one.saved() for one in pair]
    first = further(*pair)
    for one, state in zip(pair, states, strict=True):
        one.restore(state)
    np.testing.assert_array_equal(further(*pair), first)
    others = exports.pair("study_1", "AFL", version)
    for one, other, state in zip(pair, others, states, strict=True):
        other.restore(other.read(one.written(state)))
    np.testing.assert_array_equal(further(*others), first)
    with pytest.raises(Exception, match="failed"):
        others[1].read(pair[0].written(states[0]))
    assert others[1].messages[-1] == "this is no state of this FMU"


def further(law: Slave, plant: Slave) -> np.ndarray:
    """A few samples from where they are."""
    rows = []
    for k in range(5, 10):
        wired(plant, "measured", law)
        law.step(k * SAMPLE_TIME)
        wired(law, "voltage", plant)
        plant.step(k * SAMPLE_TIME)
        rows.append(np.concatenate([law.get("voltage"), law.get("estimate"), plant.get("state")]))
    return np.array(rows)


def test_a_controller_samples_by_its_own_clock_whatever_the_steps(exports: Exports) -> None:
    """Four steps a sample time are one sample, and a step of three sample times are three."""
    law, plant = exports.pair("study_1", "AFL", 3)
    short, long = exports.pair("study_1", "AFL", 3)[0], exports.pair("study_1", "AFL", 3)[0]
    for one in (law, short, long):
        wired(plant, "measured", one)
    for k in range(3):
        law.step(k * SAMPLE_TIME)
        for part in range(4):
            short.step((k + 0.25 * part) * SAMPLE_TIME, 0.25 * SAMPLE_TIME)
            np.testing.assert_array_equal(short.get("voltage"), law.get("voltage"))
    long.step(0.0, 3 * SAMPLE_TIME)
    np.testing.assert_array_equal(long.get("estimate"), law.get("estimate"))


def test_a_robot_takes_steps_of_any_length(exports: Exports) -> None:
    """Of several sample times as if they came one by one; of half a sample time each integrated by itself."""
    plants = [exports.pair("study_1", "AFL", 3)[1] for _ in range(3)]
    for one in plants:
        one.put({"voltage.u_r": 2.0, "voltage.u_l": 1.0})
    for k in range(6):
        plants[0].step(k * SAMPLE_TIME)
    for k in range(12):
        plants[1].step(0.5 * k * SAMPLE_TIME, 0.5 * SAMPLE_TIME)
    plants[2].step(0.0, 6 * SAMPLE_TIME)
    np.testing.assert_array_equal(plants[2].get("state"), plants[0].get("state"))
    assert np.any(plants[1].get("state") != plants[0].get("state"))
    np.testing.assert_allclose(plants[1].get("state"), plants[0].get("state"), atol=0.1)
    assert plants[0].get("time") == pytest.approx([6 * SAMPLE_TIME])


@pytest.mark.parametrize("version", [2, 3])
def test_what_makes_no_sense_is_refused_and_changes_nothing(exports: Exports, version: int) -> None:
    plant = exports.pair("study_1", "AFL", version)[1]
    plant.put({"voltage.u_r": 1.0})
    plant.step(0.0)
    before = plant.get("state")
    wrong: list[tuple[Any, str]] = [
        (lambda: plant.put({"start.x": 1.0}), "can be set now"),
        (lambda: plant.put({"state.x": 1.0}), "can be set now"),
        (lambda: plant.put({"time": 1.0}), "can be set now"),
        (lambda: plant.step(SAMPLE_TIME, 0.0), "above zero"),
        (lambda: plant.step(SAMPLE_TIME, np.nan), "above zero"),
        (lambda: plant.begin(), "initialization"),
    ]
    for call, words in wrong:
        with pytest.raises(Exception, match="failed"):
            call()
        assert words in plant.messages[-1]
    plant.put({"voltage.u_r": np.nan})
    with pytest.raises(Exception, match="failed"):
        plant.step(SAMPLE_TIME)
    assert plant.messages[-1] == "the robot's state is no longer finite"
    np.testing.assert_array_equal(plant.get("state"), before)
    plant.put({"voltage.u_r": 1.0, "parameters.m_C": 40.0})
    plant.step(SAMPLE_TIME)
    assert np.any(plant.get("state") != before)
    plant.fmu.reset()
    plant.begin()
    assert plant.get("state").tolist() == [15.0, 25.0, 0.0, 0.0, 0.0]
    assert plant.get("parameters.m_C") == [36.0]


def test_a_reference_is_the_experiments_own_or_what_is_given(exports: Exports) -> None:
    own, plant = exports.pair("study_1", "AFL", 2)
    given = Slave(own.path, own.folder, {"own_reference": False})
    loop = load_experiment("study_1").loops["AFL"]
    reference = np.hstack(loop.reference.over(np.arange(4) * SAMPLE_TIME))
    groups = ("reference", "reference_rate", "reference_acceleration")
    names = [name for group in groups for name in given.names(group)]
    for k in range(4):
        for one in (own, given):
            wired(plant, "measured", one)
        given.put(dict(zip(names, reference[k], strict=True)))
        own.step(k * SAMPLE_TIME)
        given.step(k * SAMPLE_TIME)
        np.testing.assert_allclose(given.get("voltage"), own.get("voltage"), rtol=1e-12)
        wired(own, "voltage", plant)
        plant.step(k * SAMPLE_TIME)
    given.put({"reference.y1": np.inf})
    given.step(4 * SAMPLE_TIME)
    assert given.get("status") == [2]


def test_gains_may_be_set_if_they_are_tunable_and_precision_may_be_single(exports: Exports) -> None:
    plain, plant = exports.pair("study_1", "AFL", 3)
    law = exports.pair("study_1", "AFL", 3, is_tunable=True, is_single=True, has_reference=False)[0]
    assert "own_reference" not in law.variables
    reference = np.hstack(load_experiment("study_1").loops["AFL"].reference.over(np.zeros(1)))[0]
    groups = ("reference", "reference_rate", "reference_acceleration")
    names = [name for group in groups for name in law.names(group)]
    law.put(dict(zip(names, reference, strict=True)))
    for one in (plain, law):
        wired(plant, "measured", one)
        one.step(0.0)
    np.testing.assert_allclose(law.get("voltage"), plain.get("voltage"), rtol=1e-5)
    assert law.get("gains.outer_loop.b1[1]") == [2.0]
    assert law.get("gains.c.L") == pytest.approx([0.1])
    law.put({"gains.outer_loop.b1[1]": 4.0, "gains.outer_loop.b1[2]": 4.0})
    law.step(SAMPLE_TIME)
    plain.step(SAMPLE_TIME)
    assert np.all(np.abs(law.get("voltage") - plain.get("voltage")) > 0.01)


def test_without_a_compiler_the_sources_are_there_and_can_be_built(
    exports: Exports, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(c_compiler, "compiler", lambda: None)
        with pytest.warns(BackendWarning, match="^no C compiler was found, so the FMUs hold sources only; install"):
            export("study_1", "AFL", tmp_path / "out", is_unlimited=True, samples=1, fmu=3)
    for name in ("controller", "plant"):
        assert fmpy.supported_platforms(str(tmp_path / "out" / f"{name}.fmu")) == ["c-code"]
    folder, place = Path(fmpy.extract(str(tmp_path / "out" / "controller.fmu"), str(tmp_path / "fmu"))), tmp_path / "b"
    place.mkdir()
    monkeypatch.setenv("PATH", os.pathsep.join((sysconfig.get_path("scripts"), os.environ["PATH"])))  # CMake is there
    build.build_platform_binary(folder, place)
    law, plant = Slave(tmp_path / "out" / "controller.fmu", folder), exports.pair("study_1", "AFL", 3)[1]
    agree(driven(law, plant, 20)["state"], run_of("study_1", "AFL", 20).state[:20])


def test_the_same_experiment_gives_the_same_bytes(exports: Exports, tmp_path: Path) -> None:
    first = exports.make("study_1", "AFL", 3)
    again = Exports(tmp_path).make("study_1", "AFL", 3)
    for name in ("controller.fmu", "plant.fmu"):
        assert (first / name).read_bytes() == (again / name).read_bytes()
        with zipfile.ZipFile(first / name) as archive:
            assert {one.date_time for one in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_names_follow_the_prefix_and_an_unknown_version_writes_nothing(tmp_path: Path) -> None:
    with patch.object(cosimulation, "binary", failing), pytest.warns(BackendWarning):
        files = export("study_1", "AFL", is_unlimited=True, prefix="fmu", samples=1, fmu=2)
    assert {name for name in files if name.endswith(".fmu")} == {"fmu.fmu", "fmu_plant.fmu"}
    with zipfile.ZipFile(io.BytesIO(files["fmu.fmu"])) as archive:
        sources = {Path(name).name for name in archive.namelist() if name.endswith(".c")}
    assert sources == {"fmu.c", "fmu_reference.c", "fmu_fmu.c"}
    with pytest.raises(UnknownNameError, match=r"^unknown version of FMI '4'; there is 2, 3$"):
        export("study_1", "AFL", tmp_path / "none", is_unlimited=True, fmu=4)
    given = ["export", "study_1", "--out", str(tmp_path / "none"), "--unlimited", "--fmu", "1"]
    done = CliRunner().invoke(app, given)
    assert (done.exit_code, done.stderr) == (2, "error: unknown version of FMI '1'; there is 2, 3\n")
    assert list(tmp_path.iterdir()) == []


def failing(*arguments: object) -> dict[str, bytes]:
    raise CompilerError("no C compiler was found")
