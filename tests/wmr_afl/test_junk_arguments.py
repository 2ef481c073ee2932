"""Whatever is handed to a public function, it answers in finite numbers or in one line with a remedy."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from tests.fuzzing import SEED, budget, stream
from tests.wmr_afl.identification.logs import GEOMETRY, small_drive
from tests.wmr_afl.junk import answered, is_finite, junk, shown
from wmr_afl import CampaignResult, Controller, Log, Model, Run
from wmr_afl.analysis import animation, files, plots
from wmr_afl.controllers.live_reference import LiveReference, ReferenceBuffer
from wmr_afl.controllers.path import along
from wmr_afl.controllers.pieces import Pieces
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.sampled import Sampled
from wmr_afl.controllers.waypoints import Waypoints

SHORT = (
    (EXPERIMENTS / "study_1.toml")
    .read_text()
    .replace("duration = 140.0", "duration = 0.1")
    .replace("since = 100.0", "since = 0.04")
    .replace("[shared] ", "[uncertainties]\nmeasurement_noise = { deviation = 0.001 }\n[shared] ")
)
STATE = [15.0, 25.0, 0.3, 0.4, 0.05]


@dataclass(frozen=True)
class World:
    """What right calls take."""

    experiment: Path
    model: Model
    columns: Model  # the same in CasADi
    run: Run
    drawn: CampaignResult
    controller: Controller
    log: Log


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Study 1 for five samples, with noise."""
    file = tmp_path_factory.mktemp("world") / "short.toml"
    file.write_text(SHORT)
    return World(
        file,
        wmr_afl.load_model("type_2_0"),
        wmr_afl.load_model("type_2_0", "casadi"),
        wmr_afl.run(file, "casadi", "AFL")["AFL"],
        wmr_afl.campaign(file, 4, backend="casadi"),
        Controller.from_experiment(file),
        small_drive(4.0),
    )


def pushed() -> ReferenceBuffer:
    """A buffer that holds a setpoint."""
    buffer = ReferenceBuffer(["y1"])
    buffer.push(0.0, [1.0], [0.5])
    return buffer


