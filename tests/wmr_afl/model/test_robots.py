"""Numbers that no robot can have, files that do not belong together, and names that are no names."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import ROOT
from tests.wmr_afl.model.sealing import sealed
from wmr_afl import InputError, ShapeError, UnknownNameError, WmrError, load_model
from wmr_afl.model.files import list_models, model_folder
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model
from wmr_afl.model.plausibility import check_robots, robot_faults


@pytest.fixture
def model(situation: Situation) -> Model:
    return situation.numpy


def test_masses_and_inertias_are_not_negative(model: Model) -> None:
    """Each of them, of one robot and of one among many; lengths and the like may be."""
    for name, unit in model.parameter_units.items():
        p = model.parameters(**{name: [1.0, -1e-9, -2.0]})
        p[[0, 2]] = model.parameters()
        if unit in ("kg", "kg m^2"):
            for robots in (p, p[1]):
                with pytest.raises(WmrError, match=f"{name} = -1e-09 .* is negative"):
                    check_robots(model, {}, robots)
    check_robots(model, {}, model.parameters())


def test_of_many_robots_the_wrong_ones_are_told_apart() -> None:
    """Which they are, and what is wrong with each."""
    model = load_model("type_2_0")
    robots = model.parameters(m_C=[36.0, -1.0, 36.0, -3.0], r=[0.15, 0.15, -0.15, 0.15])
    found: dict[int, list[str]] = {}
    for is_wrong, describe in robot_faults(model, np.zeros((len(robots), model.coordinate_count)), robots):
        for robot in np.flatnonzero(is_wrong):
            found.setdefault(int(robot), []).append(describe(int(robot))[0])
    assert set(found) == {1, 2, 3}
    assert found[1][0] == "m_C = -1 kg is negative"
    assert found[2] == ["the radius of wheel 'right' is -0.15", "the radius of wheel 'left' is -0.15"]
    assert found[3][0] == "m_C = -3 kg is negative"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"m_C": 0.0, "m_w": 0.0}, "not finite with m_C = 0, m_w = 0"),
        ({"I_C": 0.0, "I_m": 0.0, "d": 0.0, "b": 0.0}, r"not finite|not positive definite with b = 0, d = 0, I_m = 0"),
        ({"r": 0.0}, "the radius of wheel 'right' is 0; choose a positive one"),
        ({"K1": -1.0}, "the torque gain of 'u_r' is -1"),
    ],
)
def test_a_robot_that_cannot_be_is_described_by_what_differs_from_the_defaults(changes: dict, words: str) -> None:
    """Radii and torque gains are positive, and some mass moves."""
    model = load_model("type_2_0")
    with pytest.raises(WmrError, match=words):
        check_robots(model, {}, model.parameters(**changes))


def test_the_inertia_matrix_is_that_at_the_start() -> None:
    """Where a robot starts, Mbar must be positive definite; what is not named starts at zero."""
    seen: list[np.ndarray] = []
    model: Any = load_model("type_1_1")
    truth = model.inertia_matrix
    model.inertia_matrix = lambda q, p: seen.append(q) or truth(q, p)
    check_robots(model, {"beta": 0.4, "x": 2.0}, model.parameters(m=[100.0, 110.0]))
    names = list(model.state_units)[: model.coordinate_count]
    expected = [{"beta": 0.4, "x": 2.0}.get(name, 0.0) for name in names]
    np.testing.assert_array_equal(seen[0], [expected] * 2)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "generated" / "type_2_0", tmp_path / "mine")
    return tmp_path / "mine"


@pytest.mark.parametrize(
    "constant", ["NAME", "PARAMETRIZATION", "STATE", "INPUTS", "OUTPUTS", "PARAMETERS", "KNOWN", "BASE_PARAMETERS"]
)
@pytest.mark.parametrize("library", ["numpy", "casadi"])
def test_a_module_has_the_names_of_model_json_in_their_order(folder: Path, constant: str, library: str) -> None:
    """Two names that are exchanged would exchange numbers."""
    module = folder / f"{library}_model.py"
    space: dict[str, Any] = {}
    exec(module.read_text(), space)  # noqa: S102, it was generated
    value = space[constant]
    other = dict(reversed(value.items())) if isinstance(value, dict) and len(value) > 1 else {"other": "m"}
    other = other if isinstance(value, dict) else "another"
    module.write_text(module.read_text() + f"\n{constant} = {other!r}\n")
    with pytest.raises(InputError, match=f"{library}_model.py: {constant}: is not that of model.json"):
        load_model(sealed(folder), library)


@pytest.mark.parametrize("name", ["../generated/type_2_0", "./type_2_0", "type_2_0/", "type_2_0/../type_2_0"])
def test_a_path_is_no_name_of_a_shipped_model(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is looked for where it says."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownNameError, match="unknown model"):
        model_folder(name)
    assert model_folder("type_2_0").name == "type_2_0"
    assert "type_2_0" in list_models()


def test_a_missing_or_damaged_key_of_model_json_is_named(folder: Path) -> None:
    """Each key that the runtime reads, absent and of another type."""
    text = (folder / "model.json").read_text()
    keys = (
        *("name", "title", "parametrization", "state", "inputs", "outputs", "parameters", "motors", "defaults"),
        *("known", "base_parameters", "base_parameter_formulas", "functions", "geometry", "findings"),
        "slip_rows",
    )
    for key in keys:
        for wrong in (None, 3):
            content = json.loads(text)
            content[key] = wrong
            if wrong is None:
                del content[key]
            (folder / "model.json").write_text(json.dumps(content))
            with pytest.raises(InputError, match=rf"model\.json: .*{key}.*; derive the robot again"):
                load_model(folder)


def test_parameters_are_replaced_in_single_robots_and_in_batches(model: Model) -> None:
    """p with some entries changed, and c the known ones among them, in the order of model.json."""
    names, p = list(model.parameter_units), model.parameters()
    np.testing.assert_array_equal(p, list(model.metadata["defaults"].values()))
    first, last = names[0], names[-1]
    changed = model.replaced(p, {first: 7.0, last: [8.0, 9.0]})
    assert changed.shape == (2, len(names))
    np.testing.assert_array_equal(changed[:, 0], [7.0, 7.0])
    np.testing.assert_array_equal(changed[:, -1], [8.0, 9.0])
    np.testing.assert_array_equal(changed[:, 1:-1], np.tile(p[1:-1], (2, 1)))
    known = [names.index(name) for name in model.known_units]
    np.testing.assert_array_equal(model.known(changed), changed[:, known])
    np.testing.assert_array_equal(model.replaced(changed, {}), changed)
    with pytest.raises(ShapeError, match="finite"):
        model.replaced(p, {first: np.inf})


def test_a_model_counts_its_coordinates_and_pseudo_velocities(model: Model) -> None:
    """x = [q; v], and what each argument of a function holds."""
    n, m = model.coordinate_count, model.pseudo_velocity_count
    assert n + m == len(model.state_units)
    assert list(model.state_units)[n:] == list(model.findings["pseudo_velocities"])
    sizes = {"q": n, "x": n + m, "u": len(model.input_units), "w": m, "a": m, "v_r": m, "p": len(model.parameter_units),
             "theta": len(model.base_parameter_units), "c": len(model.known_units)}  # fmt: skip
    for name, entry in model.metadata["functions"].items():
        given = [np.full(sizes[argument], 0.3) for argument in entry["arguments"]]
        with np.errstate(all="ignore"):
            assert getattr(model, name)(*given).shape == tuple(entry["size"])
            assert getattr(model, name)(**dict(zip(entry["arguments"], given, strict=True))).shape == tuple(
                entry["size"]
            )
        with pytest.raises(ShapeError):
            getattr(model, name)(*given, given[0])
        with pytest.raises(ShapeError):
            getattr(model, name)(*given[:-1], np.zeros(len(given[-1]) + 1))
