"""The pose observer: where its poles are, what it converges to, and laws that see no velocity."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS
from wmr_afl import Controller, WmrError, load_model
from wmr_afl.analysis.files import columns, write_results
from wmr_afl.controllers.observer import Seen
from wmr_afl.controllers.outer_loop import sampled_gains
from wmr_afl.controllers.pose_observer import Cancelling, PoseObserver
from wmr_afl.controllers.sight import Sight
from wmr_afl.controllers.under_way import CommandsUnderWay
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.parts import by_part

MODEL = load_model("type_2_0")
C = MODEL.known(MODEL.parameters())
STEP = 0.02
E = MODEL.output_map(np.zeros(3), C)


def own(part: object) -> SimpleNamespace:
    """The part's numbers, as it is given them."""
    return SimpleNamespace(**part.values)  # type: ignore[attr-defined]


def pose_of(y: Floats) -> Floats:
    """A state whose outputs are y, heading along x; its v is nonsense that nobody may look at."""
    return np.array([y[0] - C[0], y[1], 0.0, 1e9, -1e9])


def watched(observer: PoseObserver, outputs: Floats, accelerations: Floats, step: float = STEP) -> list[Floats]:
    """(y^, y'^, d^) after each sample of outputs (T, 2), told y'' (T, 2)."""
    z, k, rows = SimpleNamespace(**observer.states), own(observer), []
    for y, acceleration in zip(outputs, accelerations, strict=True):
        seen = observer.see(pose_of(y), z, k, C, MODEL, step)
        rows.append(np.array([seen.y, seen.y_rate, seen.unexpected]))
        z = SimpleNamespace(**observer.update(seen, acceleration + seen.unexpected, np.zeros(2), NUMPY))
    return rows


@pytest.mark.parametrize("step", [0.001, 0.02, 0.1])
@pytest.mark.parametrize("rate", [3.0, 30.0])
def test_all_error_poles_are_where_the_rate_says(rate: float, step: float) -> None:
    """One sample maps the errors of y^, y'^ and d^ by a matrix whose characteristic polynomial is (z - B)^3."""
    observer, columns = PoseObserver(2, rate), []
    for start in np.eye(3):
        parts = {name: np.array([value, 0.0]) for name, value in zip(("y", "y_rate", "unexpected"), start, strict=True)}
        z = SimpleNamespace(**parts, acceleration=parts["unexpected"], is_running=np.ones(1))
        seen = observer.see(pose_of(np.zeros(2)), z, own(observer), C, MODEL, step)
        columns.append([seen.y[0], seen.y_rate[0], seen.unexpected[0]])
    B = np.exp(-rate * step)
    np.testing.assert_allclose(np.poly(np.array(columns).T), [1.0, -3.0 * B, 3.0 * B**2, -(B**3)], atol=1e-12)


def test_what_was_not_expected_is_found_exactly_where_it_is_constant() -> None:
    """y = t^2 a/2 + b t with an expectation that is wrong by a constant: y'^ and d^ become exact."""
    t = STEP * np.arange(150)[:, None]
    a, b, told = np.array([3.0, -1.0]), np.array([0.4, 2.0]), np.array([5.0, 0.5])
    last = watched(PoseObserver(2, 30.0), 0.5 * a * t**2 + b * t, np.tile(told, (150, 1)))[-1]
    np.testing.assert_allclose(last[1], a * t[-1] + b, rtol=1e-9)
    np.testing.assert_allclose(last[2], a - told, rtol=1e-8)


def test_it_begins_where_the_robot_is_and_at_rest() -> None:
    first = watched(PoseObserver(2, 30.0), np.array([[7.0, -3.0]]), np.zeros((1, 2)))[0]
    np.testing.assert_array_equal(first, [[7.0, -3.0], [0.0, 0.0], [0.0, 0.0]])


def test_an_angle_that_jumps_by_a_turn_is_the_same_angle() -> None:
    """Of an output in rad; the mecanum's third one."""
    model = load_model("mecanum")
    c, observer = model.known(model.parameters()), PoseObserver(3, 30.0)
    z, k = SimpleNamespace(**observer.states), own(observer)
    for phi in (3.1, 3.13, 3.16 - 2.0 * np.pi, 3.19 - 2.0 * np.pi):
        x = np.array([0.0, 0.0, phi, 0.0, 0.0, 0.0])
        seen = observer.see(x, z, k, c, model, STEP)
        z = SimpleNamespace(**observer.update(seen, np.zeros(3), np.zeros(3), NUMPY))
        assert abs(seen.y_rate[2]) < 3.0


