"""Every generated model obeys every law, and every law can be broken."""

import casadi as ca
import numpy as np
import pytest

from tests.conftest import ROBOTS
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
