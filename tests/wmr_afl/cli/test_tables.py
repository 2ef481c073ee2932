"""What tables and lines of the command line hold, for runs, campaigns and models that are made by hand."""

import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.main import get_command
from typer.testing import CliRunner

from tests.wmr_afl.experiments.campaigns.handmade import INF, NAN, result
from wmr_afl import load_model
from wmr_afl.analysis import feasibility
from wmr_afl.analysis.feasibility import Demand, Doubt
from wmr_afl.cli import app, campaigns, checks, progress, show, terminal
from wmr_afl.experiments.distributions import SuccessTable
from wmr_afl.simulation.conditions import Condition
from wmr_afl.simulation.result import Failure, Run

MODEL = load_model("type_2_0")
VERBS = {"models", "show", "derive", "check", "animate", "simulate", "reproduce", "campaign"}


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are not wrapped; lines of errors are as long as they are."""
    monkeypatch.setattr(terminal.console, "_width", 400)
    monkeypatch.setattr(terminal.errors, "_width", 60)


def run(**changed: Any) -> Run:
    """A run of 70 s whose errors are 3 m and 4 m in its first half and a tenth of it later."""
    time = np.arange(71.0)
    error = np.where(time[:, None] < 35.0, 1.0, 0.1) * [3.0, -4.0]
    usual = {
        "controller": "AFL", "model": MODEL, "time": time, "state": np.zeros((71, 5)), "input": np.full((71, 2), -7.25),
        "command": np.zeros((71, 2)), "error": error, "estimate": np.ones((71, 6)), "reference": np.zeros((71, 2)),
        "parameters": MODEL.parameters(), "known": MODEL.known(MODEL.parameters()),
    }  # fmt: skip
    return Run(**{**usual, **changed})


def printed(part: Any) -> str:
    """A part of the output as plain text."""
    console = Console(width=400, no_color=True)
    with console.capture() as captured:
        console.print(part, highlight=False)
    return captured.get()


def cells(line: str) -> list[str]:
    """The cells of a line of a table."""
    plain = line.replace("│", "  ").replace("┃", "  ")
    return [cell.strip() for cell in plain.split("  ") if cell.strip()]


def test_a_table_of_metrics_has_a_line_for_each_run(capsys: pytest.CaptureFixture[str]) -> None:
    """Errors, those once it has settled, and the largest input; of a run that failed its cause instead."""
    failed = run(failure=Failure(1.5, "diverged [in red]"), controller="[PID]")
    progress.print_metrics("a [title]", {"AFL": run(), "[PID]": failed, "none": run(failure=Failure(0.0, "at once"))})
    lines = [cells(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["a [title]"]
    table = {line[0]: line[1:] for line in lines if line}
    rms = ", ".join(f"{value:.3g}" for value in run().rms())
    assert table["AFL"] == [rms, "0.3, 0.4", "7.25 V"]
    assert "RMS error since 50 s" in table["controller"]
    assert table["[PID]"] == ["-", "-", "7.25 V", "stopped at t = 1.5 s: diverged [in red]"]
    assert table["none"][-1] == "stopped at t = 0 s: at once"


def test_each_sign_of_doubt_is_a_line_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    """On the error stream, with the run that it is about, however long it is."""
    long = "[bold] of " + "many words " * 20
    progress.print_metrics("title", {"[one]": run(warnings=(long.strip(), "short")), "two": run(warnings=("other",))})
    found = capsys.readouterr().err.splitlines()
    assert found == [f"warning: [one]: {long.strip()}", "warning: [one]: short", "warning: two: other"]


def test_a_campaign_is_told_in_success_quantiles_and_worst_runs() -> None:
    """A line for each quantity and each of the worst runs, with what it drew; causes with their numbers."""
    found = result(
        [[0.1, 0.2], [0.3, 0.1], [NAN, NAN], [0.5, 0.4]], [NAN, NAN, 7.5, NAN], success=SuccessTable(rms=0.4)
    )
    parts = [printed(part) for part in campaigns.tables(found)]
    lines = [line.strip() for line in "".join(parts).splitlines()]
    assert lines[0] == "4 runs of AFL, seed 3"
    rate, low, high = found.success_rate()
    confidence = f"{rate:.2%}, with 95 % confidence {low:.2%} to {high:.2%}"
    assert lines[1] == f"success (did not fail, rms at most 0.4): {confidence}"
    assert lines[2] == "failed 1: diverged"
    table = {row[0]: row[1:] for row in map(cells, lines) if row}
    for name, quantiles in found.quantiles().items():
        assert table[name] == [f"{value:.3g}" if np.isfinite(value) else "failed" for value in quantiles]
    worst = [int(row[0]) for row in map(cells, lines) if len(row) == 3 and row[0].isdigit()]
    assert worst == found.worst(campaigns.SHOWN).tolist()
    assert table["2"] == ["failed at 7.5 s", "start.x = 0.6667"]
    assert table["3"] == ["RMS error 0.5", "start.x = 1"]


def test_controllers_are_compared_in_a_line_each() -> None:
    """Rates with their bounds, quantiles of the error or that such a run failed, and then the causes of failures."""
    good = result([[0.1, 0.2], [0.3, 0.1], [0.5, 0.4]], [NAN, NAN, NAN])
    bad = result([[0.1, 0.2], [INF, INF], [INF, INF]], [NAN, 7.5, 2.0])
    parts = [printed(part) for part in campaigns.comparison({"good": good, "[bad]": bad})]
    lines = [line.strip() for line in "".join(parts).splitlines()]
    assert lines[0] == "3 runs, seed 3, the same draws for each; bounds hold with 95 % confidence"
    table = {row[0]: row[1:] for row in map(cells, lines) if row}
    for name, one in (("good", good), ("[bad]", bad)):
        rates = [[100.0 * share for share in rate] for rate in (one.failure_rate(), one.success_rate())]
        shares = [f"{share:.1f} ({low:.1f}-{high:.1f})" for share, low, high in rates]
        assert table[name] == [*shares, *(["0.3", "0.5", "0.5"] if name == "good" else ["failed"] * 3)]
    assert lines[-1] == "[bad] failed 2: diverged"
    assert not [line for line in lines if line.startswith("good failed")]


@pytest.mark.parametrize("count", range(7))
def test_of_many_rows_three_lines_are_listed_that_account_for_all(count: int) -> None:
    """All of them up to three; then the first ones, and how many more there are."""
    rows = [f"row {number}" for number in range(count)]
    lines = show._listed(rows, "a ").splitlines()
    assert len(lines) == min(count, 3)
    listed = [line for line in lines if line.startswith("a row")]
    assert listed == [f"a {row}" for row in rows[: len(listed)]]
    if count > 3:
        assert lines[-1] == f"and {count - len(listed)} more, see model.json"
        assert len(listed) == 2
    else:
        assert len(listed) == count


@pytest.mark.parametrize("lines", [1, 2, 3])
def test_a_long_text_is_cut_off_where_its_lines_end(lines: int) -> None:
    """One that fits stays; a longer one says where the whole is."""
    longest = lines * (400 - 25) - (lines - 1) * 10
    assert show._short("x" * longest, lines) == "x" * longest
    cut = show._short("x" * (longest + 1), lines)
    assert cut == "x" * (longest - 25) + "... (see model.json)"
    assert len(cut) <= longest


def test_what_can_be_adapted_is_told_of_each_robot(robot: str) -> None:
    """In how many parameters for each group, and whether the paper's law can, too."""
    model = load_model(robot)
    sizes = " + ".join(str(len(group["parameters"])) for group in model.metadata["passivity_groups"])
    expected = f"composite and direct laws in {sizes} parameters pi, apart by motor factors"
    assert show._adaptation(model) == expected + (", the paper's in theta" if model.has("regressor") else "")


