"""From columns to a motion: grids, units, noise, smoothing, and what a log does wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.wmr_afl.identification.rehearsed import ROBOTS, driven, effort_of, logged
from wmr_afl import WmrError, load_model
from wmr_afl.identification.checks import check_input, check_length, dead_encoders, findings, missing_motions
from wmr_afl.identification.columns import between, quantum, update_period
from wmr_afl.identification.log import Log, log_of
from wmr_afl.identification.log_file import read_log, read_logs, write_log
from wmr_afl.identification.motion import Motion, Smoother, with_rest
from wmr_afl.identification.noise import standard_deviations
from wmr_afl.identification.recording import Sensors
from wmr_afl.numerics.arrays import Floats

UNICYCLE = load_model("type_2_0")


def smoother_of(log: Log, robot: str) -> Smoother:
    return Smoother(effort_of(robot), log.channels, standard_deviations(log), float(log.periods.max()))


def motions_of(smoother: Smoother, log: Log) -> list[Motion]:
    return [smoother.motion(segment) for segment in log.segments]


def simple(time: np.ndarray, **columns: np.ndarray) -> Log:
    measured = {"angle:u_r": np.sin(time), "angle:u_l": np.cos(time)} | columns
    return log_of(UNICYCLE, time, np.ones((len(time), 2)), measured)


def test_rows_come_to_lie_on_a_grid() -> None:
    """Jitter is evened out; a gap begins another segment; a voltage that is held over a sample stays what it is."""
    random = np.random.default_rng(0)
    time = 0.02 * np.arange(200) + random.uniform(-0.002, 0.002, 200)
    u = np.repeat(np.arange(20.0), 10)[:, None] * np.ones(2)
    log = log_of(UNICYCLE, time, u, {"angle:u_r": 3.0 * time, "angle:u_l": time})
    (segment,) = log.segments
    np.testing.assert_allclose(segment.z[:, 0], 3.0 * segment.time, atol=1e-12)
    assert np.mean(np.isclose(segment.u[:, 0], np.round(segment.u[:, 0]))) > 0.85
    assert abs(segment.step - 0.02) < 1e-4
    two = simple(np.concatenate([0.02 * np.arange(50), 3.0 + 0.02 * np.arange(60)]))
    assert [len(one) for one in two.segments] == [50, 60]
    assert abs(two.duration - 110 * 0.02) < 1e-9


@pytest.mark.parametrize("jitter", [0.1, 0.3, 0.37])
def test_voltages_of_uneven_rows_are_means_of_what_was_held(jitter: float) -> None:
    """Their sum over time is that of the rows, to the last sample; the robot turns by no more and no less."""
    random = np.random.default_rng(1)
    time = 0.02 * np.arange(300) + 0.02 * random.uniform(-jitter, jitter, 300)
    volts = random.normal(size=(300, 2))
    (segment,) = log_of(UNICYCLE, time, volts, {"angle:u_r": time, "angle:u_l": time}).segments
    held = np.vstack([np.zeros((1, 2)), np.cumsum(volts[:-1] * np.diff(time)[:, None], axis=0)])
    exact = np.column_stack([np.interp(segment.time, time, one) for one in held.T])
    np.testing.assert_allclose(segment.step * np.cumsum(segment.u[:-1], axis=0), exact[1:], atol=1e-9)
    assert segment.is_new.all()


def test_a_row_that_is_lost_lies_between_the_others() -> None:
    """Voltage and angles alike, and it is no measurement; rows that were written at a fixed rate stay as they are."""
    time = 0.02 * np.arange(100)
    kept = np.delete(np.arange(100), [20, 50, 51])
    volts = np.column_stack([time, time])
    (segment,) = log_of(UNICYCLE, time[kept], volts[kept], {"angle:u_r": time[kept], "angle:u_l": time[kept]}).segments
    np.testing.assert_allclose(segment.u, volts, atol=1e-9)
    np.testing.assert_allclose(segment.z[:, 0], time, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(~segment.is_new[:, 0]), [20, 50, 51])
    (whole,) = log_of(UNICYCLE, time, volts, {"angle:u_r": time, "angle:u_l": time}).segments
    np.testing.assert_array_equal(whole.u, volts)


def test_rows_that_were_lost_are_told() -> None:
    """And their share."""
    log = logged("type_2_0")
    (segment,) = log.segments
    kept = np.random.default_rng(0).uniform(size=len(segment)) > 0.1
    columns = {one.name: segment.z[kept, k] for k, one in enumerate(log.channels)}
    less = log_of(log.model, segment.time[kept], segment.u[kept], columns)
    assert less.lost == pytest.approx(1.0 - kept.mean(), abs=1e-3)
    assert f"rows: put on a grid of 20 ms; {less.lost:.1%} of the rows are missing" in text_of(less)
    assert "rows:" not in text_of(log)


@pytest.mark.parametrize(("name", "by", "rows"), [("angle:u_r", 5.0, 1), ("rate:phi", 50.0, 1), ("angle:u_l", -9.0, 3)])
def test_a_cell_that_jumps_is_left_out(name: str, by: float, rows: int) -> None:
    """It is told where, what is put in its place lies between its neighbours, and no wheel radius is blamed."""
    log = logged("type_2_0")
    k, at = [one.name for one in log.channels].index(name), slice(200, 200 + rows)

    def spoilt(t: Floats, z: Floats) -> tuple[Floats, Floats]:
        z = z.copy()
        z[at, k] += by
        return t, z

    wrong = rewritten(log, spoilt)
    (found,), (true,) = wrong.segments, log.segments
    np.testing.assert_allclose(wrong.spikes[name], true.time[at])
    assert np.abs(found.z - true.z)[at, k].max() < 0.5
    np.testing.assert_array_equal(np.flatnonzero(~found.is_new[:, k]), np.arange(200, 200 + rows))
    text = text_of(wrong)
    assert f"spikes: {name} jumps in {rows} row{'' if rows == 1 else 's'} and is back then, at t = 4" in text
    assert "rate:phi agrees to" in text


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_motion_is_a_spike(robot: str) -> None:
    """However fast it is, and however often values repeat, rows are lost or angles begin anew after a turn."""
    log = logged(robot)
    (segment,) = log.segments
    angles = [not one.is_rate for one in log.channels]
    kept = np.random.default_rng(0).uniform(size=len(segment)) > 0.1
    wrapped = np.where(angles, (segment.z + np.pi) % (2.0 * np.pi) - np.pi, segment.z)
    every = np.arange(len(segment)) // 4 * 4
    for z, rows in ((segment.z, kept), (segment.z[every], slice(None)), (wrapped, slice(None))):
        columns = {one.name: z[rows, k] for k, one in enumerate(log.channels)}
        assert not log_of(log.model, segment.time[rows], segment.u[rows], columns).spikes


def test_less_than_three_rows_are_no_segment() -> None:
    """Whether a gap leaves them or a name."""
    time = np.concatenate([0.02 * np.arange(50), [3.0, 3.02], 6.0 + 0.02 * np.arange(3)])
    assert [len(one) for one in simple(time).segments] == [50, 3]
    measured = {"angle:u_r": np.sin(time), "angle:u_l": np.cos(time)}
    names = np.repeat(["a", "b", "c"], [50, 2, 3]).tolist()
    log = log_of(UNICYCLE, time, np.ones((len(time), 2)), measured, names)
    assert [(one.name, len(one)) for one in log.segments] == [("a", 50), ("c", 3)]


@pytest.mark.parametrize(
    ("time", "told"),
    [
        (np.array([0.0, 0.1, 0.2, 0.2, 0.3]), "time stands still at t = 0.2 s (row 4)"),
        (np.array([0.0, 0.1, 0.2, 0.1, 0.3]), "time goes backwards at t = 0.1 s (row 4)"),
        (np.array([0.0, 0.1, 0.2, np.nan, 0.3]), "row 4 of the log holds what is not a finite number"),
        (0.02 * np.flatnonzero(np.arange(100) % 5 < 3), "39% of the rows after t = 0 s are missing (one each 20 ms"),
    ],
    ids=["still", "backwards", "NaN", "lost"],
)
def test_time_goes_on(time: np.ndarray, told: str) -> None:
    """Or it is said where it does not."""
    with pytest.raises(WmrError) as error:
        simple(time)
    assert told in str(error.value)


def test_a_log_is_what_was_written(tmp_path: Path) -> None:
    """Channels, segments and numbers; units may stand behind names; runs as `simulate` writes them are logs."""
    log = driven("car", 3.0).log(Sensors(), "first")
    log = log.of([*log.segments, replace(log.segments[0], name="second", start=10.0)])
    write_log(log, tmp_path / "log.csv", about=["a drive"])
    again = read_log(log.model, tmp_path / "log.csv")
    assert [one.name for one in again.segments] == ["first", "second"]
    assert again.channels == log.channels
    for one, other in zip(again.segments, log.segments, strict=True):
        np.testing.assert_allclose(one.z, other.z, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(one.u, other.u, rtol=1e-9, atol=1e-12)
    (first, second) = log.segments
    write_log(log.of([first, second.part(10, len(second))]), tmp_path / "other.csv")
    both = read_logs(log.model, [tmp_path / "log.csv", tmp_path / "other.csv"])
    assert [one.name for one in both.segments] == ["log first", "log second", "other first", "other second"]
    (tmp_path / "copy.csv").write_bytes((tmp_path / "log.csv").read_bytes())
    for again in ("log.csv", "copy.csv"):
        with pytest.raises(WmrError, match=rf"{again}: holds the same rows as .*log\.csv; give each log once"):
            read_logs(log.model, [tmp_path / "log.csv", tmp_path / "other.csv", tmp_path / again])
    text = "time [s],x [m],phi [rad],v [m/s],u_r [V],u_l [V],command_u_r [V],error_y1 [m],estimate_theta1 [1/s]\n"
    text += "".join(f"{0.02 * k},0,0,1,1,1,1,0,0\n" for k in range(20))
    (tmp_path / "run.csv").write_text(text)
    assert [one.name for one in read_log(UNICYCLE, tmp_path / "run.csv").channels] == ["x", "phi", "v"]


@pytest.mark.parametrize(
    ("file", "told"), [("a\0b", "'a\\x00b': is no path"), ("nowhere.csv", "nowhere.csv: cannot be")]
)
def test_a_file_that_cannot_be_is_told(file: str, told: str) -> None:
    """In one line."""
    with pytest.raises(WmrError) as error:
        read_log(UNICYCLE, file)
    assert told in str(error.value)


@pytest.mark.parametrize("step", [2 * np.pi / 2048, 0.01, 0.0])
def test_the_step_of_an_encoder_is_read_off(step: float) -> None:
    """From its smallest changes; a channel without steps has none, and its noise is what smoothing takes away."""
    time = 0.02 * np.arange(2000)
    column = 3.0 * np.sin(time) + 2.0 * np.sin(2.7 * time)
    if step:
        found = np.floor(column / step) * step
        assert quantum(np.round(found, 6)) == pytest.approx(step, rel=1e-2)
        return
    noisy = column + 1e-3 * np.random.default_rng(0).standard_normal(len(column))
    assert quantum(noisy) == 0.0
    log = log_of(UNICYCLE, time, np.ones((len(time), 2)), {"angle:u_r": noisy, "angle:u_l": noisy})
    np.testing.assert_allclose(standard_deviations(log), 1e-3, rtol=0.1)
    kept = np.random.default_rng(1).uniform(size=len(time)) > 0.1  # smoothing goes over no row that is lost
    less = log_of(UNICYCLE, time[kept], np.ones((kept.sum(), 2)), {"angle:u_r": noisy[kept], "angle:u_l": noisy[kept]})
    np.testing.assert_allclose(standard_deviations(less), 1e-3, rtol=0.1)


@pytest.mark.parametrize("robot", ROBOTS)
def test_smoothing_gives_the_state(robot: str) -> None:
    """q and v of a drive that was measured exactly, but for coordinates that do not matter."""
    made = driven(robot, 6.0, rubs=0.0)
    log = made.log(Sensors(encoder=0.0, joint=0.0, gyro=0.0))
    smoother = smoother_of(log, robot)
    (motion,) = motions_of(smoother, log)
    effort = smoother.effort
    matter = [i for i in range(effort.n) if not effort.cyclic[i]] + list(range(effort.n, effort.n + effort.n_v))
    size = np.abs(made.state).max(axis=0)[matter]
    missed = np.abs(motion.x - made.state)[motion.ok][:, matter]
    assert np.all(np.sqrt(np.mean(missed**2, axis=0)) < 0.02 * size)


def test_a_joint_without_a_column_is_followed() -> None:
    """By what the other columns say of its rate; how it stood at the start nobody knows."""
    made = driven("car", 6.0, rubs=0.0)
    log = made.log(Sensors(encoder=0.0, gyro=0.0, measured=("angle:u_drive", "angle:u_steer")))
    smoother = smoother_of(log, "car")
    (motion,) = motions_of(smoother, log)
    joint = [i for i in range(smoother.effort.n) if not smoother.effort.cyclic[i]]
    missed = (motion.x - made.state)[motion.ok][:, joint]
    assert np.abs(missed - missed[0]).max() < 0.1


def test_positions_count_only_with_the_heading() -> None:
    """x and y say nothing of v where nobody knows the heading."""
    made = driven("type_2_0", 3.0)
    for measured, used in ((("x", "y", "phi"), 3), (("x", "y", "angle:u_r", "angle:u_l"), 2)):
        log = made.log(Sensors(measured=measured))
        assert smoother_of(log, "type_2_0").used.sum() == used


def test_columns_that_do_not_suffice_are_told() -> None:
    """One encoder of two does not tell how a robot turns."""
    log = driven("type_2_0", 3.0).log(Sensors(measured=("angle:u_r",)))
    with pytest.raises(WmrError, match=r"angle:u_r determine 1 of 2 pseudo-velocities; add the encoders of all motors"):
        smoother_of(log, "type_2_0")


def test_a_test_from_rest_gets_rest_in_front() -> None:
    """Half a second, so that its transient is not cut off."""
    log = driven("type_2_0", 3.0).log(Sensors(gyro=0.0))
    segment = log.segments[0]
    rows = np.concatenate([np.zeros(3, dtype=int), np.arange(len(segment))])
    volts = np.vstack([np.zeros((3, 2)), segment.u])
    still = replace(segment, u=volts, z=segment.z[rows], is_new=segment.is_new[rows])
    rates = np.array([one.is_rate for one in log.channels])
    assert len(with_rest(still, rates)) == len(still) + 25
    assert with_rest(still, rates).start == pytest.approx(still.start - 0.5)
    early = with_rest(replace(still, u=still.u + np.array([1.0, 2.0])), rates)  # a logger that begins with the command
    assert len(early) == len(still) + 25
    assert not np.any(early.u[:25])
    np.testing.assert_array_equal(early.u[25], [1.0, 2.0])
    assert early.is_new.shape == early.z.shape
    moving = segment.part(40, len(segment))
    assert with_rest(moving, rates) is moving
    turning = replace(still, z=still.z + np.where(rates, 0.1, 0.0))
    assert with_rest(turning, rates) is turning


def text_of(log: Log, robot: str = "type_2_0") -> str:
    """What the checks say of a log."""
    smoother = smoother_of(log, robot)
    return "\n".join(map(str, findings(smoother, log, motions_of(smoother, log))))


def changed(log: Log, **columns: float) -> Log:
    """Columns times a number."""
    factors = np.array([columns.get(one.name.replace(":", "_"), 1.0) for one in log.channels])
    return log.of([replace(one, z=one.z * factors) for one in log.segments])


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1.0, "rate:phi agrees to"),
        (-1.0, "rate:phi runs against the encoders (by a factor of -1.0"),
        (1.05, "rate:phi moves +5."),
        (180.0 / np.pi, "convert rate:phi to rad"),
    ],
)
def test_a_gyroscope_is_held_against_the_encoders(factor: float, told: str) -> None:
    """Its sign, its unit, its size."""
    assert told in text_of(changed(logged("type_2_0"), rate_phi=factor))


def rewritten(log: Log, change: Callable[[Floats, Floats], tuple[Floats, Floats]]) -> Log:
    """The log whose times (T,) and measured columns (T, channels) were changed before they were read."""
    (segment,) = log.segments
    t, z = change(segment.time, segment.z)
    return log_of(log.model, t, segment.u, {one.name: z[:, k] for k, one in enumerate(log.channels)})


def test_values_that_only_repeat_are_told() -> None:
    """A log that is written more often than anything is measured; smoothing then spans two updates."""
    log = logged("type_2_0")
    slow = rewritten(log, lambda t, z: (t, z[np.arange(len(z)) // 4 * 4]))
    step = log.segments[0].step
    np.testing.assert_allclose(slow.periods, 4.0 * step, rtol=0.1)
    np.testing.assert_array_equal(rewritten(log, lambda t, z: (t, z)).periods, 0.0)
    told = f"changes every {4e3 * step:.0f} ms only, and is written every {1e3 * step:.0f} ms"
    assert f"angle:u_r {told}" in text_of(slow)
    assert smoother_of(slow, "type_2_0").half(step) in (8, 9)
    assert smoother_of(slow, "type_2_0").half(2.0 * step) in (4, 5)
    assert smoother_of(log, "type_2_0").half(step) == 3


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_what_is_written_more_often_than_measured_is_a_line_between_new_values(jitter: float) -> None:
    """Whatever the rows' times, which differ by a part of a sample; the values that were measured are marked."""
    random, log = np.random.default_rng(3), logged("type_2_0")
    step = log.segments[0].step

    def slowly(t: Floats, z: Floats) -> tuple[Floats, Floats]:
        uneven = t + jitter * step * random.uniform(-0.5, 0.5, len(t))
        exact = np.column_stack([np.interp(uneven, t, column) for column in z.T])
        return uneven, exact[np.arange(len(z)) // 4 * 4]

    (found,), (true,) = rewritten(log, slowly).segments, log.segments
    moving = slice(200, 204 + 4 * ((len(true) - 204) // 4) - 8)
    at = found.is_new[moving, 0]
    assert 0.2 < at.mean() < 0.3
    assert np.all(found.is_new[:, 2] == found.is_new[:, 0])
    scale = np.ptp(true.z, axis=0)
    assert np.all(np.abs(found.z[moving] - true.z[moving]).mean(axis=0) < 0.01 * scale)
    late = np.repeat(true.z[moving][::4], 4, axis=0)
    left, held = (np.abs(one - true.z[moving]).mean(axis=0)[0] for one in (found.z[moving], late))
    assert left < 0.5 * held


def test_a_value_that_is_kept_at_rest_is_left_just_before_the_next_one() -> None:
    """A line from where it began to be kept would be a motion that never was."""
    grid = 0.01 * np.arange(20)
    column = np.repeat([1.0, 1.0, 1.0, 2.0, 3.0], 4)
    np.testing.assert_allclose(between(grid, grid, column, 0.04)[:9], 1.0)
    np.testing.assert_allclose(between(grid, grid, column, 0.04)[8:17], np.linspace(1.0, 3.0, 9))
    np.testing.assert_allclose(between(grid, grid, column, 0.0), column)


def test_a_channel_that_hardly_moves_says_nothing_of_its_rate() -> None:
    """A heading that drifts by single steps while the robot drives straight is not measured slowly."""
    t = 0.01 * np.arange(600)
    drift = 1e-3 * np.floor(t / 0.13)
    turning = np.floor(np.sin(t) / 1e-3) * 1e-3
    assert update_period([t], [drift]) == 0.0
    assert update_period([t, t], [drift, turning]) == 0.0
    held = turning[np.arange(600) // 2 * 2]
    assert update_period([t, t], [drift, held]) == pytest.approx(0.02, rel=0.05)
    assert quantum(turning) == pytest.approx(1e-3)


@pytest.mark.parametrize(("count", "period"), [(1, 0.0), (8, 0.0), (9, 0.0), (38, 0.0), (60, 0.02)])
def test_few_samples_say_nothing_of_a_rate(count: int, period: float) -> None:
    """Half a second is enough."""
    t = 0.01 * np.arange(count)
    held = np.sin(t)[np.arange(count) // 2 * 2]
    assert update_period([t], [held]) == pytest.approx(period, rel=0.1)


def test_a_dead_encoder_is_told() -> None:
    """One that stands still although its motor has voltage; not one of a motor without."""
    log = logged("type_2_0")
    dead = changed(log, angle_u_l=0.0)
    assert dead_encoders(dead) == [1]
    assert dead_encoders(log) == []
    without = dead.of([replace(one, u=one.u * [1.0, 0.0]) for one in dead.segments])
    assert dead_encoders(without) == []


def test_voltages_that_are_alike_were_commanded() -> None:
    """To the last digit on both sides."""
    log = logged("type_2_0")
    same = log.of([replace(one, u=one.u[:, :1] * [1.0, -1.0]) for one in log.segments])
    assert "u_r and u_l are alike to the last digit: commanded, not measured" in text_of(same)
    assert "commanded, not measured" not in text_of(log)


def test_a_motion_that_is_missing_is_named() -> None:
    """Straight driving tells nothing of turning."""
    log = logged("type_2_0")
    smoother = smoother_of(log, "type_2_0")
    assert missing_motions(smoother, motions_of(smoother, log)) == []
    straight = log.of([replace(one, z=one.z[:, [0, 0, 2]] * [1.0, 1.0, 0.0]) for one in log.segments])
    assert missing_motions(smoother, motions_of(smoother, straight)) == ["omega"]


@pytest.mark.parametrize(
    ("u", "z", "told"),
    [
        (np.ones((400, 2)), 1.0, "the voltages never change"),
        (np.zeros((400, 2)), 1.0, "the motors never have any voltage"),
        (None, 0.0, "the robot never moves"),
        (np.sign(np.sin(0.1 * np.arange(400)) + 0.01)[:, None] * np.full(2, 12.0), 1.0, "at their largest (12, 12 V)"),
    ],
    ids=["constant", "none", "rest", "saturated"],
)
def test_a_log_that_tells_nothing_is_refused(u: np.ndarray | None, z: float, told: str) -> None:
    """And what would be better is said."""
    log = logged("type_2_0", 8.0)
    segment = log.segments[0]
    other = log.of([replace(segment, u=segment.u if u is None else u, z=z * segment.z)])
    with pytest.raises(WmrError) as error:
        check_input(other, standard_deviations(log))
    assert told in str(error.value)
    check_input(log, standard_deviations(log))
    with pytest.raises(WmrError, match="the log lasts"):
        check_length(log.of([segment.part(0, 50)]))


def test_rates_and_voltages_pass_the_same_filter() -> None:
    """A wheel that turns as fast as it has volts: its encoder's rate is the voltage, smoothed; a rate sensor's nearly.

    Otherwise what changes fast is seen too small on one side of the equation.
    """
    step, volts = 0.02, np.random.default_rng(0).normal(size=(120, 2))
    angles = step * np.vstack([np.zeros((1, 2)), np.cumsum(volts, axis=0)[:-1]])
    time = step * np.arange(120)
    log = log_of(UNICYCLE, time, volts, {"angle:u_r": angles[:, 0], "angle:u_l": angles[:, 1]})
    (motion,) = motions_of(smoother_of(log, "type_2_0"), log)
    np.testing.assert_allclose(motion.rates[motion.ok], motion.u[motion.ok], atol=1e-12)
    turning = {"angle:u_r": np.sin(12.0 * time) / 12.0, "rate:u_r": np.cos(12.0 * time), "angle:u_l": time}
    log = log_of(UNICYCLE, time, volts, turning)
    (motion,) = motions_of(smoother_of(log, "type_2_0"), log)
    assert np.abs(motion.rates[:, 0] - motion.rates[:, 1])[motion.ok].max() < 0.006  # 0.01 if only one is averaged
