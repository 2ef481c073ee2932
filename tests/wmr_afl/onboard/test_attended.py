"""What a controller tells besides voltages, and what it can be told: diagnostics, applied voltages, pauses, limits."""

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl import CompilerError, Controller, SimulationError, WmrError
from wmr_afl.controllers.live_reference import LiveReference, ReferenceBuffer
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.onboard import controller as onboard
from wmr_afl.onboard.status import Status
from wmr_afl.plant.command_limits import CommandLimits
from wmr_afl.plant.input_limits import InputLimits

LAWS = [
    ("study_1", "AFL"), ("study_2", "robust AFL"), ("track_mecanum", "AFL"), ("track_car", "composite"),
    ("track_mecanum", "direct"), ("track_type_3_0", "exact"), ("study_2_pose", "pose"),
]  # fmt: skip


@pytest.fixture(params=[True, False], ids=["compiled", "interpreted"])
def _runner(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*arguments: object) -> None:
        raise CompilerError("no C compiler was found")

    if not request.param:
        monkeypatch.setattr(onboard, "Compiled", failing)


@pytest.mark.usefixtures("_runner")
@pytest.mark.parametrize(("experiment", "name"), LAWS)
def test_diagnostics_are_those_of_the_simulator(experiment: str, name: str) -> None:
    """e, the command before limits, what is at its limit, and what an observer sees."""
    run = wmr_afl.run(experiment, controllers=name)[name]
    controller = Controller.from_experiment(experiment, name)
    assert controller.diagnostics.status == Status.OK
    motors = list(controller.model.input_units)
    for k in range(120):
        u = controller.update(run.time[k], run.state[k])
        told = controller.diagnostics
        by_observer = 0.0 if told.observed is None else 1e-2  # e of y as the observer makes it out
        np.testing.assert_allclose(told.error, run.error[k], rtol=1e-9, atol=1e-9 + by_observer)
        assert told.saturated == tuple(m for m, a, b in zip(motors, u, told.command, strict=True) if a != b)
        np.testing.assert_allclose(u[u == told.command], run.input[k][u == told.command], rtol=1e-9, atol=1e-9)
        assert np.all(np.abs(told.command[u != told.command]) > np.abs(u[u != told.command]))
        assert told.regularity > 0.0
        if told.observed is not None:
            np.testing.assert_allclose(told.observed, run.observed[k], rtol=1e-9, atol=1e-9)
        if controller.deviation is not None:
            np.testing.assert_allclose(controller.deviation, run.deviation[k + 1], rtol=1e-6, atol=1e-9)


@pytest.mark.usefixtures("_runner")
def test_the_filtered_error_is_that_of_the_law() -> None:
    """E1 = e' + alpha e, e' by differences of e along the run."""
    run = wmr_afl.run("study_1", controllers="AFL")["AFL"]
    controller = Controller.from_experiment("study_1", "AFL")
    alpha = controller.law.values["outer_loop.alpha"]
    rates = np.gradient(run.error[:400], run.time[:400], axis=0)
    found = []
    for k in range(400):
        controller.update(run.time[k], run.state[k])
        found.append(controller.diagnostics.filtered_error)
    np.testing.assert_allclose(np.array(found)[100:-1], (rates + alpha * run.error[:400])[100:-1], atol=5e-3)


@pytest.mark.usefixtures("_runner")
def test_a_refusal_tells_why_and_an_estimate_at_its_bound_is_named() -> None:
    controller = Controller.from_experiment("study_1", "AFL")
    x = np.array([15.0, 25.0, 0.1, 0.2, 0.05])
    for bad, status in ((np.nan, Status.BAD_MEASUREMENT), (1e200, Status.NOT_FINITE)):
        with pytest.raises(SimulationError):
            controller.update(0.0, [15.0, 25.0, 0.0, bad, 0.0])
        assert controller.diagnostics.status == status
    controller.update(0.0, x)
    assert controller.diagnostics.at_bound == ()
    lower = controller.law.values["projection.lower"]
    controller.load_state({"theta_hat": np.where(np.isfinite(lower), lower, 1.0)})
    controller.update(0.02, x)
    units = list(controller.law.knowledge.units)
    expected = controller.estimate <= lower
    assert controller.diagnostics.at_bound == tuple(np.array(units)[expected])
    assert expected.any()


