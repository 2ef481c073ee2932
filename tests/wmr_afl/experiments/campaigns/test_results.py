"""What a campaign amounts to, from results that are made by hand, and what a campaign's fingerprint knows."""

import json
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest

import wmr_afl
from tests.wmr_afl.experiments.campaigns.handmade import INF, NAN, result
from wmr_afl.experiments.campaigns import job, runner, workers
from wmr_afl.experiments.campaigns.job import ensemble_of, loop_of, prepare, run_block
from wmr_afl.experiments.campaigns.ledger import Ledger, clear
from wmr_afl.experiments.campaigns.result import LEVELS, wilson
from wmr_afl.experiments.distributions import BLOCK, CampaignTable, Distribution, SuccessTable, draw, draws, noise_seeds
from wmr_afl.simulation.layout import Layout
from wmr_input import InputError, WmrError
from wmr_input.toml_file import validate


def test_a_run_succeeds_if_every_output_keeps_every_bound_and_nothing_failed() -> None:
    """One output above one bound is enough to fail; a bound is kept by what equals it."""
    errors = [[0.1, 0.9], [0.5, 0.5], [0.1, 0.1], [0.9, 0.1], [0.1, 0.1]]
    failure = [NAN, NAN, NAN, NAN, 3.0]
    one = result(errors, failure, success=SuccessTable(rms=0.5))
    assert one.succeeded.tolist() == [False, True, True, False, False]
    assert result(errors, failure).succeeded.tolist() == [True, True, True, True, False]
    volts = np.array([[1.0, 9.0], [9.0, 1.0], [5.0, 5.0], [1.0, 1.0], [1.0, 1.0]])
    both = result(errors, failure, largest_input=volts, success=SuccessTable(rms=0.5, largest_input=5.0))
    assert both.succeeded.tolist() == [False, False, True, False, False]
    largest = result(errors, failure, success=SuccessTable(largest_error=0.3))
    assert largest.succeeded.tolist() == [False, False, True, False, False]


def test_quantiles_are_never_too_optimistic() -> None:
    """A level's quantile is a run's own measure, the higher one of two; failures count as infinite."""
    one = result([[0.1, 0.2], [0.4, 0.3], [INF, INF], [0.3, 0.1]], [NAN, NAN, 1.0, NAN])
    found = one.quantiles([0.0, 0.1, 0.5, 0.7, 1.0])
    assert found["RMS error of y1 [m]"].tolist() == [0.1, 0.3, 0.4, INF, INF]
    assert found["RMS error of y2 [rad]"].tolist() == [0.1, 0.2, 0.3, INF, INF]
    assert one.quantiles()["largest estimate"].shape == (len(LEVELS),)


def test_quantiles_are_told_in_pairs_about_the_median() -> None:
    """In order, and of the larger values one more."""
    assert list(LEVELS) == sorted(LEVELS)
    paired = [level for level in LEVELS if any(abs(level + other - 1.0) < 1e-12 for other in LEVELS)]
    assert 0.5 in paired
    assert len(paired) == len(LEVELS) - 1
    assert max(LEVELS) not in paired


def test_measures_are_of_every_output_and_of_the_motor_that_needs_most() -> None:
    """Each named with its unit."""
    volts = np.array([[1.0, 3.0], [4.0, 2.0]])
    found = result([[0.1, 0.2], [0.3, 0.4]], largest_input=volts).measures()
    assert {name: column.tolist() for name, column in found.items()} == {
        "RMS error of y1 [m]": [0.1, 0.3],
        "RMS error of y2 [rad]": [0.2, 0.4],
        "largest error of y1 [m]": [0.2, 0.6],
        "largest error of y2 [rad]": [0.4, 0.8],
        "largest input [V]": [3.0, 4.0],
        "largest estimate": [1.0, 2.0],
    }