def test_with_v_measured_only_the_unexpected_is_estimated() -> None:
    observer = PoseObserver(2, 30.0, measures_v=True)
    x = np.array([0.3, 0.2, 0.5, 1.5, -0.4])
    seen = observer.see(x, SimpleNamespace(**observer.states), own(observer), C, MODEL, STEP)
    np.testing.assert_array_equal(seen.x, x)
    np.testing.assert_allclose(seen.y, MODEL.output(x[:3], C), rtol=1e-15)
    np.testing.assert_allclose(seen.y_rate, MODEL.output_rate(x, C), rtol=1e-14)


def test_cancelling_learns_first_and_keeps_what_is_fast_out_of_the_data() -> None:
    """g = 0 until the start, then 1 - exp(-(t - start)/ramp); a step is fast, and slow after some tau_d."""
    part = Cancelling(2, start=1.0, ramp=0.5, band=2.0)
    z, k, whole = SimpleNamespace(**part.states), own(part), np.array([2.0, -4.0])
    for n in range(400):
        t = STEP * n
        cancelled = part.cancelled(whole, z, k, NUMPY)
        expected = (1.0 - np.exp(-max(t - 1.0, 0.0) / 0.5)) * whole
        np.testing.assert_allclose(cancelled, expected, atol=1e-12)
        fast = part.fast(cancelled, z)
        np.testing.assert_allclose(fast, cancelled - z.slow, atol=1e-15)
        z = SimpleNamespace(**part.update(cancelled, z, k, NUMPY, STEP))
    assert np.abs(part.fast(whole, z)).max() < 0.1 * np.abs(whole).max()
    one = part.update(whole, SimpleNamespace(elapsed=np.zeros(1), slow=np.zeros(2)), k, NUMPY, 2.0)
    np.testing.assert_allclose(one["slow"], (1.0 - np.exp(-1.0)) * whole, rtol=1e-12)
    assert not Cancelling(2, separates=False).fast(whole, z).any()


def test_sampled_gains_place_both_poles() -> None:
    """Of e'' = -b1 e' - b2 e, held over a sample."""
    for bandwidth in (1.0, 15.0, 40.0):
        b1, b2 = sampled_gains(bandwidth, STEP)
        step = np.array([[1.0 - 0.5 * STEP**2 * b2, STEP - 0.5 * STEP**2 * b1], [-STEP * b2, 1.0 - STEP * b1]])
        pole = np.exp(-bandwidth * STEP)
        np.testing.assert_allclose(np.poly(step), [1.0, -2.0 * pole, pole**2], atol=1e-12)


LAWS = {
    "composite": 'law = "composite"',
    "frozen": 'law = "frozen"',
    "direct": 'law = "direct"',
    "linearizing": "outer_loop = { bandwidth = 15.0 }",
}


def experiment(robot: str, folder: Path, laws: dict[str, str], duration: float = 4.0, more: str = "") -> Path:
    """The shipped track of a robot from the pose alone."""
    text = find_experiment(f"track_{robot}").read_text()
    text = text[: text.index("[shared]")]
    begin = text.index("duration = ")
    text = text[:begin] + f"duration = {duration}\n" + text[text.index("\n", begin) :]
    text = text.replace("[uncertainties]\n", f"[uncertainties]\n{more}\n", 1)
    tables = "".join(
        f'[controllers.{law}]\n{table}\nmeasures = "pose"\nreference_rate = 3.0\n' for law, table in laws.items()
    )
    file = folder / "pose.toml"
    file.write_text(text + tables)
    return file


@pytest.mark.parametrize(
    ("robot", "law"),
    [(robot, "composite") for robot in ROBOTS] + [("type_2_0", law) for law in LAWS] + [("car", "linearizing")],
)
def test_all_backends_give_the_same_run_from_the_pose(robot: str, law: str, tmp_path: Path) -> None:
    file = experiment(robot, tmp_path, {law: LAWS[law]})
    runs = [wmr_afl.run(file, backend=backend)[law] for backend in ("numpy", "casadi", "compiled")]
    assert runs[0].failure is None
    for run in runs[1:]:
        for signal in ("state", "input", "estimate", "error"):
            expected = getattr(runs[0], signal)
            assert np.abs(getattr(run, signal) - expected).max() < 1e-9 * max(1.0, np.abs(expected).max()), signal
        if runs[0].slip is not None:
            np.testing.assert_allclose(run.slip, runs[0].slip, atol=1e-7)


