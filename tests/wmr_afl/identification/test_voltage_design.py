"""Laws of designed voltages: limits hold for every robot that is tried, they tell more than random ones."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import wmr_afl
from tests.derive.descriptions import derived, motor, robot, steered, wheel
from wmr_afl.cli import app, terminal
from wmr_afl.identification import voltage_design
from wmr_afl.identification.effort import FRICTION_WIDTH
from wmr_afl.identification.excursions import SPREAD, moved, others, space_of, substeps
from wmr_afl.identification.information import FRICTION, condition, deviations, log_determinant, unknowns
from wmr_afl.identification.voltage_design import NOISE, REST, SAMPLE, Excitation, excite
from wmr_afl.numerics.arrays import Floats

Case = tuple[float, float, dict[str, float]]  # volts, room, limits
CASES: dict[str, Case] = {
    "type_2_0": (12.0, 2.0, {}),
    "type_2_0_uneven": (12.0, 2.0, {}),
    "mecanum": (12.0, 2.0, {}),
    "type_1_1": (12.0, 3.0, {"beta": 1.0}),
    "tractor_trailer": (12.0, 6.0, {"beta": 1.0}),
}
STEERED = ["type_1_1"]


def singular(name: str) -> list[str]:
    """Where the kinematics of a shipped robot are."""
    return list(wmr_afl.load_model(name).findings["kinematic_singularities"])


ROBOTS = 20  # that are tried here, to save time
FEW: dict[str, Any] = {"seconds": 4.0, "frequencies": [0.5, 1.25]}


@pytest.fixture(autouse=True)
def _few_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voltage_design, "ROBOTS", ROBOTS)


@cache
def designed(name: str) -> Excitation:
    """Short, of two frequencies."""
    return excite(name, *CASES[name], **FEW)


@pytest.fixture(params=CASES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_design_keeps_its_limits(name: str) -> None:
    """Voltage, room and angles; it begins and ends without voltage, and ends at rest."""
    found, (volts, room, limits) = designed(name), CASES[name]
    assert np.abs(found.voltages).max() <= volts
    assert np.abs(found.voltages).max() > 0.3 * volts
    assert not found.voltages[[0, -1]].any()
    for index, column in enumerate(found.states):
        bound = room if column in ("x", "y") else limits.get(column, np.inf)
        assert np.abs(found.state[:, index]).max() <= bound
    assert np.abs(found.state[-1, wmr_afl.load_model(name).coordinate_count :]).max() < 1.1 * REST


def test_every_robot_that_is_off_keeps_them(name: str) -> None:
    """Of those that were tried, and it is what the verdict says."""
    found, (_, room, limits) = designed(name), CASES[name]
    assert found.tried.shape[1:] == (ROBOTS, 2 + len(limits))
    bounds = np.array([room, room, *limits.values()])
    assert np.all(np.abs(found.tried) <= bounds)
    assert found.is_within_limits
    assert "stay within limits" in found.verdict
    assert list(found.limits) == ["x", "y", *limits]
    lost = replace(found, tried=1.2 * found.tried / np.abs(found.tried).max(axis=(0, 1)) * bounds)
    assert not lost.is_within_limits
    assert lost.verdict.startswith(f"NOT within limits: some of {ROBOTS} robots")


def witness(name: str, found: Excitation, p: Floats) -> Floats:
    """States at all samples by SciPy, each voltage and loop held over a sample, and two seconds of coasting."""
    model, columns, motors = wmr_afl.load_model(name), list(found.states), list(found.inputs)
    none, x = np.zeros(model.pseudo_velocity_count), found.state[0]
    states = [x]
    for k in range(len(found.tried) - 1):
        row = min(k, len(found.voltages) - 1)
        u = found.voltages[row].copy()
        for loop in found.loops:
            u[motors.index(loop.motor)] += loop.gain * (loop.reference[row] - x[columns.index(loop.coordinate)])
        u = np.clip(u, -found.volts, found.volts)
        done = solve_ivp(
            lambda _, state, u=u: model.state_derivative(state, u, none, p), (0.0, SAMPLE), x, rtol=1e-7, atol=1e-9
        )
        x = done.y[:, -1]
        states.append(x)
    return np.array(states)


def test_another_integrator_gets_the_same(name: str) -> None:
    """Of the guessed robot and of one that is off."""
    found, model = designed(name), wmr_afl.load_model(name)
    robots = others(model, model.parameters(), ROBOTS, seed=0)
    places = [found.states.index(one) for one in found.limits]
    for index in (0, 1):
        states = witness(name, found, robots[index])
        np.testing.assert_allclose(states[:, places], found.tried[:, index], atol=0.01)
        if index == 0:
            np.testing.assert_allclose(states[: len(found.time)], found.state, atol=0.02)


def test_robots_are_off_in_what_the_kinematics_do_not_know(name: str) -> None:
    """By 30 % at most; half of them by just that; the first one is as guessed."""
    model = wmr_afl.load_model(name)
    p = model.parameters()
    robots = others(model, p, 12, seed=4)
    np.testing.assert_array_equal(robots[0], p)
    off = robots / np.where(p == 0.0, 1.0, p) - 1.0
    assert np.abs(off).max() <= SPREAD + 1e-12
    varied = np.abs(off[1:]).max(axis=0) > 0.0
    np.testing.assert_allclose(np.abs(off[1::2][:, varied]), SPREAD)
    assert {unit for unit, is_varied in zip(model.parameter_units.values(), varied, strict=True) if not is_varied} <= {
        "m", "rad"
    }  # fmt: skip
    q = np.random.default_rng(0).normal(size=model.coordinate_count)
    for term in (model.kinematic_matrix, model.actuator_rates_matrix):
        assert all(np.array_equal(term(q, p), term(q, one)) for one in robots)
    assert len(np.unique(robots, axis=0)) == len(robots)


def columns(name: str, volts: float, states: Floats, voltages: Floats) -> tuple[Floats, Floats]:
    """In NumPy: what the columns of the effort form hold, each scaled by its guess, (T, n-m, k), and R diag(rho) u."""
    model = wmr_afl.load_model(name)
    p, n = model.parameters(), model.coordinate_count
    c, rho = model.known(p), model.gain_ratios(p) if model.has("gain_ratios") else np.ones(len(model.input_units))
    rows, efforts = [], []
    for x, u in zip(states, voltages, strict=True):
        a = model.state_derivative(x, u, np.zeros(model.pseudo_velocity_count), p)[n:]
        effort = model.effort_map(x[:n], c) * rho
        parts = [model.effort_regressor(x, a, c) * np.abs(model.effort_parameters(p))]
        parts += [-effort[:, [1]] * u[1]] if np.any(rho != 1.0) else []
        friction = effort * np.tanh(model.actuator_rates_matrix(x[:n], p) @ x[n:] / FRICTION_WIDTH) * FRICTION * volts
        motors = [tuple(motor.values())[1:] for motor in model.metadata["motors"].values()]
        for kind in dict.fromkeys(motors):
            parts.append(sum(friction[:, [j]] for j, one in enumerate(motors) if one == kind))
        rows.append(np.hstack(parts))
        efforts.append(effort @ u)
    return np.array(rows), np.array(efforts)


def test_columns_are_those_of_the_equation(name: str) -> None:
    """Rows differ from the plain ones by a factor each, and Y pi is R diag(rho) u along the motion."""
    found, model, volts = designed(name), wmr_afl.load_model(name), CASES[name][0]
    numbers = unknowns(model, model.parameters(), volts)
    chosen = slice(5, -1, 9)
    plain, efforts = columns(name, volts, found.state[chosen], found.voltages[chosen])
    pairs = zip(found.state[chosen], found.voltages[chosen], strict=True)
    scaled = np.array([numbers.columns(x, u).full() for x, u in pairs])
    sizes = np.median(plain[np.abs(scaled) > 1e-9] / scaled[np.abs(scaled) > 1e-9])
    assert sizes > 0.0
    factors = (plain * scaled).sum(axis=(0, 2)) / (scaled**2).sum(axis=(0, 2))
    np.testing.assert_allclose(scaled * factors[:, None], plain, atol=1e-9 * np.abs(plain).max())
    pi = model.effort_parameters(model.parameters())
    np.testing.assert_allclose(plain[..., : len(pi)] @ np.sign(pi), efforts, atol=1e-9 * np.abs(efforts).max())
    assert list(found.deviations)[: len(pi)] == list(model.units_of("effort_parameters"))
    assert len(found.deviations) == plain.shape[2]


def test_it_tells_more_than_random_voltages(name: str) -> None:
    """Multisines of the same frequencies, as large as the voltage and, for the guessed robot alone, the room allow."""
    found, model, volts = designed(name), wmr_afl.load_model(name), CASES[name][0]
    p = model.parameters()
    numbers, step = unknowns(model, p, volts), SAMPLE
    count = substeps(model, p, found.state[0], step)
    bounds = np.array([np.inf if one not in found.limits else found.limits[one][1] for one in found.states])
    best = found.log_determinants[1]
    assert best == pytest.approx(log_determinant(numbers.information(found.state[:-1], found.voltages[:-1])), rel=1e-9)
    assert best > found.log_determinants[0]
    angles = 2.0 * np.pi * np.outer(FEW["frequencies"], found.time[:-1])
    fade = np.minimum(1.0, np.minimum(found.time, found.time[-1] - found.time))[:-1]
    for seed in range(3):
        random = np.random.default_rng(100 + seed)
        parts = random.normal(size=(2, len(found.inputs), len(angles)))
        voltages = fade[:, None] * (parts[0] @ np.cos(angles) + parts[1] @ np.sin(angles)).T
        voltages *= volts / np.abs(voltages).max()
        states = np.array([np.full(len(found.states), np.inf)])
        while np.any(np.abs(states) > bounds):
            voltages, states = 0.9 * voltages, found.state[:1]
            for u in voltages:
                states = np.vstack([states, moved(model, p, states[-1], u, step, count)])
        assert best > log_determinant(numbers.information(states[:-1], voltages))


def test_nothing_is_handed_out_that_tells_less_than_random_voltages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where each round leads astray, the start stands, and the status says so."""
    monkeypatch.setattr(voltage_design._Program, "solved", lambda self, weights, used: (0.1 * weights, "astray"))
    found = excite("type_2_0", *CASES["type_2_0"], **FEW)
    before, after = found.log_determinants
    assert before == after
    assert found.status == "nothing better than the random multisine was found"
    assert found.is_within_limits


