"""Campaigns: the numbers depend on seed and index alone, whoever runs the blocks and however often that is stopped."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS, ROOT
from wmr_afl import InputError, SimulationWarning, WmrError
from wmr_afl.experiments.campaigns import runner
from wmr_afl.experiments.campaigns.ledger import Ledger
from wmr_afl.experiments.campaigns.result import wilson
from wmr_afl.experiments.distributions import BLOCK, CampaignTable, Distribution, draw, draws

STUDY_1 = (EXPERIMENTS / "study_1.toml").read_text()


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Study 1's campaign with runs of 10 s."""
    file = tmp_path / "short.toml"
    file.write_text(STUDY_1.replace("duration = 140.0", "duration = 10.0").replace("since = 100.0", "since = 5.0"))
    return file


def same(first: wmr_afl.CampaignResult, second: wmr_afl.CampaignResult) -> None:
    for name, column in vars(first.runs).items():
        np.testing.assert_array_equal(column, getattr(second.runs, name), err_msg=name)
    for name, column in first.draws.items():
        np.testing.assert_array_equal(column, second.draws[name], err_msg=name)


TABLE = CampaignTable(
    seed=7,
    start={"x": Distribution(uniform=[1.0, 3.0]), "y": Distribution(normal=[2.0, 0.5])},
    scale={"m_C": Distribution(log_uniform=[0.1, 10.0]), "I_C": Distribution(choice=[1.0, 2.0])},
)


def test_a_draw_depends_on_seed_and_index_alone() -> None:
    whole, part = draws(TABLE, 3, BLOCK), draws(TABLE, 3, 10)
    for name, column in part.items():
        np.testing.assert_array_equal(column, whole[name][:10])
    fewer = TABLE.model_copy(update={"start": {"y": TABLE.start["y"]}})
    np.testing.assert_array_equal(draws(fewer, 3, 10)["start.y"], part["start.y"])
    for other in (draws(TABLE, 4, 10), draws(TABLE.model_copy(update={"seed": 8}), 3, 10)):
        assert not np.any(other["start.x"] == part["start.x"])
    assert abs(np.corrcoef(whole["start.x"], whole["start.y"])[0, 1]) < 5 / np.sqrt(BLOCK)


@pytest.mark.parametrize(
    ("distribution", "mean", "deviation", "low", "high"),
    [
        (Distribution(uniform=[1.0, 3.0]), 2.0, 2.0 / np.sqrt(12.0), 1.0, 3.0),
        (Distribution(normal=[2.0, 0.5]), 2.0, 0.5, -np.inf, np.inf),
        (Distribution(choice=[1.0, 2.0]), 1.5, 0.5, 1.0, 2.0),
        (Distribution(log_uniform=[1.0, np.e]), np.e - 1.0, 0.4924, 1.0, np.e),  # sqrt((e^2-1)/2 - (e-1)^2)
    ],
)
def test_what_is_drawn_has_the_distribution_that_is_given(distribution, mean, deviation, low, high) -> None:
    numbers = np.concatenate([draw(distribution, np.random.default_rng(seed)) for seed in range(50)])
    assert abs(numbers.mean() - mean) < 5.0 * deviation / np.sqrt(len(numbers))
    assert abs(numbers.std() - deviation) < 0.02 * deviation
    assert low <= numbers.min() <= numbers.max() <= high


def test_a_campaign_gives_what_a_batch_and_single_runs_give(short: Path) -> None:
    result = wmr_afl.campaign(short, 40)
    start = {name: result.draws[f"start.{name}"] for name in ("x", "y", "phi")}
    scale = {name: result.draws[f"scale.{name}"] for name in ("m_C", "I_C", "Gamma")}
    batch = wmr_afl.run_batch(short, start=start, scale=scale, since=5.0)
    np.testing.assert_array_equal(batch.rms, result.runs.rms)
    well = np.flatnonzero(~result.runs.failed)[:3]
    for index in well:
        run = wmr_afl.replay(short, int(index), backend="numpy")
        np.testing.assert_allclose(run.rms(since=5.0), result.runs.rms[index], rtol=1e-9)
        np.testing.assert_allclose(run.state[0, :3], [start[name][index] for name in ("x", "y", "phi")])
    lost = int(result.worst(1)[0])
    with pytest.warns(SimulationWarning, match=f"run {lost}"):
        failure = wmr_afl.replay(short, lost).failure
    assert failure.time == pytest.approx(result.runs.failure_time[lost])


