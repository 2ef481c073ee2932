"""The laws that adapt any robot: each part against its equation, and the energy along runs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS
from tests.derive import descriptions
from tests.derive.descriptions import AHEAD, derived, wheel
from wmr_afl import WmrError, load_model
from wmr_afl.controllers import DirectAdaptation, Effort, Knowledge, LeastSquares, PassivityLaw
from wmr_afl.controllers.direct_adaptation import guessed_inertia
from wmr_afl.controllers.groups import RowsOfGroups, groups_of
from wmr_afl.controllers.outer_loop import TrackingError, tracking_error
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.controllers.tables import box_around, spread_of
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.laws import LAWS as MODEL_LAWS
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.numerics.formulas import numpy_value
from wmr_afl.numerics.parts import by_part
from wmr_afl.simulation.closed_loop import ClosedLoop, trace
from wmr_afl.simulation.layout import Layout

LAWS = ("composite", "direct", "frozen")
ADAPTING = ("composite", "direct")


def own(part: object) -> SimpleNamespace:
    return SimpleNamespace(**part.values)  # type: ignore[attr-defined]


@pytest.fixture
def model(robot: str) -> Model:
    return load_model(robot)


def track(robot: str, law: str, extra: str = "", step: float = 0.02, duration: float = 10.0) -> str:
    """The shipped track of a robot under one law, from a guess of all that is uncertain which is 50 % off."""
    experiment = load_experiment(f"track_{robot}").experiment
    model = load_model(robot)
    factors = {"kg": 1.5, "kg m^2": 1.5, "N m/V": 0.6}
    uncertain = {name: unit for name, unit in model.parameter_units.items() if name not in model.known_units}
    guess = {
        name: factors[unit] * model.metadata["defaults"][name] for name, unit in uncertain.items() if unit in factors
    }
    start = ", ".join(f"{name} = {value}" for name, value in experiment.start.items())
    kinds = {name: kind for name, kind in experiment.reference.kinds().items() if kind is not None}
    ((kind, given),) = kinds.items()
    table = given if isinstance(given, dict) else given.model_dump()
    entries = ", ".join(
        f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value}" for name, value in table.items()
    )
    return f"""
title = "{robot} under the {law} law"
robot = "{robot}"
start = {{ {start} }}
reference = {{ {kind} = {{ {entries} }} }}
simulation = {{ duration = {duration}, sample_time = {step}, integrator = "rk4" }}
[controllers.{law}]
law = "{law}"
reference_rate = 3.0
guess = {{ {", ".join(f"{name} = {value}" for name, value in guess.items())} }}
{extra}
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "experiment.toml"
    file.write_text(text)
    return file


OF_ALL_ROBOTS = [(robot, "composite") for robot in ROBOTS] + [("mecanum", "direct"), ("type_2_1", "frozen")]


@pytest.mark.parametrize(("robot", "law"), OF_ALL_ROBOTS)
def test_all_backends_give_the_same_run(robot: str, law: str, tmp_path: Path) -> None:
    file = written(tmp_path, track(robot, law, duration=3.0))
    runs = [wmr_afl.run(file, backend=backend)[law] for backend in ("numpy", "casadi", "compiled")]
    for run in runs:
        assert run.failure is None
    for run in runs[1:]:
        for signal in ("state", "input", "estimate", *(("deviation",) if law == "composite" else ())):
            expected = getattr(runs[0], signal)
            assert np.abs(getattr(run, signal) - expected).max() < 1e-9 * max(1.0, np.abs(expected).max()), signal


def test_from_a_wrong_guess_every_robot_tracks_better_than_without_adaptation(robot: str, tmp_path: Path) -> None:
    errors = {}
    for law in LAWS:
        run = wmr_afl.run(written(tmp_path, track(robot, law, duration=20.0)), backend="casadi")[law]
        assert run.failure is None
        errors[law] = np.linalg.norm(run.rms(since=10.0))
    assert errors["composite"] < 0.3 * errors["frozen"]
    assert errors["direct"] < 0.7 * errors["frozen"]


def loop_of(file: Path) -> ClosedLoop:
    (loop,) = load_experiment(file).loops.values()
    return loop


