"""Estimates against the robots that were driven, and against plain linear algebra."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.wmr_afl.identification.rehearsed import ROBOTS, RUBS, driven, effort_of, logged, truth
from wmr_afl import WmrError
from wmr_afl.cli import app
from wmr_afl.errors import SimulationError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.alike import is_geometry, motor_kinds
from wmr_afl.identification.dead_time import dead_time
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import Estimate, jackknife, prior_of
from wmr_afl.identification.excursions import others
from wmr_afl.identification.held_out import foretold, score, split
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log
from wmr_afl.identification.log_file import write_log
from wmr_afl.identification.motion import Smoother
from wmr_afl.identification.noise import standard_deviations
from wmr_afl.identification.output_error import OutputError, delayed, windows_of
from wmr_afl.identification.physical import physical
from wmr_afl.identification.recording import Sensors, drive, record
from wmr_afl.identification.simulated import Simulated
from wmr_afl.identification.weak_form import WeakForm, bump
from wmr_afl.plant.plant import Plant
from wmr_afl.simulation.simulate import simulate


def exact(robot: str) -> tuple[Smoother, list]:
    """A drive that was measured exactly."""
    log = driven(robot).log(Sensors(encoder=0.0, joint=0.0, gyro=0.0))
    smoother = Smoother(effort_of(robot), log.channels, np.full(len(log.channels), 1e-4))
    return smoother, [smoother.motion(segment) for segment in log.segments]


def off(robot: str, found: np.ndarray) -> np.ndarray:
    """By how much numbers are off, as a share of what they bring about (of the largest such share at most)."""
    return (found - truth(robot)) / truth(robot)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_weak_form_finds_the_robot(robot: str) -> None:
    """Within a few per cent of the voltages that it explains, from the first seconds of a drive."""
    smoother, motions = exact(robot)
    effort = smoother.effort
    form = WeakForm(effort, prior_of(effort, 10.0), 0.24, tuple(range(effort.n_v)))
    found = form.estimate(motions)
    assert found.left < 0.03
    big = found.share > 0.1
    assert np.all(np.abs(off(robot, found.unknown))[big] < 0.1)


@pytest.mark.parametrize("robot", ROBOTS)
def test_output_error_finds_the_robot(robot: str) -> None:
    """From 12 s of encoders and a noisy gyroscope, without touching its start: what is told is within its interval."""
    made = identify(effort_of(robot).model, logged(robot, seed=3), coulomb="each")
    found, true = made.estimate, truth(robot)
    assert found.cost is not None
    assert found.cost < 2.0
    assert found.method == "output error"
    told = np.array([name not in made.undetermined for name in made.names])
    assert told.sum() >= 0.5 * len(told)
    missed = np.abs(found.unknown - true)[told]
    assert np.all(missed < 4.0 * found.interval[told] + 3e-3 * np.abs(true[told]))
    assert np.median(missed / np.abs(true[told])) < 0.01


def smoother_of(log: Log, robot: str) -> Smoother:
    """With the noise that the log shows."""
    return Smoother(effort_of(robot), log.channels, standard_deviations(log))


def search_of(log: Log, robot: str, substep: float = 0.01, seconds: float = 1.0) -> OutputError:
    """Output error on a whole log."""
    smoother = smoother_of(log, robot)
    motions = [smoother.motion(segment) for segment in log.segments]
    return OutputError(smoother, windows_of(motions, seconds), prior_of(smoother.effort, 10.0), substep)


@pytest.mark.parametrize("robot", ["type_2_1", "type_1_2"])
def test_a_joint_that_was_read_coarsely_is_no_error_of_the_model(robot: str) -> None:
    """Where a window begins its angle is free within some steps of its encoder: noise is all that is left."""
    log = driven(robot).log(Sensors(joint=512.0, gyro=0.003))
    search = search_of(log, robot, 0.0025)
    assert search.misfit(Estimate("truth", truth(robot), np.empty((0, 0)))) < 1.1
    moved = search.loose
    joints = [i for i in moved if i < search.effort.n]
    assert len(joints) == sum(search.effort.is_joint(one) for one in search.channels) > 0


def test_windows_whose_steps_are_too_coarse_count_less() -> None:
    """Where friction reverses a motor in the middle of a step; the finer the steps the fewer they are."""
    log = driven("type_3_0").log(Sensors(encoder=65536.0))
    coarse, fine = (search_of(log, "type_3_0", substep)._trust(truth("type_3_0")) for substep in (0.02, 0.0025))
    assert np.all(coarse <= 1.0)
    assert coarse.mean() < 0.5 < 0.8 < fine.mean()
    search = search_of(log, "type_3_0", 0.02)
    search.trust = coarse
    assert search.weight.sum() == pytest.approx(search.shares.sum(), rel=1e-9)
    without = driven("type_3_0", rubs=0.0).log(Sensors())
    smooth = np.concatenate([truth("type_3_0", rubs=0.0)])
    assert search_of(without, "type_3_0", 0.01)._trust(smooth).min() > 0.9


def test_where_a_window_begins_is_as_read_off_unless_it_tells_better() -> None:
    """While a robot stands without voltage nothing tells how its joints stand."""
    log = driven("type_1_2").log(Sensors())
    (moving,) = log.segments
    rows = np.concatenate([np.zeros(150, dtype=int), np.arange(len(moving))])
    u = np.vstack([np.zeros((150, 3)), moving.u])
    gyro = np.array([one.is_rate for one in log.channels])
    noise = np.where(np.arange(len(u))[:, None] < 150, 0.01 * np.random.default_rng(1).standard_normal((len(u), 1)), 0)
    log = log.of([replace(moving, u=u, z=moving.z[rows] + gyro * noise, is_new=moving.is_new[rows])])
    search = search_of(log, "type_1_2", 0.005)
    before = search.first.copy()
    found = search.fit(truth("type_1_2"))
    assert found.cost < 1.1
    still = ~np.any(search.windows[0].u, axis=(1, 2))
    assert still.sum() >= 2
    assert np.all(np.abs(search.first - before)[still] < 0.1 * search.spread)
    assert np.any(np.abs(search.first - before)[~still] > 0.1 * search.spread)


def test_what_the_description_is_sure_of_stays() -> None:
    """The search goes there from the truth, although the log says something else."""
    log, true = driven("type_2_0", 6.0).log(Sensors()), truth("type_2_0")
    search = search_of(log, "type_2_0", 0.02)
    sure = replace(search.prior, mean=1.1 * true, spread=1e-6 * true)
    found = OutputError(smoother_of(log, "type_2_0"), search.windows, sure, 0.02).fit(true)
    np.testing.assert_allclose(found.unknown, 1.1 * true, rtol=1e-5)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_output_error_is_the_same_in_other_units_of_voltage(unit: float) -> None:
    """In kilovolts and in millivolts, with its covariance."""
    log, true = driven("type_2_0", 6.0).log(Sensors()), truth("type_2_0")
    search = search_of(log, "type_2_0", 0.02)
    prior = replace(search.prior, mean=unit * search.prior.mean, spread=unit * search.prior.spread)
    windows = [replace(one, u=unit * one.u) for one in search.windows]
    found = search.fit(0.9 * true)
    other = OutputError(smoother_of(log, "type_2_0"), windows, prior, 0.02).fit(unit * 0.9 * true)
    np.testing.assert_allclose(other.unknown, unit * found.unknown, rtol=1e-4)
    np.testing.assert_allclose(other.interval, unit * found.interval, rtol=1e-2)
    assert other.cost == pytest.approx(found.cost, rel=1e-4)


def test_a_channel_that_contradicts_the_others_counts_less() -> None:
    """As little as what is left of it; those that the model explains count as their noise tells."""
    log = driven("type_2_0", 6.0).log(Sensors())
    search = search_of(log.of([replace(one, z=one.z * [1.0, 1.0, 1.1]) for one in log.segments]), "type_2_0")
    found = search.fit(truth("type_2_0"))
    right, left, gyro = search.error / search.noise
    assert max(right, left) < 1.5
    assert gyro > 10.0
    np.testing.assert_allclose(found.unknown, truth("type_2_0"), rtol=3e-3)


@pytest.mark.parametrize("prior", [np.zeros(3), np.array([3.0, 20.0, 100.0])], ids=["alone", "described"])
def test_windows_that_are_left_out_give_the_spread(prior: np.ndarray) -> None:
    """The jackknife is what leaving each cluster out and solving again gives, around the estimate; and the prior's."""
    random = np.random.default_rng(2)
    a, b = random.normal(size=(8, 12, 3)), random.normal(size=(8, 12))

    def solved(kept: list[int]) -> np.ndarray:
        rows, right = np.vstack([*a[kept], np.diag(np.sqrt(prior))]), np.concatenate([*b[kept], np.zeros(3)])
        return np.linalg.lstsq(rows, right, rcond=None)[0]

    whole = solved([*range(8)])
    left = b - a @ whole
    moved = np.array([solved([i for i in range(8) if i != k]) - whole for k in range(8)])
    inverse = np.linalg.inv(np.einsum("wki,wkj->ij", a, a) + np.diag(prior))
    expected = 7 / 8 * moved.T @ moved + inverse @ np.diag(prior) @ inverse
    for units in (np.ones(3), np.array([1e-9, 1.0, 1e9])):  # whatever numbers are counted in
        own = a * units
        found = jackknife(np.einsum("wki,wkj->wij", own, own), np.einsum("wki,wk->wi", own, left), prior * units**2)
        np.testing.assert_allclose(found * np.outer(units, units), expected, rtol=1e-9)


