"""Whether a robot can follow a reference: against voltages of runs, and references made to be impossible."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import wmr_afl
from tests.conftest import EXPERIMENTS
from tests.wmr_afl.controllers.test_waypoints import experiment
from wmr_afl.analysis.feasibility import Demand, Doubt, _beyond, demand
from wmr_afl.cli import app
from wmr_afl.experiments.experiment import find_experiment, read_experiment

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