def energies(loop: ClosedLoop, duration: float) -> Floats:
    """V1 and the estimates' share for every group, at each sample, (T, 1 + groups), without 1/gamma."""
    model, states = loop.model.in_library("numpy"), Layout(loop.states)
    values, n = Layout(loop.values).pack(loop.values), loop.model.coordinate_count
    p = loop.plant.parameters
    truth = loop.law.knowledge.truth(p)
    step, z = trace(loop), states.pack(loop.states)
    groups, rows = model.metadata["passivity_groups"], []
    scales = [
        float(wmr_afl.numerics.formulas.numpy_value(g["scale"], dict(zip(model.parameter_units, p, strict=True))))
        for g in groups
    ]
    packed = RowsOfGroups(groups_of(model))
    before = None
    for i in range(round(duration / loop.sample_time)):
        after = step(z, i * loop.sample_time, np.zeros(0), values)[0].full()[:, 0]
        now, then = states.unpack(z), states.unpack(after)
        if before is not None:
            x = now["x"]
            s = sliding(loop, x, i * loop.sample_time, now)
            off = then["theta_hat"] - truth  # learned at this sample, and acting from it on
            row = [0.5 * s @ model.inertia_matrix(x[:n], p) @ s]
            for scale, (group, P) in zip(scales, packed.blocks_of(then["least_squares.covariance"]), strict=True):
                error = off[list(group.parameters)]
                row.append(0.5 * scale * error @ np.linalg.solve(np.array(P, dtype=float), error))
            rows.append([*row, *now["direct.largest"]])
        before, z = now, after
    return np.array(rows)


def sliding(loop: ClosedLoop, x: Floats, t: float, states: dict[str, Floats]) -> Floats:
    """s = v - v_r."""
    model, law = loop.model.in_library("numpy"), loop.law
    assert isinstance(law, PassivityLaw)
    k, z, n, c = by_part(law.values), by_part(states), model.coordinate_count, law.knowledge.known
    reference = loop.reference.at(t)
    error = tracking_error(x, c, reference, model)
    d = law.reference_model.distance(error, z.reference_model, k.reference_model, NUMPY, loop.sample_time)
    error, wanted = law.reference_model.seen_from(error, d, reference, k.reference_model, model)
    v_r = np.linalg.solve(model.output_map(x[:n], c), wanted.velocity - k.error.rate[0] * error.e)
    return x[n:] - v_r


@pytest.mark.parametrize("step", [0.001, 0.02])
@pytest.mark.parametrize("robot", ["type_2_0", "type_2_1", "mecanum", "tractor_trailer"])
def test_the_energy_of_errors_and_estimates_never_grows(robot: str, step: float, tmp_path: Path) -> None:
    """(A8) with a memory without end, after the first second, in which the gains settle; at every single sample."""
    extra = "rate = 3.0\nlearning = { memory = 1e12, box = 1e6 }"
    loop = loop_of(written(tmp_path, track(robot, "composite", extra, step)))
    rows = energies(loop, 6.0)[round(1.0 / step) :]
    groups = groups_of(loop.model)
    count = len(groups)
    gain = loop.values["direct.gain"][0] * 3.0 * loop.values["direct.inertia"] / rows[-1, 1 + count :]
    energy = rows[:, 0] + (rows[:, 1 : 1 + count] / gain).sum(axis=1)
    settled = rows[:, 1 + count :] == rows[-1, 1 + count :]
    energy = energy[settled.all(axis=1)]
    assert len(energy) > 2.0 / step
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    assert energy[-1] < energy[0]