def driven(controller: Controller, applied: Callable[[Floats], Floats] | None = None, samples: int = 150) -> Floats:
    """The states after each sample of a made-up motion; `applied` of the last voltages is handed back."""
    x = np.zeros(len(controller.measured))
    count, rows, u = len(x), [], None
    for k in range(samples):
        t = controller.sample_time * k
        x = np.sin(0.7 * t + np.arange(count)) * np.linspace(0.3, 1.0, count)
        told = None if applied is None or u is None else applied(u)
        u = controller.update(t, x, applied=told)
        rows.append(controller.states)
    return np.array(rows)


@pytest.mark.usefixtures("_runner")
@pytest.mark.parametrize(("experiment", "name"), [("track_car", "composite"), ("study_2_pose", "pose")])
def test_applied_voltages_that_are_handed_back_teach_as_if_the_drive_had_been_known(experiment: str, name: str) -> None:
    """A sample late: limits that only the motors know, against the same limits as the drive."""
    loop = load_experiment(experiment).loops[name]
    clip = InputLimits(len(loop.model.input_units), 1.5)
    knows = Controller(loop.model, loop.law, loop.reference, loop.sample_time, [clip])
    hears = Controller(loop.model, loop.law, loop.reference, loop.sample_time, hears_applied=True)
    by_drive = driven(knows)
    by_word = driven(hears, lambda u: np.clip(u, -1.5, 1.5))
    theta = knows.sampled.states.places["theta_hat"]
    np.testing.assert_allclose(by_word[1:, theta], by_drive[1:, theta], rtol=1e-9, atol=1e-9)
    for wrong in ([1.0], [np.nan] * 9, "volts"):
        before = hears.states
        with pytest.raises(WmrError, match="applied"):
            hears.update(1e3, np.zeros(len(hears.measured)), applied=wrong)
        assert hears.diagnostics.status == Status.BAD_MEASUREMENT
        np.testing.assert_array_equal(hears.states, before)


@pytest.mark.usefixtures("_runner")
@pytest.mark.parametrize(("experiment", "name"), LAWS)
def test_in_a_pause_estimates_keep_every_bit_and_the_law_goes_on(experiment: str, name: str) -> None:
    controller = Controller.from_experiment(experiment, name)
    run = wmr_afl.run(experiment, controllers=name)[name]

    def drive(samples: range) -> list[Floats]:
        return [controller.update(run.time[k], run.state[k]) for k in samples]

    drive(range(60))
    controller.pause_learning()
    assert not controller.is_learning
    kept, learned = controller.states, controller.sampled.learned.copy()
    learned[controller.sampled.silent] = False  # flags: data of the past is not joined to that of the future
    inputs = drive(range(60, 90))
    np.testing.assert_array_equal(controller.states[learned], kept[learned])
    assert np.ptp(np.array(inputs), axis=0).max() > 0.0
    frozen = controller.estimate
    controller.resume_learning()
    drive(range(90, 150))
    assert controller.is_learning == controller.law.adapts
    assert np.any(controller.estimate != frozen) == controller.law.adapts


def test_a_buffer_gives_the_reference_and_its_age() -> None:
    """Before anything has come there is no command, which is not a command of zero."""
    loop = load_experiment("study_1").loops["AFL"]
    outputs = list(loop.model.output_units)
    live = Controller(loop.model, loop.law, LiveReference(outputs), loop.sample_time)
    buffer, x = ReferenceBuffer(outputs, timeout=0.5, stop=1.0), [15.0, 25.0, 0.0, 0.0, 0.0]
    with pytest.raises(SimulationError, match="no setpoint has come yet"):
        live.update(0.0, x, buffer)
    buffer.push(0.0, [15.0, 25.0], [0.1, 0.0])
    buffer.push(0.1, [15.01, 25.0], [0.1, 0.0])
    given = live.update(0.0, x, buffer.at(0.0))
    np.testing.assert_array_equal(live.update(0.0, x, buffer), given)
    assert live.diagnostics.reference_age == -0.1
    live.update(0.3, x, buffer)
    assert live.diagnostics.reference_age == pytest.approx(0.2)


