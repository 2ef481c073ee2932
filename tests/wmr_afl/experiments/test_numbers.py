"""What an experiment's file says reaches the loop, and a batch is what single runs of edited files are, key by key."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wmr_afl
from wmr_afl import Controller, InputError, ShapeError, UnknownNameError, WmrError
from wmr_afl.experiments.assembly import assemble, model_of
from wmr_afl.experiments.experiment import MOST_SAMPLES, Experiment, SimulationTable, file_name
from wmr_afl.experiments.load import load_experiment
from wmr_afl.experiments.vary import Differences, gain_name, vary
from wmr_afl.model.model import load_model
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.layout import Layout
from wmr_input.toml_file import validate

MODEL = load_model("type_2_0")
THETAS = list(MODEL.base_parameter_units)


def toml(table: dict[str, Any]) -> str:
    """A table of TOML on one line."""

    def text(value: Any) -> str:
        if isinstance(value, dict):
            return "{ " + ", ".join(f'"{key}" = {text(one)}' for key, one in value.items()) + " }"
        if isinstance(value, list):
            return "[" + ", ".join(map(text, value)) + "]"
        return (
            f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else repr(value)
        )

    return "\n".join(f'"{key}" = {text(value)}' for key, value in table.items())


def tables(**changed: Any) -> dict[str, Any]:
    """An adaptive run of 0.2 s with its own parameters; keys with two underscores reach into the controller."""
    controller = {
        "outer_loop": {"b1": 2.0, "b2": 1.0},
        "adaptation": {"relative_gain": 0.1},
        "projection": {"relative": 0.9},
        "guess": {"m_C": 30.0},
    }
    inside = {key[12:]: value for key, value in changed.items() if key.startswith("controller__")}
    outside = {key: value for key, value in changed.items() if not key.startswith("controller__")}
    controller = {key: value for key, value in {**controller, **inside}.items() if value is not None}
    usual = {
        "title": "one", "robot": "type_2_0", "parameters": {"m_C": 30.0, "b": 0.6}, "start": {"x": 2.5, "phi": 0.3},
        "reference": {"circle": {"center": [0.0, 0.0], "radius": 2.6, "rate": 0.2}},
        "simulation": {"duration": 0.2, "sample_time": 0.02}, "controllers": {"AFL": controller},
    }  # fmt: skip
    return {**usual, **outside}


def loop(**changed: Any) -> ClosedLoop:
    """The loop of such an experiment, without a file."""
    experiment = validate(tables(**changed), Experiment, "one.toml")
    return assemble(experiment, Path("one.toml"))["AFL"]


@pytest.fixture
def write(tmp_path: Path):  # type: ignore[no-untyped-def]
    """A function that writes such an experiment and returns its file."""
    count = 0

    def written(**changed: Any) -> Path:
        nonlocal count
        count += 1
        path = tmp_path / f"experiment_{count}.toml"
        path.write_text(toml(tables(**changed)))
        return path

    return written


NOISE = {"measurement_noise": {"deviation": 0.01, "seed": 5}}
PAYLOAD = {"payload": {"time": 0.08, "parameters": {"I_C": 40.0}}}
ABSOLUTE = {"controller__adaptation": {"gain": 0.1}, "controller__projection": None}

# What a batch is given -> the experiment whose single run it must be, each as changes of the usual one. The loop from
# which the batch departs is the usual one with the third entry.
KEYS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "parameters": ({"parameters": {"m_C": [45.0]}}, {"parameters": {"m_C": 45.0, "b": 0.6}}, {}),
    "start": ({"start": {"x": [2.7], "v": [0.4]}}, {"start": {"x": 2.7, "phi": 0.3, "v": 0.4}}, {}),
    "a gain from which alpha follows": (
        {"values": {"b2": [1.5]}}, {"controller__outer_loop": {"b1": 2.0, "b2": 1.5}}, {}
    ),
    "an alpha that is given": (
        {"values": {"alpha": [0.3], "b1": [3.0]}},
        {"controller__outer_loop": {"b1": 3.0, "b2": 1.0, "alpha": 0.3}}, {},
    ),
    "an alpha of the experiment": (
        {"values": {"b1": [3.0]}},
        {"controller__outer_loop": {"b1": 3.0, "b2": 1.0, "alpha": 0.4}},
        {"controller__outer_loop": {"b1": 2.0, "b2": 1.0, "alpha": 0.4}},
    ),
    "a gain for each output": (
        {"values": {"outer_loop.b1": [[3.0, 4.0]]}}, {"controller__outer_loop": {"b1": [3.0, 4.0], "b2": 1.0}}, {}
    ),
    "a scale of a parameter": ({"scale": {"m_C": [1.5]}}, {"parameters": {"m_C": 45.0, "b": 0.6}}, {}),
    "a scale of a parameter that the batch gives": (
        {"parameters": {"m_C": [20.0]}, "scale": {"m_C": [2.0]}}, {"parameters": {"m_C": 40.0, "b": 0.6}}, {}
    ),
    "a scale of a gain": (
        {"scale": {"Gamma": [2.0]}}, {"controller__adaptation": {"gain": 0.2}, "controller__projection": None}, ABSOLUTE
    ),
    "a scale of a relative gain": ({"scale": {"Gamma": [2.0]}}, {"controller__adaptation": {"relative_gain": 0.2}}, {}),
    "seeds": (
        {"seeds": [9]},
        {"uncertainties": {"measurement_noise": {"deviation": 0.01, "seed": 9}}},
        {"uncertainties": NOISE},
    ),
    "the experiment's seed": ({"start": {"x": [2.7]}}, {"start": {"x": 2.7, "phi": 0.3}, "uncertainties": NOISE},
                              {"uncertainties": NOISE}),
    "a number of an uncertainty": (
        {"values": {"volts": [1.5]}},
        {"uncertainties": {"input_limits": {"volts": 1.5}}}, {"uncertainties": {"input_limits": {"volts": 24.0}}},
    ),
    "a payload on a robot that differs": (
        {"parameters": {"m_C": [45.0]}},
        {"parameters": {"m_C": 45.0, "b": 0.6}, "uncertainties": PAYLOAD}, {"uncertainties": PAYLOAD},
    ),
    "a payload of a parameter that differs": (
        {"parameters": {"I_C": [10.0]}},
        {"parameters": {"m_C": 30.0, "b": 0.6, "I_C": 10.0}, "uncertainties": PAYLOAD}, {"uncertainties": PAYLOAD},
    ),
    "a known constant": ({"parameters": {"L": [0.25]}}, {"parameters": {"m_C": 30.0, "b": 0.6, "L": 0.25}}, {}),
}  # fmt: skip


@pytest.mark.parametrize("key", KEYS)
def test_a_batch_is_the_single_run_of_the_edited_file(key: str, write) -> None:
    """Every key of a batch, alone and with what follows from it; and it makes a difference."""
    given, edited, usual = KEYS[key]
    batch = wmr_afl.run_batch(write(**usual), backend="casadi", **given)
    same = {**usual, **edited}
    longer = {"simulation": {"duration": 0.22, "sample_time": 0.02}}
    run, after = (wmr_afl.run(write(**changes), "numpy")["AFL"] for changes in (same, {**same, **longer}))
    np.testing.assert_allclose(batch.rms[0], run.rms(), rtol=1e-10)
    np.testing.assert_allclose(batch.final_state[0], after.state[-1], rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(batch.largest_estimate[0], np.abs(run.estimate).max(), rtol=1e-10)
    plain = wmr_afl.run(write(**usual), "numpy")["AFL"]
    if key != "a payload of a parameter that differs":
        assert np.abs(batch.rms[0] - plain.rms()).max() > 1e-9


def varied(differences: Differences, **changed: Any) -> list[dict[str, np.ndarray]]:
    """Numbers and states of each robot by name."""
    one, experiment = loop(**changed), validate(tables(**changed), Experiment, "one.toml")
    ensemble = vary(experiment, "AFL", one, differences)
    robots = zip(ensemble.values.T, ensemble.states.T, strict=True)
    return [{**Layout(one.values).unpack(v), **Layout(one.states).unpack(z)} for v, z in robots]


def test_every_robot_of_a_batch_has_its_own_numbers() -> None:
    """One column a robot; one number holds for all."""
    robots = varied(Differences(parameters={"m_C": [10.0, 20.0], "I_C": 9.0}, start={"y": [1.0, 2.0], "x": 7.0}))
    place = list(MODEL.parameter_units).index
    assert [float(one["p"][place("m_C")]) for one in robots] == [10.0, 20.0]
    assert [float(one["p"][place("I_C")]) for one in robots] == [9.0, 9.0]
    assert [float(one["p"][place("b")]) for one in robots] == [0.6, 0.6]
    assert [one["x"].tolist() for one in robots] == [[7.0, 1.0, 0.3, 0.0, 0.0], [7.0, 2.0, 0.3, 0.0, 0.0]]


def test_estimates_gains_and_bounds_follow_each_robot() -> None:
    """theta_hat(0) is that of the guess with the robot's other parameters; Gamma and bounds are relative to it."""
    robots = varied(Differences(parameters={"I_C": [10.0, 20.0]}))
    for one, inertia in zip(robots, (10.0, 20.0), strict=True):
        theta = MODEL.base_parameters(MODEL.parameters(m_C=30.0, b=0.6, I_C=inertia))
        np.testing.assert_allclose(one["theta_hat"], theta, rtol=1e-15)
        np.testing.assert_allclose(one["adaptation.Gamma"], 0.1 * theta**2, rtol=1e-14)
        np.testing.assert_allclose(one["projection.lower"], 0.1 * theta, rtol=1e-13)
        np.testing.assert_allclose(one["projection.upper"], 1.9 * theta, rtol=1e-14)