def test_least_squares_is_the_minimum_that_it_stands_for(model: Model) -> None:
    """Without forgetting, pi_hat minimizes the sum of squares and the prior's, group by group."""
    random, groups = np.random.default_rng(3), groups_of(model)
    count = len(model.units_of("passivity_parameters"))
    prior, spread = random.uniform(0.5, 2.0, count), random.uniform(0.5, 2.0, count)
    part = LeastSquares(groups, len(model.input_units), prior, spread, noise=0.3, filter=0.05, memory=1e15)
    k, c, step = own(part), model.known(model.parameters()), 0.01
    z, pi_hat = SimpleNamespace(**part.states), prior
    data: list[tuple[Floats, Floats]] = []
    s = Situation(model.name, count=12)
    for x, u in zip(s.x, s.u, strict=True):
        pi_hat, following = part.learn(x, pi_hat, z, k, c, model, step)
        R = model.allocation(x[: model.coordinate_count], c)
        z = SimpleNamespace(**following, **part.applied(u, R))
        Phi = np.zeros((len(R), count))
        for group, rows in part.groups.rows_of(z.regressor):
            Phi[np.ix_(group.rows, group.parameters)] = rows
        data.append((Phi, np.array(z.effort)))
    information = np.diag(spread**-2.0) + sum(Phi.T @ Phi for Phi, _ in data) * step / 0.3**2
    right = prior / spread**2 + sum(Phi.T @ ubar for Phi, ubar in data) * step / 0.3**2
    np.testing.assert_allclose(pi_hat, np.linalg.solve(information, right), rtol=1e-6, atol=1e-8)
    inverse = np.linalg.inv(information)
    for group, P in part.groups.blocks_of(z.covariance):
        block = inverse[np.ix_(group.parameters, group.parameters)]
        np.testing.assert_allclose(np.array(P, dtype=float), block, rtol=1e-6, atol=1e-10)
    blocks = np.zeros_like(information)  # of groups; what lies between them is zero, or rounding
    for group in groups:
        blocks[np.ix_(group.parameters, group.parameters)] = information[np.ix_(group.parameters, group.parameters)]
    deviation = np.sqrt(np.diag(np.linalg.inv(blocks)))
    np.testing.assert_allclose(part.deviation(z, NUMPY), deviation, rtol=1e-6)


def test_what_the_equation_leaves_unexplained_is_told_in_the_unit_of_its_noise() -> None:
    """White noise of this size on R u, and estimates that are right: what is left is the noise, whatever the filter."""
    model, random, step = load_model("type_2_0"), np.random.default_rng(8), 0.01
    pi, c = np.asarray(model.passivity_parameters(model.parameters())), model.known(model.parameters())
    for filter_time, noise in ((0.02, 0.3), (0.2, 0.3), (0.1, 2.0)):
        part = LeastSquares(groups_of(model), 2, pi, 1e-9 * pi, noise=noise, filter=filter_time)
        z, k, x = SimpleNamespace(**part.states), own(part), np.array([0.0, 0.0, 0.2, 0.5, 0.3])
        R = model.allocation(x[:3], c)
        steady = np.linalg.solve(R, model.rest_regressor(x, c) @ pi)
        told = []
        for n in range(20_000):
            _, following = part.learn(x, pi, z, k, c, model, step)
            pushed = np.linalg.solve(R, noise / np.sqrt(step) * random.normal(size=2))
            z = SimpleNamespace(**following, **part.applied(steady + pushed, R))
            if n > 5000:
                told.append(float(part.unexplained(z, k, NUMPY, step)[0]))
        assert np.mean(told) == pytest.approx(noise, rel=0.1)


def test_without_data_estimates_go_back_to_the_guess() -> None:
    model = load_model("type_2_0")
    part = LeastSquares(groups_of(model), 2, np.ones(6), np.full(6, 0.5), memory=2.0)
    k, c, x = own(part), model.known(model.parameters()), np.zeros(5)
    z, pi_hat = SimpleNamespace(**part.states), np.full(6, 3.0)
    for _ in range(1000):
        pi_hat, following = part.learn(x, pi_hat, z, k, c, model, 0.01)
        z = SimpleNamespace(**following, **part.applied(np.zeros(2), np.eye(2)))
    np.testing.assert_allclose(pi_hat - 1.0, 2.0 * (1.0 - 0.01 / 2.0) ** 1000, rtol=1e-9)
    np.testing.assert_allclose(z.covariance, part.states["covariance"], rtol=1e-12)


def test_the_filtered_motion_obeys_the_equation_of_the_robot(model: Model) -> None:
    """Phi pi = ubar along a run without load, by the trapezoidal rule: the true parameters leave little."""
    s, p = Situation(model.name, count=1), model.parameters()
    c, step, x = model.known(p), 1e-4, s.x[0].copy()
    pi = model.passivity_parameters(p)
    part = LeastSquares(groups_of(model), len(model.input_units), pi, np.abs(pi) + 1.0, filter=1e-3)
    k, z, n = own(part), SimpleNamespace(**part.states), model.coordinate_count
    for i in range(60):
        u = s.u[0] * np.cos(30.0 * i * step)
        _, following = part.learn(x, pi, z, k, c, model, step)
        z = SimpleNamespace(**following, **part.applied(u, model.allocation(x[:n], c)))
        middle = x + 0.5 * step * model.state_derivative(x, u, np.zeros(len(x) - n), p)
        x = x + step * model.state_derivative(middle, u, np.zeros(len(x) - n), p)
    found = np.zeros(len(x) - n)
    for group, rows in part.groups.rows_of(z.regressor):
        found[list(group.rows)] = np.array(rows) @ pi[list(group.parameters)]
    np.testing.assert_allclose(found, z.effort, atol=2e-4 * max(1.0, np.abs(z.effort).max()))


