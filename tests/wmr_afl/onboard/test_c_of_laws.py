"""What the C of a sampled law does, called in this process, and how a runner runs it."""

import ctypes
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENTS
from tests.wmr_afl.onboard.test_c_text import LAWS, sampled_of
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.c_source import TOLD, Source
from wmr_afl.onboard.runners import Compiled, Interpreted, Runner
from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.onboard.status import Status
from wmr_afl.simulation.kernels.c_compiler import compiler, library

has_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


class InC:
    """A law in C, in this process."""

    def __init__(self, sampled: SampledLaw, is_single: bool, is_tunable: bool) -> None:
        self.source = Source(sampled, is_single=is_single, is_tunable=is_tunable)
        self.library = library(self.source.header() + self.source.code(has_header=False), is_fused=False)
        self.type = np.dtype(np.float32 if is_single else np.float64)
        real, pointer = ctypes.c_float if is_single else ctypes.c_double, ctypes.c_void_p
        gains = [pointer] if is_tunable else []
        self.library.controller_step.argtypes = [pointer, *gains, real, *4 * [pointer]]
        self.library.controller_restore.argtypes = [pointer, *gains, pointer]
        self.library.controller_save.argtypes = 2 * [pointer]
        self.library.controller_init.argtypes = [pointer]
        values = [v for name, v in sampled.values.items() if np.size(v)]
        self.gains = np.concatenate([np.ravel(v) for v in values]).astype(self.type)
        self.first = [self.gains.ctypes.data] if is_tunable else []
        self.size, self.told = sampled.states.size, {n: s for n, s in sampled.signals.items() if n in TOLD}
        self.state = np.zeros(self.size + len(self.source.compensated), self.type)
        self.u = np.ones(sampled.signals["u"], self.type)
        self.diagnostics = np.ones(4 * sum(self.told.values()) + 16, self.type)
        self.library.controller_init(self.state.ctypes.data)

    def step(self, dt: float, x: Floats, reference: Floats) -> int:
        given = [np.ascontiguousarray(one, self.type) for one in (x, reference)]
        data = [one.ctypes.data for one in (*given, self.u, self.diagnostics)]
        return int(self.library.controller_step(self.state.ctypes.data, *self.first, dt, *data))

    def of(self, name: str) -> Floats:
        """What a step has told under this name."""
        ends = np.cumsum([0, *(self.told[one] for one in TOLD if one in self.told)])
        places = {
            one: slice(a, b) for one, (a, b) in zip((n for n in TOLD if n in self.told), pairwise(ends), strict=True)
        }
        return self.diagnostics[places[name]].astype(float)

    def saved(self, state: Floats) -> Any:
        room = np.zeros(8 + 8 + self.type.itemsize * len(self.state), np.uint8)
        held = np.ascontiguousarray(state, self.type)
        self.library.controller_save(held.ctypes.data, room.ctypes.data)
        return room

    def restore(self, room: Any) -> int:
        return int(self.library.controller_restore(self.state.ctypes.data, *self.first, room.ctypes.data))


@cache
def in_c(experiment: str, name: str, gate: float | None, is_single: bool, is_tunable: bool) -> InC:
    return InC(sampled_of(experiment, name, gate), is_single, is_tunable)


def motion(sampled: SampledLaw, samples: int) -> list[tuple[float, Floats, Floats]]:
    """dt, what is measured and setpoints of a made-up motion, with jitter, a late sample and a gap."""
    count, outputs, rows, t = len(sampled.measured), len(sampled.model.output_units), [], 0.0
    for k in range(samples):
        dt = sampled.sample_time * {5: 1.7, 9: 0.4, 14: 12.0}.get(k, 1.0)
        t += dt
        x = np.sin(0.4 * t + np.arange(count)) * np.linspace(0.3, 1.0, count)
        reference = [np.sin(0.3 * t + np.arange(outputs) + 0.5 * np.pi * order) * 0.3**order for order in range(3)]
        rows.append((dt, x, np.concatenate(reference)))
    return rows