@pytest.mark.parametrize("law", list(LAWS))
def test_no_velocity_is_looked_at(law: str, tmp_path: Path) -> None:
    """Whatever is measured of v: the voltages are the same, to the bit."""
    controllers = [Controller.from_experiment(experiment("type_2_0", tmp_path, LAWS), law) for _ in range(2)]
    random = np.random.default_rng(3)
    for n in range(200):
        q = [0.3 * np.sin(0.01 * n), 0.1 + 0.002 * n, 0.4 + 0.01 * n]
        u = [controller.update(STEP * n, [*q, *random.normal(0.0, 100.0, 2)]) for controller in controllers]
        np.testing.assert_array_equal(u[0], u[1])


@pytest.mark.parametrize("robot", ["type_2_0", "mecanum", "tractor_trailer"])
def test_with_a_force_the_pose_is_enough(robot: str, tmp_path: Path) -> None:
    """From the true parameters under friction and a force: closer than the same law with v that cancels nothing."""
    forces = 'disturbance = { expression = "2*sin(3*t)", on = "pseudo_velocities" }'
    file = experiment(robot, tmp_path, {"frozen": LAWS["frozen"]}, 20.0, forces)
    pose = wmr_afl.run(file)["frozen"]
    file.write_text(file.read_text().replace('measures = "pose"', "rate = 12.959"))
    state = wmr_afl.run(file)["frozen"]
    assert pose.failure is None
    assert np.linalg.norm(pose.rms(since=10.0)) < 0.7 * np.linalg.norm(state.rms(since=10.0))


@pytest.mark.parametrize(("law", "volts"), [("frozen", 12.0), ("linearizing", 12.0), ("linearizing", 1.2)])
def test_with_the_true_parameters_nothing_is_unexpected(law: str, volts: float, tmp_path: Path) -> None:
    """Also while motors are at their limits where the law knows what they then do: nothing winds up."""
    file = experiment("type_2_0", tmp_path, {law: LAWS[law]})
    file.write_text(file.read_text().replace("volts = 12.0", f"volts = {volts}").replace('"rk4"', '"euler"'))
    loop = load_experiment(file).loops[law]
    z, k = by_part(loop.states), by_part(loop.values)
    model, largest, saturated = loop.model.in_library("numpy"), 0.0, 0
    for n in range(200):
        following, signals = loop.step(STEP * n, z, k, np.zeros(0), model)
        z = by_part(following)
        saturated += bool(np.abs(signals["command"]).max() > volts)
        largest = max(largest, float(np.abs(z.observer.unexpected).max()) if n > 50 else 0.0)
    assert (saturated > 3) == (volts < 2.0)
    assert largest < 0.1


def test_a_batch_and_a_controller_are_as_many_runs(tmp_path: Path) -> None:
    file = experiment("type_2_0", tmp_path, {"composite": LAWS["composite"]})
    run = wmr_afl.run(file, "compiled")["composite"]
    batch = wmr_afl.run_batch(file, scale={"estimates.pi1": [1.0, 2.0], "parameters.m_C": [1.0, 1.2]})
    np.testing.assert_allclose(batch.rms[0], run.rms(), rtol=1e-9)
    assert abs(batch.rms[1] - run.rms()).max() > 1e-6
    controller = Controller.from_experiment(file)
    for t, x, u in zip(run.time, run.state, run.input, strict=True):
        np.testing.assert_allclose(controller.update(t, x), u, rtol=1e-9, atol=1e-9)