def test_the_worst_runs_are_those_that_failed_early_then_those_with_the_largest_error() -> None:
    """Of equals the first; by the larger RMS error of any output."""
    errors = [[0.1, 0.2], [0.9, 0.1], [INF, INF], [0.1, 0.9], [INF, INF], [0.3, 0.3]]
    one = result(errors, [NAN, NAN, 7.0, NAN, 2.0, NAN])
    assert one.worst(6).tolist() == [4, 2, 1, 3, 5, 0]
    assert one.worst(2).tolist() == [4, 2]
    assert len(result([[0.1, 0.1]] * 12).worst()) == 10


def test_a_run_is_described_by_what_it_drew_and_what_it_came_to() -> None:
    """Infinite measures are null, numbers have nine digits."""
    one = result([[0.123456789123, 0.2], [INF, INF]], [NAN, 7.0])
    assert one.describe(0) == {
        "run": 0, "drawn": {"start.x": 0.0}, "failed_at": None, "cause": None, "RMS error of y1 [m]": 0.123456789,
        "RMS error of y2 [rad]": 0.2, "largest error of y1 [m]": 0.246913578, "largest error of y2 [rad]": 0.4,
        "largest input [V]": 2.0, "largest estimate": 1.0,
    }  # fmt: skip
    failed = one.describe(1)
    assert (failed["failed_at"], failed["RMS error of y1 [m]"]) == (7.0, None)
    assert failed["cause"] == "diverged; lower the gains"
    assert [one.describe(index) for index in (-2, -1)] == [one.describe(0), failed]
    for index in (-3, 2):
        with pytest.raises(WmrError, match=f"no run {index}; runs are counted from 0 to 1"):
            one.describe(index)


def test_controllers_are_compared_by_the_larger_error_of_their_outputs() -> None:
    """Median, 99 % and worst; null where so many runs failed."""
    errors = [[k / 1000, (201 - k) / 2000] for k in range(1, 201)]
    larger = sorted(max(row) for row in errors)
    found = result(errors).brief()
    assert [found[key] for key in ("rms_median", "rms_99", "rms_worst")] == [larger[100], larger[198], larger[199]]
    failing = result([[INF, INF], *errors[1:]], [2.0, *[NAN] * 199]).brief()
    assert (failing["rms_worst"], failing["failed"], failing["causes"]) == (None, 1 / 200, {"diverged": 1})
    assert failing["rms_median"] is not None


def test_a_summary_counts_what_there_is() -> None:
    """And is what stands in summary.json."""
    one = result([[0.1, 0.2], [INF, INF], [0.3, 0.4], [0.9, 0.1]], [NAN, 2.0, NAN, NAN], success=SuccessTable(rms=0.5))
    found = one.summary()
    assert (found["controller"], found["runs"], found["seed"], found["failed"]) == ("AFL", 4, 3, 1)
    rate, low, high = wilson(2, 4, 0.95)
    assert found["success"] == {"criteria": {"rms": 0.5}, "rate": rate, "confidence_95": [low, high]}
    assert found["levels"] == list(LEVELS)
    assert found["quantiles"]["RMS error of y1 [m]"][-1] is None
    assert [run["run"] for run in found["worst"]] == [1, 3, 2, 0]
    assert json.loads(json.dumps(found)) == found
    assert len(one) == 4
    assert one.success_rate() == (rate, low, high)


