"""What each verb prints, writes and ends with, called in this process."""

import json
import os
import shutil
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import wmr_afl
from tests.conftest import EXPERIMENTS, ROBOTS, ROOT
from tests.wmr_afl.model.sealing import sealed
from wmr_afl import load_model
from wmr_afl.analysis import campaign_plots, plots
from wmr_afl.analysis.excitation import sentence
from wmr_afl.analysis.paper.beyond_figures import CAPTIONS
from wmr_afl.analysis.paper.claims import CLAIMS
from wmr_afl.analysis.paper.figures import FIGURES
from wmr_afl.cli import app, progress, terminal
from wmr_afl.cli.terminal import reporting
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.laws import LAWS, Situation
from wmr_afl.simulation.closed_loop import trace
from wmr_afl.simulation.kernels.block import LANES
from wmr_afl.simulation.kernels.compiled import print_loop
from wmr_afl.simulation.layout import Layout

STUDY = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 2.0")
SHORT = STUDY.replace("since = 100.0", "since = 1.0")
WILD = SHORT.replace("lower = 0.1", "lower = 1e-14")


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Lines are not wrapped, and what is written without a place is written here."""
    for console in (terminal.console, terminal.errors):
        monkeypatch.setattr(console, "_width", 400)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """For what is not about them, which saves their time."""
    monkeypatch.setattr(plots, "overview", lambda runs, title: {})


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


def rows(text: str) -> list[list[str]]:
    """Lines of a table as cells, between two spaces or more, or bars."""
    cells = (" ".join(line.replace("│", "  ").replace("┃", "  ").split(" ")).split("  ") for line in text.splitlines())
    return [[cell.strip() for cell in line if cell.strip()] for line in cells]


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Study 1 for two seconds."""
    (tmp_path / "short.toml").write_text(SHORT)
    return tmp_path / "short.toml"


def test_models_are_listed_with_what_was_found_out() -> None:
    """A line each: title, type, number of base parameters and form, outputs; then the experiments."""
    done = call("models")
    assert done.exit_code == 0
    table = {row[0]: row for row in rows(done.output) if row}
    for name in ROBOTS:
        model = load_model(name)
        expected = [model.title, model.findings["type"], f"{len(model.base_parameter_units)}, {model.parametrization}"]
        assert table[name][1:] == [*expected, ", ".join(model.output_units)]
    assert (
        "study_1, study_1_identified, study_1_laws, study_2, study_2_high_gain, study_2_pose, study_3, study_3_pose"
        in done.output
    )


def test_a_model_is_shown_with_all_its_findings(robot: str) -> None:
    """Each finding of model.json, each parameter with its role, each base parameter with its value."""
    model = load_model(robot)
    found, text = model.findings, call("show", robot).output
    table = {row[0]: row for row in rows(text) if row}
    assert table["type"][1] == (
        f"{found['type']}: mobility {found['degree_of_mobility']}, steerability {found['degree_of_steerability']}"
    )
    assert table["state"][1] == ", ".join(f"{name} [{unit}]" for name, unit in model.state_units.items())
    assert table["controllable"][1] == ("yes, in small time" if found["controllable"] else "no")
    growth = ", ".join(map(str, found["growth_vector"]))
    nonholonomy = f"{found['degree_of_nonholonomy']} (growth of brackets {growth})"
    assert table["degree of nonholonomy"][1] == nonholonomy
    count = len(found["constraint_rows"])
    assert table["constraints"][1] == (f"{count}, {found['constraints']}" if count else "none")
    assert ("can be integrated" in text) == bool(found["holonomic_rows"])
    assert ("smooth everywhere" in text) == (not found["kinematic_singularities"])
    assert table["degenerate"][1] == (
        f"more motion where {' or '.join(found['degenerate_configurations'])}"
        if found["degenerate_configurations"]
        else "nowhere"
    )
    for row in found["dropped_rows"]:
        assert f"follows from these: {row}" in text
    assert table["parametrization"][1].startswith(f"{model.parametrization}: ")
    obstacle = found["parametrization_obstacle"]
    assert ("no forward form" in table) == (obstacle is not None)
    if obstacle:
        assert f"have rank {obstacle['rank_of_values']}, which proves it" in text
    assert table["known constants"][1] == ", ".join(f"{name} [{unit}]" for name, unit in model.known_units.items()) or (
        table["known constants"][1] == "none" and not model.known_units
    )
    assert table["relative degree"][1] == ", ".join(f"{name}: 2" for name in model.output_units)
    assert table[f"det {found['determinant_of']}"][1] == found["det_decoupling_matrix"]
    assert ("Delta is the determinant" in text) == ("Delta" in found["det_decoupling_matrix"])
    assert table["singular where"][1] == (" or ".join(found["singular_where"]) or "nowhere")
    assert table["internal coordinates"][1] == (", ".join(found["internal_coordinates"]) or "none")
    line = found["straight_line"]
    assert ("along a straight line" in table) == bool(line)
    if line:
        values = ", ".join(line["eigenvalues"]) or ", ".join(map(str, line["eigenvalues_at_defaults"]))
        words = f"{line['forward']} forward, {line['backward']} backward; eigenvalues per speed: {values}"
        assert table["along a straight line"][1] == words
    theta = model.base_parameters(model.parameters())
    for name, value in zip(model.base_parameter_units, theta, strict=True):
        assert table[name][1] == model.base_parameter_formulas[name]
        assert table[name][-1] == f"{value:.6g}"
    for name in model.parameter_units:
        shown = next(row for row in rows(text) if row and row[0] == name and row[-1] == model.metadata["about"][name])
        assert shown[1] == f"{model.metadata['defaults'][name]:g}"
        assert shown[3] == ("known" if name in model.known_units else "uncertain")