@pytest.mark.parametrize("place", ["parameters", "estimates", "gains", ""])
def test_a_scale_is_a_factor_on_what_stands_at_its_place(place: str) -> None:
    """Of each robot on its own; of other names there nothing changes, and unknown ones are refused with the place."""
    name, whole, entry = {
        "parameters": ("m_C", "p", list(MODEL.parameter_units).index("m_C")),
        "estimates": (THETAS[2], "theta_hat", 2),
        "gains": ("outer_loop.b1", "outer_loop.b1", 0),
        "": ("b2", "outer_loop.b2", 1),
    }[place]
    key = f"{place}.{name}" if place else name
    usual, *_ = varied(Differences(start={"x": [2.5, 2.5]}), controller__projection=None)
    scaled = varied(Differences(scale={key: [2.0, 1.5]}), controller__projection=None)
    for one, factor in zip(scaled, (2.0, 1.5), strict=True):
        assert one[whole][entry] == pytest.approx(factor * usual[whole][entry], rel=1e-14)
        others = np.arange(usual[whole].size) != entry
        if place in ("parameters", "estimates"):
            np.testing.assert_array_equal(one[whole][others], usual[whole][others])
    with pytest.raises(UnknownNameError, match="nothing'"):
        varied(Differences(scale={f"{place}.nothing" if place else "nothing": [1.0]}))