Usual = Callable[[World], dict[str, Any]]
CALLS: dict[str, tuple[Callable[..., Any], Usual]] = {  # public function -> itself, and arguments that are right
    "load_model": (wmr_afl.load_model, lambda w: {"name": "type_2_0"}),
    "Model": (Model, lambda w: {"folder": w.model.folder}),
    "Model.replaced": (Model.replaced, lambda w: {"self": w.model, "p": w.model.parameters(), "changes": {"m_C": 1.0}}),
    "Model.known": (Model.known, lambda w: {"self": w.model}),
    "Model.has": (Model.has, lambda w: {"self": w.model}),
    "Model.in_library": (Model.in_library, lambda w: {"self": w.model}),
    "derive": (wmr_afl.derive, lambda w: {"description": "nowhere.toml"}),
    "run": (wmr_afl.run, lambda w: {"experiment": w.experiment, "backend": "casadi"}),
    "run_batch": (
        wmr_afl.run_batch,
        lambda w: {"experiment": w.experiment, "backend": "casadi", "scale": {"m_C": [1.0, 1.1]}},
    ),
    "campaign": (wmr_afl.campaign, lambda w: {"experiment": w.experiment, "backend": "casadi", "runs": 3}),
    "compare": (wmr_afl.compare, lambda w: {"experiment": w.experiment, "backend": "casadi", "runs": 2}),
    "replay": (wmr_afl.replay, lambda w: {"experiment": w.experiment, "backend": "casadi", "index": 3}),
    "Run.rms": (Run.rms, lambda w: {"self": w.run}),
    "Run.largest_error": (Run.largest_error, lambda w: {"self": w.run}),
    "CampaignResult.success_rate": (CampaignResult.success_rate, lambda w: {"self": w.drawn}),
    "CampaignResult.quantiles": (CampaignResult.quantiles, lambda w: {"self": w.drawn}),
    "CampaignResult.worst": (CampaignResult.worst, lambda w: {"self": w.drawn}),
    "CampaignResult.describe": (CampaignResult.describe, lambda w: {"self": w.drawn}),
    "Controller": (
        Controller,
        lambda w: {name: getattr(w.controller, name) for name in ("model", "law", "reference", "sample_time")},
    ),
    "Controller.from_experiment": (Controller.from_experiment, lambda w: {"experiment": w.experiment}),
    "Controller.load_state": (Controller.load_state, lambda w: {"self": w.controller}),
    "Controller.update": (Controller.update, lambda w: {"self": w.controller, "t": 0.02, "x": STATE}),
    "excite": (
        wmr_afl.excite,
        lambda w: {"robot": w.model, "volts": 9.0, "room": 2.0, "seconds": 4.0, "frequencies": [0.5]},
    ),
    "identify": (wmr_afl.identify, lambda w: {"robot": w.model, "logs": w.log, "parameters": GEOMETRY}),
    "validate": (wmr_afl.validate, lambda w: {"robot": w.model, "count": 2, "seconds": 0.2}),
    "export": (wmr_afl.export, lambda w: {"experiment": w.experiment, "is_unlimited": True, "samples": 2}),
    "Reference": (Reference, lambda w: {"expressions": {"y1": "t"}}),
    "Reference.ordered": (Reference.ordered, lambda w: {"self": w.controller.reference}),
    "Reference.at": (Reference.at, lambda w: {"self": w.controller.reference}),
    "Reference.over": (Reference.over, lambda w: {"self": w.controller.reference}),
    "Waypoints": (Waypoints, lambda w: {"times": [0.0, 1.0], "values": {"y1": [0.0, 1.0]}}),
    "along": (along, lambda w: {"points": {"y1": [0.0, 1.0], "y2": [0.0, 0.5]}, "speed": 1.0, "acceleration": 1.0}),
    "Sampled": (Sampled, lambda w: {"outputs": ["y1"], "yr": lambda t: 2.0 * t, "duration": 1.0, "step": 0.1}),
    "Pieces": (Pieces, lambda w: {"pieces": [(w.controller.reference, 1.0)]}),
    "Pieces.over": (Pieces.over, lambda w: {"self": Pieces([(w.controller.reference, 1.0)])}),
    "Pieces.at": (Pieces.at, lambda w: {"self": Pieces([(w.controller.reference, 1.0)])}),
    "LiveReference": (LiveReference, lambda w: {"outputs": ["y1"]}),
    "ReferenceBuffer": (ReferenceBuffer, lambda w: {"outputs": ["y1"]}),
    "ReferenceBuffer.push": (
        ReferenceBuffer.push,
        lambda w: {"self": ReferenceBuffer(["y1"]), "t": 0.0, "position": [1.0], "velocity": [0.0]},
    ),
    "ReferenceBuffer.at": (ReferenceBuffer.at, lambda w: {"self": pushed(), "t": 0.5}),
    "animate": (animation.animate, lambda w: {"run": w.run, "path": "run.gif"}),
    "write_results": (files.write_results, lambda w: {"runs": {"AFL": w.run}, "folder": Path("out")}),
    "overview": (plots.overview, lambda w: {"runs": {"AFL": w.run}, "title": "a title"}),
    "save": (plots.save, lambda w: {"figure": plots.new_figure(1.0, 1.0), "stem": Path("figure")}),
}
NOT_CALLED = {
    "Identified",
    "Validation",
    "Log",
    "BatchResult",
    "CampaignResult",
    "Diagnostics",
    "Run",
    "Failure",
    "list_models",
    "list_experiments",
}  # results; no argument
SLOW = {
    "animate": 2,
    "overview": 2,
    "save": 5,
    "excite": 4,
    "identify": 4,
    "validate": 2,
}  # calls that draw or search -> how often in the suite
ROUNDS = 10  # of the others, for each argument
ARITHMETIC = ("Reference.at", "Reference.over", "Pieces.at", "Pieces.over")  # where what is not finite goes through
NOT_THE_PRODUCTS = {  # a function raises what it likes, a scheduler is looked for in the network
    "progress": callable,
    "scheduler": lambda given: isinstance(given, str) and given != "",
}