def test_noise_is_each_runs_own(tmp_path: Path) -> None:
    noise = "[uncertainties]\nmeasurement_noise = { deviation = 0.001 }\n[shared]"
    file = tmp_path / "noisy.toml"
    file.write_text(STUDY_1.replace("duration = 140.0", "duration = 110.0").replace("[shared]", noise, 1))
    result = wmr_afl.campaign(file, 5)
    assert len(set(result.draws["noise_seed"])) == 5
    index = int(np.flatnonzero(~result.runs.failed)[0])
    np.testing.assert_allclose(wmr_afl.replay(file, index).rms(since=100.0), result.runs.rms[index], rtol=1e-9)


def test_the_shipped_campaign_shows_how_study_1_depends_on_its_start() -> None:
    """A finding of this project: within a metre of the paper's start a third of the runs fail."""
    result = wmr_afl.campaign("study_1", 1000)
    rate, low, high = result.success_rate()
    assert 0.6 < low < rate < high < 0.75
    close = np.abs(result.draws["start.phi"] - 0.3) < 0.1
    assert np.mean(result.succeeded[close]) > 0.9


def test_confidence_bounds_are_wilsons() -> None:
    """R. G. Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    for successes, trials, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611)):
        np.testing.assert_allclose(wilson(successes, trials, 0.95)[1:], (low, high), atol=5e-5)


def test_quantiles_count_failed_runs_as_infinite(short: Path) -> None:
    result = wmr_afl.campaign(short, 200)
    failed = np.mean(result.runs.failed)
    assert 0.1 < failed < 0.6
    for name, row in result.quantiles([0.5 * (1 - failed), 1 - 0.5 * failed]).items():
        assert np.isfinite(row[0]), name
        assert np.isinf(row[1]), name
    assert set(result.worst(int(failed * 200))) == set(np.flatnonzero(result.runs.failed))
    assert json.loads(json.dumps(result.summary()))["failed"] == np.count_nonzero(result.runs.failed)


def test_an_interrupted_campaign_goes_on_without_losing_or_repeating_a_block(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs, out = 5 * BLOCK + 100, tmp_path / "out"
    begun: list[int] = []

    def counted(job, wanted, threads, original=runner.here):
        for block, columns in original(job, wanted, threads):
            begun.append(block)
            yield block, columns

    monkeypatch.setattr(runner, "here", counted)

    def interrupt(done: int) -> None:
        if len(begun) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        wmr_afl.campaign(short, runs, out, progress=interrupt)
    resumed = wmr_afl.campaign(short, runs, out)
    assert begun == [0, 1, 2, 3, 4, 5]
    same(resumed, wmr_afl.campaign(short, runs))
    begun.clear()
    longer = wmr_afl.campaign(short, 6 * BLOCK, out)
    assert begun == [5]  # which was not whole
    np.testing.assert_array_equal(longer.runs.rms[:runs], resumed.runs.rms)


def test_a_damaged_block_is_run_again(short: Path, tmp_path: Path) -> None:
    first = wmr_afl.campaign(short, 2 * BLOCK, tmp_path / "out")
    content = (tmp_path / "out" / "block_000001.npz").read_bytes()
    for damaged in (b"", content[: len(content) // 2], content[:3000] + b"\0" * 500 + content[3500:]):
        (tmp_path / "out" / "block_000001.npz").write_bytes(damaged)
        same(wmr_afl.campaign(short, 2 * BLOCK, tmp_path / "out"), first)
    assert (tmp_path / "out" / "block_000001.npz").read_bytes() == content


def test_blocks_of_another_campaign_are_never_taken(short: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    wmr_afl.campaign(short, 100, out)
    text = short.read_text()
    short.write_text(text.replace("rms = 0.05", "rms = 0.001").replace('title = "', 'title = "Another '))
    wmr_afl.campaign(short, 100, out)  # what counts as success changes no run
    for old, new in (
        ("seed = 1", "seed = 2"),
        ("b1 = 2.0", "b1 = 2.1"),
        ("x = { uniform = [14.0", "x = { uniform = [13.0"),
    ):
        short.write_text(text.replace(old, new))
        with pytest.raises(WmrError, match=r"holds another campaign.*--fresh"):
            wmr_afl.campaign(short, 100, out)
    fresh = wmr_afl.campaign(short, 100, out, fresh=True)
    same(fresh, wmr_afl.campaign(short, 100))
    (out / "campaign.json").write_text("{")
    with pytest.raises(WmrError, match="damaged"):
        wmr_afl.campaign(short, 100, out)


def test_a_block_that_is_not_this_campaigns_is_run_again(short: Path, tmp_path: Path) -> None:
    """Also if somebody has removed the note, or copied a block over another."""
    out = tmp_path / "out"
    wmr_afl.campaign(short, 2 * BLOCK, out)
    (out / "block_000001.npz").write_bytes((out / "block_000000.npz").read_bytes())
    same(wmr_afl.campaign(short, 2 * BLOCK, out), wmr_afl.campaign(short, 2 * BLOCK))
    (out / "campaign.json").unlink()
    short.write_text(short.read_text().replace("b1 = 2.0", "b1 = 2.1"))
    same(wmr_afl.campaign(short, 2 * BLOCK, out), wmr_afl.campaign(short, 2 * BLOCK))


def test_a_robot_of_a_users_own_runs_in_a_campaign(tmp_path: Path) -> None:
    """Its model travels with the job."""
    (tmp_path / "mine").mkdir()
    for file in (ROOT / "generated" / "type_2_0").glob("*model.*"):
        (tmp_path / "mine" / file.name).write_text(file.read_text())
    text = STUDY_1.replace('robot = "type_2_0"', 'robot = "mine"')
    (tmp_path / "own.toml").write_text(text.replace("duration = 140.0", "duration = 101.0"))
    (tmp_path / "shipped.toml").write_text(STUDY_1.replace("duration = 140.0", "duration = 101.0"))
    same(wmr_afl.campaign(tmp_path / "own.toml", 40), wmr_afl.campaign(tmp_path / "shipped.toml", 40))


CAMPAIGN = STUDY_1[STUDY_1.index("[campaign]") :]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", r"\[campaign\]: is missing; say what each run draws"),
        ("[campaign]\nseed = 1", "draws nothing"),
        ("[campaign.start]\nx = { uniform = [2.0, 1.0] }", "range from 2 to 1 is empty"),
        ("[campaign.start]\nx = { log_uniform = [-1.0, 1.0] }", "above zero"),
        ("[campaign.start]\nx = { normal = [1.0, 0.0] }", "deviation > 0"),
        ("[campaign.start]\nx = { uniform = [1.0, 2.0], choice = [1.0] }", "exactly one of"),
        ("[campaign.start]\nx = {}", "no distribution"),
        ("[campaign.start]\nx = { gauss = [1.0, 2.0] }", "gauss"),
        ("[campaign.start]\nz = { uniform = [1.0, 2.0] }", "unknown state 'z'"),
        ("[campaign.parameters]\nm = { uniform = [1.0, 2.0] }", "unknown parameter .* 'm'"),
        ("[campaign.gains]\nGama = { uniform = [1.0, 2.0] }", "did you mean 'Gamma'"),
        ("[campaign.scale]\nGama = { uniform = [1.0, 2.0] }", "did you mean 'Gamma'"),
        ("[campaign.parameters]\nm_C = { uniform = [-2.0, -1.0] }", "what no robot can have: m_C = -.* kg is negative"),
        ('[campaign]\ncontroller = "PID"\n[campaign.start]\nx = { choice = [1.0] }', "unknown controller 'PID'"),
        ("[campaign]\nsince = 141.0\n[campaign.start]\nx = { choice = [1.0] }", "a run ends at 140 s"),
        ("[campaign]\nsuccess = { rms = 0.0 }\n[campaign.start]\nx = { choice = [1.0] }", "greater than 0"),
    ],
)
def test_a_campaign_that_means_nothing_is_reported_with_its_place(tmp_path: Path, table: str, words: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(STUDY_1.replace(CAMPAIGN, table))
    with pytest.raises(InputError, match=words) as caught:
        wmr_afl.campaign(file, 10)
    assert "bad.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_gains_are_drawn_and_what_follows_from_them_follows(tmp_path: Path) -> None:
    """alpha is b2/b1 unless given, also for gains that are drawn."""
    file = tmp_path / "gains.toml"
    file.write_text(STUDY_1.replace(CAMPAIGN, "[campaign.gains]\nb1 = { choice = [3.0] }\nb2 = { choice = [2.0] }\n"))
    drawn = wmr_afl.campaign(file, 1)
    file.write_text(STUDY_1.replace("b1 = 2.0, b2 = 1.0", "b1 = 3.0, b2 = 2.0"))
    single = wmr_afl.run(file, controllers="AFL")["AFL"]
    np.testing.assert_allclose(drawn.runs.rms[0], single.rms(), rtol=1e-9)


def heeding_interrupts() -> None:
    """A background job's children ignore SIGINT unless they say otherwise."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*arguments: object, cwd: Path, **options) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "wmr_afl", "campaign", *map(str, arguments)],
        cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "COLUMNS": "200", "PYTHONPATH": str(ROOT)},
        **{"preexec_fn": heeding_interrupts, **options},
    )  # fmt: skip


