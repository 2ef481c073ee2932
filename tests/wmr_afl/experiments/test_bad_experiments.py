"""Every mistake in an experiment: one line with file, place and remedy."""

from pathlib import Path

import pytest

import wmr_afl
from wmr_afl import InputError, UnknownNameError
from wmr_afl.experiments.experiment import find_experiment

GOOD = find_experiment("study_1").read_text().replace("duration = 140.0", "duration = 0.1")

MISTAKES = {
    "unknown table": ("[start]", "[begin]", ["begin", "unknown key", "start", "shared"]),
    "unknown key": ("sample_time = 0.02", "sample_tme = 0.02", ["[simulation]", "did you mean 'sample_time'"]),
    "misspelt table": ("[simulation]", "[simulations]", ["[simulations]", "did you mean 'simulation'"]),
    "missing table": ("[reference]", "[parameters]", ["reference", "missing"]),
    "unknown robot": ('robot = "type_2_0"', 'robot = "type_2_O"', ["robot", "type_2_0"]),
    "unknown state": ("x = 15.0", "z = 15.0", ["[start]", "'z'", "x, y, phi, v, omega"]),
    "unknown parameter": ("[start]", "[parameters]\nmass = 3.0\n[start]", ["[parameters]", "'mass'", "m_C"]),
    "unknown integrator": ('"euler"', '"simpson"', ["[simulation] integrator", "'euler'", "'rk4'"]),
    "unknown controller key": (
        "projection = { lower",
        "projektion = { lower",
        ["[controllers] AFL", "did you mean 'projection'"],
    ),
    "unknown reference": ("circle = {", "spiral = {", ["[reference]", "'spiral'"]),
    "two references": (
        "circle = {",
        "line = { start = [0, 0], velocity = [1, 0] }\ncircle = {",
        ["[reference]", "give one of"],
    ),
    "reference of a wrong size": (
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
        "line = { start = [0, 0, 0], velocity = [1, 0, 0] }",
        ["[reference.line]", "3", "y1, y2"],
    ),
    "reference expression": (
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
        'expressions = { y1 = "cos(t)", y2 = "sn(t)" }',
        ["[reference.expressions]", "did you mean 'sin'"],
    ),
    "reference for an unknown output": (
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
        'expressions = { y1 = "cos(t)", y3 = "sin(t)" }',
        ["[reference.expressions]", "'y3'", "y1, y2"],
    ),
    "reference missing": (
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
        'expressions = { y1 = "cos(t)" }',
        ["[reference.expressions]", "'y2'", "add y2"],
    ),
    "estimate of a wrong size": ("estimate = 1.0", "estimate = [1.0, 2.0]", ["[shared] estimate", "2", "6"]),
    "estimate of an unknown name": ("estimate = 1.0", "estimate = { theta9 = 1.0 }", ["estimate", "theta9", "theta6"]),
    "estimate incomplete": ("estimate = 1.0", "estimate = { theta1 = 1.0 }", ["estimate", "'theta2'", "add theta2"]),
    "gain of a wrong size": ("gain = [10.0, 5.0, ", "gain = [10.0, ", ["[controllers.AFL] adaptation", "(5,)", "(6,)"]),
    "gain not positive": ("gain = [10.0", "gain = [-10.0", ["[controllers.AFL] adaptation", "positive definite"]),
    "bound for an unknown name": (
        "lower = 0.1",
        "lower = { theta7 = 0.1 }",
        ["[controllers.AFL] projection", "theta7"],
    ),
    "outer loop not positive real": (
        "b1 = 2.0",
        "b1 = 0.5",
        ["[shared] outer_loop", "strictly positive real"],
    ),
    "no outer loop": ("outer_loop = {", "# outer_loop = {", ["[controllers.AFL] outer_loop", "[shared]"]),
    "unknown shared key": ("estimate = 1.0", "hunch = 1.0", ["[shared]", "'hunch'", "estimate"]),
    "negative duration": ("duration = 0.1", "duration = -1.0", ["[simulation] duration", "greater than 0"]),
    "not a number": ("x = 15.0", 'x = "east"', ["[start] x", "a number"]),
    "infinite": ("x = 15.0", "x = inf", ["[start] x", "finite"]),
    "no controllers": ("[controllers.AFL]", "[controllers]\n[other]", ["controllers"]),
    "negative limit": (
        "[shared]",
        "[uncertainties.input_limits]\nvolts = -24.0\n[shared]",
        ["[uncertainties.input_limits] volts", "positive"],
    ),
    "noise on an unknown state": (
        "[shared]",
        "[uncertainties.measurement_noise]\ndeviation = { z = 0.1 }\n[shared]",
        ["[uncertainties.measurement_noise] deviation", "'z'", "omega"],
    ),
    "unknown uncertainty": ("[shared]", "[uncertainties.gremlins]\n[shared]", ["gremlins", "input_limits"]),
    "physical parameters of no robot": (
        "[start]",
        "[parameters]\nm_C = -50.0\n[start]",
        ["[parameters]", "negative", "m_C = -50"],
    ),
    "a wheel without a radius": (
        "[start]",
        "[parameters]\nr = 0.0\n[start]",
        ["[parameters]", "the radius of wheel 'right' is 0", "positive"],
    ),
    "run shorter than a sample": ("duration = 0.1", "duration = 0.01", ["[simulation]", "sample_time exceeds"]),
    "more samples than memory": ("sample_time = 0.02", "sample_time = 1e-9", ["[simulation]", "too many"]),
    "ragged gain": ("gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0]", "gain = [[1.0], [1.0, 2.0]]", ["adaptation", "rows"]),
    "gain of no kind": ("gain = [10.0,", 'gain = ["ten",', ["adaptation.gain", "square matrix"]),
    "line with ends that differ": (
        "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }",
        "line = { start = [0, 0], velocity = [1] }",
        ["[reference] line", "2 entries of start, 1 of velocity"],
    ),
    "first estimate out of bounds": (
        "lower = 0.1",
        "lower = 2.0",
        ["[controllers.AFL] projection", "first estimate of theta5, 1", "2"],
    ),
    "bounds without adaptation": (
        '[controllers."frozen estimates"]',
        '[controllers."frozen estimates"]\nprojection = { lower = 0.5 }',
        ["[controllers.frozen estimates] projection", "nothing adapts"],
    ),
    "controllers with the same file": (
        '[controllers."frozen estimates"]',
        '[controllers."a/b"]\n[controllers."a b"]',
        ["'a/b' and 'a b' would share files"],
    ),
    "controller without a name": ('[controllers."frozen estimates"]', '[controllers.""]', ["no good name"]),
    "text for a number": ("x = 15.0", 'x = "15.0"', ["[start] x", "a number"]),
    "not TOML": ("[start]", "[start", ["not valid TOML"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_reported_with_its_place(mistake: str, tmp_path: Path) -> None:
    old, new, words = MISTAKES[mistake]
    assert old in GOOD, "the test itself must change something"
    path = tmp_path / "experiment.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        wmr_afl.run(path)
    assert str(caught.value).startswith(str(path))
    for word in words:
        assert word in str(caught.value)


def test_the_good_experiment_runs(tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    path.write_text(GOOD)
    assert list(wmr_afl.run(path)) == ["AFL", "frozen estimates"]


def test_unknown_experiments_and_controllers_list_what_there_is() -> None:
    with pytest.raises(UnknownNameError, match="study_1"):
        wmr_afl.run("study_l")
    with pytest.raises(UnknownNameError, match="frozen estimates"):
        wmr_afl.run("study_1", controllers=["PID"])
    with pytest.raises(InputError, match="no such file"):
        wmr_afl.run("nowhere/experiment.toml")


def test_a_model_folder_beside_the_experiment_is_found(tmp_path: Path) -> None:
    import shutil

    from tests.conftest import ROOT

    shutil.copytree(ROOT / "generated" / "type_2_0", tmp_path / "mine")
    path = tmp_path / "experiment.toml"
    path.write_text(GOOD.replace('robot = "type_2_0"', 'robot = "mine"'))
    assert wmr_afl.run(path)["AFL"].failure is None