@pytest.mark.parametrize("trials", [1, 7, 50, 1000])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_wilsons_bounds_solve_his_equation(trials: int, confidence: float) -> None:
    """|share - p| = z sqrt(p (1 - p)/n) at both bounds p, which lie within 0 and 1 around the share."""
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    for successes in {0, 1, trials // 2, trials}:
        share, low, high = wilson(successes, trials, confidence)
        assert share == successes / trials
        assert np.all(np.diff([0.0, low, share, high, 1.0]) > -1e-12)
        for p in (low, high):
            assert (share - p) ** 2 == pytest.approx(z**2 * p * (1.0 - p) / trials, abs=1e-12)
        assert low < high


EXPERIMENT = """
title = "one"
robot = "type_2_0"
[parameters]
m_C = 30.0
[start]
x = 2.5
[reference]
circle = { center = [0.0, 0.0], radius = 2.6, rate = 0.2 }
[simulation]
duration = 0.2
sample_time = 0.02
integrator = "euler"
[uncertainties]
input_limits = { volts = 24.0 }
[controllers.AFL]
estimate = 1.0
outer_loop = { b1 = 2.0, b2 = 1.0 }
[controllers.other]
estimate = 2.0
outer_loop = { b1 = 2.0, b2 = 1.0 }
[campaign]
since = 0.1
seed = 1
success = { rms = 0.05 }
[campaign.scale]
m_C = { uniform = [0.9, 1.1] }
"""


def test_what_no_robot_can_have_is_told_of_the_first_run(tmp_path: Path) -> None:
    """Of which the same draw, moved to where a robot can have it, is by as much larger."""
    path, drawn = tmp_path / "one.toml", "[campaign.parameters]\nm_C = {{ uniform = [{}, {}] }}\n"
    text = EXPERIMENT[: EXPERIMENT.index("[campaign.scale]")]
    path.write_text(text + drawn.format(1.0, 2.0))
    possible = prepare(path, backend="casadi")
    (first,) = ensemble_of(possible, loop_of(possible), 0, 1)[0]["parameters.m_C"]
    path.write_text(text + drawn.format(-2.0, -1.0))
    with pytest.raises(InputError, match="what no robot can have: m_C = ") as caught:
        prepare(path, backend="casadi")
    told = float(str(caught.value).partition("m_C = ")[2].split()[0])
    assert told == pytest.approx(first - 3.0, rel=1e-3)


def fingerprint(path: Path, text: str = EXPERIMENT, **options) -> str:
    path.write_text(text)
    return prepare(path, **{"backend": "casadi", **options}).fingerprint


CHANGES = {
    "duration": ("duration = 0.2", "duration = 0.22"),
    "sample time": ("sample_time = 0.02", "sample_time = 0.01"),
    "integrator": ('"euler"', '"rk4"'),
    "start": ("x = 2.5", "x = 2.4"),
    "parameters": ("m_C = 30.0", "m_C = 31.0"),
    "parameters that are the defaults": ("[parameters]\n", "[parameters]\nr = 0.15\n"),
    "reference": ("radius = 2.6", "radius = 2.7"),
    "estimate": ("estimate = 1.0", "estimate = 1.1"),
    "gain": ("b1 = 2.0, b2 = 1.0 }\n[controllers.other]", "b1 = 2.1, b2 = 1.0 }\n[controllers.other]"),
    "alpha that is the usual one": ("b2 = 1.0 }\n[controllers.other]", "b2 = 1.0, alpha = 0.5 }\n[controllers.other]"),
    "limits": ("volts = 24.0", "volts = 23.0"),
    "another uncertainty": ("[uncertainties]\n", '[uncertainties]\nlateral_slip = { speed = "0" }\n'),
    "since": ("since = 0.1", "since = 0.08"),
    "seed": ("seed = 1", "seed = 2"),
    "a distribution": ("[0.9, 1.1]", "[0.9, 1.2]"),
    "another draw": ("[campaign.scale]\n", "[campaign.scale]\nI_C = { uniform = [0.9, 1.1] }\n"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_campaign_that_would_give_other_numbers_is_another_one(change: str, tmp_path: Path) -> None:
    """Each single change, so that blocks of two campaigns never meet."""
    old, new = CHANGES[change]
    assert old in EXPERIMENT
    assert fingerprint(tmp_path / "one.toml") != fingerprint(tmp_path / "one.toml", EXPERIMENT.replace(old, new, 1))


def test_controller_and_backend_belong_to_a_campaign(tmp_path: Path) -> None:
    """Others give other numbers, or other last digits."""
    path = tmp_path / "one.toml"
    prints = [fingerprint(path), fingerprint(path, controller="other"), fingerprint(path, backend="compiled")]
    assert len(set(prints)) == 3


@pytest.mark.parametrize(
    ("old", "new"), [('"one"', '"two"'), ("rms = 0.05", "rms = 0.06"), ("estimate = 2.0", "estimate = 3.0")]
)
def test_a_change_that_changes_no_number_keeps_the_blocks(old: str, new: str, tmp_path: Path) -> None:
    """Titles, what counts as success, and other controllers."""
    path = tmp_path / "one.toml"
    assert fingerprint(path) == fingerprint(path, EXPERIMENT.replace(old, new, 1))


@pytest.mark.parametrize("blocks", [0, 2])
def test_a_run_is_replayed_from_its_own_block(blocks: int, tmp_path: Path) -> None:
    """Run k is row k mod BLOCK of block k div BLOCK: with its noise, its start and its numbers."""
    path, row = tmp_path / "one.toml", 5
    path.write_text(
        EXPERIMENT.replace("[uncertainties]", "[uncertainties]\nmeasurement_noise = { deviation = 0.01 }")
        + "[campaign.start]\nphi = { normal = [0.1, 0.1] }\n"
    )
    job = prepare(path, backend="casadi")
    columns = run_block(job, blocks, row + 1)
    run = wmr_afl.replay(path, blocks * BLOCK + row, backend="numpy")
    np.testing.assert_allclose(run.rms(since=0.1 - 1e-12), columns["rms"][row], rtol=1e-10)
    np.testing.assert_allclose(np.abs(run.input[5:]).max(axis=0), columns["largest_input"][row], rtol=1e-10)
    assert run.state[0, 2] == columns["start.phi"][row]
    assert run.controller == f"AFL, run {blocks * BLOCK + row}"
    assert run.parameters[list(run.model.parameter_units).index("m_C")] == pytest.approx(
        30.0 * columns["scale.m_C"][row]
    )
    for wrong in (-1, 10_000_000):
        with pytest.raises(WmrError, match=f"no run {wrong}"):
            wmr_afl.replay(path, wrong)


def test_draws_reach_the_robots_as_their_places_say(tmp_path: Path) -> None:
    """Parameters and starts as numbers, gains in every entry, scales as factors; seeds only with noise."""
    path = tmp_path / "one.toml"
    tables = """
[campaign.parameters]
I_C = { uniform = [10.0, 11.0] }
[campaign.start]
phi = { uniform = [0.1, 0.2] }
[campaign.gains]
b1 = { uniform = [3.0, 4.0] }
"""
    path.write_text(EXPERIMENT + tables)
    job = prepare(path, backend="casadi")
    loop = loop_of(job)
    columns, ensemble, _ = ensemble_of(job, loop, 1, 3)
    assert set(columns) == {"parameters.I_C", "start.phi", "gains.b1", "scale.m_C"}
    values, states = Layout(loop.values).places, Layout(loop.states).places
    names = list(loop.model.parameter_units)
    p = ensemble.values[values["p"]]
    np.testing.assert_array_equal(p[names.index("I_C")], columns["parameters.I_C"])
    np.testing.assert_allclose(p[names.index("m_C")], 30.0 * columns["scale.m_C"], rtol=1e-15)
    np.testing.assert_array_equal(ensemble.states[states["x"]][2], columns["start.phi"])
    np.testing.assert_array_equal(ensemble.values[values["outer_loop.b1"]], np.tile(columns["gains.b1"], (2, 1)))
    np.testing.assert_allclose(ensemble.values[values["outer_loop.alpha"]][0], 1.0 / columns["gains.b1"], rtol=1e-15)


def test_a_campaign_gathers_its_blocks_in_order(tmp_path: Path) -> None:
    """Also if some are there already; progress counts all of them, and the first runs of a block are enough."""
    path, out, done = tmp_path / "one.toml", tmp_path / "out", []
    path.write_text(EXPERIMENT)
    few = wmr_afl.campaign(path, 30, out=out, backend="compiled")
    whole = wmr_afl.campaign(path, BLOCK + 20, out=out, backend="compiled", progress=done.append)
    np.testing.assert_array_equal(few.runs.rms, whole.runs.rms[:30])
    assert done == [BLOCK, 20]
    again = []
    same = wmr_afl.campaign(path, BLOCK + 10, out=out, backend="compiled", progress=again.append)
    assert again == [BLOCK, 10]
    np.testing.assert_array_equal(same.runs.rms, whole.runs.rms[: BLOCK + 10])
    job = prepare(path, backend="compiled")
    np.testing.assert_array_equal(whole.runs.rms[BLOCK:], run_block(job, 1, 20)["rms"])
    np.testing.assert_array_equal(whole.draws["scale.m_C"][BLOCK:], draws(job.table, 1, 20)["scale.m_C"])
    assert (whole.controller, whole.seed, whole.criteria.rms) == ("AFL", 1, 0.05)
    assert (list(whole.outputs), list(whole.inputs)) == (["y1", "y2"], ["u_r", "u_l"])
    for wrong in (0, 10_000_001):
        with pytest.raises(WmrError, match="choose 1 to 10000000"):
            wmr_afl.campaign(path, wrong)


def test_blocks_that_are_left_go_to_the_scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the job and the number of threads; if none is left, nobody is asked."""
    asked: list[tuple] = []

    def on_cluster(job: job.Job, wanted: workers.Wanted, threads: int, scheduler: str) -> workers.Finished:
        asked.append((job.controller, list(wanted), threads, scheduler))
        return workers.here(job, wanted, threads)

    monkeypatch.setattr(runner, "on_cluster", on_cluster)
    path, given = tmp_path / "one.toml", ("other", 2, "casadi", "tcp://there:1")
    path.write_text(EXPERIMENT)
    there = wmr_afl.campaign(path, 3, tmp_path / "out", *given)
    again = wmr_afl.campaign(path, 3, tmp_path / "out", *given)
    here = wmr_afl.campaign(path, 3, None, *given[:3])
    assert asked == [("other", [(0, 3)], 2, "tcp://there:1")]
    for one in (again, here):
        np.testing.assert_array_equal(one.runs.rms, there.runs.rms)


def test_a_ledger_keeps_whole_blocks_of_one_campaign(tmp_path: Path) -> None:
    """What is damaged, of another campaign or of another block is not read; fewer runs than there are can be."""
    columns = {"rms": np.arange(10.0).reshape(5, 2), "failure_time": np.arange(5.0)}
    ledger = Ledger(tmp_path / "out", "mine")
    assert ledger.read(0, 5) is None
    ledger.write(0, columns)
    for count in (5, 3):
        found = ledger.read(0, count)
        assert set(found) == set(columns)
        for name, column in columns.items():
            np.testing.assert_array_equal(found[name], column[:count])
    assert ledger.read(0, 6) is None
    assert Ledger(tmp_path / "out", "mine").read(0, 5) is not None
    (block,) = (tmp_path / "out").glob("block_*.npz")
    block.rename(block.with_name("block_000001.npz"))
    assert ledger.read(1, 5) is None
    with pytest.raises(WmrError, match="holds another campaign"):
        Ledger(tmp_path / "out", "another")
    (tmp_path / "out" / "block_000002.npz").write_bytes(b"damaged")
    assert ledger.read(2, 1) is None
    (tmp_path / "out" / "mine.txt").write_text("a file of somebody else")
    (tmp_path / "out" / ".unfinished-1-block").write_text("")
    clear(tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]
    (tmp_path / "out" / "campaign.json").write_text("{")
    with pytest.raises(WmrError, match="is damaged"):
        Ledger(tmp_path / "out", "mine")
    (tmp_path / "file").write_text("")
    with pytest.raises(WmrError, match="cannot be written"):
        Ledger(tmp_path / "file" / "out", "mine")


class Half:
    """A stream whose every number is in the middle of what it may be, or one deviation above it."""

    def random(self, size: int) -> np.ndarray:
        return np.full(size, 0.25)

    def standard_normal(self, size: int) -> np.ndarray:
        return np.full(size, 1.0)

    def integers(self, high: int, size: int) -> np.ndarray:
        return np.arange(size) % high


@pytest.mark.parametrize(
    ("distribution", "expected"),
    [
        (Distribution(uniform=[1.0, 3.0]), 1.5),
        (Distribution(log_uniform=[1.0, 16.0]), 2.0),
        (Distribution(normal=[1.0, 3.0]), 4.0),
    ],
)
def test_a_draw_is_its_distributions_quantile(distribution: Distribution, expected: float) -> None:
    """Of the stream's number, one for each run of a block."""
    np.testing.assert_allclose(draw(distribution, Half()), np.full(BLOCK, expected), rtol=1e-14)


def test_a_choice_draws_each_of_its_values() -> None:
    """As likely as any other."""
    np.testing.assert_array_equal(draw(Distribution(choice=[5.0, 7.0]), Half())[:4], [5.0, 7.0, 5.0, 7.0])


def test_seeds_of_noise_are_each_runs_own() -> None:
    """Different for every run, block and seed of the campaign."""
    table = CampaignTable(seed=1)
    seeds = [noise_seeds(table, 0, 50), noise_seeds(table, 1, 50), noise_seeds(CampaignTable(seed=2), 0, 50)]
    assert len(np.unique(np.concatenate(seeds))) == 150
    np.testing.assert_array_equal(noise_seeds(table, 0, 10), seeds[0][:10])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "no distribution"),
        ({"uniform": [0.0, 1.0], "normal": [0.0, 1.0]}, "uniform and normal"),
        ({"uniform": [1.0, 1.0]}, "is empty"),
        ({"log_uniform": [2.0, 1.0]}, "is empty"),
        ({"log_uniform": [0.0, 1.0]}, "above zero"),
        ({"normal": [0.0, 0.0]}, "deviation of 0"),
        ({"choice": []}, "choice"),
        ({"uniform": [1.0]}, "uniform"),
    ],
)
def test_a_distribution_that_cannot_be_drawn_is_refused(given: dict, words: str) -> None:
    """Exactly one kind, a range that holds something."""
    with pytest.raises(InputError, match=words):
        validate(given, Distribution, "file")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("since = 0.1", "since = 0.3", "a run ends at 0.2 s"),
        ("[campaign.scale]\nm_C = { uniform = [0.9, 1.1] }", "", "draws nothing"),
        ("seed = 1", 'controller = "PID"', "unknown controller 'PID'"),
        ("m_C = { uniform", "mass = { uniform", "'mass'"),
    ],
)
def test_a_campaign_that_cannot_be_run_is_reported(old: str, new: str, words: str, tmp_path: Path) -> None:
    """Before anything runs."""
    path = tmp_path / "one.toml"
    path.write_text(EXPERIMENT.replace(old, new))
    with pytest.raises(WmrError, match=words):
        prepare(path, backend="casadi")
    path.write_text(EXPERIMENT.split("[campaign]")[0])
    with pytest.raises(WmrError, match=r"\[campaign\]: is missing"):
        prepare(path)
    with pytest.raises(WmrError, match="backend of a campaign"):
        prepare(path, backend="numpy")


