"""Models are found, opened and asked; what is asked wrongly is answered in one exception family."""

import json
import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS, ROOT
from tests.wmr_afl.model.sealing import sealed
from wmr_afl import InputError, MissingTermError, ShapeError, UnknownNameError, WmrError, load_model
from wmr_afl.model.files import import_module


def test_the_catalogue_is_shipped() -> None:
    assert wmr_afl.list_models() == ROBOTS


def test_a_folder_serves_as_well_as_a_name(tmp_path: Path, robot: str) -> None:
    shutil.copytree(ROOT / "generated" / robot, tmp_path / "mine")
    shipped, own = load_model(robot), load_model(tmp_path / "mine")
    np.testing.assert_array_equal(own.base_parameters(own.parameters()), shipped.base_parameters(shipped.parameters()))


def test_parameters_override_the_defaults() -> None:
    model = load_model("type_2_0")
    p = model.parameters(r=0.05, m_C=10)
    names = list(model.parameter_units)
    assert p[names.index("r")] == 0.05
    assert p[names.index("m_C")] == 10.0
    assert p[names.index("b")] == 0.75
    assert model.known(p).tolist() == [0.1]


def test_parameters_may_be_batches() -> None:
    model = load_model("type_2_0")
    p = model.parameters(m_C=[10.0, 20.0, 30.0])
    assert p.shape == (3, 10)
    assert model.base_parameters(p).shape == (3, 6)


def test_names_and_units_stand_beside_the_functions(robot: str) -> None:
    for backend in ("numpy", "casadi"):
        model = load_model(robot, backend)
        file = model.folder / f"{backend}_model.py"
        module = import_module(file, file.read_text())
        assert model.state_units == module.STATE
        assert model.input_units == module.INPUTS
        assert model.output_units == module.OUTPUTS
        assert model.parameter_units == module.PARAMETERS
        assert model.known_units == module.KNOWN
        assert model.base_parameter_units == module.BASE_PARAMETERS
        assert model.base_parameter_formulas == module.BASE_PARAMETER_FORMULAS
        assert "?" not in [*model.state_units.values(), *model.base_parameter_units.values()]


def test_casadi_functions_inline_and_have_names() -> None:
    function = load_model("type_2_0", "casadi").functions()["decoupling_matrix"]
    assert function.name_in() == ["x", "theta", "c"]
    assert function.name_out() == ["decoupling_matrix"]
    result = function(ca.SX.sym("x", 5), ca.SX.sym("theta", 6), ca.SX.sym("c", 1))
    assert isinstance(result, ca.SX)
    assert result.shape == (2, 2)


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: m.output([1.0, 2.0], [0.1]), ["q", "(2,)", "x, y, phi"]),
        (lambda m: m.output(1.0, [0.1]), ["q", "()"]),
        (lambda m: m.output([1.0, 2.0, 3.0], [0.1, 0.2]), ["c", "(2,)", "L"]),
        (lambda m: m.decoupling_matrix(np.zeros(5), np.zeros(5), [0.1]), ["theta", "theta1"]),
        (lambda m: m.state_derivative(np.zeros(5), np.zeros(3), np.zeros(2), m.parameters()), ["u", "u_r, u_l"]),
        (lambda m: m.output(["a", "b", "c"], [0.1]), ["q", "numbers"]),
        (lambda m: m.known(np.zeros(3)), ["p", "(3,)"]),
        (lambda m: m.parameters(r="wide"), ["r", "number"]),
        (lambda m: m.parameters(r=float("nan")), ["r", "finite"]),
    ],
)
def test_a_wrong_shape_names_the_expected_one(backend, call, words) -> None:
    with pytest.raises(ShapeError) as caught:
        call(load_model("type_2_0", backend))
    for word in words:
        assert word in str(caught.value)
    assert isinstance(caught.value, WmrError)


def test_casadi_does_not_broadcast_a_wrong_shape() -> None:
    model = load_model("type_2_0", "casadi")
    for wrong in (ca.SX.sym("q", 1), ca.SX.sym("q", 1, 3), ca.DM.zeros(3, 3)):
        with pytest.raises(ShapeError, match="expected"):
            model.output(wrong, [0.1])


def test_batches_that_do_not_fit_are_reported() -> None:
    with pytest.raises(ShapeError, match="do not fit"):
        load_model("type_2_0").output(np.zeros((2, 3)), np.zeros((3, 1)))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: load_model("type_2_1_0"), ["type_2_1_0", "type_2_0"]),
        (lambda: load_model("type_2_0", "fortran"), ["backend", "numpy, casadi"]),
        (lambda: load_model("type_2_0").parameters(mass=3.0), ["mass", "m_C", "K1"]),
    ],
)
def test_an_unknown_name_lists_what_there_is(call, words) -> None:
    with pytest.raises(UnknownNameError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("damage", ["missing module", "broken module", "broken json", "empty json"])
def test_a_damaged_folder_is_reported(tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(ROOT / "generated" / "type_2_0", folder)
    if damage == "missing module":
        (folder / "numpy_model.py").unlink()
    if damage == "broken module":
        (folder / "numpy_model.py").write_text("def (")
    if damage == "broken json":
        (folder / "model.json").write_text("{")
    if damage == "empty json":
        (folder / "model.json").write_text("{}")
    with pytest.raises(InputError, match="derive the robot again"):
        load_model(folder)


def test_a_missing_term_says_why(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(ROOT / "generated" / "type_2_0", folder)
    module, metadata = folder / "numpy_model.py", folder / "model.json"
    module.write_text(module.read_text().replace("def regressor(", "def other("))
    sealed(folder)
    with pytest.raises(InputError, match="has no regressor; derive"):
        load_model(folder)
    content = json.loads(metadata.read_text())
    del content["functions"]["regressor"]
    metadata.write_text(json.dumps(content))
    with pytest.raises(MissingTermError, match="no regressor"):
        load_model(folder).regressor(np.zeros(5), np.zeros(2), [0.1])


def test_code_of_another_robot_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(ROOT / "generated" / "type_2_0", folder)
    module = folder / "numpy_model.py"
    module.write_text(module.read_text().replace('"omega": "rad/s"', '"w": "rad/s"'))
    sealed(folder)
    with pytest.raises(InputError, match=r"numpy_model.py: STATE: is not that of model.json"):
        load_model(folder)


def test_a_folder_of_models_names_them(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "generated" / "type_2_0", tmp_path / "mine")
    with pytest.raises(InputError, match=r"name one of .*mine"):
        load_model(tmp_path)


def test_a_name_too_long_for_a_file_is_unknown() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown model"):
        load_model("a" * 5000)


def test_batches_of_parameters_must_fit() -> None:
    with pytest.raises(ShapeError, match=r"m_C \(2,\), r \(3,\)|r \(3,\), m_C \(2,\)"):
        load_model("type_2_0").parameters(m_C=[1.0, 2.0], r=[1.0, 2.0, 3.0])


def test_a_term_names_its_model_and_itself(robot: str) -> None:
    """In every message: `type_2_0.output`."""
    for library in ("numpy", "casadi"):
        model = load_model(robot, library)
        for name, entry in model.metadata["functions"].items():
            assert repr(getattr(model, name)) == f"<{robot}.{name}({', '.join(entry['arguments'])})>"
            with pytest.raises(ShapeError, match=rf"^{robot}\.{name} takes "):
                getattr(model, name)()