@has_compiler
@pytest.mark.parametrize(
    ("experiment", "name", "gate", "is_single", "is_tunable"),
    [(*LAWS[0], False, True), (*LAWS[0], True, False), (*LAWS[1], False, False), (*LAWS[2], False, False)],
)
def test_its_c_does_what_casadi_does(
    experiment: str, name: str, gate: float | None, is_single: bool, is_tunable: bool
) -> None:
    """Voltages, states and all that is told, sample by sample; refusals, jitter and gaps included."""
    one = in_c(experiment, name, gate, is_single, is_tunable)
    one.library.controller_init(one.state.ctypes.data)
    sampled = sampled_of(experiment, name, gate)
    other = Interpreted(sampled)
    np.testing.assert_allclose(one.state[: one.size], sampled.start, rtol=1e-6)
    tolerance = {"rtol": 2e-2, "atol": 2e-3} if is_single else {"rtol": 1e-9, "atol": 1e-9}
    seen = set()
    for dt, x, reference in motion(sampled, 8 if is_single else 20):
        for number in (np.nan, 0.0) if len(seen) == 1 else (0.0,):
            other.now[:] = np.concatenate([[dt], x + number, [0.0], reference])
            status = one.step(dt, x + number, reference)
            assert status == other.sample()
            seen.add(status)
        np.testing.assert_allclose(one.u, other.u, **tolerance)
        np.testing.assert_allclose(one.state[: one.size], other.state, **tolerance)
        for told, value in other.told.items():
            np.testing.assert_allclose(one.of(told), value, err_msg=told, **tolerance)
    assert {Status.OK, Status.BAD_MEASUREMENT} <= seen


@has_compiler
@pytest.mark.parametrize(("experiment", "name", "gate"), LAWS[1:])
def test_what_python_runs_has_the_bits_of_what_is_exported(experiment: str, name: str, gate: float | None) -> None:
    """Without fused products, which some processors have and others do not."""
    one = in_c(experiment, name, gate, False, False)
    one.library.controller_init(one.state.ctypes.data)
    runner = Compiled(sampled_of(experiment, name, gate))
    for dt, x, reference in motion(one.source.sampled, 20):
        assert one.step(dt, x, reference) == fed(runner, dt, x, reference)
        np.testing.assert_array_equal(runner.u, one.u)
        np.testing.assert_array_equal(runner.state, one.state)


@has_compiler
def test_small_changes_of_estimates_add_up_in_single_precision() -> None:
    """Each far below the last digit of the estimate, under an error of 0.1 mm at 1 kHz."""
    x, moved = np.array([1.0, 2.0, 0.3, 0.5, 0.2]), []
    for is_single in (False, True):
        one = in_c("study_1", "AFL", None, is_single, not is_single)
        model, c = one.source.sampled.model.in_library("numpy"), one.source.sampled.law.knowledge.known
        setpoint = np.concatenate([model.output(x[:3], c) - 1e-4, model.output_rate(x, c), np.zeros(2)])
        one.library.controller_init(one.state.ctypes.data)
        before = one.state[: one.size].astype(float)
        for _ in range(5000):
            assert one.step(0.001, x, setpoint) == Status.OK
        moved.append(one.state[: one.size] - before)
    assert np.abs(moved[0]).max() > 2e-5
    np.testing.assert_allclose(moved[1], moved[0], rtol=0.02, atol=1e-6)