def test_an_interval_is_two_standard_deviations() -> None:
    """None where rounding makes a variance negative."""
    found = Estimate("told", np.ones(3), np.diag([9.0, 0.0, -1e-20])).interval
    np.testing.assert_array_equal(found, [6.0, 0.0, 0.0])


def test_a_number_that_no_window_tells_has_the_spread_of_the_description() -> None:
    """Neither none nor any."""
    normals, slopes = np.zeros((5, 2, 2)), np.zeros((5, 2))
    normals[:, 0, 0] = 1.0
    spread = np.sqrt(np.diag(jackknife(normals, slopes, np.array([0.04, 0.04]))))
    assert spread[1] == pytest.approx(5.0)
    assert spread[0] < 0.1


def test_a_test_function_ends_smoothly() -> None:
    """It is zero at its ends with its slope, and its slope is its derivative."""
    psi, slope = bump(200)
    assert abs(psi[0]) < 1e-5
    assert abs(slope[0]) < 1e-5
    np.testing.assert_allclose(np.gradient(psi)[1:-1], slope[1:-1], atol=1e-6)


@pytest.mark.parametrize(("delay", "share"), [(0.0, [3.0]), (0.02, [2.0]), (0.005, [2.75]), (-0.02, [4.0])])
def test_a_delayed_voltage_is_the_mean_over_the_sample(delay: float, share: list[float]) -> None:
    """Of what is held then; forwards and backwards."""
    u = np.arange(6.0)[:, None]
    assert delayed(u, delay, 0.02)[3] == pytest.approx(share)