def test_the_end_of_a_run_is_a_time_from_which_errors_may_count(tmp_path: Path) -> None:
    """The last sample is one; the table names the controller unless the caller does."""
    path = tmp_path / "one.toml"
    path.write_text(EXPERIMENT.replace("since = 0.1", 'since = 0.2\ncontroller = "other"'))
    assert prepare(path, backend="casadi").controller == "other"
    assert prepare(path, "AFL", backend="casadi").controller == "AFL"


def test_only_the_last_few_loops_of_campaigns_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files of older ones go with them, and they are assembled again where they are needed."""
    monkeypatch.setattr(job, "_ASSEMBLED", {})
    monkeypatch.setattr(job, "MOST_ASSEMBLED", 1)
    jobs = []
    for seed in (1, 2):
        (tmp_path / f"{seed}.toml").write_text(EXPERIMENT.replace("seed = 1", f"seed = {seed}"))
        jobs.append(prepare(tmp_path / f"{seed}.toml", backend="casadi"))
    job.loop_of(jobs[0])
    folder = Path(job._ASSEMBLED[jobs[0].fingerprint][1].name)
    assert folder.exists()
    job.loop_of(jobs[1])
    assert list(job._ASSEMBLED) == [jobs[1].fingerprint]
    assert not folder.exists()
    assert job.loop_of(jobs[0]) is not None
    for _, kept in job._ASSEMBLED.values():
        kept.cleanup()
