"""The observer of what is measured in part: a Kalman filter as a textbook writes it, and laws that go by it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS
from wmr_afl import Controller, WmrError, load_model
from wmr_afl.controllers.kalman_observer import KalmanObserver
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.model.observability import undetermined
from wmr_afl.numerics.arrays import NUMPY, Floats

STEP = 0.02
FEW = {  # what is measured of a robot instead of its state, often neither heading nor steering
    "car": "x y phi", "mecanum": "x y phi u_fl u_fr u_rl u_rr", "tractor_3_trailers": "x y phi beta3",
    "tractor_trailer": "x y beta", "type_1_1": "x y phi", "type_1_2": "x y phi u_front", "type_2_0": "x y u_r u_l",
    "type_2_0_caster": "x y phi beta omega", "type_2_0_uneven": "x y v", "type_2_1": "x y phi gamma",
    "type_3_0": "x y phi platform_turning",
}  # fmt: skip


def random_filter(model: Model, names: list[str]) -> tuple[KalmanObserver, SimpleNamespace, Floats]:
    """An observer in the middle of its work, its states at random, and what is measured next; slips if all of q is."""
    random, p = np.random.default_rng(7), model.parameters()
    measurement = Measurement(model, names)
    deviation = {name: 0.01 * (n + 1.0) for n, name in enumerate(names)}
    slip_rate = 5.0 if len(measurement.coordinates) == model.coordinate_count else None
    observer = KalmanObserver(model, measurement, 20.0, p, deviation, slip_rate=slip_rate)
    count, n, size = model.pseudo_velocity_count, model.coordinate_count, len(observer.states["state"])
    root = random.normal(0.0, 0.1, (size, size))
    P = root @ root.T
    state = random.uniform(0.2, 0.8, size)
    states = {
        "state": state, "covariance": P[np.triu_indices(size)], "acceleration": random.normal(size=count),
        "is_running": np.ones(1),
    }  # fmt: skip
    z = measurement.of(state[: n + count] + random.normal(0.0, 0.05, n + count), p, model)
    return observer, SimpleNamespace(**states), z


def slip_directions(observer: KalmanObserver, model: Model, q: Floats) -> Floats:
    """Across every wheel that must not slip, and along S where rates are measured, too."""
    p, rates = observer.p, len(observer.measurement.names) > len(observer.measurement.coordinates)
    A = model.constraint_matrix(q, p) if observer.n > observer.count else np.zeros((0, observer.n))
    return np.hstack([A.T, model.kinematic_matrix(q, p) if rates else np.zeros((observer.n, 0))])


def textbook(observer: KalmanObserver, model: Model, z: SimpleNamespace, measured: Floats) -> tuple[Floats, Floats]:
    """The extended Kalman filter with whole matrices, K = P H^T (H P H^T + R)^-1, its derivatives by CasADi."""
    symbolic, p, n, count = model.in_library("casadi"), observer.p, observer.n, observer.count
    size, slips = len(z.state), len(z.state) - n - 2 * count
    q, v, sigma, delta = np.split(z.state, [n, n + count, n + count + slips])
    any_q, any_v = ca.SX.sym("q", n), ca.SX.sym("v", count)
    moves = symbolic.kinematic_matrix(any_q, p) @ any_v
    by_x = ca.Function("by_x", [any_q, any_v], [ca.jacobian(moves, ca.vertcat(any_q, any_v))])

    def G(place: Floats) -> Floats:
        return slip_directions(observer, model, place) if slips else np.zeros((n, 0))

    middle_q = q + 0.5 * STEP * (model.kinematic_matrix(q, p) @ v + G(q) @ sigma)
    middle_v = v + 0.5 * STEP * z.acceleration
    F = np.eye(size)
    F[:n, : n + count] += STEP * by_x(middle_q, middle_v).full()
    F[:n, n + count : n + count + slips] = STEP * G(middle_q)
    F[:n, n + count + slips :] = 0.5 * STEP**2 * model.kinematic_matrix(middle_q, p)
    F[n : n + count, n + count + slips :] = STEP * np.eye(count)
    P = np.zeros((size, size))
    P[np.triu_indices(size)] = z.covariance
    P = P + P.T - np.diag(np.diag(P))
    is_rate = np.array([place not in observer.measurement.coordinates.values() for place in range(len(measured))])
    r, predicted_q = (
        observer.deviation,
        q + STEP * (model.kinematic_matrix(middle_q, p) @ middle_v + G(middle_q) @ sigma),
    )
    finest = np.min(np.where(is_rate, r / observer.rate[0], r))
    Q = np.zeros(size)
    Q[n + count : n + count + slips] = (5.0**2 * finest * STEP) ** 2
    Q[n + count + slips :] = (observer.rate[0] ** 3 * finest * STEP) ** 2
    rate = model.kinematic_matrix(middle_q, p) @ middle_v + G(middle_q) @ sigma
    predicted = np.concatenate([q + STEP * rate, v + STEP * z.acceleration, sigma, delta])
    P = F @ P @ F.T + np.diag(Q)
    held = observer.measurement.of(ca.vertcat(any_q, any_v), p, symbolic)  # X(q) as it is at q^, its slope is left out
    slope = ca.Function("slope", [any_q, any_v], [ca.jacobian(held, ca.vertcat(any_q, any_v)), held])
    values, expected = (value.full() for value in slope(predicted[:n], predicted[n : n + count]))
    H = np.zeros((len(measured), size))
    H[:, : n + count] = values
    H[is_rate, :n] = 0.0
    r = r * np.array(observer.measurement.sizes(predicted_q, p, model))  # noise of an encoder in units of its own
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(r**2))
    return predicted + K @ (measured - expected[:, 0]), P - K @ H @ P


@pytest.mark.parametrize("what", ["few", "pose"])
def test_it_is_the_filter_of_the_textbook(robot: str, what: str) -> None:
    model = load_model(robot)
    p, pose = model.parameters(), list(model.state_units)[: model.coordinate_count]
    observer, z, measured = random_filter(model, FEW[robot].split() if what == "few" else pose)
    c, k = model.known(p), SimpleNamespace(**observer.values)
    seen = observer.see(measured, z, k, c, model, STEP)
    state, P = textbook(observer, model, z, measured)
    n, count = observer.n, observer.count
    near = {"rtol": 1e-8, "atol": 1e-10}
    np.testing.assert_allclose(seen.memory["state"], state, **near)
    np.testing.assert_allclose(seen.memory["covariance"], P[np.triu_indices(len(state))], rtol=1e-7, atol=1e-10)
    q = state[:n]
    E, J = model.output_map(q, c), model.output_jacobian(q, c)
    q_rate = model.kinematic_matrix(q, p) @ state[n : n + count]
    if observer.slips:
        q_rate = q_rate + slip_directions(observer, model, q) @ state[n + count : -count]
    np.testing.assert_allclose(seen.x[:n], q, **near)
    np.testing.assert_allclose(seen.E, E, **near)
    np.testing.assert_allclose(seen.y, model.output(q, c), **near)
    np.testing.assert_allclose(seen.y_rate, J @ q_rate, **near)
    np.testing.assert_allclose(E @ seen.x[n:], J @ q_rate, **near)
    np.testing.assert_allclose(seen.unexpected, E @ state[-count:], **near)
    asked, drift = np.arange(1.0, count + 1.0), 0.3 * np.ones(count)
    after = observer.update(seen, E @ asked + drift, drift, NUMPY)
    np.testing.assert_allclose(after["acceleration"], asked, rtol=1e-9)
    assert after["is_running"] == 1.0


def test_poles_of_a_measured_coordinate_lie_near_the_rate() -> None:
    """The platform held at phi = 0 is three chains of integrators: their poles as the samples become fine."""
    model, rate, step = load_model("mecanum"), 10.0, 0.001
    observer = KalmanObserver(model, Measurement(model, ["x", "y", "phi"]), rate, model.parameters())
    c, k = model.known(model.parameters()), SimpleNamespace(**observer.values)
    z = SimpleNamespace(**observer.states)
    for _ in range(3000):
        seen = observer.see(np.zeros(3), z, k, c, model, step)
        z = SimpleNamespace(**observer.update(seen, np.zeros(3), np.zeros(3), NUMPY))
    columns = []
    for error in np.eye(9):
        z.state, z.acceleration = error, error[6:]  # which takes in what is not expected
        columns.append(observer.see(np.zeros(3), z, k, c, model, step).memory["state"])
    poles = np.log(np.linalg.eigvals(np.array(columns).T).astype(complex)) / step
    np.testing.assert_allclose(np.abs(poles), rate, rtol=0.02)
    assert (poles.real < 0.0).all()


def test_it_begins_as_measured_and_otherwise_as_told() -> None:
    """Measured coordinates to a millionth, the others from `first`, and at rest; a gap forgets rates only."""
    model = load_model("car")
    measurement = Measurement(model, ["y", "x", "phi"])
    observer = KalmanObserver(model, measurement, 30.0, model.parameters(), 1e-3, {"beta": 0.2})
    c, k = model.known(model.parameters()), SimpleNamespace(**observer.values)
    z = SimpleNamespace(**observer.states)
    seen = observer.see(np.array([5.0, -3.0, 40.0]), z, k, c, model, STEP)
    np.testing.assert_allclose(seen.x, [-3.0, 5.0, 40.0, 0.2, 0.0, 0.0], atol=1e-12)
    assert seen.surprise == 0.0
    after = SimpleNamespace(**observer.update(seen, np.ones(2), np.zeros(2), NUMPY))
    after.state = after.state + np.array([0.0, 0.0, 0.0, 0.1, 3.0, 3.0, 3.0, 3.0])
    after.is_running = np.zeros(1)
    again = observer.see(np.array([5.0, -3.0, 40.0]), after, k, c, model, STEP)
    np.testing.assert_allclose(again.x, [-3.0, 5.0, 40.0, 0.3, 0.0, 0.0], atol=1e-12)


def test_a_heading_that_jumps_by_a_turn_is_the_same() -> None:
    model = load_model("type_2_0")
    observer = KalmanObserver(model, Measurement(model, ["x", "y", "phi"]), 30.0, model.parameters())
    c, k, z = model.known(model.parameters()), SimpleNamespace(**observer.values), SimpleNamespace(**observer.states)
    for phi in (3.1, 3.13, 3.16 - 2.0 * np.pi, 3.19 - 2.0 * np.pi):
        seen = observer.see(np.array([0.0, 0.0, phi]), z, k, c, model, STEP)
        z = SimpleNamespace(**observer.update(seen, np.zeros(2), np.zeros(2), NUMPY))
        assert abs(seen.x[4]) < 3.0
        assert seen.surprise < 0.1


def experiment(robot: str, folder: Path, more: str = "", duration: float = 1.0, measured: str = "") -> Path:
    """The shipped track of a robot of which little is measured."""
    text = find_experiment(f"track_{robot}").read_text()
    text = text[: text.index("[shared]")]
    begin = text.index("duration = ")
    text = text[:begin] + f"duration = {duration}\n" + text[text.index("\n", begin) :]
    names = ", ".join(f'"{name}"' for name in (measured or FEW[robot]).split())
    law = f'[controllers.few]\nlaw = "composite"\nreference_rate = 3.0\nmeasured = [{names}]\n{more}\n'
    file = folder / "few.toml"
    file.write_text(text + law)
    return file


def test_what_is_measured_here_determines_the_state(robot: str) -> None:
    assert not undetermined(load_model(robot), FEW[robot].split(), load_model(robot).parameters())


@pytest.mark.parametrize("robot", ROBOTS)
def test_few_measured_entries_are_enough_to_follow(robot: str, tmp_path: Path) -> None:
    """What is observed comes to what is true, and the robot to its reference."""
    run = wmr_afl.run(experiment(robot, tmp_path, duration=20.0), backend="casadi")["few"]
    assert run.failure is None
    assert run.observed is not None
    late = run.time > 15.0
    assert np.abs(run.observed - run.state)[late].max() < 0.02
    assert np.abs(run.rms(since=15.0)).max() < 2e-3


@pytest.mark.parametrize("robot", ["car", "type_2_0", "tractor_trailer", "mecanum"])
def test_all_ways_to_run_give_the_same(robot: str, tmp_path: Path) -> None:
    """NumPy, CasADi, compiled, a batch of two, and a Controller that is given what is measured and nothing else."""
    file = experiment(robot, tmp_path)
    runs = [wmr_afl.run(file, backend=backend)["few"] for backend in ("numpy", "casadi", "compiled")]
    assert runs[0].failure is None
    for run in runs[1:]:
        for signal in ("state", "input", "estimate", "observed", "surprise"):
            expected = getattr(runs[0], signal)
            assert np.abs(getattr(run, signal) - expected).max() < 1e-9 * max(1.0, np.abs(expected).max()), signal
    uncertain = next(name for name, unit in runs[0].model.parameter_units.items() if unit == "kg")
    batch = wmr_afl.run_batch(file, scale={f"parameters.{uncertain}": [1.0, 1.2]})
    np.testing.assert_allclose(batch.rms[0], runs[0].rms(), rtol=1e-9)
    controller = Controller.from_experiment(file)
    assert controller.measured == tuple(FEW[robot].split())
    measurement = Measurement(runs[0].model, controller.measured)
    for t, x, u in zip(runs[0].time, runs[0].state, runs[0].command, strict=True):
        z = measurement.of(x, runs[0].parameters, runs[0].model)
        np.testing.assert_allclose(controller.update(t, z), u, rtol=1e-8, atol=1e-8)


def test_a_controller_of_the_pose_takes_the_pose_or_all_of_the_state(tmp_path: Path) -> None:
    """And looks at no velocity then, not even at one that is not a number."""
    file = experiment("type_2_0", tmp_path, measured="x y phi")
    first, second, third = (Controller.from_experiment(file) for _ in range(3))
    for n in range(50):
        q = np.array([0.01 * n, 0.1, 0.3])
        u = first.update(STEP * n, q)
        np.testing.assert_array_equal(second.update(STEP * n, [*q, np.nan, np.nan]), u)
        np.testing.assert_array_equal(third.update(STEP * n, [*q, 3.0, -4.0]), u)
    with pytest.raises(WmrError, match=r"expected \(3,\): x, y, phi"):
        first.update(2.0, [0.0, 0.0])


def test_a_robot_of_a_batch_has_an_observer_of_its_own_geometry(tmp_path: Path) -> None:
    """The wheelbase of each robot is in its observer, too: errors are as small for both."""
    file = experiment("car", tmp_path, duration=20.0)
    batch = wmr_afl.run_batch(file, scale={"parameters.a": [1.0, 1.3]}, since=15.0)
    assert np.all(batch.rms < 1e-3)


def lost(folder: Path, law: str, bound: str = "") -> Path:
    """Voltages ten times too large for an unknown robot without limits."""
    file = experiment("type_2_0", folder, measured="x y phi", duration=4.0)
    text = file.read_text().replace('law = "composite"', f"{law}\nobserver = {{ {bound} }}")
    lines = [line for line in text.splitlines() if not line.startswith("input_limits")]
    file.write_text("\n".join(lines))
    return file


@pytest.mark.filterwarnings("ignore:few stopped")
@pytest.mark.parametrize("kind", ['kind = "pose"', 'kind = "kalman"'])
def test_an_observer_that_is_lost_ends_the_run_with_time_and_cause(kind: str, tmp_path: Path) -> None:
    """Alike on every backend and in a batch; a run that ends so had surprises below the bound until then."""
    file = lost(tmp_path, 'law = "frozen"\nguess = { K1 = 1.2 }', kind)
    runs = [wmr_afl.run(file, backend=backend)["few"] for backend in ("numpy", "casadi", "compiled")]
    for run in runs:
        assert run.failure is not None
        assert "the observer is lost" in run.failure.cause
        assert run.failure.time == runs[0].failure.time  # type: ignore[union-attr]
        assert run.surprise is not None
        assert 0.0 < run.surprise.max() < 1.0
    batch = wmr_afl.run_batch(file, scale={"parameters.m_C": [1.0]})
    assert batch.failed[0]
    wider = file.read_text().replace(kind, f"{kind}, bound = 3.0")
    file.write_text(wider)
    later = wmr_afl.run(file)["few"]
    assert later.failure is None or later.failure.time > runs[0].failure.time  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('measured = ["x", "y", "phi"]\nmeasures = "pose"', "measures and measured both say"),
        ("measured = []", "nothing is measured"),
        ('measured = ["x", "x"]', "x is measured twice"),
        ('measured = ["x", "speed"]', "unknown entry of the state or motor 'speed'"),
        ('measured = ["u_r", "u_l"]', "nothing of u_r, u_l determines x, y, phi, beta; measure x and y and beta, too"),
        ('measured = ["x"]\nobserver = { carried = ["y", "phi", "beta"] }', "nothing of x determines"),
        ('measured = ["x", "y"]\nobserver = { kind = "pose" }', "needs all of q, or of x"),
        ('measured = ["x", "y", "phi"]\nobserver = { carried = ["beta", "beta"] }', "observer.carried names beta"),
        ('measured = ["x", "y", "phi"]\nobserver = { carried = ["v"] }', "observer.carried names v"),
        ('measured = ["x", "y", "beta"]\nobserver = { first = { x = 1.0 } }', "observer.first names x"),
        (
            'measured = ["x", "y", "phi"]',
            "nothing of x, y, phi determines beta; measure beta, too, or let the motion carry along what nothing "
            "tells: observer.carried = ['beta']",
        ),
        ('measured = ["x", "y", "phi"]\nobserver = { carried = ["phi"] }', "observer.carried names phi"),
        ('measured = ["x", "y", "phi"]\nobserver = { carried = ["wheel"] }', "observer.carried names wheel"),
        ('measured = ["x", "y", "beta"]\nobserver = { slip_rate = 3.0 }', "means nothing where q is measured in part"),
        ('measures = "pose"\nobserver = { slip = false }', "means nothing where the pose is measured"),
        ('measures = "pose"\nobserver = { carried = ["beta"] }', "means nothing where the pose is measured"),
        ('measures = "pose"\nobserver = { first = { beta = 1.0 } }', "means nothing where the pose is measured"),
        ('measured = ["x", "y", "beta"]\nobserver = { first = { gamma = 1.0 } }', "observer.first names gamma"),
        ('measured = ["x", "y", "beta"]\nobserver = { deviation = 0.0 }', "choose positive deviations"),
        ('measured = ["x", "y", "beta"]\nobserver = { deviation = { phi = 1.0 } }', "unknown measured entry 'phi'"),
        ('measured = ["x", "y", "beta"]\nobserver = { bound = 0.0 }', "greater than 0"),
    ],
)
def test_what_does_not_fit_is_told_with_its_place_and_a_remedy(table: str, words: str, tmp_path: Path) -> None:
    file = experiment("type_2_0_caster", tmp_path)
    text = file.read_text()
    file.write_text(text[: text.index("[controllers.few]")] + f'[controllers.mine]\nlaw = "composite"\n{table}\n')
    with pytest.raises(WmrError, match="mine") as caught:
        load_experiment(file)
    assert words in str(caught.value)


def test_what_the_motion_carries_along_need_not_be_measured(tmp_path: Path) -> None:
    """A caster's angle that is told wrongly by half a radian: it comes to the truth as the robot drives."""
    more = 'observer = { carried = ["beta"], first = { beta = 0.5 } }'
    file = experiment("type_2_0_caster", tmp_path, more, 10.0, "x y phi")
    run = wmr_afl.run(file, backend="casadi")["few"]
    assert run.observed is not None
    assert abs(run.observed[0, 3] - run.state[0, 3]) > 0.1
    assert abs(run.observed[-1, 3] - run.state[-1, 3]) < 1e-3
    assert run.failure is None