def test_seeds_belong_to_loops_that_draw() -> None:
    """Without noise there are none; with it they are the given ones, or the experiment's for all."""
    experiment = validate(tables(uncertainties=NOISE), Experiment, "one.toml")
    noisy = loop(uncertainties=NOISE)
    assert vary(experiment, "AFL", noisy, Differences(seeds=[4, 5, 6])).seeds.tolist() == [4, 5, 6]
    assert vary(experiment, "AFL", noisy, Differences(start={"x": [1.0, 2.0]})).seeds.tolist() == [5, 5]
    quiet = vary(validate(tables(), Experiment, "one.toml"), "AFL", loop(), Differences(start={"x": [1.0, 2.0]}))
    assert quiet.seeds.shape == (0,)


@pytest.mark.parametrize(
    ("differences", "error", "words"),
    [
        (Differences(), ShapeError, "nothing says how many"),
        (Differences(start={"x": 1.0}), ShapeError, "nothing says how many"),
        (Differences(start={"x": []}), ShapeError, "nothing says how many"),
        (Differences(start={"x": [1.0, 2.0]}, scale={"m_C": [1.0]}), ShapeError, "x 2, scale of m_C 1"),
        (Differences(seeds=[1, 2], gains={"b1": [1.0]}), ShapeError, "b1 1, seeds 2"),
        (Differences(start={"z": [1.0]}), UnknownNameError, "unknown state 'z'"),
        (Differences(parameters={"m_C": [1.0, -1.0]}), WmrError, "m_C = -1 kg is negative"),
        (Differences(gains={"b1": [float("nan")]}), WmrError, r"b1 is not finite"),
        (Differences(gains={"b1": [[1.0, 2.0, 3.0]]}), ShapeError, r"b1 has shape \(1, 3\); expected"),
        (Differences(start={"x": [[1.0], [2.0]]}), ShapeError, r"x has shape \(2, 1\); expected one number, or 2: one"),
        (Differences(parameters={"m_C": [[30.0, 31.0]]}), ShapeError, r"m_C has shape \(1, 2\); expected one number"),
        (Differences(scale={"parameters.nothing": [1.0]}), UnknownNameError, "parameter of type_2_0"),
    ],
)
def test_differences_that_mean_nothing_are_refused(differences: Differences, error: type, words: str) -> None:
    """Numbers of robots agree, names are the loop's, numbers are numbers that a robot can have."""
    with pytest.raises(error, match=words):
        varied(differences)


