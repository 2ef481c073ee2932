"""Every generated model obeys every law, and every law can be broken."""

import casadi as ca
import numpy as np
import pytest

from wmr_afl.model.laws import LAWS, Law, Situation
from wmr_afl.model.model import TERMS


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_model_obeys(law: Law, situation: Situation) -> None:
    if not law.applies(situation.numpy):
        pytest.skip(f"{situation.numpy.name} has no such term")
    assert law.deviation(situation) <= law.tolerance, law.statement


def test_the_reported_determinant_is_checked_on_every_robot_of_the_catalogue(situation: Situation) -> None:
    (law,) = (law for law in LAWS if law.name == "determinant")
    assert law.applies(situation.numpy)


@pytest.mark.parametrize("term", TERMS)
def test_a_wrong_term_breaks_a_law(term: str, robot: str) -> None:
    """A thousandth more in one entry, in both languages alike, is noticed."""
    situation = Situation(robot, count=8)
    if not situation.numpy.has(term):
        pytest.skip(f"{robot} has no {term}")
    falsify(situation, term)
    broken = [law.name for law in LAWS if law.applies(situation.numpy) and not _obeyed(law, situation)]
    assert broken


@pytest.mark.parametrize("language", ["numpy", "casadi"])
def test_a_term_wrong_in_one_language_breaks_a_law(language: str, robot: str) -> None:
    situation = Situation(robot, count=8)
    falsify(situation, "state_derivative", languages=(language,))
    assert any(not _obeyed(law, situation) for law in LAWS if law.name == "languages agree")


def _obeyed(law: Law, situation: Situation) -> bool:
    return law.deviation(situation) <= law.tolerance


def falsify(situation: Situation, term: str, languages: tuple[str, ...] = ("numpy", "casadi")) -> None:
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
    if "numpy" in languages:
        truth_function = getattr(situation.numpy._module, term)
        setattr(situation.numpy._module, term, wrong)
    if "casadi" in languages:
        setattr(situation.casadi._module, term, ca.Function(term, symbols, [value], function.name_in(), [term]))