@pytest.mark.parametrize(("delay", "begin", "end"), [(0.04, [0, 0, 0, 1], [3]), (-0.04, [2], [5, 5, 5])])
def test_beyond_its_ends_a_delayed_voltage_is_the_first_or_the_last(
    delay: float, begin: list[float], end: list[float]
) -> None:
    """A log holds no other."""
    found = delayed(np.arange(6.0)[:, None], delay, 0.02)[:, 0]
    np.testing.assert_array_equal(found[: len(begin)], begin)
    np.testing.assert_array_equal(found[-len(end) :], end)


@pytest.mark.parametrize("samples", [0, 1, 3, -1])
def test_a_time_offset_is_found(samples: int) -> None:
    """Of voltages that stand in the wrong row."""
    log = logged("type_2_0")
    moved = log.of([replace(one, u=np.roll(one.u, -samples, axis=0)) for one in log.segments])
    smoother = Smoother(effort_of("type_2_0"), log.channels, np.array([1e-3, 1e-3, 1e-2]))
    form = WeakForm(smoother.effort, prior_of(smoother.effort, 10.0), 0.24, (0, 1))
    found, gain = dead_time(smoother, [smoother.motion(one) for one in moved.segments], form, 1.0)
    assert found == pytest.approx(0.02 * samples, abs=0.004)
    assert (gain > 0.3) == (samples != 0)