def test_a_gain_is_named_by_its_last_part_if_no_other_ends_in_it() -> None:
    """Two parts with a number of the same name are told apart by their whole names."""
    both = {"friction": {"viscous": 1.0, "on": "wheels"}, "input_limits": {"volts": 5.0}}
    found = loop(uncertainties=both)
    assert gain_name("volts", found) == "input_limits.volts"
    assert gain_name("gains.friction.viscous", found) == "friction.viscous"
    with pytest.raises(UnknownNameError, match="viscous"):
        gain_name("viscosity", found)


# What the file says -> numbers of the loop.
def test_references_go_to_the_outputs_by_name() -> None:
    """Whatever their order in the file."""
    given = {"y2": "5", "y1": "1 + t"}
    point = loop(reference={"expressions": given}).reference.at(2.0)
    np.testing.assert_array_equal(point.position, [3.0, 5.0])
    np.testing.assert_array_equal(point.velocity, [1.0, 0.0])


@pytest.mark.parametrize(
    ("table", "position", "velocity"),
    [
        ({"circle": {"center": [1.0, 2.0], "radius": 3.0, "rate": 0.5}}, [4.0, 2.0], [0.0, 1.5]),
        ({"figure_eight": {"center": [1.0, 2.0], "radius": 3.0, "rate": 0.5}}, [1.0, 2.0], [3.0, 1.5]),
        ({"line": {"start": [1.0, 2.0], "velocity": [3.0, 4.0]}}, [1.0, 2.0], [3.0, 4.0]),
    ],
)
def test_named_trajectories_start_where_they_say(table: dict, position: list, velocity: list) -> None:
    """(92), (94): at t = 0."""
    point = loop(reference=table).reference.at(0.0)
    np.testing.assert_allclose(point.position, position, atol=1e-15)
    np.testing.assert_allclose(point.velocity, velocity, atol=1e-15)


