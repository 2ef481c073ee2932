"""Every generated model obeys every law, and every law can be broken."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from sympy import Matrix

from derive.codegen.quantities import QUANTITIES, Entry
from derive.codegen.write import files_of, generate_one, write
from derive.derivation import Derivation, derive_robot
from tests.conftest import DESCRIPTIONS, ROBOTS
from wmr_afl.model.laws import LAWS, Law, Situation
from wmr_afl.model.model import load_model


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_model_obeys(law: Law, situation: Situation) -> None:
    if not law.applies(situation.numpy):
        pytest.skip(f"{situation.numpy.name} has no such term")
    assert law.deviation(situation) <= law.tolerance, law.statement


def test_the_reported_determinant_is_checked_on_every_robot_of_the_catalogue(situation: Situation) -> None:
    (law,) = (law for law in LAWS if law.name == "determinant")
    assert law.applies(situation.numpy)


@pytest.mark.parametrize("term", sorted({term for robot in ROBOTS for term in load_model(robot).functions()}))
def test_a_wrong_term_breaks_a_law(term: str, robot: str) -> None:
    """A thousandth more in one entry, in both libraries alike, is noticed."""
    situation = Situation(robot, count=8)
    if not situation.numpy.has(term):
        pytest.skip(f"{robot} has no {term}")
    falsify(situation, term)
    trusted, *others = sorted(LAWS, key=lambda law: law.name != "trusted values")
    assert not _obeyed(trusted, situation)
    assert any(law.applies(situation.numpy) and not _obeyed(law, situation) for law in others)


@pytest.mark.parametrize("distance", [0.2, 0.03, 0.005])
def test_a_right_model_is_not_called_broken_near_a_singularity(distance: float) -> None:
    """A fixed step reaches too far where the steering angle is almost 90 degrees; a wrong Jacobian still shows."""
    situation = Situation("car")
    situation.x[:, 3] = np.pi / 2 - distance
    laws = [law for law in LAWS if law.name in ("Jacobians", "differences")]
    assert [law.name for law in laws if not _obeyed(law, situation)] == []
    falsify(situation, "state_jacobian")
    assert [law.name for law in laws if _obeyed(law, situation)] == []


def test_a_motor_constant_may_be_any_formula(tmp_path: Path) -> None:
    """Whatever function a description may call, the laws can evaluate."""
    text = DESCRIPTIONS["type_2_0"].read_text().replace('torque_gain = "K1"', 'torque_gain = "K1*exp(sin(d/b))"')
    (tmp_path / "robot.toml").write_text(text.replace('back_emf = "K2"', 'back_emf = "K2*sqrt(1 + tan(d/b))"'))
    write({f"robot/{name}": text for name, text in generate_one(tmp_path / "robot.toml").items()}, tmp_path)
    situation = Situation(tmp_path / "robot")
    assert [law.name for law in LAWS if law.applies(situation.numpy) and not _obeyed(law, situation)] == []


def test_one_more_quantity_is_known_and_checked_without_another_line(tmp_path: Path) -> None:
    path, entry = DESCRIPTIONS["type_2_0"], Entry("kinetic_energy", "x p", "1", "(14)", "v^T Mbar v / 2 [J]", energy)
    files = files_of(derive_robot(path), path, entries=[*QUANTITIES, entry])
    write({f"robot/{name}": text for name, text in files.items()}, tmp_path)
    situation = Situation(tmp_path / "robot")
    assert "kinetic_energy" in situation.numpy.functions()
    assert situation.numpy.kinetic_energy(situation.x, situation.p).shape == (len(situation.x), 1)
    assert "v^T Mbar v / 2 [J]" in situation.casadi.kinetic_energy.__doc__
    assert [law.name for law in LAWS if law.applies(situation.numpy) and not _obeyed(law, situation)] == []
    falsify(situation, "kinetic_energy")
    broken = [law.name for law in LAWS if law.applies(situation.numpy) and not _obeyed(law, situation)]
    assert broken == ["trusted values"]


def energy(derivation: Derivation) -> Matrix:
    v = Matrix(derivation.kinematics.v)
    return v.T * derivation.dynamics.inertia_matrix * v / 2


@pytest.mark.parametrize("library", ["numpy", "casadi"])
def test_a_term_wrong_in_one_library_breaks_a_law(library: str, robot: str) -> None:
    situation = Situation(robot, count=8)
    falsify(situation, "state_derivative", libraries=(library,))
    assert any(not _obeyed(law, situation) for law in LAWS if law.name == "libraries agree")


def _obeyed(law: Law, situation: Situation) -> bool:
    return law.deviation(situation) <= law.tolerance


def falsify(situation: Situation, term: str, libraries: tuple[str, ...] = ("numpy", "casadi")) -> None:
    """Makes the first entry that is not zero a thousandth larger."""
    truth = getattr(situation.numpy, term)
    function = situation.casadi.functions()[term]
    arguments = [getattr(situation, name) for name in function.name_in()]
    sample = np.abs(truth(*arguments)).sum(axis=0)
    if not sample.size:
        pytest.skip(f"{term} is empty")
    place = np.unravel_index(int(np.argmax(sample > 0)), sample.shape)

    def wrong(*given: np.ndarray) -> np.ndarray:
        value = truth_function(*given)
        value[(..., *place)] *= 1.001
        return value

    symbols = [ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()]
    value = function(*symbols)
    value[place if len(place) == 2 else place[0]] *= 1.001
    if "numpy" in libraries:
        truth_function = situation.numpy.functions()[term]
        situation.numpy._add(term, wrong)
    if "casadi" in libraries:
        situation.casadi._add(term, ca.Function(term, symbols, [value], function.name_in(), [term]))