@pytest.mark.parametrize("status", voltage_design.STOPPED)
def test_a_search_that_is_interrupted_is_no_design(status: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi takes Ctrl-C for the end of a search."""
    program = object.__new__(voltage_design._Program)
    answer = {"x": casadi.DM([1.0])}
    solver = SimpleNamespace(stats=lambda: {"return_status": status, "iter_count": 3}, size1_in=lambda name: 1)
    program._chosen, program._basis = [], np.zeros((1, 2))
    program._solver = Solver(answer, solver)
    with pytest.raises(KeyboardInterrupt):
        program.solved(np.ones(1), np.ones(1))


class Solver(SimpleNamespace):
    """Something that answers, and tells how it ended."""

    def __init__(self, answer: dict[str, Any], others: SimpleNamespace) -> None:
        super().__init__(**vars(others))
        self.answer = answer

    def __call__(self, **given: Any) -> dict[str, Any]:
        return self.answer


def test_a_start_within_limits_is_no_smaller_than_it_has_to_be() -> None:
    """A few percent more and a robot breaks a limit."""
    model = wmr_afl.load_model("car")
    p = model.parameters()
    space, frequencies = space_of(model, p, 8.0, {}), np.array(FEW["frequencies"])
    task = voltage_design._Task(model, p, 24.0, space, 4.0, frequencies, 0)
    kept = task.within(task.random())
    assert space.fractions(task.tried(kept)).max() <= 1.0 < space.fractions(task.tried(1.05 * kept)).max()


def test_between_what_is_lost_and_what_is_kept_it_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a robot is lost nothing tells by how much it is too much: halves alone would end at a quarter."""
    task: Any = object.__new__(voltage_design._Task)
    monkeypatch.setattr(task, "tried", lambda weights: weights, raising=False)
    lost = SimpleNamespace(fractions=lambda weights: np.array([np.inf if weights.max() > 0.37 else 0.5]))
    monkeypatch.setattr(task, "space", lost, raising=False)
    assert 0.37 / voltage_design.FINE <= task.within(np.ones(3)).max() <= 0.37


@pytest.mark.parametrize("shipped", [one for one in wmr_afl.list_models() if singular(one)])
def test_angles_keep_away_from_where_the_kinematics_are_singular(shipped: str) -> None:
    """S(q) is of the size that it has at the start in all corners of the space, and far larger a quarter farther on."""
    model = wmr_afl.load_model(shipped)
    p, n = model.parameters(), model.coordinate_count
    space = space_of(model, p, 2.0, {})
    angles = [list(model.state_units).index(name) for name in space.names[2:]]
    assert angles

    def size(reach: float) -> Floats:
        q = np.zeros((2 ** len(angles), n))
        q[:, angles] = reach * np.array(list(product(*zip(space.lower[2:], space.upper[2:], strict=True))))
        return np.linalg.norm(model.kinematic_matrix(q, np.broadcast_to(p, (len(q), len(p)))), axis=(1, 2))

    assert size(1.0).max() < 10.0 * size(0.0).max()
    assert size(1.2499).max() > 30.0 * size(0.0).max()


def test_robots_that_are_lost_on_the_way_say_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """The car with much room and voltage turns its wheel across where it has no motion, while IPOPT looks about."""
    heard: list[tuple[int, int]] = []
    found = excite("car", 24.0, 8.0, **FEW, progress=lambda done, total: heard.append((done, total)))
    assert found.is_within_limits
    assert found.limits["beta"][1] == pytest.approx(0.8 * np.pi / 2, abs=0.01)
    assert capfd.readouterr() == ("", "")
    assert [done for done, _ in heard] == list(range(found.rounds))


def test_numbers_of_the_information() -> None:
    """Against an inverse, and of what is not determined at all."""
    information = np.array([[4.0, 1.0], [1.0, 2.0]])
    assert log_determinant(information) == pytest.approx(np.log(7.0))
    np.testing.assert_allclose(deviations(information, 0.5), 0.5 * np.sqrt(np.diag(np.linalg.inv(information))))
    assert condition(np.diag([9.0, 1.0])) == pytest.approx(3.0)
    nothing = np.diag([4.0, 0.0])
    assert log_determinant(nothing) == -np.inf
    assert condition(nothing) == np.inf
    assert deviations(nothing, 0.5)[1] == np.inf


def test_deviations_are_those_of_least_squares() -> None:
    """A thousand fits to the predicted efforts, with noise in each row."""
    found, model = designed("type_2_0"), wmr_afl.load_model("type_2_0")
    numbers = unknowns(model, model.parameters(), found.volts)
    rows = np.vstack([numbers.columns(x, u).full() for x, u in zip(found.state, found.voltages, strict=True)])
    noise = np.random.default_rng(1).normal(scale=NOISE, size=(len(rows), 1000))
    off = np.linalg.lstsq(rows, noise, rcond=None)[0].std(axis=1)
    np.testing.assert_allclose(off, list(found.deviations.values()), rtol=0.1)


@pytest.mark.parametrize("name", CASES)
def test_only_motors_that_steer_have_a_loop(name: str) -> None:
    found = designed(name)
    assert bool(found.loops) == (name in STEERED)
    for loop in found.loops:
        np.testing.assert_array_equal(loop.reference, found.state[:, found.states.index(loop.coordinate)])
        assert loop.gain > 0.0


@pytest.mark.parametrize("name", STEERED)
def test_the_loop_brings_angles_to_their_references(name: str) -> None:
    """A robot whose steering starts beside its reference comes near it; without the loop it stays where it is."""
    found, model = designed(name), wmr_afl.load_model(name)
    (loop,) = found.loops
    beside = found.state.copy()
    beside[0, found.states.index(loop.coordinate)] += 0.2
    away = replace(found, state=beside)
    p = model.parameters()
    ends = [
        abs(witness(name, one, p)[-1, found.states.index(loop.coordinate)] - loop.reference[-1])
        for one in (away, replace(away, loops=()))
    ]
    assert ends[0] < 0.02
    assert ends[1] > 0.1


def test_the_same_arguments_give_the_same_bytes() -> None:
    one, other = designed("type_1_1"), excite("type_1_1", *CASES["type_1_1"], **FEW)
    model = wmr_afl.load_model(one.robot)
    assert one.played.text(model) == other.played.text(model)
    assert one.tried.tobytes() == other.tried.tobytes()
    assert str(one) == str(other)


FORK = robot(
    steered("fork", ("a", "0"), "beta").replace("angle =", "limits = [-0.3, 0.5]\nangle ="),
    wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), wheel("front", "fork"),
    motor("front"), motor("fork"), angles=("beta",),
)  # fmt: skip