@has_compiler
@pytest.mark.parametrize("is_tunable", [False, True])
@pytest.mark.parametrize("bound", ["lower", "upper"])
def test_saved_estimates_beyond_a_bound_are_not_restored(bound: str, is_tunable: bool, tmp_path: Path) -> None:
    """Each of them that has one; upon it, and where there is none, they are."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    assert "projection = { lower = 0.1 }" in text
    table = (
        "projection = { lower = { theta1 = 0.1, theta3 = -0.2 }, upper = { theta1 = 9.0, theta4 = 7.0, theta6 = 8.0 } }"
    )
    (tmp_path / "bounds.toml").write_text(text.replace("projection = { lower = 0.1 }", table))
    sampled = sampled_of(str(tmp_path / "bounds.toml"), "AFL")
    one = InC(sampled, False, is_tunable)
    limits, place = sampled.values[f"projection.{bound}"], sampled.states.places["theta_hat"]
    assert 0 < np.isfinite(limits).sum() < len(limits)
    sign = 1.0 if bound == "upper" else -1.0
    for i, limit in enumerate(limits):
        for off, is_beyond in ((0.0, False), (0.01, True)):
            state = sampled.start.copy()
            state[place][i] = (limit if np.isfinite(limit) else sign * 90.0) + sign * off
            is_wrong = is_beyond and np.isfinite(limit)
            assert one.restore(one.saved(state)) == (Status.BAD_STATE if is_wrong else Status.OK)


@has_compiler
def test_what_was_of_the_moment_is_not_restored_and_another_layout_is_refused() -> None:
    """Flags of parts that compare samples are down, estimates are back; precision and law are of the layout."""
    one = in_c("track_car", "composite", 0.3, False, False)
    sampled = one.source.sampled
    state = sampled.start + 0.01
    assert one.restore(one.saved(state)) == Status.OK
    expected = state.copy()
    expected[sampled.of_the_moment] = 0.0
    np.testing.assert_array_equal(one.state, expected)
    assert sampled.flags
    layouts = {
        Source(sampled_of(*law), is_single=is_single).context["layout"] for law in LAWS for is_single in (False, True)
    }
    assert len(layouts) == 2 * len(LAWS)
    damaged = one.saved(state)
    damaged[0] ^= 1
    assert one.restore(damaged) == Status.OTHER_LAYOUT
    damaged = one.saved(state)
    damaged[11] ^= 1
    assert one.restore(damaged) == Status.DAMAGED
    assert one.restore(one.saved(np.where(np.arange(len(state)) == 1, np.nan, state))) == Status.BAD_STATE


@has_compiler
def test_a_gain_that_is_set_acts_as_if_it_had_been_built_in(tmp_path: Path) -> None:
    """Of any part, in the order of the struct."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    one = in_c("study_1", "AFL", None, False, True)
    header = one.source.header()
    names = [entry["name"] for entry in one.source.context["gains"]]
    assert [header.index(f" {name}[") for name in names] == sorted(header.index(f" {name}[") for name in names)
    assert "b1" in text
    values = dict(one.source.sampled.values)
    place = int(sum(np.size(values[name]) for name in list(values)[: list(values).index("outer_loop.b1")]))
    one.library.controller_init(one.state.ctypes.data)
    dt, x, reference = motion(one.source.sampled, 1)[0]
    kept = one.gains.copy()
    found = []
    for b1 in (2.0, 4.0):
        one.gains[place : place + 2] = b1
        one.library.controller_init(one.state.ctypes.data)
        assert one.step(dt, x, reference) == Status.OK
        found.append(one.u.copy())
    one.gains[:] = kept
    loop = load_experiment("study_1").loops["AFL"]
    assert values["outer_loop.b1"].tolist() == [2.0, 2.0]
    model, c = loop.model.in_library("numpy"), values["c"]
    rate = model.output_rate(x, c) - reference[2:4]
    G = model.decoupling_matrix(x, values.get("theta", one.source.sampled.start[:6]), c)
    np.testing.assert_allclose(G @ (found[1] - found[0]), -2.0 * rate, rtol=1e-9)


@pytest.fixture(params=[Interpreted, pytest.param(Compiled, marks=has_compiler)])
def kind(request: pytest.FixtureRequest) -> type[Runner]:
    found: type[Runner] = request.param
    return found


def fed(runner: Runner, dt: float, x: Floats, reference: Floats) -> int:
    runner.now[:] = np.concatenate([[dt], x, [0.0], reference])
    return runner.sample()


@pytest.mark.parametrize(
    ("place", "value", "status"),
    [
        (1, np.nan, Status.BAD_MEASUREMENT), (3, np.inf, Status.BAD_MEASUREMENT), (-1, np.nan, Status.BAD_REFERENCE),
        (0, 0.0, Status.BAD_TIME_STEP), (0, -0.02, Status.BAD_TIME_STEP), (0, np.inf, Status.BAD_TIME_STEP),
        (0, np.nan, Status.BAD_TIME_STEP), (4, 1e200, Status.NOT_FINITE),
    ],
)  # fmt: skip
def test_a_refused_sample_gives_no_voltages_and_keeps_every_bit(
    kind: type[Runner], place: int, value: float, status: Status
) -> None:
    """Of state, the sample before, and what was remembered of it; the next sound sample goes on."""
    sampled = sampled_of("study_1", "AFL")
    runner, usual = kind(sampled), motion(sampled, 3)
    assert fed(runner, *usual[0]) == Status.OK
    np.testing.assert_array_equal(runner.last, runner.now)
    assert np.all(runner.u != 0.0)
    kept = [one.copy() for one in (runner.state, runner.before, runner.last)]
    np.testing.assert_array_equal(runner.before, sampled.start)
    assert np.any(runner.state != sampled.start)
    runner.now[:] = np.concatenate([[usual[1][0]], usual[1][1], [0.0], usual[1][2]])
    runner.now[place] = value
    assert runner.sample() == status
    assert not runner.u.any()
    if status != Status.NOT_FINITE:
        assert not any(told.any() for told in runner.told.values())
    for found, before in zip((runner.state, runner.before, runner.last), kept, strict=True):
        np.testing.assert_array_equal(found, before)
    assert fed(runner, *usual[1]) == Status.OK
    assert (runner.dt.tolist(), len(runner.x), runner.clock.tolist()) == ([usual[1][0]], 5, [0.0, *usual[1][2]])