def arguments_of(function: Callable[..., Any]) -> list[str]:
    """The names of the arguments that may be junk."""
    called = function.__init__ if isinstance(function, type) else function  # type: ignore[misc]
    return [name for name in inspect.signature(called).parameters if name != "self"]


def batch(place: str, name: str, world: World, given: Any) -> object:
    """Junk for one number of all robots, or as that of two robots."""
    numbers = given if isinstance(given, list | np.ndarray) else [given, given]
    return wmr_afl.run_batch(world.experiment, backend="casadi", **{place: {name: numbers}})


def updated(world: World, given: Any) -> object:
    """Two updates, the second with one junk measurement; then the controller's own numbers."""
    world.controller.reset()
    world.controller.update(0.0, STATE)
    try:
        return world.controller.update(0.02, [15.0, given, *STATE[2:]])
    finally:
        assert is_finite(world.controller.state_dict())


DEEPER: dict[str, Callable[[World, Any], object]] = {  # junk inside of what is right
    "Model.parameters m_C": lambda w, given: w.model.parameters(m_C=given),
    "Model.parameters m_C and r": lambda w, given: w.model.parameters(m_C=given, r=[0.1, 0.2]),
    "Model attribute": lambda w, given: getattr(w.model, given) if isinstance(given, str) else None,
    "Reference y1": lambda w, given: Reference({"y1": given}),
    "Waypoints y1": lambda w, given: Waypoints([0.0, 1.0], {"y1": given}),
    "Sampled yr": lambda w, given: Sampled(["y1"], lambda t: given, 1.0, step=0.1),
    "Sampled yr1": lambda w, given: Sampled(["y1"], lambda t: t, 1.0, yr1=lambda t: given, step=0.1),
    "a duration of Pieces": lambda w, given: Pieces([(w.controller.reference, given)]),
    "a piece of Pieces": lambda w, given: Pieces([(w.controller.reference, 1.0), given]),
    "Controller.update x": updated,
    "Controller.load_state theta_hat": lambda w, given: w.controller.load_state({"theta_hat": given}),
    **{
        f"run_batch {place} {name}": partial(batch, place, name)
        for place, name in (
            ("parameters", "m_C"),
            ("start", "x"),
            ("values", "b1"),
            ("values", "Gamma"),
            ("values", "projection.lower"),
            ("values", "measurement_noise.deviation"),
            ("scale", "m_C"),
            ("scale", "Gamma"),
        )
    },
}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_every_public_name_that_can_be_called_is_called() -> None:
    named = {name.partition(".")[0] for name in CALLS} | NOT_CALLED
    for name in wmr_afl.__all__:
        thing = getattr(wmr_afl, name)
        is_error = isinstance(thing, type) and issubclass(thing, Exception)
        assert name in named or is_error or not callable(thing), name


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
@pytest.mark.parametrize(
    ("name", "argument"), [(name, argument) for name, (call, _) in CALLS.items() for argument in arguments_of(call)]
)
def test_a_junk_argument_is_answered(world: World, name: str, argument: str) -> None:
    chosen, (function, usual) = stream(f"{name} {argument}"), CALLS[name]
    for number in range(budget(SLOW.get(name, ROUNDS))):
        given = junk(chosen)
        if NOT_THE_PRODUCTS.get(argument, lambda given: False)(given):
            continue
        what = f"{SEED}:{number} {name}, {argument} = {shown(given)}"
        world.controller.reset()
        found, _ = answered(what, partial(function, **{**usual(world), argument: given}))
        assert is_finite(found) or name in ARITHMETIC, what


@pytest.mark.filterwarnings("ignore::wmr_afl.SimulationWarning")
@pytest.mark.parametrize("name", DEEPER)
def test_junk_inside_of_a_right_argument_is_answered(world: World, name: str) -> None:
    chosen = stream(name)
    for number in range(budget(ROUNDS)):
        given = junk(chosen)
        what = f"{SEED}:{number} {name} = {shown(given)}"
        assert is_finite(answered(what, partial(DEEPER[name], world, given))[0]), what