def test_direct_adaptation_is_a_step_down_the_gradient_of_the_error(model: Model) -> None:
    """pi_hat - dt kappa lambda N0/m P0 Y_^T s in every group, nothing at the first sample nor after a limit."""
    random, groups = np.random.default_rng(5), groups_of(model)
    count, rows = len(model.units_of("passivity_parameters")), model.pseudo_velocity_count
    inertia, spread = random.uniform(0.5, 2.0, len(groups)), random.uniform(0.5, 2.0, count)
    part = DirectAdaptation(groups, 7.0, inertia, spread)
    k, pi, s = own(part), random.normal(size=count), random.normal(size=rows)
    x, v_r, a = random.normal(size=rows + model.coordinate_count), random.normal(size=rows), random.normal(size=rows)
    Y = np.asarray(model.passivity_regressor(x, v_r, a, model.known(model.parameters())))
    z = SimpleNamespace(**part.states)
    np.testing.assert_array_equal(part.learn(pi, s, 3.0, None, z, k, NUMPY, 0.02), pi)
    z = SimpleNamespace(**part.update(Y, 1.0, z, k, NUMPY))
    expected = pi.copy()
    for index, group in enumerate(groups):
        own_rows, own_parameters = list(group.rows), list(group.parameters)
        block, P0 = Y[np.ix_(own_rows, own_parameters)], spread[own_parameters] ** 2
        largest = max(row @ (P0 * row) for row in block)
        assert z.largest[index] == pytest.approx(max(largest, 1e-9))
        gamma = 7.0 * 3.0 * inertia[index] / max(largest, 1e-9)
        expected[own_parameters] -= 0.02 * gamma * P0 * (block.T @ s[own_rows])
    np.testing.assert_allclose(part.learn(pi, s, 3.0, None, z, k, NUMPY, 0.02), expected, rtol=1e-12)
    smaller = part.update(0.1 * Y, 0.0, z, k, NUMPY)
    np.testing.assert_array_equal(smaller["largest"], z.largest)
    assert smaller["is_running"][0] == 0.0
    assert part.update(1e7 * Y + 1e7, 1.0, z, k, NUMPY)["is_running"][0] == 0.0


@pytest.mark.parametrize("step", [0.001, 0.05, 0.5])
def test_the_reference_model_comes_to_the_reference_exactly(step: float) -> None:
    """d(t) = (d0 + (d0' + r d0) t) exp(-r t), whatever the sample time; yd'' is what its distance needs."""
    part, model = ReferenceModel(2, 3.0), load_model("type_2_0")
    k, d0, d1 = own(part), np.array([1.0, -2.0]), np.array([0.5, 0.3])
    z, samples = SimpleNamespace(**part.states), 8
    first, later = TrackingError(d0, d1), TrackingError(np.full(2, 9.0), np.full(2, 9.0))
    for i in range(samples + 1):
        d = part.distance(first if i == 0 else later, z, k, NUMPY, step)
        z = SimpleNamespace(**part.update(d, NUMPY))
    t = samples * step
    np.testing.assert_allclose(d.e, (d0 + (d1 + 3.0 * d0) * t) * np.exp(-3.0 * t), rtol=1e-10, atol=1e-14)
    slope = (d1 - 3.0 * (d1 + 3.0 * d0) * t) * np.exp(-3.0 * t)
    np.testing.assert_allclose(d.e_dot, slope, rtol=1e-10, atol=1e-14)
    reference = Point(np.array([5.0, 6.0]), np.array([0.1, 0.2]), np.array([0.7, 0.8]))
    error, wanted = part.seen_from(TrackingError(d.e + 0.25, d.e_dot - 0.5), d, reference, k, model)
    np.testing.assert_allclose(error.e, 0.25)
    np.testing.assert_allclose(error.e_dot, -0.5)
    np.testing.assert_allclose(wanted.position, reference.position + d.e)
    np.testing.assert_allclose(wanted.acceleration, reference.acceleration - 6.0 * d.e_dot - 9.0 * d.e)