def test_slip_is_told_apart_from_forces_unless_it_is_ruled_out(tmp_path: Path) -> None:
    """Study 3's slip: millimetres where it is looked for, decimetres where it is not."""
    text = find_experiment("study_3_pose").read_text()
    rms = {}
    for slip in ("true", "false"):
        table = f'measures = "pose"\nobserver = {{ kind = "kalman", slip = {slip} }}'
        file = tmp_path / f"{slip}.toml"
        file.write_text(text.replace('measures = "pose"', table, 1))
        rms[slip] = np.abs(wmr_afl.run(file, backend="compiled")["pose"].rms(since=50.0, until=70.0)).max()
    assert rms["true"] < 0.003
    assert rms["false"] > 0.05


def test_nothing_is_carried_where_nothing_tells_how(tmp_path: Path) -> None:
    """A platform that moves sideways: without its heading its velocity is not known either."""
    with pytest.raises(WmrError) as caught:
        load_experiment(experiment("mecanum", tmp_path, measured="x y"))
    assert "measure phi" in str(caught.value)
    assert "observer.carried" not in str(caught.value)


@pytest.mark.parametrize("late", [0.0, 0.04])
@pytest.mark.parametrize("radius", [1.0, 0.2])
def test_an_encoder_counts_by_the_speed_that_it_tells(late: float, radius: float, tmp_path: Path) -> None:
    """Small wheels turn fast: with a late drive, too, the observer keeps the robot."""
    file = experiment("type_2_0", tmp_path, duration=8.0, measured="x y phi u_r u_l")
    text = file.read_text()
    if late:
        text = text.replace("[uncertainties]\n", f"[uncertainties]\ninput_delay = {{ seconds = {late} }}\n")
    file.write_text(text)
    batch = wmr_afl.run_batch(file, scale={f"parameters.{name}": [radius] for name in ("r", "K1", "K2")}, since=5.0)
    assert not batch.failed[0]
    assert np.abs(batch.rms).max() < 2e-3