def test_steps_that_jitter_disturb_no_observer() -> None:
    """It goes by the time that passed: a uniformly accelerated motion stays exact at uneven samples."""
    observer, random = PoseObserver(2, 30.0), np.random.default_rng(5)
    z, k, t = SimpleNamespace(**observer.states), own(observer), 0.0
    a, b = np.array([1.0, -2.0]), np.array([0.3, 0.1])
    for _ in range(300):
        step = STEP * random.uniform(0.5, 1.5)
        t += step
        seen = observer.see(pose_of(0.5 * a * t**2 + b * t), z, k, C, MODEL, step)
        z = SimpleNamespace(**observer.update(seen, a + 0.0 * seen.unexpected, np.zeros(2), NUMPY))
        if t < 2.0:
            z.unexpected = np.zeros(2)
    np.testing.assert_allclose(seen.y_rate, a * t + b, rtol=1e-6)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('measures = "speed"', "'state' or 'pose'"),
        ("observer = { rate = 0.0 }", "greater than 0"),
        ("observer = { ramp = -1.0 }", "greater than 0"),
        ("observer = { begin = 1.0 }", "begin"),
        (
            "observer = { predict = true }\nouter_loop = { bandwidth = 3.0 }",
            "predict means nothing: the drive is not late",
        ),
        ('law = "frozen"\nobserver = { predict = true }', "predict means nothing: the drive is not late"),
        ("outer_loop = { bandwidth = 3.0, b1 = 1.0 }", "give b1 and b2, or bandwidth"),
        ("outer_loop = { b1 = 1.0 }", "give b1 and b2, or bandwidth"),
        ("outer_loop = { }", "give b1 and b2, or bandwidth"),
    ],
)
def test_a_table_that_means_nothing_is_told_with_its_place(table: str, words: str, tmp_path: Path) -> None:
    file = experiment("type_2_0", tmp_path, {})
    file.write_text(f"{file.read_text()}[controllers.mine]\n{table}\n")
    with pytest.raises(WmrError, match="mine") as caught:
        load_experiment(file)
    assert words in str(caught.value)


def test_parts_refuse_numbers_without_meaning() -> None:
    for build in (
        lambda: PoseObserver(2, 0.0), lambda: PoseObserver(2, np.nan), lambda: Cancelling(2, start=-1.0),
        lambda: Cancelling(2, ramp=0.0), lambda: Cancelling(2, band=np.inf),
    ):  # fmt: skip
        with pytest.raises(WmrError, match="choose"):
            build()


def test_rates_that_the_samples_cannot_carry_are_told(tmp_path: Path) -> None:
    """Twice the rule is the most; of observer and loop, with the usual number."""
    for own, words in (
        ("observer = { rate = 59.0 }", ()),
        ("observer = { rate = 61.0 }", ("the rate of the observer is 61 /s, at samples of 0.02 s 30 /s is usual",)),
        ("rate = 31.0", ("the rate of the loop is 31 /s, at samples of 0.02 s 15 /s is usual",)),
    ):
        file = experiment("type_2_0", tmp_path, {"frozen": f"{LAWS['frozen']}\n{own}"}, 1.0)
        found = [sign for sign in wmr_afl.run(file)["frozen"].warnings if "is usual" in sign]
        assert tuple(sign.partition(";")[0] for sign in found) == words


def test_what_is_observed_is_logged(tmp_path: Path) -> None:
    """The state as the observer tells it, close to the true one, and d^; in the run, its samples and trajectories."""
    h5py = pytest.importorskip("h5py")
    file = experiment("type_2_0", tmp_path, {"composite": LAWS["composite"]}, 10.0)
    run = wmr_afl.run(file, "casadi")["composite"]
    assert run.observed is not None
    assert run.unexpected is not None
    np.testing.assert_array_equal(run.observed[:, :3], run.state[:, :3])
    assert np.abs(run.observed[100:, 3:] - run.state[100:, 3:]).max() < 0.02
    assert run.unexpected.shape == run.error.shape
    assert run.slip is not None
    header = columns(run)
    assert header[-10:] == [
        "observed_x [m]", "observed_y [m]", "observed_phi [rad]", "observed_v [m/s]", "observed_omega [rad/s]",
        "unexpected_y1 [m/s^2]", "unexpected_y2 [m/s^2]", "surprise [m or rad]", "slip_right sideways [m/s]",
        "slip_left sideways [m/s]",
    ]  # fmt: skip
    write_results({"pose": run}, tmp_path)
    table = np.loadtxt(tmp_path / "pose.csv", delimiter=",", skiprows=1)
    assert run.surprise is not None
    signals = [run.observed, run.unexpected, run.surprise[:, None], run.slip]
    np.testing.assert_array_equal(table[:, -10:], np.hstack(signals))
    wmr_afl.run_batch(file, scale={"m_C": [1.0]}, trajectories=tmp_path / "runs.h5", backend="casadi")
    with h5py.File(tmp_path / "runs.h5") as record:
        np.testing.assert_allclose(record["observed"][0], run.observed, rtol=1e-9, atol=1e-12)
        assert list(record["unexpected"].attrs["names"]) == ["y1 [m/s^2]", "y2 [m/s^2]"]
        np.testing.assert_allclose(record["slip"][0], run.slip, atol=1e-9)
        assert list(record["slip"].attrs["names"]) == ["right sideways [m/s]", "left sideways [m/s]"]
        assert "slip_true" not in record