def test_the_loop_has_what_the_file_says() -> None:
    """Start by name with zero where no name stands, parameters over defaults, sample time and integrator."""
    found = loop(simulation={"duration": 0.2, "sample_time": 0.05, "integrator": "rk4"})
    np.testing.assert_array_equal(found.plant.start, [2.5, 0.0, 0.3, 0.0, 0.0])
    np.testing.assert_array_equal(found.plant.parameters, MODEL.parameters(m_C=30.0, b=0.6))
    np.testing.assert_array_equal(found.law.knowledge.known, MODEL.known(MODEL.parameters()))
    assert (found.sample_time, found.plant.integrator.__name__) == (0.05, "rk4")
    assert loop().plant.integrator.__name__ == "euler"
    assert loop().law.robust is None
    robust = loop(controller__robust={"gamma": 0.5, "mu": 2.0, "mu_decay": 0.3, "leakage": 0.1}).law.robust
    assert (robust.gains, robust.start_mu.tolist()) == ({"gamma": 0.5, "mu_decay": 0.3, "leakage": 0.1}, [2.0])
    weighted = loop(controller__input_weights=[1.0, 5.0]).values
    np.testing.assert_array_equal(weighted["linearizing.input_weights"], [1.0, 5.0])


def test_adaptation_has_what_the_file_says() -> None:
    """Gains by number, list, name or matrix; leakage by name; the input at which W is taken."""
    matrix = (np.eye(6) + 0.1).tolist()
    named = {name: 1.0 + i for i, name in enumerate(THETAS)}
    for given, expected in (
        (3.0, np.full(6, 3.0)), (list(named.values()), list(named.values())), (named, list(named.values())),
        (matrix, matrix),
    ):  # fmt: skip
        found = loop(controller__adaptation={"gain": given}).law.adaptation
        np.testing.assert_array_equal(found.gain, expected)
        assert not found.sees_applied
    adapted = loop(controller__adaptation={"gain": 1.0, "leakage": {THETAS[2]: 0.5}, "input": "applied"})
    assert adapted.law.adaptation.sees_applied
    assert adapted.values["leakage.Sigma"].tolist() == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0]
    assert loop(controller__adaptation={"gain": 1.0, "normalization": 0.7}).values["normalization.weight"] == [0.7]
    assert loop(controller__adaptation=None, controller__projection=None).law.adaptation is None


def test_a_plain_bound_holds_for_the_estimates_that_enter_the_determinant() -> None:
    """Remark 7; bounds by name hold for those that are named, and nothing bounds without a table."""
    guarded = MODEL.findings["determinant_parameters"]
    plain = loop(controller__projection={"lower": 0.01}).law.adaptation.projection
    assert [name for name, low in zip(THETAS, plain.lower, strict=True) if low == 0.01] == guarded
    assert np.isinf(plain.lower).sum() == len(THETAS) - len(guarded)
    assert np.all(plain.upper == np.inf)
    named = loop(
        controller__projection={"lower": {THETAS[1]: 0.01}, "upper": {THETAS[0]: 1e3}}
    ).law.adaptation.projection
    np.testing.assert_array_equal(named.lower, [-np.inf, 0.01] + [-np.inf] * 4)
    np.testing.assert_array_equal(named.upper, [1e3] + [np.inf] * 5)
    free = loop(controller__projection=None).law.adaptation.projection
    assert free.values == {}


def test_estimates_are_exact_guessed_or_given() -> None:
    """theta of the robot, theta of the guess, or what stands there."""
    p = MODEL.parameters(m_C=30.0, b=0.6)
    exact = loop(controller__guess=None).law.knowledge.theta_hat
    np.testing.assert_array_equal(exact, MODEL.base_parameters(p))
    guessed = loop(controller__guess={"m_C": 50.0}).law.knowledge.theta_hat
    np.testing.assert_array_equal(guessed, MODEL.base_parameters(MODEL.replaced(p, {"m_C": 50.0})))
    given = loop(controller__guess=None, controller__estimate=1.5).law.knowledge.theta_hat
    np.testing.assert_array_equal(given, np.full(6, 1.5))


