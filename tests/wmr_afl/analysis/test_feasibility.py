"""Whether a robot can follow a reference: against voltages of runs, and references made to be impossible."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import wmr_afl
from tests.conftest import EXPERIMENTS
from tests.wmr_afl.controllers.test_waypoints import experiment
from wmr_afl.analysis import feasibility
from wmr_afl.analysis.feasibility import Demand, Doubt, _beyond, _jumps, _limits, _rate, demand
from wmr_afl.cli import app
from wmr_afl.experiments.experiment import find_experiment, read_experiment
from wmr_afl.model.grip import FLOOR
from wmr_afl.model.wheel_loads import GRAVITY
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.command_limits import CommandLimitsTable
from wmr_afl.plant.input_limits import InputLimitsTable
from wmr_afl.plant.order import UncertaintiesTable
from wmr_afl.simulation.result import Failure, Run

LINE = "line = { start = [0.0, 0.0], velocity = [0.3, 0.0] }"


def demanded(folder: Path, reference: str) -> Demand:
    """Of a differential robot that stands on the x axis, its output at the origin, and drives as `LINE` does."""
    file = experiment("type_2_0", folder, f"[reference]\n{reference}")
    model, text = wmr_afl.load_model("type_2_0"), file.read_text()
    ahead = dict(zip(model.parameter_units, model.parameters(), strict=True))["L"]
    begin, end = text.index("[start]"), text.index("[reference]")
    file.write_text(f"{text[:begin]}[start]\nx = {-ahead}\nv = 0.3\n\n{text[end:]}")
    return demand(*read_experiment(file))


def test_every_shipped_track_can_be_followed(robot: str) -> None:
    """Their limits were chosen so; what is needed lies below them."""
    found = demand(*read_experiment(f"track_{robot}"))
    assert not found.doubts
    for name, volts in found.volts.items():
        assert 0.0 <= volts < found.limits[name]


def test_a_straight_line_needs_what_back_emf_takes(tmp_path: Path) -> None:
    """At constant speed a motor needs K2/K1 times its rate, and nothing else."""
    found = demanded(tmp_path, LINE)
    model = wmr_afl.load_model("type_2_0")
    p = dict(zip(model.parameter_units, model.parameters(), strict=True))
    for volts in found.volts.values():
        assert volts == pytest.approx(p["K2"] / p["K1"] * 0.3 / p["r"], rel=0.02)


def test_a_circle_driven_ever_faster_needs_more_friction_than_floors_have(tmp_path: Path) -> None:
    """Sideways v^2/R over gravity, along d/b of it, for the mass is ahead of the axle, and what driving takes."""
    p = wmr_afl.load_model("type_2_0").metadata["defaults"]
    for faster, expected in ((0.1, 0), (0.4, 2)):  # [rad/s^2], on a circle of 1 m
        angle = f"(0.3*t + {0.5 * faster}*t**2)"
        found = demanded(tmp_path, f'expressions = {{ y1 = "sin{angle}", y2 = "1 - cos{angle}" }}')
        told = [doubt for doubt in found.doubts if "friction" in doubt.what]
        assert [doubt.what[: doubt.what.index(" would")] for doubt in told] == ["wheel right", "wheel left"][:expected]
        if told:
            first = min(doubt.first for doubt in told)
            sideways = (0.3 + faster * first) ** 2 / GRAVITY
            assert np.hypot(sideways, sideways * p["d"] / p["b"]) == pytest.approx(FLOOR, rel=0.15)
            assert min(found.friction.values()) > FLOOR


def test_where_motors_have_less_is_told_with_the_times(tmp_path: Path) -> None:
    """The shipped reference with the voltage that a run without limits needs, lessened: the same stretches."""
    file = find_experiment("beyond_limits_type_2_0")
    found = demand(*read_experiment(file))
    told = [doubt for doubt in found.doubts if doubt.what.startswith("u_r would need")]
    assert len(told) == 4
    assert all("of 3 V" in doubt.what for doubt in told)
    assert all(doubt.first <= doubt.last for doubt in told)
    assert any("times more," in doubt.what for doubt in found.doubts)
    done = CliRunner().invoke(app, ["check-reference", str(file)])
    assert done.exit_code == 1
    assert "u_r would need up to" in done.output
    assert "between" in done.output


def test_limits_of_software_count_on_their_side(tmp_path: Path) -> None:
    """Backwards a robot has what `least` allows, forwards the lesser of drive and software."""
    straight = 'expressions = { y1 = "15 + SPEED*t", y2 = "25" }'
    for speed, limits, bound in (
        (0.4, "command_limits = { most = 0.4, least = -9.0 }", "0.4 V"),
        (0.4, "command_limits = { most = 9.0, least = -0.4 }", ""),
        (-0.4, "command_limits = { most = 9.0, least = -0.4 }", "0.4 V"),
        (0.4, "command_limits = { most = 9.0 }\ninput_limits = { volts = 0.3 }", "0.3 V"),
    ):
        text = (EXPERIMENTS / "study_1.toml").read_text()
        circle = "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }"
        assert circle in text
        text = text.replace(circle, straight.replace("SPEED", str(speed))).replace("140.0", "10.0")
        file = tmp_path / "limited.toml"
        file.write_text(text.replace("[shared]", f"[uncertainties]\n{limits}\n\n[shared]", 1))
        found = demand(*read_experiment(file))
        assert bool(found.doubts) == bool(bound), found
        assert all(f"of {bound}" in doubt.what for doubt in found.doubts)


def test_a_jump_is_told_with_its_time(tmp_path: Path) -> None:
    """Of the reference, and of its velocity; that of an acceleration is none, nor a smooth one that turns sharply."""
    step = 'expressions = { y1 = "0.3*t + 0.2*step(t - 4)", y2 = "0" }'
    jumps = [doubt for doubt in demanded(tmp_path, step).doubts if "the reference jumps" in doubt.what]
    assert [doubt.first for doubt in jumps] == [pytest.approx(4.0, abs=0.03)]
    assert "jumps by 0.2" in jumps[0].what
    corner = 'expressions = { y1 = "0.3*t", y2 = "0.5*(t - 3)*step(t - 3)" }'
    found = demanded(tmp_path, corner).doubts
    assert any(
        "velocity of the reference jumps by 0.5" in doubt.what and abs(doubt.first - 3.0) < 0.05 for doubt in found
    )
    bend = 'expressions = { y1 = "0.3*t + 2*(t - 4)**2*step(t - 4)", y2 = "0" }'
    assert not [doubt for doubt in demanded(tmp_path, bend).doubts if "jumps" in doubt.what]
    smooth = 'expressions = { y1 = "0.3*t", y2 = "0.2*sin(2*t)" }'
    assert not [doubt for doubt in demanded(tmp_path, smooth).doubts if "jumps" in doubt.what]


def test_without_limits_nothing_is_compared(tmp_path: Path) -> None:
    found = demand(*read_experiment("study_1"))
    assert set(found.limits.values()) == {np.inf}
    assert not found.doubts
    done = CliRunner().invoke(app, ["check-reference", "study_1"])
    assert done.exit_code == 0
    assert "no limit told" in done.output


def test_a_model_without_passivity_form_is_asked_by_the_linearizing_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The voltages that both laws need once they follow are the same."""
    usual = demanded(tmp_path, LINE)
    has = wmr_afl.Model.has
    monkeypatch.setattr(wmr_afl.Model, "has", lambda self, term: term != "passivity_regressor" and has(self, term))
    other = demanded(tmp_path, LINE)
    for name, volts in usual.volts.items():
        assert other.volts[name] == pytest.approx(volts, rel=0.02)