@pytest.mark.parametrize("kind", ["pose", "kalman"])
def test_the_order_of_what_is_measured_is_the_one_that_is_told(kind: str, tmp_path: Path) -> None:
    """A Controller takes them so, and computes the same voltages."""
    orders, voltages = (["x", "y", "phi"], ["phi", "y", "x"], ["omega", "y", "v", "x", "phi"]), []
    x = dict(zip(("x", "y", "phi", "v", "omega"), (0.1, -0.2, 0.3, 0.05, 0.02), strict=True))
    for order in orders:
        file = experiment("type_2_0", tmp_path, f'observer = {{ kind = "{kind}" }}', measured=" ".join(order))
        controller = Controller.from_experiment(file)
        assert controller.measured == tuple(order)
        voltages.append(controller.update(0.0, [x[name] for name in order]))
    np.testing.assert_allclose(voltages[1], voltages[0], rtol=1e-12)
    assert np.abs(voltages[2] - voltages[0]).max() > 1e-6


def test_a_lost_observer_says_so_and_begins_again_after_a_gap(tmp_path: Path) -> None:
    """A robot that was carried away: refused with time and distance until the gap is long enough, or after reset."""
    controller = Controller.from_experiment(experiment("type_2_0", tmp_path, measured="x y phi"))
    for n in range(50):
        controller.update(STEP * n, [0.0, 0.0, 0.0])
    with pytest.raises(WmrError, match=r"observer is lost: what is measured differs by 3 m or rad.*or call reset\(\)"):
        controller.update(STEP * 50, [3.0, 0.0, 0.0])
    u = controller.update(STEP * 50 + 0.3, [3.0, 0.0, 0.0])
    assert np.isfinite(u).all()
    controller.update(STEP * 51 + 0.3, [3.0, 0.0, 0.0])
    controller.reset()
    controller.update(0.0, [-7.0, 0.0, 0.0])


def test_a_coordinate_that_is_observed_wrongly_is_told(tmp_path: Path) -> None:
    """By a warning after the run; measured and carried ones that come to the truth give none."""
    wrong = experiment("type_2_0_caster", tmp_path, 'observer = { carried = ["beta"] }', 1.0, "x y phi")
    text = wrong.read_text().replace('carried = ["beta"]', 'carried = ["beta"], first = { beta = 2.5 }')
    wrong.write_text(text.replace("duration = 1.0", "duration = 0.2"))
    told = [line for line in wmr_afl.run(wrong, backend="numpy")["few"].warnings if "as observed" in line]
    assert len(told) == 1
    assert told[0].startswith("beta as observed is off by ")
    right = experiment("type_2_0_caster", tmp_path, 'observer = { carried = ["beta"] }', 8.0, "x y phi")
    assert not [line for line in wmr_afl.run(right, backend="casadi")["few"].warnings if "as observed" in line]