def test_what_stands_under_shared_holds_for_those_who_do_not_say_otherwise() -> None:
    """A controller's own table replaces the shared one as a whole, and mistakes are reported where they stand."""
    shared = {"estimate": 2.0, "outer_loop": {"b1": 2.0, "b2": 1.0, "alpha": 0.3}}
    controllers = {"first": {}, "second": {"outer_loop": {"b1": 4.0, "b2": 2.0}, "estimate": "exact"}}
    experiment = validate(tables(shared=shared, controllers=controllers), Experiment, "one.toml")
    first, second = assemble(experiment, Path("one.toml")).values()
    assert (first.values["outer_loop.b1"][0], first.values["outer_loop.alpha"][0]) == (2.0, 0.3)
    assert (second.values["outer_loop.b1"][0], second.values["outer_loop.alpha"][0]) == (4.0, 0.5)
    np.testing.assert_array_equal(first.states["theta_hat"], np.full(6, 2.0))
    np.testing.assert_array_equal(second.states["theta_hat"], MODEL.base_parameters(second.plant.parameters))
    assert experiment.place("first", "estimate") == "[shared] estimate"
    assert experiment.place("second", "estimate") == "[controllers.second] estimate"
    assert experiment.place("second", "robust") == "[controllers.second] robust"


ADAPTIVE = {"adaptation": {"gain": 1.0}, "outer_loop": {"b1": 2.0, "b2": 1.0}}
MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "no outer loop": ({"controller__outer_loop": None}, r"\[controllers.AFL\] outer_loop: is missing"),
    "guess and estimate": ({"controller__estimate": 1.0}, r"\[controllers.AFL\] guess: stands beside an estimate"),
    "guess of a known one": ({"controller__guess": {"L": 0.1}}, r"guess: the controller knows L"),
    "guess of nothing": ({"controller__guess": {"mass": 0.1}}, r"unknown parameter of type_2_0 'mass'"),
    "guess that is impossible": ({"controller__guess": {"r": 0.0}}, r"guess: the radius of wheel 'right' is 0; choose"),
    "estimate of nothing": (
        {"controller__guess": None, "controller__estimate": {"theta9": 1.0}}, r"estimate: unknown base parameter"
    ),
    "bounds without adaptation": ({"controller__adaptation": None}, r"projection: bounds estimates that nothing"),
    "estimate beyond its bound": ({"controller__projection": {"lower": 1e6}}, r"projection: the first estimate of"),
    "bounds that leave nothing": (
        {"controller__projection": {"lower": 2.0, "upper": 1.0}}, r"projection: bounds .* leave nothing"
    ),
    "weights": ({"controller__input_weights": 0.0}, r"input_weights: input weights are"),
    "robust term": ({"controller__robust": {"gamma": 1.0, "mu_decay": 0.0}}, r"robust: with a constant mu"),
    "gain": ({"controller__adaptation": {"gain": -1.0}}, r"adaptation: the adaptation gain .* positive definite"),
    "leakage of nothing": (
        {"controller__adaptation": {"gain": 1.0, "leakage": {"theta9": 0.1}}}, r"adaptation: unknown base parameter"
    ),
    "output without reference": ({"reference": {"expressions": {"y1": "t"}}}, r"output 'y2' has no reference"),
    "reference of no output": (
        {"reference": {"expressions": {"y1": "t", "y2": "t", "y3": "t"}}}, r"\[reference.expressions\]: unknown output"
    ),
    "reference of another size": (
        {"reference": {"line": {"start": [1.0], "velocity": [1.0]}}}, r"\[reference.line\]: gives 1 coordinates for 2"
    ),
    "start of nothing": ({"start": {"z": 1.0}}, r"\[start\]: unknown state 'z'"),
    "parameter of nothing": ({"parameters": {"mass": 1.0}}, r"\[parameters\]: unknown parameter"),
    "negative mass": ({"parameters": {"m_C": -1.0}}, r"\[parameters\]: m_C = -1 kg is negative"),
    "robot": ({"robot": "type_9"}, r"robot: unknown model"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_reported_where_it_stands(mistake: str) -> None:
    """File, place, problem and remedy in one line."""
    changed, words = MISTAKES[mistake]
    with pytest.raises(InputError, match=words) as caught:
        loop(**changed)
    assert str(caught.value).startswith("one.toml: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"simulation": {"duration": 0.01, "sample_time": 0.02}}, "sample_time exceeds duration"),
        ({"simulation": {"duration": 1e6, "sample_time": 0.1}}, "1e.07 samples are too many"),
        ({"controllers": {}}, "controllers"),
        ({"controllers": {" ": {}}}, "no good name"),
        ({"controllers": {"a" * 61: {}}}, "no good name"),
        ({"controllers": {"a\tb": {}}}, "no good name"),
        ({"controllers": {"a b": {}, "a_b": {}}}, "would share files"),
        ({"controllers": {"AFL": {}, "afl": {}}}, "would share files"),
        ({"reference": {}}, "no or several trajectories"),
        ({"reference": {"line": {"start": [1.0], "velocity": [1.0, 2.0]}}}, "1 entries of start, 2 of velocity"),
    ],
)
def test_an_experiment_that_means_nothing_is_refused(changed: dict[str, Any], words: str) -> None:
    """Times, names of controllers and trajectories."""
    with pytest.raises(InputError, match=words):
        validate(tables(**changed), Experiment, "one.toml")