@pytest.mark.parametrize("library", ["model", "columns"])
def test_a_generated_function_answers_junk(world: World, library: str) -> None:
    """What is not finite goes through, as NumPy lets it: then only the kind of answer is looked at."""
    chosen, model = stream(library), getattr(world, library)
    right = {name: np.ravel(value) for name, value in model.trusted_values()["arguments"].items()}
    for number in range(budget(300)):
        name = chosen.choice(sorted(model.functions()))
        names = model.metadata["functions"][name]["arguments"]
        argument, given = chosen.choice(names), junk(chosen)
        call = partial(getattr(model, name), **{**{one: right[one] for one in names}, argument: given})
        with np.errstate(all="ignore"):
            answered(f"{SEED}:{number} {name}, {argument} = {shown(given)}", call)


FOUND: dict[str, tuple[str, str, Any]] = {  # what was found: function, argument, junk
    "no text for a name": ("load_model", "name", [1.0]),
    "a number for an experiment": ("run", "experiment", 3),
    "a list for a backend": ("run", "backend", ["numpy"]),
    "numbers for names": ("run", "controllers", np.array([1.0, 2.0])),
    "text for a table": ("run_batch", "scale", "m_C"),
    "an array for a table": ("run_batch", "parameters", np.ones(3)),
    "two numbers for each robot": ("run_batch", "parameters", {"m_C": [[1.0, 2.0], [1.0, 2.0]]}),
    "an integer beyond floating point": ("run_batch", "start", {"x": 10**400}),
    "complex numbers": ("run_batch", "start", {"x": np.array([1 + 2j, 3])}),
    "a name of two lines": ("run_batch", "values", {"a\nb": "x"}),
    "a seed beyond 63 bits": ("run_batch", "seeds", 2**63),
    "a zero byte in a path": ("run_batch", "trajectories", "a\0b"),
    "a zero byte in the path of a folder": ("campaign", "out", "a\0b"),
    "a zero byte in the path of a picture": ("animate", "path", "a\0b.gif"),
    "robots in several numbers": ("run_batch", "seeds", [1, 2, 3]),
    "a gain without a remedy": ("run_batch", "values", {"Gamma": 0.0}),
    "an array for a time": ("run_batch", "since", np.zeros(2)),
    "text for threads": ("campaign", "threads", "2"),
    "no truth value": ("campaign", "fresh", np.zeros(2)),
    "one number for p": ("Model.replaced", "p", 7),
    "a list for changes": ("Model.replaced", "changes", [1.0]),
    "rows for a time": ("Run.rms", "since", np.zeros((2, 5))),
    "a confidence above 1": ("CampaignResult.success_rate", "confidence", 7),
    "a level above 1": ("CampaignResult.quantiles", "levels", [7.0]),
    "no levels": ("CampaignResult.quantiles", "levels", np.zeros((2, 0))),
    "a run that there is not": ("CampaignResult.describe", "index", 99),
    "no number of a run": ("CampaignResult.describe", "index", None),
    "a state that is not finite": ("Controller.update", "x", [np.nan] * 5),
    "a time beyond floating point": ("Controller.update", "t", 10**400),
    "no table of states": ("Controller.load_state", "state", [1.0]),
    "no reference": ("Controller", "reference", {"y1": "t"}),
    "no drive": ("Controller", "drive", np.zeros(2)),
    "numbers for expressions": ("Reference", "expressions", {"y1": 1.0}),
    "numbers for outputs": ("Reference.ordered", "outputs", np.zeros(2)),
    "a table for a time": ("Reference.at", "t", {}),
    "None among times": ("Reference.over", "times", [0.0, None]),
    "a text for a folder": ("write_results", "folder", "out"),
    "no run to draw": ("overview", "runs", {}),
    "a name of a file in two lines": ("animate", "path", "a\nb"),
}


@pytest.mark.parametrize("found", FOUND)
def test_what_was_found_is_refused_in_one_line(world: World, found: str) -> None:
    name, argument, given = FOUND[found]
    function, usual = CALLS[name]
    assert answered(found, partial(function, **{**usual(world), argument: given}))[1]