def test_a_delay_that_is_given_mends_it() -> None:
    """The numbers are those of the log that is right."""
    log = logged("type_2_0")
    moved = log.of([replace(one, u=np.roll(one.u, -2, axis=0)) for one in log.segments])
    model = effort_of("type_2_0").model
    right, late, mended = (
        identify(model, one, delay=delay) for one, delay in ((log, 0.0), (moved, 0.0), (moved, 0.04))
    )
    assert np.abs(late.estimate.unknown / right.estimate.unknown - 1.0).max() > 0.05
    np.testing.assert_allclose(mended.estimate.unknown, right.estimate.unknown, rtol=0.01)
    assert any("answer 40 ms later" in str(check) or "answer 39 ms later" in str(check) for check in late.checks)


@pytest.mark.parametrize("robot", ["type_2_0", "car", "mecanum"])
def test_physical_parameters_bring_back_the_base_parameters(robot: str) -> None:
    """From a description that is off by factors; masses and gains together stay as they were described."""
    effort = effort_of(robot)
    names = list(effort.model.parameter_units)
    described = effort.p.copy()
    random = np.random.default_rng(4)
    for k in effort.sought:
        described[k] *= random.uniform(0.7, 1.4)
    own = Effort(effort.model, described, "none")
    true = effort.base(effort.p)
    estimate = Estimate("exact", true, np.diag((1e-4 * true) ** 2))
    found = physical(own, estimate)
    np.testing.assert_allclose(effort.base(found.p), true, rtol=0.02)
    assert not found.is_contradiction
    assert found.chi2 < 1.0
    assert np.all(found.p[[k for k in effort.sought if not effort.is_length[k]]] > 0.0)
    assert set(found.uncertain) == {names[k] for k in effort.sought}
    far = Estimate("impossible", np.where(np.arange(len(true)) == 0, -true, true), np.diag((1e-3 * true) ** 2))
    assert physical(own, far).is_contradiction


def test_what_no_voltage_tells_stays_as_described() -> None:
    """The scale of masses and gains together: half of it in the description gives half of it."""
    effort = effort_of("type_2_0")
    names = list(effort.model.parameter_units)
    scaled = effort.p.copy()
    for k, name in enumerate(names):
        if name[0] in "mIK":
            scaled[k] *= 2.0
    true = effort.base(effort.p)
    estimate = Estimate("exact", true, np.diag((1e-4 * true) ** 2))
    found = physical(Effort(effort.model, scaled, "none"), estimate)
    np.testing.assert_allclose(found.p, scaled, rtol=1e-3)


def test_held_out_parts_are_foretold() -> None:
    """By the truth nearly wholly, by another robot less; nothing of what is held out is in what is kept."""
    log = logged("type_2_0")
    kept, held = split(log, 0.25)
    assert kept.duration + held.duration == pytest.approx(log.duration)
    assert held.segments[0].start == pytest.approx(9.0)
    smoother, _ = exact("type_2_0")
    motions = [smoother.motion(one) for one in held.segments]
    true = Estimate("truth", truth("type_2_0"), np.zeros((8, 8)))
    heavier = replace(true, unknown=true.unknown * np.array([2.0, 1, 1, 2.0, 1, 1, 1, 1]))
    best, other = (score(smoother, motions, one) for one in (true, heavier))
    assert best.overall > 97.0
    assert other.overall < best.overall - 5.0
    assert np.all(best.each > 95.0)
    rows, v = foretold(smoother, motions[0], true)
    assert len(rows) == len(v)
    windows = windows_of(motions, 1.0)
    search = OutputError(smoother, windows, prior_of(smoother.effort, 10.0))
    assert search.misfit(true) < 0.5 * search.misfit(heavier)