def test_effort_keeps_its_direction_at_the_limit(model: Model) -> None:
    """And is the cheapest one, with weights, where there are more motors than speeds."""
    s, random = Situation(model.name, count=1), np.random.default_rng(1)
    R = np.asarray(model.allocation(s.q[0], s.c[0]))
    wanted, weights = random.normal(size=len(R)), random.uniform(0.5, 2.0, R.shape[1])
    free = Effort(R.shape[1], weights)
    u, beyond = free.inputs(R, wanted, own(free), model)
    np.testing.assert_allclose(R @ u, wanted, rtol=1e-9, atol=1e-9)
    cheapest = np.linalg.pinv(R / np.sqrt(weights)) @ wanted / np.sqrt(weights)
    np.testing.assert_allclose(u, cheapest, rtol=1e-9, atol=1e-9)
    assert beyond == 1.0
    limited = Effort(R.shape[1], weights, 0.5 * np.abs(u).max())
    held, beyond = limited.inputs(R, wanted, own(limited), model)
    np.testing.assert_allclose(held, 0.5 * u, rtol=1e-12)
    assert beyond == pytest.approx(2.0)


def test_with_true_parameters_the_sliding_error_fades_at_its_rate(model: Model) -> None:
    """Mbar (s' + lambda s) + Cbar s = 0 (A1), by the robot's own equation of motion."""
    s, p, random = Situation(model.name, count=1), model.parameters(), np.random.default_rng(2)
    c, n, rate = model.known(p), model.coordinate_count, 2.0
    pi = model.passivity_parameters(p)
    law = PassivityLaw(Knowledge(model, c, pi, "passivity_parameters"), rate, 1.0)
    k, z, x = by_part(law.values), by_part(law.states), s.x[0]
    y = np.asarray(model.output(x[:n], c))
    point = Point(y - 0.1, random.normal(size=len(y)), random.normal(size=len(y)))
    z.reference_model.is_running = np.ones(1)  # without distance: yd is the reference
    action = law.act(x, point, z, k, model, 0.01)
    E, E_rate = model.output_map(x[:n], c), model.output_map_rate(x, c)
    e, e_dot = model.output(x[:n], c) - point.position, model.output_rate(x, c) - point.velocity
    v_r = np.linalg.solve(E, point.velocity - rate * e)
    a = np.linalg.solve(E, point.acceleration - rate * e_dot - E_rate @ v_r)
    slide, v_dot = x[n:] - v_r, model.state_derivative(x, action.input, np.zeros(len(x) - n), p)[n:]
    left = model.inertia_matrix(x[:n], p) @ (v_dot - a + rate * slide) + model.coriolis_matrix(x, p) @ slide
    np.testing.assert_allclose(left, 0.0, atol=1e-8 * max(1.0, np.abs(v_dot).max()))