def test_why_nothing_can_be_adapted_is_told() -> None:
    """The obstacle, or that there is nothing to track."""
    terms: dict[str, Any] = {"metadata": {"passivity_obstacle": "motors differ"}, "output_units": {"y": "m"}}
    none = SimpleNamespace(has=lambda term: False, **terms)
    assert show._adaptation(none) == "none of the composite law: motors differ"  # type: ignore[arg-type]
    blind = SimpleNamespace(has=lambda term: True, output_units={}, units_of=lambda kind: {"a": "kg", "b": "kg"})
    expected = "none without outputs; R u = Y pi is linear in 2 parameters"
    assert show._adaptation(blind) == expected  # type: ignore[arg-type]


class Alone:
    """A model without outputs and what a controller needs of them."""

    metadata, findings = MODEL.metadata, MODEL.findings

    def __getattr__(self, name: str) -> Any:
        return {} if name == "output_units" else getattr(MODEL, name)

    def has(self, term: str) -> bool:
        return term != "decoupling_matrix" and MODEL.has(term)


@pytest.mark.parametrize(("model", "is_alone"), [(MODEL, False), (Alone(), True)])
def test_of_a_model_alone_it_is_told_that_there_is_nothing_to_control(model: Any, is_alone: bool) -> None:
    table = {row[0]: row[1:] for row in map(cells, "".join(map(printed, show.describe(model))).splitlines()) if row}
    assert (table.get("controller") == ["none: the description wants the model alone"]) == is_alone
    assert ("singular where" in table) == ("internal coordinates" in table) == (not is_alone)
    assert (table["outputs"] == ["none"]) == is_alone