def test_numbers_at_the_edge_are_taken() -> None:
    """A run of one sample time, the longest run, a name of sixty characters."""
    assert SimulationTable(duration=0.02, sample_time=0.02).integrator == "euler"
    assert SimulationTable(duration=float(MOST_SAMPLES), sample_time=1.0).duration == MOST_SAMPLES
    validate(tables(controllers={"a" * 60: {}}), Experiment, "one.toml")
    assert file_name("robust AFL-2_é/") == "robust_AFL-2_é_"


def test_a_model_is_a_shipped_one_or_one_beside_the_file(tmp_path: Path) -> None:
    """By its name; a folder beside the file does not stand in for a shipped model of the same name."""
    for name in ("type_2_0", "mine"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "model.json").write_text("{}")
    for name, folder in (("type_2_0", MODEL.folder), ("mine", tmp_path / "mine")):
        assert model_of(validate(tables(robot=name), Experiment, "one.toml"), tmp_path / "one.toml") == folder


def test_an_experiment_is_assembled_again_only_if_its_file_has_changed(write) -> None:
    """The same objects, so that what was traced and compiled serves again."""
    path = write()
    first = load_experiment(path)
    assert load_experiment(path) is first
    path.write_text(path.read_text().replace("30.0", "31.0"))
    second = load_experiment(path)
    assert second is not first
    assert second.loops["AFL"].plant.parameters[list(MODEL.parameter_units).index("m_C")] == 31.0
    assert (second.name(), second.name("AFL")) == ("AFL", "AFL")
    with pytest.raises(UnknownNameError, match="unknown controller 'PID'"):
        second.name("PID")