def test_a_long_part_is_foretold_in_windows_of_two_seconds() -> None:
    """One after the other without a gap, each from what was measured; a shorter part as a whole.

    A robot that stops at once, whatever its voltages, tells where windows begin.
    """
    smoother, (motion,) = exact("type_2_0")
    segment, stops = motion.segment, Estimate("stops", 1e6 * truth("type_2_0"), np.empty((0, 0)))
    again = np.tile(np.arange(len(segment)), 3)
    long = smoother.motion(replace(segment, u=segment.u[again], z=segment.z[again], is_new=segment.is_new[again]))
    size, reach = round(2.0 / segment.step), smoother.reach(segment.step)
    for one, windows in ((motion, 1), (long, len(long.x) // size - 1)):
        rows, v = foretold(smoother, one, stops)
        moves = np.linalg.norm(v, axis=1) > 1e-6
        begins = np.flatnonzero(moves[1:] & ~moves[:-1]) + 1
        np.testing.assert_array_equal(begins, size * np.arange(1, windows))
        np.testing.assert_array_equal(rows, np.arange(rows[0], rows[0] + len(rows)))
        assert len(rows) > one.ok.sum() - size - 2 * reach


def test_segments_are_held_out_by_name() -> None:
    """All of that name; short tests as a whole, the last of them."""
    log = logged("type_2_0", 6.0)
    parts = [replace(log.segments[0], name=name, start=10.0 * k) for k, name in enumerate("abcd")]
    four = log.of(parts)
    kept, held = split(four, "b")
    assert [one.name for one in kept.segments] == ["a", "c", "d"]
    assert [one.name for one in held.segments] == ["b"]
    kept, held = split(four, 0.3)
    assert [one.name for one in held.segments] == ["c"]
    kept, held = split(four, 0.5)
    assert [one.name for one in held.segments] == ["b", "d"]
    kept, held = split(four, "[ad]")
    assert [one.name for one in held.segments] == ["a", "d"]
    assert [one.name for one in kept.segments] == ["b", "c"]
    for wrong in ("e", 0.0, 0.9):
        with pytest.raises(WmrError, match="hold_out"):
            split(four, wrong)
    with pytest.raises(WmrError, match="is the whole log"):
        split(log.of(parts[:1]), "a")


@pytest.mark.parametrize("robot", ["type_2_0", "type_1_2", "mecanum", "tractor_trailer"])
def test_many_motions_are_as_each_alone(robot: str) -> None:
    """The simulation of windows, against a drive of the robot that was sampled finely."""
    made = driven(robot, 2.0)
    effort = effort_of(robot)
    count, size = 50, effort.n + effort.n_v
    u = np.repeat(made.applied[None, :count], 3, axis=0)
    unknown = np.repeat(truth(robot)[None], 3, axis=0)
    states = Simulated(effort, 0.02).states(unknown, np.repeat(made.state[:1], 3, axis=0), u)
    np.testing.assert_array_equal(states[:, :, 0], states[:, :, 2])
    scale = np.abs(made.state[: count + 1]).max(axis=0) + 0.05
    assert np.abs((states[:, :size, 0] - made.state[: count + 1]) / scale).max() < 0.02
    angles = made.angles[: count + 1]
    assert np.abs(states[:, size:, 0] - angles).max() < 0.02 * np.abs(angles).max() + 1e-3


def test_a_log_of_an_experiment_is_the_run(tmp_path: object) -> None:
    """The state at each sample is the run's, but for finer steps; the same seed gives the same log."""
    sensors = Sensors(encoder=0.0, joint=0.0, gyro=0.0, measured=("x", "v", "omega"))
    log = record("track_type_2_0", seconds=2.0, sensors=sensors)
    run = simulate(next(iter(load_experiment("track_type_2_0").loops.values())), 2.0)
    rows = len(log.segments[0])
    names = list(run.model.state_units)
    expected = run.state[:rows, [names.index(name) for name in ("x", "v", "omega")]]
    np.testing.assert_allclose(log.segments[0].z, expected, atol=0.02)
    np.testing.assert_allclose(log.segments[0].u, run.input[:rows], atol=1e-9)
    one, two, other = (record("track_type_2_0", seconds=1.0, sensors=Sensors(seed=seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.segments[0].z, two.segments[0].z)
    assert not np.array_equal(one.segments[0].z, other.segments[0].z)


def test_a_drive_without_bound_is_told() -> None:
    """As soon as anything of it is no number: here x alone, which begins near the largest one."""
    loop = next(iter(load_experiment("track_type_2_0").loops.values()))
    start = np.array([1.7976e308, 0.0, 0.0, 0.0, 0.0])
    plant = Plant(loop.model, loop.plant.parameters, start, "rk4", [])
    with pytest.raises(SimulationError, match=r"the motion grows without bound at t = 0\.\d+ s"):
        drive(replace(loop, plant=plant), lambda t, x: np.full(2, 1e305), 200, 4)


def test_encoders_count_steps() -> None:
    """What is written is a multiple of a step, and no more than one off."""
    made = driven("type_2_0", 3.0)
    z = made.log(Sensors(encoder=500.0)).segments[0].z[:, :2]
    step = 2.0 * np.pi / 500.0
    np.testing.assert_allclose(z / step, np.round(z / step), atol=1e-9)
    assert np.all((made.angles - z >= -1e-12) & (made.angles - z < step))
    every = made.log(Sensors(every=5)).segments[0]
    assert every.step == pytest.approx(0.1)
    assert len(every) == len(made.log(Sensors()).segments[0]) // 5


def test_it_prints_what_it_found() -> None:
    """Verdict, checks, every number with its interval, and a guess that can be pasted."""
    made = identify(effort_of("type_2_0").model, logged("type_2_0"))
    text = str(made)
    for wanted in ("foretells", "encoders against other sensors", "pi1", "coulomb_u_r", "guess = { d = "):
        assert wanted in text
    assert repr(made).startswith("<Identified type_2_0: output error: leaves ")
    assert made.estimate.unknown[-1] == pytest.approx(RUBS, rel=0.1)


def test_a_log_of_something_else_is_a_contradiction(tmp_path: Path) -> None:
    """Voltages of another drive explain nothing: one line says so, and the exit status is 1; the right ones do."""
    right, other = driven("type_2_0").log(Sensors()), driven("type_2_0", seed=5)
    wrong = right.of([replace(one, u=other.applied) for one in right.segments])
    for log, status in ((right, 0), (wrong, 1)):
        write_log(log, tmp_path / "log.csv")
        done = CliRunner().invoke(
            app, ["identify", "type_2_0", str(tmp_path / "log.csv"), "--out", str(tmp_path / "out")]
        )
        assert done.exit_code == status, done.output
        assert ("this robot does not match the log" in " ".join(done.output.split())) == bool(status)


def test_a_delay_at_the_edge_of_what_is_tried_is_not_believed() -> None:
    """Voltages half a second off look better and better the further they are moved: what is wrong is something else."""
    log = logged("type_2_0")
    smoother = Smoother(effort_of("type_2_0"), log.channels, np.array([1e-3, 1e-3, 1e-2]))
    form = WeakForm(smoother.effort, prior_of(smoother.effort, 10.0), 0.24, (0, 1))
    moved = log.of([replace(one, u=np.roll(one.u, -8, axis=0)) for one in log.segments])
    found, gain = dead_time(smoother, [smoother.motion(one) for one in moved.segments], form, 1.0)
    assert (found, gain) == (pytest.approx(0.12), 0.0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_motors_and_lengths_are_told_apart_once(robot: str) -> None:
    """What identification asks for and what a design of voltages lets vary are the same parameters."""
    effort = effort_of(robot)
    known = is_geometry(effort.model, effort.p)
    varied = np.any(others(effort.model, effort.p, 8, 0) != effort.p, axis=0)
    assert set(np.flatnonzero(varied)) <= set(effort.sought)
    assert not any(known[k] for k in effort.sought)
    motors = list(effort.model.input_units)
    assert sorted(j for kind in motor_kinds(effort.model) for j in kind) == list(range(len(motors)))
    moved = effort.model.actuator_rates_matrix(np.full(effort.n, 0.3), effort.p * 1.1)
    assert any(known) or np.allclose(moved, effort.motor_rates(np.full(effort.n, 0.3)))