@pytest.mark.parametrize("keeps_direction", [True, False])
def test_commands_stay_within_limits_and_change_no_faster_than_allowed(keeps_direction: bool) -> None:
    part = CommandLimits(3, most=[5.0, 6.0, 7.0], least=[-2.0, -6.0, -7.0], room=1.5, keeps_direction=keeps_direction)
    k, z = by_part(part.values), by_part(part.states)
    random, last = np.random.default_rng(4), np.zeros(3)
    reached = set()
    for _ in range(300):
        u = random.normal(size=3) * 8.0
        v = part.applied(u, z, k, NUMPY)
        assert np.all((v <= part.most + 1e-12) & (v >= part.least - 1e-12))
        assert np.all(np.abs(v - last) <= 1.5 + 1e-12)
        reached |= {round(float(one), 9) for one in np.abs(v - last)}
        if keeps_direction:
            within = u / max(1.0, *(u / part.most), *(u / part.least))
            np.testing.assert_allclose(np.cross(v - last, within - last), 0.0, atol=1e-9)
        z = by_part({"last": part.update(u, z, k, NUMPY)["last"]})
        np.testing.assert_array_equal(z.last, v)
        last = v
    assert 1.5 in reached
    free = CommandLimits(3, most=10.0)
    np.testing.assert_array_equal(
        free.applied(np.array([1.0, -20.0, 30.0]), z, by_part(free.values), NUMPY), [1, -10, 10]
    )


@pytest.mark.parametrize(
    ("wrong", "words"), [({"most": -1.0}, "least < 0 < most"), ({"most": 2.0, "least": 1.0}, "least < 0 < most"),
                         ({"most": 2.0, "room": 0.0}, "positive slew"), ({"most": [1.0, 2.0]}, "most")]
)  # fmt: skip
def test_limits_that_leave_nothing_are_refused(wrong: dict, words: str) -> None:
    with pytest.raises(WmrError, match=words):
        CommandLimits(3, **wrong)


def test_a_limited_command_is_returned_as_the_simulator_applies_it(tmp_path: Path) -> None:
    """Asymmetric limits with slew in the experiment's file: the loop and the controller for the robot agree."""
    text = "command_limits = { most = [3.0, 4.0], least = -2.0, slew = 60.0, keeps_direction = true }"
    source = (EXPERIMENTS / "study_1.toml").read_text()
    file = tmp_path / "limited.toml"
    file.write_text(source.replace("[shared]", f"[uncertainties]\n{text}\n\n[shared]", 1))
    run = wmr_afl.run(file, controllers="AFL")["AFL"]
    controller = Controller.from_experiment(file, "AFL")
    for k in range(200):
        u = controller.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, run.input[k], rtol=1e-9, atol=1e-9)
    assert np.abs(np.diff(run.input[:200], axis=0)).max() <= 60.0 * 0.02 + 1e-9
    with pytest.raises(SimulationError, match="build it with hears_applied=True"):
        controller.update(5.0, run.state[0], applied=[0.0, 0.0])


@pytest.mark.usefixtures("_runner")
@pytest.mark.parametrize(("experiment", "name"), [("study_1", "AFL"), ("track_car", "composite")])
def test_a_gate_refuses_what_jumps_and_changes_nothing_else(experiment: str, name: str) -> None:
    """An outlier leaves every bit; the next sample is believed again, and after a gap whatever comes."""
    run = wmr_afl.run(experiment, controllers=name)[name]
    free, gated = Controller.from_experiment(experiment, name), Controller.from_experiment(experiment, name, gate=0.2)
    for k in range(60):
        if k % 20 == 7:
            before = gated.states
            for off in (0.25, -0.25):
                with pytest.raises(SimulationError, match=r"the gate refuses a sample: it differs by 0\.2"):
                    gated.update(run.time[k], run.state[k] + off * np.eye(len(run.state[k]))[0])
                assert gated.diagnostics.status == Status.LOST
                assert gated.diagnostics.surprise == pytest.approx(0.25, abs=0.01)
            np.testing.assert_array_equal(gated.states, before)
        u = gated.update(run.time[k], run.state[k])
        np.testing.assert_allclose(u, free.update(run.time[k], run.state[k]), rtol=1e-12, atol=1e-12)
    jumped = run.state[60] + 5.0 * np.eye(len(run.state[60]))[0]
    with pytest.raises(SimulationError, match="the gate refuses"):
        gated.update(run.time[60], jumped)
    for k in range(3):
        gated.update(run.time[60] + 1.0 + k * gated.sample_time, jumped + k * (run.state[1] - run.state[0]))