@pytest.mark.parametrize("limited", [{}, {"fork": ["-0.6", "0.6"]}, {"fork": ["-0.6", "0.6"], "arm": ["0", "a/2"]}])
def test_limits_are_told_of_the_joints_that_have_them(limited: dict[str, list[str]]) -> None:
    """On one line."""
    frames = {"body": {}, **{name: {"limits": limits} for name, limits in limited.items()}}
    model = Alone()
    model.metadata = MODEL.metadata | {"geometry": MODEL.metadata["geometry"] | {"frames": frames}}
    facts = "".join(map(printed, show.describe(model)))  # type: ignore[arg-type]
    table = {row[0]: row[1:] for row in map(cells, facts.splitlines()) if row}
    told = ", ".join(f"{name}: {low} to {high} rad" for name, (low, high) in limited.items())
    assert table.get("limits of joints") == ([told] if limited else None)


@pytest.mark.parametrize("doubts", [(), (Doubt("the reference [y1] jumps", 1.0, 1.0), Doubt("too fast", 2.0, 3.5))])
def test_a_reference_is_doubtful_if_anything_is(doubts: tuple[Doubt, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """A line for each motor and for each doubt; a script hears of it by the status."""
    limits, friction = {"u_r": 24.0, "u_l": np.inf}, {"right": 0.25, "left": 0.5}
    demand = Demand({"u_r": 7.25, "u_l": 30.0}, limits, doubts, friction, since=1.5)
    monkeypatch.setattr(feasibility, "demand", lambda experiment, path: demand)
    done = CliRunner().invoke(app, ["check-reference", "study_1"])
    assert done.exit_code == (1 if doubts else 0)
    lines = [cells(line) for line in done.stdout.splitlines()]
    assert lines[1:3] == [["u_r", "7.25", "24"], ["u_l", "30", "no limit told"]]
    assert lines[3] == ["friction, over each wheel's load at rest: right 0.25, left 0.5"]
    assert lines[4][0].startswith("friction is judged from 1.5 s on")
    assert lines[5:] == [[str(doubt)] for doubt in doubts]


def held(holds: bool) -> Condition:
    """A condition that holds at every sample, or is broken at a third of them."""
    return Condition(f"{holds} < 2", 0.1, 1.5, 3.0, 2.0, 0.0 if holds else 1 / 3, "sample faster")


CHECKED = {  # what makes a run doubtful
    "nothing": ({"conditions": (held(True), held(True))}, ""),
    "one of two conditions": ({"conditions": (held(True), held(False))}, "a condition is broken"),
    "a failure": ({"failure": Failure(1.5, "diverged")}, "it failed"),
    "a warning": ({"warnings": ("[a] doubt",)}, "it carries a warning"),
    "all": (
        {"conditions": (held(False),), "failure": Failure(1.5, "diverged"), "warnings": ("[a] doubt",)},
        "it failed and it carries a warning and a condition is broken",
    ),
}


@pytest.mark.parametrize("case", CHECKED)
def test_an_experiment_is_doubtful_if_one_of_its_runs_is(
    case: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each reason is told; of another run nothing."""
    changed, why = CHECKED[case]
    runs = {"good": run(controller="good"), "[other]": run(controller="[other]", **changed)}
    monkeypatch.setattr(checks, "run_with_progress", lambda *given: runs)
    assert checks.check_experiment("one") == (not why)
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "is doubtful" in line] == ([f"[other] is doubtful: {why}"] if why else [])
    assert ("warning: [a] doubt" in lines) == bool(changed.get("warnings"))
    table = {row[0]: row[1:] for row in map(cells, lines) if row}
    for one in changed.get("conditions", ()):
        assert table[one.statement] == ["1.5 at 3 s", "2", "holds" if one.holds else "BROKEN, 33.33%"]


@pytest.mark.parametrize("moving", [0, 1, 6])
def test_who_adapts_is_told_by_what_moves(moving: int) -> None:
    """One estimate is enough, from the first sample to the last; that they differ from each other is nothing."""
    estimate = np.tile(np.arange(1.0, 7.0), (71, 1))
    estimate[1:, :moving] *= 2.0
    told = "".join(map(printed, checks._told(run(estimate=estimate))))
    assert ("nothing adapts" in told) == (moving == 0)
    assert ("robot at start" in told) == (moving > 0)
    rows = [row for row in map(cells, told.splitlines()) if row and row[0] in MODEL.base_parameter_units]
    assert [row[2:4] for row in rows] == [[f"{k + 1}", f"{(k + 1) * (1 + (k < moving))}"] for k in range(len(rows))]


@pytest.mark.parametrize(("width", "expected"), [(120, 95), (65, 40), (66, 41), (30, 40)])
def test_a_line_beside_a_name_is_what_the_terminal_leaves(
    width: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for 40 characters, with which it can be wrapped; what fits on a line is told in symbols."""
    monkeypatch.setattr(terminal.console, "_width", width)
    line = show._line()
    assert line == expected
    for length in (line, line + 1):
        straight = {"eigenvalues": ["x" * length], "eigenvalues_at_defaults": [-1.5], "forward": "f", "backward": "b"}
        assert ("x" in show._straight(straight).partition(":")[2]) == (length <= line)
        for name in ("m_C", "inertia_1"):
            denominator = f"{name} + {'1' * (length - len(name) - 3)}"
            obstacle = {"denominator": denominator, "is_proof": True, "states_and_parameter_sets": 9}
            model = Alone()
            model.findings = {"parametrization_obstacle": obstacle | {"rank_of_values": 8}}
            told = f"a denominator {denominator} mixes" if length <= line and name == "m_C" else "a denominator mixes"
            assert show._obstacle(model).startswith(told)  # type: ignore[arg-type]


def test_what_is_not_given_to_a_verb_is_the_usual() -> None:
    """Of the options that are numbers or switches; no verb installs anything."""
    group = get_command(app)
    verbs: dict[str, Any] = group.commands  # type: ignore[attr-defined]
    usual = {verb: {one.name: one.default for one in command.params} for verb, command in verbs.items()}
    assert usual["campaign"].items() >= {"runs": 1000, "threads": 1, "fresh": False, "backend": "auto"}.items()
    assert usual["animate"].items() >= {"seconds": 10.0, "backend": "auto", "out": None}.items()
    assert usual["show"].items() >= {"loop": False, "code": False, "controller": None}.items()
    assert {str(given["out"]) for verb, given in usual.items() if verb in ("simulate", "reproduce")} == {"results"}
    assert [one.name for one in group.params] == ["version"]


def test_numbers_are_not_coloured_on_a_terminal() -> None:
    """Colours would mean something."""
    for console in (terminal.console, terminal.errors):
        assert console.render_str("7.25 m of 'AFL' at 3 s").spans == []


def test_a_progress_bar_leaves_nothing_behind_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """It stands there while it is under way, and its lines are erased at the end."""
    screen = io.StringIO()
    monkeypatch.setattr(terminal, "errors", Console(file=screen, force_terminal=True, width=80))
    with terminal.progress_bar() as bar:
        bar.add_task("some work", total=2, completed=1)
        bar.refresh()
    assert "some work" in screen.getvalue()
    assert "50 %" in screen.getvalue()
    assert screen.getvalue().endswith("\x1b[2K")


def test_without_a_verb_all_verbs_are_told() -> None:
    """As with --help: whoever knows nothing yet is not only told that something is missing."""
    done, asked = (CliRunner().invoke(app, given) for given in ([], ["--help"]))
    assert "Missing command" not in done.output
    for text in (done.output, asked.output):
        assert set(text.replace("│", " ").split()) >= VERBS