def test_what_is_no_experiment_is_told() -> None:
    done = CliRunner().invoke(app, ["check-reference", "nothing"])
    assert done.exit_code == 2


@pytest.mark.parametrize("count", [1, 4, 5, 7])
def test_of_many_stretches_four_are_told_and_the_rest_as_one(count: int) -> None:
    """From the beginning of the first of them to the end of the last."""
    time = np.arange(0.0, 40.0, 0.5)
    command = np.where((time % 5.0 < 1.0) & (time < 5.0 * count), -4.0, 1.0)[:, None]
    run = SimpleNamespace(time=time, command=command)
    found = list(_beyond(run, np.ones(len(time), dtype=bool), (np.array([-3.0]), np.array([3.0])), ["u"]))  # type: ignore[arg-type]
    whole = [Doubt("u would need up to 4 V of 3 V", 5.0 * k, 5.0 * k + 0.5) for k in range(min(count, 4))]
    rest = [Doubt(f"u {count - 4} times more,", 20.0, 5.0 * (count - 1) + 0.5)] if count > 4 else []
    assert found == whole + rest


def made_to_run(monkeypatch: pytest.MonkeyPatch, **changed: object) -> list[Run]:
    """From now on what is simulated for half a second comes to this; the runs are noted."""
    usual, runs = feasibility.simulate, list[Run]()

    def simulated(loop: object, duration: float, *names: str) -> Run:
        run = usual(loop, 1.0, *names)  # type: ignore[arg-type]
        runs.append(replace(run, **{name: one(run) if callable(one) else one for name, one in changed.items()}))
        return runs[-1]

    monkeypatch.setattr(feasibility, "simulate", simulated)
    return runs