def test_a_gate_that_makes_no_sense_is_refused() -> None:
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(WmrError, match="choose a positive number"):
            Controller.from_experiment("study_1", gate=wrong)
    with pytest.raises(WmrError, match="choose the observer's bound"):
        Controller.from_experiment("study_2_pose", "pose", gate=0.3)


def test_what_does_not_mind_applied_voltages_is_not_told_of_them() -> None:
    for experiment, name in (("study_1", "AFL"), ("track_mecanum", "direct"), ("track_car", "exact")):
        with pytest.raises(WmrError, match="nothing that this law learns depends on what reached the motors"):
            Controller.from_experiment(experiment, name, hears_applied=True)


@pytest.mark.usefixtures("_runner")
def test_a_copy_goes_on_as_if_it_were_the_same(tmp_path: Path) -> None:
    """With all that it remembers of the last sample, and in its pause."""
    run = wmr_afl.run("track_car", controllers="composite")["composite"]
    one = Controller.from_experiment("track_car", "composite", hears_applied=True)
    for k in range(30):
        one.update(run.time[k], run.state[k])
    two = pickle.loads(pickle.dumps(one))  # noqa: S301
    applied = np.full(len(one.model.input_units), 0.3)
    for k in range(30, 40):
        u = one.update(run.time[k], run.state[k], applied=applied)
        np.testing.assert_array_equal(two.update(run.time[k], run.state[k], applied=applied), u)
    one.pause_learning()
    assert not pickle.loads(pickle.dumps(one)).is_learning  # noqa: S301


def test_a_call_that_comes_to_nothing_is_told_in_the_diagnostics() -> None:
    """Every refusal is one family of errors, and its status is not that of the call before."""
    x, point = [15.0, 25.0, 0.1, 0.2, 0.05], ([15.0, 25.0], [0.0, 0.0], [0.0, 0.0])
    live = Controller.from_experiment("study_1", is_live=True)
    for t, state, reference, status in (
        (0.5, x, point[:2], Status.BAD_REFERENCE), (0.5, x, 3.0, Status.BAD_REFERENCE),
        (0.5, x, (), Status.BAD_REFERENCE), (0.5, x, None, Status.BAD_REFERENCE),
        (0.5, x, ReferenceBuffer(["y1", "y2"]), Status.BAD_REFERENCE), (-1.0, x, point, Status.BAD_TIME_STEP),
        ("1", x, point, Status.BAD_TIME_STEP), (1e300, x, point, Status.BAD_TIME_STEP),
        (0.5, x[:3], point, Status.BAD_MEASUREMENT), (0.5, "x", point, Status.BAD_MEASUREMENT),
    ):  # fmt: skip
        live.reset()
        live.update(0.0, x, point)
        assert live.diagnostics.status == Status.OK
        with pytest.raises(WmrError):
            live.update(t, state, reference)
        assert live.diagnostics.status == status


def test_a_buffer_is_read_by_the_names_of_its_outputs() -> None:
    x = [15.0, 25.0, 0.1, 0.2, 0.05]
    live, other = (Controller.from_experiment("study_1", is_live=True) for _ in range(2))
    usual, turned = ReferenceBuffer(["y1", "y2"]), ReferenceBuffer(["y2", "y1"])
    usual.push(0.0, [15.1, 25.2], [0.3, 0.1])
    turned.push(0.0, [25.2, 15.1], [0.1, 0.3])
    np.testing.assert_array_equal(live.update(0.0, x, usual), other.update(0.0, x, turned))
    for names in (["a", "b"], ["y1", "y2", "y3"], ["y1"]):
        strange = ReferenceBuffer(names)
        strange.push(0.0, [0.0] * len(names), [0.0] * len(names))
        with pytest.raises(WmrError, match="output"):
            live.update(0.1, x, strange)


def test_estimates_beyond_their_bounds_are_not_loaded() -> None:
    controller = Controller.from_experiment("study_1")
    before = controller.states
    with pytest.raises(WmrError, match="theta5"):
        controller.load_state({"theta_hat": [-5.0] * 6})
    np.testing.assert_array_equal(controller.states, before)