def late(robot: str, folder: Path, own: str, law: str = "composite", duration: float = 20.0) -> Path:
    """A track whose drive is two samples late."""
    return experiment(robot, folder, {law: f"{LAWS[law]}\n{own}"}, duration, "input_delay = { seconds = 0.04 }")


def test_a_law_knows_what_a_late_drive_still_has_to_carry_out(tmp_path: Path) -> None:
    """With the true parameters, and motors without back-EMF, little is unexpected: it goes by what acts now."""
    for own in ("observer = { cancel = false }", "observer = { cancel = false, predict = true }"):
        file = late("type_2_0", tmp_path, own, "frozen")
        text = file.read_text().replace('"rk4"', '"euler"')
        file.write_text(text.replace("[start]", "[parameters]\nK2 = 1e-6\n[start]"))
        run = wmr_afl.run(file)["frozen"]
        assert run.failure is None
        assert run.unexpected is not None
        assert np.abs(run.unexpected[500:]).max() < 0.05
        assert run.rms(since=10.0).max() < 2e-4  # of a reference that is two samples off it would be millimetres


def test_commands_under_way_are_carried_out_in_their_order() -> None:
    """The oldest acts; a prediction is the motion that they bring about."""
    part = CommandsUnderWay(2, 3, STEP, predicts=True)
    z = SimpleNamespace(**part.states)
    given = [np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([-5.0, 6.0])]
    for one in given:
        z = SimpleNamespace(**part.update(one, 10.0 * one, z, NUMPY))
    np.testing.assert_array_equal(part.acting(z.accelerations), given[0])
    np.testing.assert_array_equal(part.acting(z.removed), 10.0 * given[0])
    y, rate, drift = np.array([0.3, 0.1]), np.array([1.0, -1.0]), np.array([0.2, 0.1])
    seen = Seen(np.array([0.3 - C[0], 0.1, 0.0, 0.0, 0.0]), y, rate, np.zeros(2), E, 0.0)
    ahead = part.ahead(seen, E, drift, z, NUMPY, STEP)
    for one in given:
        y, rate = y + STEP * rate + 0.5 * STEP**2 * (E @ one + drift), rate + STEP * (E @ one + drift)
    np.testing.assert_allclose(ahead.y, y, rtol=1e-14)
    np.testing.assert_allclose(ahead.y_rate, rate, rtol=1e-14)
    np.testing.assert_allclose(E @ ahead.x[3:], rate, rtol=1e-12)
    assert CommandsUnderWay(2, 3, STEP).ahead(seen, E, drift, z, NUMPY, STEP) is seen
    with pytest.raises(WmrError, match="choose at least one sample"):
        CommandsUnderWay(2, 0, STEP)


@pytest.mark.parametrize("own", ["", "observer = { predict = true }"])
def test_a_late_drive_gives_the_same_run_on_every_backend(own: str, tmp_path: Path) -> None:
    file = late("type_2_0", tmp_path, own, duration=4.0)
    runs = [wmr_afl.run(file, backend=backend)["composite"] for backend in ("numpy", "casadi", "compiled")]
    for run in runs[1:]:
        for signal in ("state", "input", "estimate"):
            expected = getattr(runs[0], signal)
            assert np.abs(getattr(run, signal) - expected).max() < 1e-9 * max(1.0, np.abs(expected).max()), signal
    controller = Controller.from_experiment(file)
    for t, x, u in zip(runs[0].time, runs[0].state, runs[0].command, strict=True):
        np.testing.assert_allclose(controller.update(t, x), u, rtol=1e-7, atol=1e-7)


def test_only_an_observer_sees_what_could_be_cancelled() -> None:
    for parts in ({"cancelling": Cancelling(2)}, {"under_way": CommandsUnderWay(2, 1, STEP)}):
        with pytest.raises(WmrError, match="only an observer tells"):
            Sight(**parts)  # type: ignore[arg-type]
