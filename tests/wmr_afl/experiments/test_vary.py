"""Robots of a batch differ in what is given, what follows from it follows, and one robot is a batch of one."""

from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from derive.codegen.write import generate_one, write
from tests.conftest import DESCRIPTIONS, EXPERIMENTS
from wmr_afl import InputError, UnknownNameError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.experiments.vary import Differences, vary
from wmr_afl.simulation.layout import Layout

EVERY_LOOP = [(name, controller) for name in wmr_afl.list_experiments() for controller in load_experiment(name).loops]


def varied(experiment: str | Path, controller: str, differences: Differences) -> list[dict[str, np.ndarray]]:
    """Numbers and states of each robot by name."""
    loaded = load_experiment(experiment)
    loop = loaded.loops[controller]
    ensemble = vary(loaded.experiment, controller, loop, differences)
    robots = zip(ensemble.values.T, ensemble.states.T, strict=True)
    return [{**Layout(loop.values).unpack(v), **Layout(loop.states).unpack(z)} for v, z in robots]


@pytest.mark.parametrize(("experiment", "controller"), EVERY_LOOP)
def test_a_batch_that_differs_in_nothing_has_the_numbers_of_the_single_run(experiment: str, controller: str) -> None:
    """Every number that is computed twice is computed by the same rule."""
    loop = load_experiment(experiment).loops[controller]
    parameter = next(iter(loop.model.parameter_units))
    for robot in varied(experiment, controller, Differences(scale={parameter: [1.0, 1.0]})):
        for name, value in {**loop.values, **loop.states}.items():
            np.testing.assert_array_equal(robot[name], value, err_msg=name)


@pytest.mark.parametrize(("experiment", "controller"), EVERY_LOOP)
def test_a_robot_of_a_batch_has_the_numbers_of_an_experiment_with_its_parameters(
    experiment: str, controller: str, tmp_path: Path
) -> None:
    """The same change once in the file and once in a batch: estimates, gains, bounds, loads all follow alike."""
    loaded = load_experiment(experiment)
    model = loaded.loops[controller].model
    names = [name for name, unit in model.parameter_units.items() if unit in ("kg", "kg m^2", "m")]
    p = dict(zip(model.parameter_units, loaded.loops[controller].values["p"], strict=True))
    changed = {name: 1.1 * float(p[name]) for name in names}
    text = (EXPERIMENTS / f"{experiment}.toml").read_text().split("[parameters]")[0]
    rest = (EXPERIMENTS / f"{experiment}.toml").read_text().partition("[parameters]")[2].partition("\n[")
    lines = "".join(f"{name} = {value!r}\n" for name, value in changed.items())
    kept = "".join(line + "\n" for line in rest[0].splitlines() if line.split("=")[0].strip() not in changed)
    (tmp_path / "one.toml").write_text(text + f"{rest[1]}{rest[2]}\n[parameters]\n{kept}{lines}")
    loop = load_experiment(tmp_path / "one.toml").loops[controller]
    (robot,) = varied(experiment, controller, Differences(parameters={n: [v] for n, v in changed.items()}))
    for name, value in {**loop.values, **loop.states}.items():
        np.testing.assert_allclose(robot[name], value, rtol=1e-15, err_msg=name)


def test_alpha_follows_the_gains_unless_it_is_scaled_itself() -> None:
    both = varied("study_1", "AFL", Differences(scale={"b2": [4.0], "alpha": [0.5]}))[0]
    np.testing.assert_allclose(both["outer_loop.b2"], 4.0)
    np.testing.assert_allclose(both["outer_loop.alpha"], 0.5 * 4.0 / 2.0)


@pytest.fixture
def clash(tmp_path: Path) -> Path:
    """Study 1 with a robot whose look-ahead distance is named like a gain, b1."""
    description = DESCRIPTIONS["type_2_0"].read_text().replace("L = {", "b1 = {").replace("L*", "b1*")
    (tmp_path / "clash.toml").write_text(description.replace('"type_2_0"', '"clash"'))
    files = generate_one(tmp_path / "clash.toml")
    write({f"clash/{name}": text for name, text in files.items()}, tmp_path / "models")
    study = (EXPERIMENTS / "study_1.toml").read_text().replace('"type_2_0"', '"models/clash"')
    (tmp_path / "study.toml").write_text(study.replace("duration = 140.0", "duration = 101.0"))
    return tmp_path / "study.toml"


def test_a_name_of_a_parameter_and_a_gain_is_refused_with_both(clash: Path) -> None:
    with pytest.raises(
        WmrError, match=r"^'b1' names a parameter of clash and a gain; write parameters.b1 or gains.b1$"
    ):
        wmr_afl.run_batch(clash, scale={"b1": [1.0, 2.0]})
    usual = varied(clash, "AFL", Differences(start={"x": [15.0]}))[0]
    look_ahead = varied(clash, "AFL", Differences(scale={"parameters.b1": [2.0]}))[0]
    gain = varied(clash, "AFL", Differences(scale={"gains.b1": [2.0]}))[0]
    changed = {name for name, value in usual.items() if np.any(look_ahead[name] != value)}
    assert changed == {"p", "c"}
    assert look_ahead["c"] == 2.0 * usual["c"]
    assert {name for name, value in usual.items() if np.any(gain[name] != value)} == {
        "outer_loop.b1", "outer_loop.alpha",
    }  # fmt: skip
    np.testing.assert_array_equal(gain["outer_loop.b1"], 2.0 * usual["outer_loop.b1"])
    for name in ("b1", "outer_loop.b1", "gains.b1", "gains.outer_loop.b1"):  # no parameter can be meant here
        given = varied(clash, "AFL", Differences(gains={name: [[3.0, 4.0]]}))[0]
        np.testing.assert_array_equal(given["outer_loop.b1"], [3.0, 4.0])


def test_a_campaign_refuses_such_a_name_and_takes_the_whole_one(clash: Path) -> None:
    clash.write_text(clash.read_text().replace("m_C = { uniform", "b1 = { uniform", 1))
    with pytest.raises(
        InputError, match=r"study.toml: \[campaign\]: 'b1' names a parameter of clash and a gain; write"
    ):
        wmr_afl.campaign(clash, 4)
    clash.write_text(clash.read_text().replace("b1 = { uniform", '"parameters.b1" = { uniform', 1))
    result = wmr_afl.campaign(clash, 4)
    assert "scale.parameters.b1" in result.draws


@pytest.mark.parametrize("name", ["b3", "gains.b3", "parameters.b3", "c", "p", "gains.p"])
def test_an_unknown_name_is_refused_with_those_there_are(name: str) -> None:
    with pytest.raises(UnknownNameError, match="unknown"):
        wmr_afl.run_batch("study_1", scale={name: [1.0, 2.0]})
    with pytest.raises(UnknownNameError, match=r"b1|Gamma"):
        wmr_afl.run_batch("study_1", values={name: [1.0, 2.0]})
