"""Columns that are reversed, exchanged or in other units are told, with what to do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.wmr_afl.identification.logs import GEOMETRY, SMALL, effort_of, logged, multisine, small_drive
from wmr_afl import WmrError
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log, Segment, log_of
from wmr_afl.numerics.arrays import Floats

DRIVE = small_drive(12.0)
ROBOT = DRIVE.model


def found(change: Callable[[Segment], Segment] = lambda one: one, log: Log = DRIVE) -> Identified:
    """What a changed log says, described rightly."""
    changed = log.of([change(one) for one in log.segments])
    known = {name: SMALL[name] for name in ("m_C", "m_w", "I_m", "I_C", "K1", "K2", "d")}
    return identify(ROBOT, changed, parameters=GEOMETRY, guess=known)


def said(one: Identified, name: str) -> str:
    """The check of that name; empty if there is none."""
    return next((str(check) for check in one.checks if check.name == name), "")


def times(u: Floats | float = 1.0, z: Floats | float = 1.0) -> Callable[[Segment], Segment]:
    """Columns times numbers."""
    return lambda one: replace(one, u=one.u * u, z=one.z * z)


def test_nothing_is_said_of_a_right_log() -> None:
    right = found()
    assert not any(said(right, name) for name in ("columns", "signs", "size"))
    assert "look at" not in right.verdict
    assert not right.is_contradiction


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (times(u=np.array([-1.0, 1.0])), "better with u_r reversed; multiply u_r by -1"),
        (times(u=np.array([1.0, -1.0])), "better with u_l reversed; multiply u_l by -1"),
    ],
)
def test_a_reversed_voltage_is_found(change: Callable[[Segment], Segment], told: str) -> None:
    """Which one it is; the robot does not match such a log."""
    wrong = found(change)
    assert told in said(wrong, "columns")
    assert wrong.is_contradiction
    assert "columns" in wrong.verdict


def test_a_reversed_encoder_is_found() -> None:
    """Beside a gyroscope, without which it could be the voltage as well."""
    (segment,) = DRIVE.segments
    turned = (segment.z[:, :1] - segment.z[:, 1:]) * GEOMETRY["r"] / (2.0 * GEOMETRY["b"])
    columns = {"angle:u_r": -segment.z[:, 0], "angle:u_l": segment.z[:, 1], "phi": turned[:, 0]}
    log = log_of(ROBOT, segment.time, segment.u, columns)
    assert "better with angle:u_r reversed; multiply angle:u_r by -1" in said(found(log=log), "columns")


def test_exchanged_motors_and_reversed_voltages_are_found() -> None:
    """What was mixed up comes first, and of what follows from it nothing is said."""
    exchanged = found(lambda one: replace(one, u=one.u[:, ::-1]))
    told = "with u_r and u_l exchanged; exchange these columns, or those of their encoders"
    assert told in said(exchanged, "columns")
    assert exchanged.checks[0].name == "columns"
    assert not said(exchanged, "signs")
    assert exchanged.is_contradiction
    reversed_ = found(times(u=-1.0))
    assert "voltages run against the motion; multiply all voltages by -1" in said(reversed_, "signs")


@pytest.mark.parametrize(("change", "size"), [(times(z=180.0 / np.pi), "0.017"), (times(u=1.0 / 12.0), "0.083")])
def test_other_units_make_numbers_of_another_size(change: Callable[[Segment], Segment], size: str) -> None:
    """Degrees, shares of a battery."""
    assert f"the numbers are {size} times those of the description; look at the units" in said(found(change), "size")


def test_time_in_milliseconds_is_told() -> None:
    """By rows that are too far apart."""
    (segment,) = DRIVE.segments
    columns = {"angle:u_r": segment.z[:, 0], "angle:u_l": segment.z[:, 1]}
    with pytest.raises(WmrError, match=r"rows are 20 s apart; give t in seconds \(not milliseconds\)"):
        log_of(ROBOT, 1e3 * segment.time, segment.u, columns)


def test_encoders_in_degrees_are_told_from_a_gyroscope_in_degrees() -> None:
    """Whichever says 57 times the other."""
    (segment,) = DRIVE.segments
    turned = (segment.z[:, 0] - segment.z[:, 1]) * GEOMETRY["r"] / (2.0 * GEOMETRY["b"])
    degrees = 180.0 / np.pi
    for encoders, gyro, told in ((degrees, 1.0, "convert the encoders to rad"), (1.0, degrees, "convert phi to rad")):
        columns = {
            "angle:u_r": encoders * segment.z[:, 0], "angle:u_l": encoders * segment.z[:, 1], "phi": gyro * turned
        }  # fmt: skip
        log = log_of(ROBOT, segment.time, segment.u, columns)
        wrong = found(log=log)
        assert told in said(wrong, "units")
        assert wrong.is_contradiction
        assert "sensors differ as degrees from radians do" in wrong.verdict


@pytest.mark.parametrize("late", [3, -3])
def test_voltages_of_another_time_are_found_both_ways(late: int) -> None:
    """60 ms."""
    told = said(found(lambda one: replace(one, u=np.roll(one.u, -late, axis=0))), "dead time")
    assert f"use --delay {0.02 * late:.3f}" in told


def test_what_only_a_missing_motion_tells_stays_as_described() -> None:
    """Driving straight tells nothing of turning, and no gain of turning is printed."""
    u = np.repeat(multisine(12.0, 1, 8.0), 2, axis=1)
    log = logged(effort_of("type_2_0", **SMALL), u)
    wrong = {"m_C": 20.0, "I_C": 0.9, "d": 0.1, "K1": 0.35, "K2": 0.42, "m_w": 0.8, "I_m": 1e-3}
    straight = identify(ROBOT, log, parameters=GEOMETRY, guess=wrong, partial=True)
    described = effort_of("type_2_0", **{**wrong, **GEOMETRY})
    assert {"pi4", "pi6"} <= set(straight.described)
    for name in straight.described:
        k = straight.names.index(name)
        assert straight.estimate.unknown[k] == described.base(described.p)[k]
        assert straight.told()[k] == "described"
    assert "pi1" not in straight.described
    assert straight.feedforward is not None
    assert [one.motion for one in straight.feedforward] == ["driving"]
    true = effort_of("type_2_0", **SMALL)
    assert straight.estimate.unknown[0] == pytest.approx(true.base(true.p)[0], rel=1e-2)