def test_a_state_that_is_not_finite_is_told_as_such(kind: type[Runner]) -> None:
    sampled = sampled_of("study_1", "AFL")
    runner = kind(sampled)
    runner.state[sampled.states.places["theta_hat"]] = np.nan
    assert fed(runner, *motion(sampled, 1)[0]) == Status.BAD_STATE


def test_the_same_sample_again_gives_its_voltages_and_changes_nothing(kind: type[Runner]) -> None:
    sampled = sampled_of("track_car", "composite", 0.3)
    runner = kind(sampled)
    for row in motion(sampled, 4):
        assert fed(runner, *row) == Status.OK
        u, state, told = runner.u.copy(), runner.state.copy(), {n: v.copy() for n, v in runner.told.items()}
        assert runner.same_sample() == Status.OK
        np.testing.assert_array_equal(runner.u, u)
        np.testing.assert_array_equal(runner.state, state)
        for name, value in told.items():
            np.testing.assert_array_equal(runner.told[name], value)


@pytest.mark.parametrize(("share", "stays"), [(1.0, False), (1.001, True)])
def test_after_more_than_the_longest_gap_the_state_stays_but_for_its_flags(
    kind: type[Runner], share: float, stays: bool
) -> None:
    """The longest gap itself is none."""
    sampled = sampled_of("track_car", "composite", 0.3)
    runner, rows = kind(sampled), motion(sampled, 3)
    for row in rows[:2]:
        assert fed(runner, *row) == Status.OK
    before = runner.state.copy()
    assert before[sampled.flags].all()
    assert fed(runner, share * sampled.max_gap, *rows[2][1:]) == Status.OK
    expected = before.copy()
    expected[sampled.flags] = 0.0
    assert np.array_equal(runner.state, expected) == stays
    assert runner.u.any()


def test_what_is_limited_and_what_lies_on_a_bound_is_told_by_its_place(kind: type[Runner]) -> None:
    """The second motor alone, and the estimates that lie on theirs."""
    sampled = sampled_of("study_2", "AFL")
    runner = kind(sampled)
    outputs = len(sampled.model.output_units)
    assert fed(runner, 0.02, np.zeros(5), np.zeros(3 * outputs)) == Status.OK
    command = runner.told["command"]
    assert runner.saturated == [i for i, (a, b) in enumerate(zip(runner.u, command, strict=True)) if a != b]
    many = []
    for far in np.linspace(-30.0, 30.0, 41):
        if fed(runner, 0.02, np.array([far, 0.5 * far, 0.3, 0.0, 0.0]), np.zeros(3 * outputs)) == Status.OK:
            assert runner.saturated == [i for i in range(2) if abs(runner.told["command"][i]) > 24.0]
            many.append(tuple(runner.saturated))
    assert {(), (0, 1)} < set(many)
    lower = sampled_of("study_1", "AFL").values["projection.lower"]
    bounded = kind(sampled_of("study_1", "AFL"))
    place = bounded_place = sampled_of("study_1", "AFL").states.places["theta_hat"]
    assert fed(bounded, *motion(sampled_of("study_1", "AFL"), 1)[0]) == Status.OK
    assert bounded.at_bound == []
    bounded.state[place] = np.where(np.isfinite(lower), lower, 1.0)
    assert fed(bounded, *motion(sampled_of("study_1", "AFL"), 1)[0]) == Status.OK
    found = bounded.state[bounded_place]
    assert bounded.at_bound == np.flatnonzero(found == lower).tolist() != []