def blocks_of(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("block_*.npz")}


def wait_for_blocks(folder: Path, count: int, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 120.0
    while len(blocks_of(folder)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize("blow", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_process_leaves_whole_blocks_and_the_next_goes_on(tmp_path: Path, blow: signal.Signals) -> None:
    runs, folder = 600 * BLOCK, tmp_path / "results" / "study_1" / "campaign_AFL"
    process = start("study_1", "--runs", runs, cwd=tmp_path)
    wait_for_blocks(folder, 3, process)
    process.send_signal(blow)
    _, errors = process.communicate(timeout=60)
    if blow == signal.SIGINT:
        assert process.returncode == 130
        assert errors.strip().splitlines()[-1].startswith("interrupted: ")
        assert "Traceback" not in errors
    before = blocks_of(folder)
    assert 3 <= len(before) < 600
    shorter = (len(before) + 1) * BLOCK
    process = start("study_1", "--runs", shorter, cwd=tmp_path)
    output, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    after = blocks_of(folder)
    assert {name: after[name] for name in before} == before
    assert f"{shorter} runs of AFL" in output
    last = Ledger(folder, json.loads((folder / "campaign.json").read_text())["fingerprint"]).read(len(before), BLOCK)
    np.testing.assert_array_equal(last["rms"], wmr_afl.campaign("study_1", shorter).runs.rms[-BLOCK:])


def test_a_full_disk_is_reported_in_one_line_and_keeps_finished_blocks(short: Path, tmp_path: Path) -> None:
    """The limit on the size of a file stands for the room that there is."""
    start(short, "--runs", 50, cwd=tmp_path).communicate(timeout=60)
    folder = tmp_path / "results" / "short" / "campaign_AFL"
    before = blocks_of(folder)
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))  # noqa: E731
    process = start(short, "--runs", 2000, cwd=tmp_path, preexec_fn=limit)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith("error: ")
    assert len(errors.splitlines()) == 1
    assert "make room" in errors
    assert blocks_of(folder) == before
    assert not list(folder.glob(".unfinished*"))


def test_the_command_writes_what_it_prints(short: Path, tmp_path: Path) -> None:
    process = start(short, "--runs", 300, cwd=tmp_path)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    folder = tmp_path / "results" / "short" / "campaign_AFL"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["runs"] == 300
    assert f"{summary['success']['rate']:.2%}" in output
    assert all((folder / name).stat().st_size > 5000 for name in ("errors.png", "success.png"))
    index = summary["worst"][-1]["run"]
    process = start(short, "--replay", index, cwd=tmp_path)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert (folder / f"run_{index}" / f"AFL__run_{index}.csv").exists()


@pytest.mark.parametrize(("arguments", "words"), [(["--runs", 0], "choose 1 to"), (["--replay", -1], "no run -1")])
def test_a_command_that_means_nothing_ends_in_one_line(short: Path, tmp_path: Path, arguments, words: str) -> None:
    process = start(short, *arguments, cwd=tmp_path)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert errors.startswith("error: ")
    assert words in errors


TWO = """
[controllers.slower]
estimate = 1.0
outer_loop = { b1 = 1.0, b2 = 0.25 }
adaptation = { gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0] }
projection = { lower = 0.1 }
"""


def two(short: Path, folder: Path, named: str = '["AFL", "slower"]') -> Path:
    """The short campaign under two controllers."""
    text = short.read_text()
    path = folder / "two.toml"
    start = text.index("[campaign]")
    path.write_text(text[:start] + TWO + text[start:].replace("[campaign]", f"[campaign]\ncontroller = {named}", 1))
    return path


def test_several_controllers_meet_the_same_draws(short: Path, tmp_path: Path) -> None:
    """Each gets what a campaign of its own gives; those of the file unless named, all checked before the first runs."""
    path = two(short, tmp_path)
    done: dict[str, int] = {}
    results = wmr_afl.compare(path, 40, tmp_path / "out", progress=lambda name, n: done.update({name: n}))
    assert list(results) == ["AFL", "slower"] == list(done)
    for name, result in results.items():
        alone = wmr_afl.campaign(path, 40, controller=name)
        np.testing.assert_array_equal(result.runs.rms, alone.runs.rms)
        for quantity, column in result.draws.items():
            np.testing.assert_array_equal(column, results["AFL"].draws[quantity])
        assert (tmp_path / "out" / f"campaign_{name}" / "block_000000.npz").exists()
    assert not np.array_equal(results["AFL"].runs.rms, results["slower"].runs.rms)
    assert list(wmr_afl.compare(path, 2, controllers="slower")) == ["slower"]
    assert list(wmr_afl.compare(path, 2, controllers=["slower", "AFL", "slower"])) == ["slower", "AFL"]
    assert list(wmr_afl.compare(short, 2)) == ["AFL"]
    with pytest.raises(WmrError, match="no controller is named; name one or more of AFL"):
        wmr_afl.compare(path, 2, controllers=[])
    assert wmr_afl.campaign(path, 2).controller == "AFL"
    with pytest.raises(WmrError, match="unknown controller 'PID'"):
        wmr_afl.compare(path, 2, tmp_path / "other", ["AFL", "PID"])
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ('["AFL", "AFL"]', "names one twice: AFL, AFL"),
        ('["AFL", "PID"]', "unknown controller 'PID'"),
        ("[]", "a name, or a list of them"),
        ("3", "a name, or a list of them"),
    ],
)
def test_controllers_that_cannot_be_compared_are_told_with_their_place(
    short: Path, tmp_path: Path, named: str, words: str
) -> None:
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        wmr_afl.compare(two(short, tmp_path, named), 2)
    assert "campaign" in str(caught.value)
    assert "controller" in str(caught.value)


def test_the_command_compares_controllers(short: Path, tmp_path: Path) -> None:
    """One line each, what each campaign writes, and a comparison of all."""
    path = two(short, tmp_path)
    process = start(path, "--runs", 30, cwd=tmp_path)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    several = start(path, "--replay", 1, cwd=tmp_path)
    _, errors = several.communicate(timeout=60)
    assert several.returncode == 2
    assert errors == "error: a replay is of one controller, not of AFL, slower; name one with --controller\n"
    folder = tmp_path / "results" / "two"
    found = json.loads((folder / "comparison" / "comparison.json").read_text())
    assert list(found) == ["AFL", "slower"]
    assert (folder / "comparison" / "comparison.png").stat().st_size > 5000
    for name, one in found.items():
        summary = json.loads((folder / f"campaign_{name}" / "summary.json").read_text())
        assert summary["success"]["rate"] == one["success"]
        low, high = one["failed_95"]
        assert f"{100 * one['failed']:.1f} ({100 * low:.1f}-{100 * high:.1f})" in output