def test_a_loop_is_shown_with_its_sizes_and_operations() -> None:
    """Of the controller that is named, the first one otherwise; `--code` prints its text alone."""
    done = call("show", "study_2", "--loop", "--controller", "robust AFL")
    loop = load_experiment("study_2").loops["robust AFL"]
    table = {row[0]: row for row in rows(done.output) if row}
    assert done.output.startswith("robust AFL on type_2_0, every 0.02 s")
    for key, sizes in (("state", Layout(loop.states).sizes), ("numbers of a robot", Layout(loop.values).sizes)):
        assert table[key][1] == ", ".join(f"{name} ({size})" for name, size in sizes.items())
    assert table["signals"][1] == ", ".join(f"{name} ({size})" for name, size in loop.signals.items())
    step = trace(loop)
    work = [k for k in range(step.n_instructions()) if step.instruction_id(k) not in (0,)]
    assert 0 < int(table["operations of a step"][1]) < len(work)
    (counts,) = [row[0] for row in rows(done.output) if row and ", add " in row[0]]
    counted = dict(one.split() for one in counts.split(", "))
    assert {"add", "mul", "sin", "fmin"} <= counted.keys()
    assert sum(map(int, counted.values())) == int(table["operations of a step"][1])
    program = print_loop(step, LANES)
    assert f"{len(program.robot)} lines for each robot, before its first step" in done.output
    assert f"{len(program.time)} lines for each step, the same for all robots" in done.output
    assert f"{len(program.both)} lines for each step and robot, {LANES} robots in lockstep" in done.output
    assert call("show", "study_2", "--loop").output.startswith("AFL on type_2_0")
    code = call("show", "study_2", "--code")
    assert code.output.startswith("/* A closed loop")
    assert "lines for each step" not in code.output


def test_a_model_is_checked_law_by_law(tmp_path: Path) -> None:
    """Every law that applies, its deviation and its verdict; the status says whether all hold."""
    done = call("check", "type_2_0")
    assert done.exit_code == 0
    situation = Situation("type_2_0")
    table = {row[0]: row for row in rows(done.output) if row}
    for law in LAWS:
        assert (law.name in table) == law.applies(situation.numpy)
        if law.applies(situation.numpy):
            assert table[law.name][1:] == [
                law.statement, f"{law.deviation(situation):.1e}", f"{law.tolerance:g}", "holds"
            ]  # fmt: skip
    shutil.copytree(ROOT / "generated" / "type_2_0", tmp_path / "mine")
    module = tmp_path / "mine" / "numpy_model.py"
    module.write_text(module.read_text().replace("term_1 = ", "term_1 = 1.001*", 1))
    done = call("check", sealed(tmp_path / "mine"))
    assert done.exit_code == 1
    assert "BROKEN" in done.output