def test_only_the_controllers_that_are_named_are_run(write) -> None:
    """All, one by its name, or several; progress counts their samples."""
    controllers = {name: {"outer_loop": {"b1": 2.0, "b2": 1.0}} for name in ("a", "b", "c")}
    path, seen = write(controllers=controllers), []
    assert list(wmr_afl.run(path)) == ["a", "b", "c"]
    assert list(wmr_afl.run(path, controllers="b")) == ["b"]
    assert list(wmr_afl.run(path, controllers=["c", "a"])) == ["c", "a"]
    wmr_afl.run(path, "numpy", ["a"], lambda *one: seen.append(one))
    assert seen == [("a", done, 11) for done in range(1, 12)]
    with pytest.raises(UnknownNameError, match="controller 'd'"):
        wmr_afl.run(path, controllers=["a", "d"])


@pytest.mark.parametrize("sees", ["commanded", "applied"])
def test_a_controller_on_the_robot_adapts_at_the_input_that_the_file_names(sees: str, write) -> None:
    """It returns limited voltages, and its law is that of the simulator with the same measurements."""
    drive = {"input_limits": {"volts": 1.0}}
    path = write(controller__adaptation={"relative_gain": 0.1, "input": sees}, uncertainties=drive)
    run, controller = wmr_afl.run(path, "numpy")["AFL"], Controller.from_experiment(path)
    for k in range(len(run.time) - 1):
        np.testing.assert_allclose(controller.update(run.time[k], run.state[k]), run.input[k], rtol=1e-9)
        np.testing.assert_allclose(controller.estimate, run.estimate[k + 1], rtol=1e-9)
    assert np.abs(run.command - run.input).max() > 0.1


@pytest.mark.parametrize(
    ("own", "drive", "expected"),
    [(None, None, None), (3.0, None, 3.0), (None, 24.0, 24.0), (3.0, 24.0, 3.0), (None, [24.0, 5.0], 5.0)],
)
def test_a_law_stays_within_its_own_limit_or_else_that_of_the_drive(own: Any, drive: Any, expected: Any) -> None:
    """The lowest one of the motors; without either there is none."""
    controller = {"law": "composite", "reference_rate": 2.0, "guess": {"m_C": 25.0}, **({"limit": own} if own else {})}
    drives = {"uncertainties": {"input_limits": {"volts": drive}}} if drive else {}
    found = loop(controllers={"AFL": controller}, **drives)
    assert found.values.get("effort.limit") == expected


@pytest.mark.parametrize("law", ["linearizing", "composite", "direct", "frozen"])
@pytest.mark.parametrize("samples", [0, 1, 3])
def test_commands_under_way_are_remembered_if_the_drive_is_late(samples: int, law: str) -> None:
    """By each law that observes, but for the linearizing one, which expects what the applied voltages do."""
    controller = {
        "law": law,
        "measures": "pose",
        **({"outer_loop": {"bandwidth": 9.0}} if law == "linearizing" else {}),
    }
    drive = {"uncertainties": {"input_delay": {"seconds": 0.02 * samples}}} if samples else {}
    found = loop(controllers={"AFL": controller}, **drive).law.states
    sizes = {name: value.size for name, value in found.items() if name.startswith("under_way.")}
    remembered = {"under_way.accelerations": 2 * samples, "under_way.removed": 2 * samples}
    assert sizes == (remembered if samples and law != "linearizing" else {})


@pytest.mark.parametrize("law", ["linearizing", "composite", "direct", "frozen"])
@pytest.mark.parametrize(
    ("table", "observer"),
    [
        ({}, None),
        ({"measures": "pose"}, "PoseObserver"),
        ({"measures": "pose", "observer": {"kind": "kalman"}}, "KalmanObserver"),
        ({"observer": {"kind": "kalman"}}, "KalmanObserver"),
        ({"observer": {"kind": "pose"}}, "PoseObserver"),
    ],
)
def test_the_state_is_measured_or_observed_as_the_file_says(table: dict, observer: str | None, law: str) -> None:
    controller = {"law": law, **({"outer_loop": {"bandwidth": 9.0}} if law == "linearizing" else {}), **table}
    found = loop(controllers={"AFL": controller}).law.sight.observer
    assert (None if found is None else type(found).__name__) == observer