def test_a_joint_at_its_stop_is_doubted_over_the_whole_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 0 s to its end; other warnings are none of what a robot can follow."""
    runs = made_to_run(monkeypatch, warnings=("beta is at its stop", "something else"))
    found = demand(*read_experiment("study_1"))
    (run,) = runs
    assert found.doubts == (Doubt("beta is at its stop", 0.0, run.time[-1]),)
    assert str(found.doubts[0]) == "beta is at its stop between 0 s and 1 s"


def test_a_run_that_fails_is_doubted_at_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    made_to_run(monkeypatch, failure=Failure(0.74, "the robot is singular"))
    found = demand(*read_experiment("study_1"))
    assert found.doubts == (Doubt("the robot is singular,", 0.74, 0.74),)
    assert str(found.doubts[0]) == "the robot is singular, at 0.74 s"


@pytest.mark.parametrize(
    ("lowest", "highest", "volts", "limit"),
    [
        (-3.0, 4.0, 3.0, 4.0),  # 3 of 4 V backwards are more than 4 of 8 V forwards
        (-1.0, 4.0, 4.0, 8.0),
        (-2.0, 4.0, 4.0, 8.0),  # the same shares: the larger number
        (0.0, 2.0, 2.0, 8.0),
        (-1.0, 0.0, 1.0, 4.0),
    ],
)
def test_what_is_needed_is_told_of_the_side_that_is_nearer_to_its_limit(
    lowest: float, highest: float, volts: float, limit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once the robot is on its way, half a second after its start."""

    def command(run: Run) -> Floats:
        u = np.zeros((len(run.time), 2))
        u[run.time < 0.49] = [-90.0, 90.0]
        u[-5], u[-3] = lowest, highest
        return u

    made_to_run(monkeypatch, command=command)
    experiment, path = read_experiment("study_1")
    limits = UncertaintiesTable(command_limits=CommandLimitsTable(most=8.0, least=-4.0))
    found = demand(experiment.model_copy(update={"uncertainties": limits}), path)
    assert set(found.volts.values()) == {volts}
    assert set(found.limits.values()) == {limit}
    assert not found.doubts


@pytest.mark.parametrize(("sample_time", "rate"), [(0.001, 10.0), (0.02, 10.0), (0.04, 5.0), (0.1, 2.0)])
def test_the_law_that_knows_everything_is_as_fast_as_samples_allow(sample_time: float, rate: float) -> None:
    """A fifth of their rate, and no faster than ten a second."""
    one = SimpleNamespace(simulation=SimpleNamespace(sample_time=sample_time))
    assert _rate(one) == pytest.approx(rate)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("drive", "software", "least", "most"),
    [
        (None, None, [-np.inf, -np.inf], [np.inf, np.inf]),
        ([3.0, 5.0], None, [-3.0, -5.0], [3.0, 5.0]),
        (None, {"most": [4.0, 2.0]}, [-4.0, -2.0], [4.0, 2.0]),
        (None, {"most": 4.0, "least": [-1.0, -2.0]}, [-1.0, -2.0], [4.0, 4.0]),
        (3.0, {"most": [4.0, 2.0], "least": [-1.0, -9.0]}, [-1.0, -3.0], [3.0, 2.0]),
    ],
)
def test_a_motor_has_the_lesser_of_drive_and_software(
    drive: object, software: dict | None, least: list, most: list
) -> None:
    """On either side, each motor for itself."""
    table = UncertaintiesTable(
        input_limits=None if drive is None else InputLimitsTable(volts=drive),  # type: ignore[arg-type]
        command_limits=None if software is None else CommandLimitsTable(**software),
    )
    np.testing.assert_array_equal(_limits(table, 2), [least, most])