def test_an_experiment_is_checked_controller_by_controller(tmp_path: Path) -> None:
    """Conditions with verdicts, estimates with deviations, what stays undetermined; 1 if a condition is broken."""
    done = call("check", "track_type_2_0")
    run = wmr_afl.run("track_type_2_0", controllers="composite")["composite"]
    told = done.output.partition("composite")[2].partition("direct")[0]
    table = {row[0]: row for row in rows(told) if row}
    (condition,) = run.conditions
    assert condition.holds
    assert table[condition.statement][1:] == [
        f"{condition.largest:.3g} at {condition.time:g} s", f"{condition.bound:.3g}", "holds"
    ]  # fmt: skip
    truth = run.model.passivity_parameters(run.parameters)
    assert run.deviation is not None
    for index, (name, unit) in enumerate(run.estimate_units.items()):
        first, last, deviation = run.estimate[0, index], run.estimate[-1, index], run.deviation[-1, index]
        numbers = [unit, f"{first:.4g}", f"{last:.4g}", f"{deviation:.2g}", f"{truth[index]:.4g}"]
        assert table[name][1:] == numbers + ["undetermined"] * (name in run.undetermined)
    assert " ".join(sentence(run).split()) in " ".join(told.split())
    assert done.output.count("nothing adapts") == 2
    assert "BROKEN" in done.output.partition("AFL")[2]
    assert done.output.splitlines()[-1] == "AFL is doubtful: a condition is broken"
    assert done.exit_code == 1
    (tmp_path / "mine.toml").write_text(
        'title = "one"\nrobot = "type_2_0"\nsimulation = { duration = 1.0, sample_time = 0.02 }\n'
        "reference = { circle = { center = [0.0, 0.0], radius = 2.0, rate = 0.1 } }\nstart = { x = 2.0 }\n"
        'controllers = { composite = { law = "composite" } }\n'
    )
    assert call("check", tmp_path / "mine.toml").exit_code == 0
    assert call("check", tmp_path / "none.toml").exit_code == 2
    unknown = call("check", "study_9")
    assert unknown.exit_code == 2
    assert "unknown model or experiment 'study_9'" in unknown.output
    assert "study_1" in unknown.output
    shutil.copytree(ROOT / "generated" / "car", tmp_path / "car_2")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        assert "write ./car_2" in call("check", "car_2").output


def test_a_simulation_prints_its_metrics_and_writes_its_files(short: Path, tmp_path: Path) -> None:
    """RMS, settled RMS, largest input; samples, metrics and figures below `out`, by the experiment's name."""
    done = call("simulate", short, "--out", tmp_path / "out", "--backend", "numpy")
    assert done.exit_code == 0, done.output
    runs = wmr_afl.run(short, "numpy")
    found = json.loads((tmp_path / "out" / "short" / "metrics.json").read_text())
    table = {row[0]: row for row in rows(done.output) if row}
    for name, run in runs.items():
        rms, settled = (", ".join(f"{value:.3g}" for value in found[name][key]) for key in ("rms", "rms_settled"))
        largest = f"{np.abs(run.input).max():.3g} V"
        assert table[name][1:4] == [rms, settled, largest]
        assert f"RMS error since {found[name]['settled_since']:g} s" in table["controller"]
        assert found[name]["samples"] == 101
    written = [path for path in (tmp_path / "out" / "short").iterdir() if not path.name.startswith(".")]
    pictures = {"path", "errors", "inputs", "estimates_AFL"}
    assert pictures <= {path.stem for path in written}
    assert f"in {tmp_path / 'out' / 'short'}" in done.output
    assert done.output.splitlines()[0].strip() == load_experiment(short).experiment.title


@pytest.mark.usefixtures("_no_figures")
def test_only_the_controller_that_is_named_is_simulated(short: Path, tmp_path: Path) -> None:
    """Below `results` unless told otherwise."""
    done = call("simulate", short, "--controller", "frozen estimates")
    assert done.exit_code == 0
    assert list(json.loads((tmp_path / "results" / "short" / "metrics.json").read_text())) == ["frozen estimates"]


