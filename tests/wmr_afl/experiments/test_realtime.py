"""The controller for a robot's own loop is the simulator's, step for step."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl import CompilerError, Controller, ShapeError, SimulationError, UnknownNameError
from wmr_afl.experiments import realtime


@pytest.mark.parametrize(
    ("experiment", "name"),
    [("study_1", "AFL"), ("study_2", "AFL with leakage"), ("study_2", "robust AFL"), ("track_mecanum", "AFL")],
)
@pytest.mark.parametrize("has_compiler", [True, False])
def test_it_gives_the_simulators_inputs(
    experiment: str, name: str, has_compiler: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = wmr_afl.run(experiment, controllers=name)[name]
    if not has_compiler:
        monkeypatch.setattr(realtime, "Kernel", failing)
    controller = Controller.from_experiment(experiment, name)
    for k in range(350):  # 7 s of the studies
        u = controller.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, run.input[k], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(controller.estimate, run.estimate[k + 1], rtol=1e-9, atol=1e-12)


def failing(*arguments: object, **options: object) -> None:
    raise CompilerError("no C compiler was found")


def test_after_a_reset_it_starts_again() -> None:
    controller = Controller.from_experiment("study_1")
    first = [controller.update(0.02 * k, [15.0, 25.0, 0.1, 0.2, 0.0]) for k in range(5)]
    controller.reset()
    second = [controller.update(0.02 * k, [15.0, 25.0, 0.1, 0.2, 0.0]) for k in range(5)]
    np.testing.assert_array_equal(first, second)


def test_its_memory_does_not_grow() -> None:
    controller, x = Controller.from_experiment("study_1"), np.array([15.0, 25.0, 0.0, 0.0, 0.0])
    for k in range(100):
        controller.update(0.02 * k, x)
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    for k in range(5000):
        controller.update(0.02 * k, x)
        controller.reset()
    grown = sum(line.size_diff for line in tracemalloc.take_snapshot().compare_to(before, "filename"))
    tracemalloc.stop()
    assert grown < 20_000


def test_inputs_stay_within_their_limits() -> None:
    controller = Controller.from_experiment("study_2")
    assert np.all(np.abs(controller.update(0.0, [50.0, -50.0, 0.0, 3.0, 3.0])) <= 24.0)


def test_it_knows_what_the_drive_does_to_its_commands(tmp_path: Path) -> None:
    """Commands are limited but not late when they are returned; the law looks at the input that is both."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 10.0")
    text = text.replace("gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0]", 'relative_gain = 0.1, input = "applied"')
    drive = "[uncertainties]\ninput_delay = { seconds = 0.06 }\ninput_limits = { volts = 6.0 }\n\n[shared]"
    (tmp_path / "late.toml").write_text(text.replace("[shared]", drive, 1))
    run = wmr_afl.run(tmp_path / "late.toml", controllers="AFL")["AFL"]
    controller = Controller.from_experiment(tmp_path / "late.toml", "AFL")
    for k in range(len(run.time) - 1):
        u = controller.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, np.clip(run.command[k], -6.0, 6.0), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(controller.estimate, run.estimate[k + 1], rtol=1e-9, atol=1e-12)
    assert np.abs(run.input - np.clip(run.command, -6.0, 6.0)).max() > 1.0


@pytest.mark.parametrize("has_compiler", [True, False])
def test_what_cannot_be_controlled_is_reported_and_changes_nothing(
    has_compiler: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_compiler:
        monkeypatch.setattr(realtime, "Kernel", failing)
    controller = Controller.from_experiment("study_1")
    before = controller.estimate
    with pytest.raises(SimulationError, match="not finite"):
        controller.update(0.0, [np.nan] * 5)
    np.testing.assert_array_equal(controller.estimate, before)
    for bad in ([15.0, 25.0, 0.0, np.nan, 0.0], [np.inf, 25.0, 0.0, 0.0, 0.0], [15.0, 25.0, 0.0, 1e200, 0.0]):
        with pytest.raises(SimulationError, match="not finite"):
            controller.update(0.0, bad)
    with pytest.raises(SimulationError, match="not finite"):
        controller.update(np.nan, [15.0, 25.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(controller.estimate, before)
    with pytest.raises(ShapeError, match=r"expected \(5,\): x, y, phi, v, omega"):
        controller.update(0.0, [0.0] * 3)
    with pytest.raises(UnknownNameError, match="AFL"):
        Controller.from_experiment("study_1", "PID")