def moved(position: Floats, velocity: Floats, acceleration: Floats) -> list[Doubt]:
    """What is doubted of one output with a sample every tenth of a second."""
    times = 0.1 * np.arange(len(position))
    rows = tuple(one[:, None] for one in (position, velocity, acceleration))
    return list(_jumps(SimpleNamespace(over=lambda t: rows), times))  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("jump", "is_told"), [(0.028, False), (0.032, True), (0.3, True), (-0.028, False), (-0.032, True)]
)
def test_a_jump_is_what_is_beyond_the_derivatives_and_their_bend(jump: float, is_told: bool, sign: float) -> None:
    """A centimetre more than a fifth of what the velocity tells, 0.1 m a sample; at the sample after it."""
    position, zero = 0.1 * np.arange(9.0), np.zeros(9)
    position[4:] += jump
    found = moved(sign * position, np.full(9, sign), zero)
    expected = [Doubt(f"the reference jumps by {abs(jump):.3g}", 0.4, 0.4)] if is_told else []
    assert [(one.what, round(one.first, 9), round(one.last, 9)) for one in found] == [
        (one.what, one.first, one.last) for one in expected
    ]
    assert len(moved(zero, zero, zero)) == 0
    speed = np.where(np.arange(9) < 4, 0.0, sign * abs(jump))
    follows = np.concatenate([[0.0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))])
    told = [one.what for one in moved(follows, speed, zero)]
    assert told == [f"the velocity of the reference jumps by {abs(jump):.3g}"]


def test_of_many_jumps_four_are_told() -> None:
    """The first ones."""
    found = moved(np.arange(9.0), np.zeros(9), np.zeros(9))
    assert [round(one.first, 9) for one in found] == [0.1, 0.2, 0.3, 0.4]


def test_stretches_are_one_unless_more_than_a_second_is_between_them() -> None:
    """What is told is the most of a stretch, on the side that is farther beyond; the bound itself is allowed."""
    time = 0.5 * np.arange(12)
    u = np.array([3.0, 3.5, 0.0, -5.0, 0.0, 0.0, 4.0, -3.0, 3.0, 0.0, 0.0, 9.0])[:, None]
    run = SimpleNamespace(time=time, command=u)
    limits = np.array([-4.0]), np.array([3.0])
    late = time < 5.0
    found = list(_beyond(run, late, limits, ["u"]))  # type: ignore[arg-type]
    assert found == [Doubt("u would need up to 5 V of 4 V", 0.5, 1.5), Doubt("u would need up to 4 V of 3 V", 3.0, 3.0)]
    assert [str(one) for one in found] == [
        "u would need up to 5 V of 4 V between 0.5 s and 1.5 s", "u would need up to 4 V of 3 V at 3 s"
    ]  # fmt: skip


def test_a_reference_that_ends_before_a_law_has_come_to_it_is_not_judged(tmp_path: Path) -> None:
    """It is told so, and no wheel's friction is."""
    text = find_experiment("track_type_2_0").read_text()
    (tmp_path / "short.toml").write_text(re.sub(r"duration = [\d.]+", "duration = 0.5", text))
    found = demand(*read_experiment(tmp_path / "short.toml"))
    assert found.since == 1.0
    assert [doubt.what for doubt in found.doubts] == [
        "nothing of the reference is judged, for a law takes 1 s to come to it: let it last longer,"
    ]
    assert found.friction == {}


def test_a_run_that_fails_at_its_first_sample_is_doubted_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of it is left to be looked at."""
    nothing = {name: (lambda run, name=name: getattr(run, name)[:0]) for name in ("time", "state", "input", "command")}
    made_to_run(monkeypatch, failure=Failure(0.0, "something is singular"), **nothing)
    found = demand(*read_experiment("study_1"))
    assert found.doubts == (Doubt("something is singular,", 0.0, 0.0),)
    assert found.friction == {}