@pytest.mark.usefixtures("_no_figures")
def test_a_run_that_failed_ends_with_status_one(tmp_path: Path) -> None:
    """Its cause in the table, dashes where nothing can be said, and its samples in the file."""
    (tmp_path / "wild.toml").write_text(WILD)
    done = call("simulate", tmp_path / "wild.toml", "--controller", "AFL")
    assert done.exit_code == 1
    (row,) = [row for row in rows(done.output) if row and row[0] == "AFL"]
    assert row[1:3] == ["-", "-"]
    assert row[-1].startswith("stopped at t = ")
    assert (tmp_path / "results" / "wild" / "AFL.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show", "type_9"], "unknown model"),
        (["show", "study_1", "--loop", "--controller", "PID"], "unknown controller 'PID'"),
        (["check", "type_9"], "unknown model or experiment"),
        (["simulate", "study_9"], "unknown experiment"),
        (["simulate", "study_1", "--backend", "abacus"], "unknown backend"),
        (["simulate", "study_1", "--controller", "PID"], "unknown controller 'PID'"),
        (["reproduce", "fig99"], "unknown figure 'fig99'"),
        (["campaign", "study_1", "--controller", "PID"], "unknown controller 'PID'"),
        (["campaign", "study_1", "--runs", "0"], "choose 1 to"),
        (["campaign", "study_1", "--backend", "numpy"], "unknown backend of a campaign"),
        (["campaign", "study_2"], r"[campaign]: is missing"),
        (["campaign", "study_1", "--replay", "-1"], "there is no run -1"),
        (["animate", "study_1", "--seconds", "0.05"], "cannot play for 0.05 s"),
        (["animate", "study_1", "--seconds", "46"], "cannot play for 46 s"),
        (["animate", "study_1", "--out", "movie.mov"], "unknown kind of animation"),
        (["animate", "study_1", "--controller", "PID"], "unknown controller 'PID'"),
    ],
)
def test_a_mistake_is_one_line_and_status_two(arguments: list[str], words: str, tmp_path: Path) -> None:
    """On the error stream, and nothing is run for it."""
    done = call(*arguments)
    assert done.exit_code == 2
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert line.startswith("error: ")
    assert words in line
    assert not list(tmp_path.rglob("*.csv"))


