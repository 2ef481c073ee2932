"""Whatever is changed in a model's folder, each call answers in one line, or as if nothing had been changed."""

import contextlib
import io
import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS, ROOT
from tests.fuzzing import SEED, budget, stream
from tests.wmr_afl.junk import answered
from tests.wmr_afl.model.mutations import mutated, places
from tests.wmr_afl.model.sealing import sealed
from wmr_afl import InputError, WmrError, load_model
from wmr_afl.cli import app
from wmr_afl.model.metadata import damage

COUNT = budget(500)
ROBOT = "type_2_0"
EXPERIMENT = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 0.1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of a user's own with an experiment beside it."""
    made = tmp_path_factory.mktemp("tampered")
    shutil.copytree(ROOT / "generated" / ROBOT, made / "mine")
    (made / "short.toml").write_text(EXPERIMENT.replace(f'robot = "{ROBOT}"', 'robot = "./mine"'))
    return made


def called(model_folder: Path, library: str) -> None:
    """Every function of a model once, with zeros."""
    model = load_model(model_folder, library)  # type: ignore[arg-type]
    p, entries = model.parameters(), model._entries()
    for name, entry in model.metadata["functions"].items():
        given = [p if argument == "p" else np.zeros(len(entries[argument])) for argument in entry["arguments"]]
        with np.errstate(all="ignore"):
            getattr(model, name)(*given)
        assert getattr(model, name).__doc__
    model.trusted_values()


def verb(*arguments: object) -> Callable[[], None]:
    """The command line in this process; its error as an exception."""

    def act() -> None:
        output, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            status = app([*map(str, arguments)], standalone_mode=False) or 0
        said = [line for line in errors.getvalue().splitlines() if not line.startswith("warning: ")]
        assert (status in (0, 1) and not said) or (status == 2 and len(said) == 1), (status, said)
        if status == 2:
            raise WmrError(*said[0].removeprefix("error: ").rsplit("; ", 1))

    return act


def acts(folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """What people do with a model."""
    out = folder / "out"
    yield "numpy", lambda: called(folder / "mine", "numpy")
    yield "casadi", lambda: called(folder / "mine", "casadi")
    yield "show", verb("show", folder / "mine")
    yield "check", verb("check", folder / "mine")
    yield "run", lambda: wmr_afl.run(folder / "short.toml", "numpy", "AFL")
    yield "simulate", verb("simulate", folder / "short.toml", "--out", out, "--controller", "AFL", "--backend", "numpy")
    yield (
        "animate",
        verb("animate", folder / "short.toml", "--out", out / "a.gif", "--seconds", "0.1", "--backend", "numpy"),
    )


def answer(what: str, act: Callable[[], object]) -> str:
    """The one line in which a call ends, empty if it works."""
    return answered(what, act)[1]


@pytest.mark.filterwarnings("ignore")
def test_no_change_of_model_json_gives_a_traceback(folder: Path) -> None:
    """Each entry is changed in turn; those that load are used in every way, the slow ways now and then."""
    chosen, path = stream("model.json"), folder / "mine" / "model.json"
    whole = json.loads((ROOT / "generated" / ROBOT / "model.json").read_text())
    keys = places(whole)
    chosen.shuffle(keys)
    refused = 0
    for number in range(COUNT):
        content, what = mutated(whole, chosen, keys[number % len(keys)])
        path.write_text(json.dumps(content))
        ways = list(acts(folder))
        first = answer(f"{SEED}:{number} {what}: {ways[0][0]}", ways[0][1])
        refused += bool(first)
        if first:
            assert str(path) in first or "numpy_model.py" in first or "trusted_values" in first, first
        later = ways[1:] if number % 20 == 0 else [] if first else ways[1:3]
        for name, act in later:
            answer(f"{SEED}:{number} {what}: {name}", act)
    assert refused > COUNT // 3


@pytest.mark.filterwarnings("ignore")
def test_no_change_of_trusted_values_gives_a_traceback(folder: Path) -> None:
    """Also if the digests are brought up to date."""
    shutil.copy(ROOT / "generated" / ROBOT / "model.json", folder / "mine" / "model.json")
    chosen, path = stream("trusted values"), folder / "mine" / "trusted_values.json"
    whole = json.loads((ROOT / "generated" / ROBOT / "trusted_values.json").read_text())
    for number in range(COUNT // 50):
        content, what = mutated(whole, chosen)
        path.write_text(json.dumps(content))
        assert "is not the one that was derived" in answer(what, lambda: load_model(folder / "mine").trusted_values())
        sealed(folder / "mine")
        answer(f"{SEED}:{number} {what}: check", verb("check", folder / "mine"))
    shutil.copy(ROOT / "generated" / ROBOT / "trusted_values.json", path)
    sealed(folder / "mine")


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("title",), "a" * 301),
        (("title",), "a\nb"),
        (("name",), "a" * 5000),
        (("name",), "a/b"),
        (("source",), "\x1b[31m"),
        (("state",), {"v": "m/s", "omega": "rad/s"}),
        (("functions", "output", "arguments"), ["c", "q"]),
        (("functions", "output", "size"), [3]),
        (("functions", "parameters"), {"arguments": [], "shape": [], "size": [], "equation": "", "meaning": ""}),
        (("geometry", "frames"), {}),
        (("geometry", "wheels", "right", "frame"), "nowhere"),
        (("passivity_groups", 0, "parameters", 0), "pi99"),
        (("slip_rows",), []),
        (("slip_rows",), [{"wheel": "right", "direction": "sideways"}]),
        (("slip_rows", 0), {"wheel": "right", "direction": "up"}),
        (("slip_rows", 0), {"wheel": "right", "direction": "sideways", "motor": "u_r"}),
        (("slip_rows", 0, "wheel"), "fifth"),
        (("slip_rows", 2), {"joint": "platform", "motor": "u_l"}),
        (("findings", "determinant_parameters"), ["theta9"]),
        (("defaults", "r"), float("nan")),
        (("defaults", "r"), "0.15"),
        (("findings", "degree_of_mobility"), "2"),
        (("findings", "controllable"), 1),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, place: tuple[str | int, ...], value: object) -> None:
    shutil.copytree(ROOT / "generated" / ROBOT, tmp_path / "mine")
    path = tmp_path / "mine" / "model.json"
    content = json.loads(path.read_text())
    holder = content
    for key in place[:-1]:
        holder = holder[key]
    holder[place[-1]] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="derive the robot again") as caught:
        load_model(tmp_path / "mine")
    said = str(caught.value).removeprefix(caught.value.file)
    assert not set(place).isdisjoint(re.findall(r"\w+", said))


def test_every_shipped_model_is_whole(robot: str) -> None:
    assert damage(json.loads((ROOT / "generated" / robot / "model.json").read_text())) is None