def test_what_follows_from_a_guess() -> None:
    guess = np.array([[2.0, -4.0, 0.0], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(spread_of(guess), [[2.0, 4.0, 2.0], [1.0, 1.0, 1.0]])
    low, high = box_around(guess, 4.0)
    np.testing.assert_allclose(low, [[0.5, -16.0, -8.0], [0.25, 0.25, 0.25]])
    np.testing.assert_allclose(high, [[8.0, -1.0, 8.0], [4.0, 4.0, 4.0]])


def test_the_guessed_inertia_is_the_least_of_each_group(model: Model) -> None:
    p = model.parameters()
    x = np.zeros(len(model.state_units))
    pi, c = np.asarray(model.passivity_parameters(p)), model.known(p)
    found = guessed_inertia(model, x, pi, c)
    q = x[: model.coordinate_count]
    inverse = np.linalg.inv(model.row_map(q, c)) if model.has("row_map") else np.eye(model.pseudo_velocity_count)
    diagonal = np.diag(inverse @ model.inertia_matrix(q, p) @ inverse.T)
    names = dict(zip(model.parameter_units, p, strict=True))
    for value, group in zip(found, model.metadata["passivity_groups"], strict=True):
        scale = float(numpy_value(group["scale"], names))
        assert value == pytest.approx(min(diagonal[row] for row in group["rows"]) / scale)


@pytest.mark.parametrize("law", ADAPTING)
def test_a_batch_of_guesses_is_as_many_runs(law: str, tmp_path: Path) -> None:
    """What follows from a guess follows for each robot: prior, spread, box, inertia, covariance."""
    text = track("type_2_1", law, duration=3.0)
    file = written(tmp_path, text)
    heavy = (
        {"m": 1.3 * load_model("type_2_1").metadata["defaults"]["m"]}
        if "m" in load_model("type_2_1").parameter_units
        else {}
    )
    factors = {"estimates.pi1": [1.0, 2.0], "estimates.pi4": [1.0, 0.6]}
    batch = wmr_afl.run_batch(file, scale=factors, parameters={name: [value, value] for name, value in heavy.items()})
    loop = loop_of(file)
    assert np.isnan(batch.failure_time).all()
    assert not np.allclose(batch.rms[0], batch.rms[1], rtol=1e-5)
    names = list(loop.law.knowledge.units)
    estimate = loop.law.knowledge.theta_hat.copy()
    estimate[names.index("pi1")] *= 2.0
    estimate[names.index("pi4")] *= 0.6
    listed = ", ".join(f"{name} = {value!r}" for name, value in zip(names, estimate.tolist(), strict=True))
    start = text[: text.index("guess = ")]
    single = start + f"estimate = {{ {listed} }}\n" + "".join(f"[parameters]\n{n} = {v}\n" for n, v in heavy.items())
    run = wmr_afl.run(written(tmp_path, single))[law]
    np.testing.assert_allclose(batch.rms[1], run.rms(), rtol=1e-7)


UNEVEN = {"K1_l": (7.0, "N m/V"), "K1_r": (6.0, "N m/V")}


def uneven(known: str = "", swapped: bool = False) -> str:
    """A differential drive whose motors differ."""
    motors = [
        f'[[motors]]\ninput = "u_{side}"\ndrives = "{wheel}"\ntorque_gain = "K1_{side}"\nback_emf = "c"\n'
        for side, wheel in (("l", "left"), ("r", "right"))
    ]
    parts = [wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), *(motors[::-1] if swapped else motors)]
    text = descriptions.robot(*parts, outputs=AHEAD, parameters=UNEVEN)
    return f'known = ["{known}"]\n{text}' if known else text


def test_motors_of_unequal_gain_need_a_known_distance(tmp_path: Path) -> None:
    """Otherwise there is no such form, and the obstacle names what would have to be known."""
    model = load_model(derived(uneven(), tmp_path))
    assert not model.has("passivity_regressor")
    assert "list b in `known`" in model.metadata["passivity_obstacle"]
    with pytest.raises(WmrError, match="admits no composite law: motors of unequal gain"):
        wmr_afl.run(written(tmp_path, UNEVEN_RUN.format(robot=tmp_path / "small")))


UNEVEN_RUN = """
title = "Motors that differ"
robot = "{robot}"
reference = {{ expressions = {{ y1 = "0.4 + 0.5*t + 0.2*sin(t)", y2 = "0.4*cos(0.7*t) - 0.4" }} }}
simulation = {{ duration = 30.0, sample_time = 0.02, integrator = "rk4" }}
shared = {{ guess = {{ m = 30.0, K1_l = 5.0, K1_r = 8.0 }}, reference_rate = 2.0 }}
controllers.composite = {{ law = "composite" }}
controllers.frozen = {{ law = "frozen" }}
"""


@pytest.mark.parametrize("swapped", [False, True])
def test_motors_of_unequal_gain_are_adapted_in_any_order(swapped: bool, tmp_path: Path) -> None:
    """Rows are those of the motors then, and so is the inertia that sets the gain."""
    folder = derived(uneven("b", swapped), tmp_path)
    situation = Situation(folder)
    laws = [law for law in MODEL_LAWS if law.applies(situation.numpy)]
    assert [law.name for law in laws if not law.deviation(situation) <= law.tolerance] == []
    model, p = situation.numpy, situation.numpy.parameters()
    assert model.has("row_map")
    inertia = guessed_inertia(model, np.zeros(5), np.asarray(model.passivity_parameters(p)), model.known(p))
    q, c = np.zeros(3), model.known(p)
    inverse = np.linalg.inv(model.row_map(q, c))
    gains = np.array([7.0, 6.0])[::-1] if swapped else np.array([7.0, 6.0])
    np.testing.assert_allclose(
        inertia, np.diag(inverse @ model.inertia_matrix(q, p) @ inverse.T) / (gains / 0.1), rtol=1e-9
    )
    runs = wmr_afl.run(written(tmp_path, UNEVEN_RUN.format(robot=folder)), backend="casadi")
    errors = {law: np.linalg.norm(run.rms(since=15.0)) for law, run in runs.items()}
    assert errors["composite"] < 0.1 * errors["frozen"]