@pytest.mark.parametrize(
    "arguments", [["simulate", "study_1"], ["reproduce", "fig5"], ["campaign", "study_1"], ["animate", "study_1"]]
)
def test_a_place_that_cannot_be_written_is_told_before_the_work(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is run for it."""
    from wmr_afl.cli import reproduction, runs
    from wmr_afl.experiments import campaigns

    def working(*given: Any, **named: Any) -> None:
        pytest.fail("it was run first")

    for module, name in ((runs, "run_with_progress"), (reproduction, "run_with_progress"), (campaigns, "compare")):
        monkeypatch.setattr(module, name, working)
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / ("one.gif" if arguments[0] == "animate" else "below")
    done = call(*arguments, "--out", place)
    assert done.exit_code == 2
    assert "cannot be written" in done.stderr


def test_several_mistakes_are_several_lines(tmp_path: Path) -> None:
    """Each with the same beginning."""
    (tmp_path / "two.toml").write_text(SHORT.replace("x = 15.0", 'x = "a"').replace("y = 25.0", 'y = "b"'))
    done = call("simulate", tmp_path / "two.toml")
    assert done.exit_code == 2
    assert [line.startswith("error: ") for line in done.stderr.splitlines()] == [True, True]


def test_a_campaign_prints_success_quantiles_and_worst_runs(short: Path, tmp_path: Path) -> None:
    """As the result that it amounts to, of the controller and with the options that are given."""
    done = call("campaign", short, "--runs", 20, "--out", tmp_path / "out", "--threads", 2, "--backend", "compiled")
    assert done.exit_code == 0, done.output
    result = wmr_afl.campaign(short, 20, backend="compiled")
    rate, low, high = result.success_rate()
    assert f"20 runs of AFL, seed 1{chr(10)}" in done.output
    words = f"success (did not fail, rms at most 0.05): {rate:.2%}, with 95 % confidence {low:.2%} to {high:.2%}"
    assert words in done.output
    table = {row[0]: row for row in rows(done.output) if row}
    for name, quantiles in result.quantiles().items():
        assert table[name][1:] == [f"{value:.3g}" if np.isfinite(value) else "failed" for value in quantiles]
    worst = [int(row[0]) for row in rows(done.output) if len(row) == 3 and row[0].isdigit()]
    assert worst == result.worst(5).tolist()
    first = result.describe(worst[0])
    came = f"failed at {first['failed_at']:g} s" if first["failed_at"] is not None else (
        f"RMS error {max(result.runs.rms[worst[0]]):.3g}"
    )  # fmt: skip
    assert came in table[str(worst[0])][1]
    for name, value in first["drawn"].items():
        assert f"{name} = {value:.4g}" in table[str(worst[0])][2]
    folder = tmp_path / "out" / "short" / "campaign_AFL"
    assert json.loads((folder / "summary.json").read_text())["runs"] == 20
    short.write_text(SHORT.replace("Gamma = { log_uniform = [0.5, 2.0] }", ""))
    other = call("campaign", short, "--runs", 3, "--controller", "frozen estimates", "--out", tmp_path / "out")
    assert "3 runs of frozen estimates" in other.output
    assert (tmp_path / "out" / "short" / "campaign_frozen_estimates" / "summary.json").exists()


def test_several_controllers_are_compared_and_none_of_them_is_replayed(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One table and one folder for all; a run is of one."""
    compared: list[tuple[list[str], Path]] = []
    monkeypatch.setattr(campaign_plots, "write", lambda result, folder: [folder / "summary.json"])
    monkeypatch.setattr(campaign_plots, "write_comparison", lambda all, to: compared.append((list(all), to)) or [to])
    short.write_text(SHORT.replace("Gamma = { log_uniform = [0.5, 2.0] }", ""))
    both = ("--controller", "AFL", "--controller", "frozen estimates")
    done = call("campaign", short, "--runs", 3, "--out", "out", *both)
    assert done.exit_code == 0, done.output
    folder = Path("out", "short")
    assert compared == [(["AFL", "frozen estimates"], folder / "comparison")]
    assert done.output.startswith("3 runs, seed 1, the same draws for each")
    assert {"AFL", "frozen estimates"} <= {row[0] for row in rows(done.output) if row}
    for name in ("AFL", "frozen_estimates"):
        assert f"summary.json in {folder / f'campaign_{name}'}" in done.output
    replayed = call("campaign", short, "--replay", 1, "--out", "out", *both)
    assert replayed.exit_code == 2
    assert "a replay is of one controller, not of AFL, frozen estimates" in replayed.stderr


def test_a_campaign_begins_anew_only_if_told(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another campaign's folder is refused, and cleared with --fresh."""
    monkeypatch.setattr(campaign_plots, "write", lambda result, folder: [])
    assert call("campaign", short, "--runs", 3, "--out", "out").exit_code == 0
    short.write_text(SHORT.replace("seed = 1", "seed = 2"))
    done = call("campaign", short, "--runs", 3, "--out", "out")
    assert done.exit_code == 2
    assert "holds another campaign" in done.stderr
    assert call("campaign", short, "--runs", 3, "--out", "out", "--fresh").exit_code == 0


def test_a_run_of_a_campaign_is_replayed_into_its_own_folder(short: Path, tmp_path: Path) -> None:
    """With all its samples, metrics and figures."""
    done = call("campaign", short, "--replay", 2, "--out", "out", "--backend", "numpy")
    assert done.exit_code == 0, done.output
    folder = tmp_path / "out" / "short" / "campaign_AFL" / "run_2"
    assert {"metrics.json", "AFL__run_2.csv", "path.png"} <= {path.name for path in folder.iterdir()}
    run = wmr_afl.replay(short, 2, backend="numpy")
    found = json.loads((folder / "metrics.json").read_text())["AFL, run 2"]
    np.testing.assert_allclose(found["rms"], run.rms(), rtol=1e-8)
    assert "AFL, run 2" in done.output


def test_an_interrupted_campaign_says_what_is_kept(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Status 130, as for any program that is interrupted."""
    from wmr_afl.experiments import campaigns

    def interrupted(*arguments: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(campaigns, "compare", interrupted)
    done = call("campaign", short, "--runs", 3, "--out", "out")
    assert done.exit_code == 130
    assert "interrupted: 0 finished blocks are kept in out/short/campaign_AFL" in done.stderr


def test_an_animation_plays_as_long_as_it_is_told(short: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """At the speed that follows; of the first controller, below results, unless told otherwise."""
    from wmr_afl.analysis import animation

    seen: list[tuple[Any, ...]] = []
    monkeypatch.setattr(
        animation, "animate", lambda run, file, fps, speed, report: seen.append((run, file, fps, speed))
    )
    done = call("animate", short, "--seconds", 0.5)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines() == ["results/short/AFL.gif"]
    call("animate", short, "--seconds", 4, "--controller", "frozen estimates", "--out", tmp_path / "my.gif")
    (run, file, fps, speed), (other, named, _, slow) = seen[:2]
    assert (run.controller, file, fps, speed) == ("AFL", Path("results/short/AFL.gif"), 12, 4.0)
    assert (other.controller, named, slow) == ("frozen estimates", tmp_path / "my.gif", 0.5)
    for seconds in (0.1, 45):
        assert call("animate", short, "--seconds", seconds).exit_code == 0
    short.write_text(WILD)
    failed = call("animate", short, "--seconds", 1)
    assert failed.exit_code == 1
    assert "stopped at t = " in failed.output


@pytest.fixture
def fake_studies(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Runs of two seconds in the place of the studies, by name of the experiment."""
    from wmr_afl.analysis.paper import beyond, beyond_figures, figures
    from wmr_afl.cli import reproduction

    asked: list[str] = []

    def run(experiment: str, backend: str, controllers: Any) -> dict[str, Any]:
        asked.append(experiment)
        text = (EXPERIMENTS / f"{experiment}.toml").read_text().replace("duration = 140.0", "duration = 2.0")
        Path(f"{experiment}.toml").write_text(text)
        return wmr_afl.run(Path(f"{experiment}.toml"), backend, controllers)

    monkeypatch.setattr(reproduction, "run_with_progress", run)

    def measured(runs: int | None, backend: str, report: Any) -> beyond.Beyond:
        asked.append(f"{runs} robots, {backend}")
        report("something")
        return beyond.Beyond({}, {}, [beyond.Sheet("trouble", "a note", ("law", "error"), (("AFL", "0.123"),))])

    monkeypatch.setattr(beyond, "measure", measured)
    monkeypatch.setattr(beyond_figures, "draw_beyond", lambda name, found: plots.new_figure(1.0, 1.0))
    monkeypatch.setattr(figures, "draw", lambda name, runs: plots.new_figure(1.0, 1.0))
    return asked


def test_a_figure_of_the_paper_is_drawn_alone(fake_studies: list[str], tmp_path: Path) -> None:
    """From its own study, whose samples are written, without a report."""
    done = call("reproduce", "fig10", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert fake_studies == ["study_3"]
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"fig10.png", "fig10.svg", "study_3"}
    assert not (tmp_path / "out" / "report.html").exists()
    assert "trouble" not in done.output
    assert f"fig10: {tmp_path / 'out' / 'fig10.png'}, {tmp_path / 'out' / 'fig10.svg'}" in done.output


def test_the_whole_paper_is_reproduced_with_every_claim_judged(fake_studies: list[str], tmp_path: Path) -> None:
    """Every study once, every figure, the report and a table of verdicts."""
    done = call("reproduce", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    studies = ["study_1", "study_2", "study_2_high_gain", "study_3"]
    assert sorted(fake_studies) == ["None robots, auto", *studies]
    assert {f"{name}.png" for name in (*FIGURES, *CAPTIONS)} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert "trouble" in (tmp_path / "out" / "report.html").read_text()
    verdicts = [row for row in rows(done.output) if row and row[-1] in ("met", "not met")]
    assert [row[1] for row in verdicts] == [claim.text for claim in CLAIMS]
    assert verdicts[0][-1] == "not met"  # after two seconds, nothing since 100 s
    assert ["AFL", "0.123"] in rows(done.output)
    assert "a note" in done.output
    call("reproduce", "--out", tmp_path / "out", "--runs", 5, "--backend", "casadi")
    assert fake_studies[-1] == "5 robots, casadi"
    assert call("reproduce", "--runs", 0).exit_code == 2


def test_progress_is_that_of_every_controller(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar for each, to its end."""
    seen: list[Any] = []

    class Bars:
        def __enter__(self) -> "Bars":
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def add_task(self, text: str, total: int) -> str:
            seen.append((text, total))
            return text

        def update(self, task: str, completed: int) -> None:
            seen.append((task, completed))

    monkeypatch.setattr(progress, "progress_bar", Bars)
    runs = progress.run_with_progress(str(short), "casadi", None)
    assert list(runs) == ["AFL", "frozen estimates"]
    assert seen == [(f"{short}: {name}", 101) for name in runs for _ in range(2)]


def test_the_version_and_a_bar_that_no_terminal_shows() -> None:
    """`--version` ends before any verb."""
    done = call("--version")
    assert done.exit_code == 0
    assert done.output.startswith("wmr-afl ")
    assert terminal.progress_bar().disable
    assert "Usage" in call().output


def test_an_interrupt_stays_one_whatever_a_library_makes_of_it() -> None:
    """Where it is swallowed and something else fails for it; without one, that failure is what it is."""

    def swallowed(comes: bool) -> None:
        with reporting():
            if comes:
                with suppress(KeyboardInterrupt):
                    os.kill(os.getpid(), signal.SIGINT)
                    time.sleep(1.0)
            raise TypeError("of something that is not there")

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background a shell has it ignored
    try:
        with pytest.raises(KeyboardInterrupt):
            swallowed(True)
        with pytest.raises(TypeError):
            swallowed(False)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