def test_limits_of_the_description_hold_unasked(tmp_path: Path) -> None:
    """A narrower one that is given holds instead, on its side."""
    folder = derived(FORK, tmp_path)
    model = wmr_afl.load_model(folder)
    for limits, bounds in (({}, (-0.3, 0.5)), ({"beta": 0.4}, (-0.3, 0.4)), ({"beta": 0.2}, (-0.2, 0.2))):
        space = space_of(model, model.parameters(), 2.0, limits)
        assert space.names == ("x", "y", "beta")
        np.testing.assert_allclose([space.lower, space.upper], [[-2.0, -2.0, bounds[0]], [2.0, 2.0, bounds[1]]])
    found = excite(model, 12.0, 2.0, **FEW)
    assert found.limits["beta"] == pytest.approx((-0.3, 0.5))
    assert -0.3 <= found.tried[..., 2].min() < 0.0 < found.tried[..., 2].max() <= 0.5


def test_a_design_prints_what_it_found() -> None:
    found = designed("type_1_1")
    text = str(found)
    assert text.splitlines()[-1] == found.verdict
    assert all(name in text for name in (*found.deviations, *found.limits, "V/rad", "IPOPT"))
    assert repr(found).startswith("<Excitation of type_1_1: 4 s, ")


WRONG: dict[str, tuple[list[str], str]] = {
    "unknown robot": (["type_9"], "'type_9'; did you mean 'type_3_0'?"),
    "unknown limit": (["car", "--limit", "betta=0.5"], "did you mean 'beta'?"),
    "limit of a position": (["car", "--limit", "x=1"], "unknown limit of car 'x'"),
    "limit without a number": (["car", "--limit", "beta"], "write --limit NAME=VALUE"),
    "limit below zero": (["car", "--limit", "beta=-1"], "the limit of beta is -1 rad"),
    "unknown parameter": (["car", "--set", "mass=3"], "unknown parameter of car 'mass'"),
    "mass below zero": (["car", "--set", "m=-3"], "m = -3 kg is negative"),
    "too fast": (["car", "--set", "I_f=1e-9"], "too fast for voltages that are held for 0.05 s"),
    "negative volts": (["car", "--volts", "-12"], "volts is -12 V"),
    "no volts": (["car", "--volts", "nan"], "volts is nan V"),
    "no room": (["car", "--room", "0"], "room is 0 m"),
    "short": (["car", "--seconds", "2"], "seconds is 2 s; choose 4 to 120 s"),
    "hardly any room": (["car", "--room", "0.001", "--limit", "beta=0.001", "--seconds", "4"], "nothing determines"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_input_gives_one_line(wrong: str, tmp_path: Path) -> None:
    arguments, part = WRONG[wrong]
    usual = [one for pair in (("--volts", "12"), ("--room", "2")) if pair[0] not in arguments for one in pair]
    done = CliRunner().invoke(app, ["excite", *arguments, *usual, "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert part in line
    assert "; " in line
    assert not done.stdout
    assert not list(tmp_path.iterdir())


def test_a_robot_whose_joint_cannot_be_straight_starts_in_the_middle(tmp_path: Path) -> None:
    """And a limit that leaves no angle is refused."""
    model = wmr_afl.load_model(derived(FORK.replace("[-0.3, 0.5]", "[0.3, 0.5]"), tmp_path))
    space = space_of(model, model.parameters(), 2.0, {})
    assert space.start[list(model.state_units).index("beta")] == pytest.approx(0.4)
    assert np.count_nonzero(space.start) == 1
    with pytest.raises(wmr_afl.WmrError, match=r"excludes every angle of 'fork'; it turns from 0\.3 to 0\.5 rad"):
        space_of(model, model.parameters(), 2.0, {"beta": 0.2})


@pytest.mark.parametrize("frequencies", [[], [0.0], [-1.0, 1.0], [6.0], [np.nan], [0.1] * 31])
def test_frequencies_that_cannot_be_driven_are_refused(frequencies: list[float]) -> None:
    with pytest.raises(wmr_afl.ArgumentError, match="give 1 to 30 between 0 and 5 Hz"):
        excite("type_2_0", 12.0, 2.0, frequencies=frequencies)


def test_the_verb_writes_what_is_driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All numbers to the bit; the loop's gain stands in what is printed; what else lies in the folder stays."""
    found, asked = designed("type_1_1"), []
    monkeypatch.setattr(
        voltage_design, "excite", lambda model, *given, progress: asked.append((model.name, *given)) or found
    )
    monkeypatch.setattr(terminal.console, "_width", 400)
    (tmp_path / "notes.txt").write_text("mine")
    arguments = ["type_1_1", "--volts", "12", "--room", "3", "--limit", "beta=1", "--seconds", "5", "--set", "m=70"]
    done = CliRunner().invoke(app, ["excite", *arguments, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert asked == [("type_1_1", 12.0, 3.0, {"beta": 1.0}, 5.0, {"m": 70.0})]
    with open(tmp_path / "voltages.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["t", "u_drive", "u_steer", "angle_reference:beta", "gain:u_steer:beta"]
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 1:3], found.voltages)
    np.testing.assert_array_equal(table[:, 3], found.loops[0].reference)
    np.testing.assert_array_equal(table[:, 4], found.loops[0].gain)
    np.testing.assert_allclose(np.diff(table[:, 0]), SAMPLE)
    assert found.verdict in done.output
    for name, deviation in found.deviations.items():
        assert [*name.split(), f"{deviation:.2%}"] in [line.split() for line in done.output.splitlines()]
    assert f"{found.loops[0].gain:.4g} V/rad" in done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "excitation.png", "excitation.svg", "notes.txt", "voltages.csv"
    ]  # fmt: skip
    assert (tmp_path / "excitation.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "excitation.svg").read_text()
    assert all(label in text for label in ("u_drive [V]", "u_steer [V]", "beta [rad]", "x [m]", "y [m]", "walls"))


def test_a_broken_limit_ends_with_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the files are there all the same."""
    found = designed("type_2_0")
    lost = replace(found, tried=2.0 * found.tried / np.abs(found.tried).max())
    lost = replace(lost, limits=dict.fromkeys(found.limits, (-1.0, 1.0)))
    monkeypatch.setattr(voltage_design, "excite", lambda *given, progress: lost)
    done = CliRunner().invoke(app, ["excite", "type_2_0", "--volts", "9", "--room", "1", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "NOT within limits" in done.stdout
    assert (tmp_path / "voltages.csv").exists()
