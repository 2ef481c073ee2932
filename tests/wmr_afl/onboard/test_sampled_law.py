"""What begins again, what stays and what is learned, of a law that is run sample by sample."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import EXPERIMENTS
from tests.wmr_afl.onboard.test_c_text import LAWS, sampled_of
from wmr_afl import WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part
from wmr_afl.onboard.export import onboard
from wmr_afl.onboard.gate import Gate
from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.plant.command_limits import CommandLimits
from wmr_afl.plant.input_limits import InputLimits


def stepped(
    sampled: SampledLaw, z: dict[str, Floats], passed: float, x: Floats
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """One step in NumPy, states by name."""
    k = by_part(sampled.values)
    clock = np.concatenate([[0.3], *(0.1 * np.arange(1.0, 1.0 + len(sampled.model.output_units)) for _ in range(3))])
    following, told = sampled.step(clock, x, passed, z, k, sampled.model.in_library("numpy"))
    return {name: np.asarray(value) for name, value in following.items()}, {n: np.asarray(v) for n, v in told.items()}


@pytest.mark.parametrize(("experiment", "name", "gate"), LAWS)
def test_a_step_gives_states_and_signals_of_the_sizes_that_are_told(
    experiment: str, name: str, gate: float | None
) -> None:
    """All of them, and no other; a traced step the same numbers."""
    sampled = sampled_of(experiment, name, gate)
    x = np.linspace(0.1, 0.4, len(sampled.measured))
    z = sampled.states.unpack(sampled.start)
    following, told = stepped(sampled, z, sampled.sample_time, x)
    assert {n: v.shape for n, v in following.items()} == {n: v.shape for n, v in z.items()}
    assert {n: v.size for n, v in told.items()} == sampled.signals
    clock = np.concatenate([[0.3], *(0.1 * np.arange(1.0, 1.0 + len(sampled.model.output_units)) for _ in range(3))])
    found = sampled.traced()(sampled.start, clock, x, sampled.sample_time, np.zeros(0))
    np.testing.assert_allclose(found[0].full()[:, 0], sampled.states.pack(following), rtol=1e-12, atol=1e-13)
    for column, signal in zip(found[1:], sampled.signals, strict=True):
        np.testing.assert_allclose(column.full()[:, 0], np.ravel(told[signal]), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    ("share", "begins"), [(0.5, False), (1.0, False), (1.5, False), (1.51, True), (9.99, True), (10.01, True)]
)
def test_least_squares_begin_again_after_more_than_one_and_a_half_sample_times(share: float, begins: bool) -> None:
    """As if nothing had come before."""
    sampled = sampled_of("track_car", "composite")
    x = np.linspace(0.1, 0.4, len(sampled.measured))
    z, _ = stepped(sampled, sampled.states.unpack(sampled.start), sampled.sample_time, x)
    assert z["least_squares.is_running"] == [1.0]
    passed = share * sampled.sample_time
    after, _ = stepped(sampled, z, passed, x + 0.05)
    fresh, _ = stepped(sampled, {**z, "least_squares.is_running": np.zeros(1)}, passed, x + 0.05)
    same = all(np.array_equal(after[name], fresh[name]) for name in after if name.startswith("least_squares."))
    assert same == begins


@pytest.mark.parametrize(("share", "begins"), [(1.0, False), (9.9, False), (10.0, False), (10.1, True)])
@pytest.mark.parametrize("kind", ["gate", "observer"])
def test_what_watches_begins_again_after_a_gap_only(kind: str, share: float, begins: bool) -> None:
    """A gate and an observer extrapolate over late samples; the first sample surprises nobody."""
    sampled = sampled_of("track_car", "composite", 0.3) if kind == "gate" else sampled_of("study_2_pose", "pose")
    x = np.linspace(0.1, 0.4, len(sampled.measured))
    first, told = stepped(sampled, sampled.states.unpack(sampled.start), sampled.sample_time, x)
    assert told["surprise"] == [0.0]
    far = x + 5.0 * np.eye(len(x))[0]
    _, told = stepped(sampled, first, share * sampled.sample_time, far)
    assert (told["surprise"][0] == 0.0) == begins
    assert (told["regularity"][0] > 0.0) == begins


@pytest.mark.parametrize("share", [0.5, 1.0, 1.9, 2.0, 2.1, 9.0, 10.0])
def test_estimates_move_by_two_sample_times_at_most_and_stay_after_a_gap(share: float) -> None:
    sampled = sampled_of("study_1", "AFL")
    x, z = np.linspace(0.1, 0.4, 5), sampled.states.unpack(sampled.start + 3.0)
    moved = {}
    for one in (1.0, share, 10.1):
        following, _ = stepped(sampled, z, one * sampled.sample_time, x)
        moved[one] = following["theta_hat"] - z["theta_hat"]
    assert np.abs(moved[1.0]).min() > 0.0
    np.testing.assert_allclose(moved[share], min(share, 2.0) * moved[1.0], rtol=1e-6)
    assert not moved[10.1].any()


@pytest.mark.parametrize(("experiment", "name", "gate"), [*LAWS, ("study_1", "frozen estimates", 0.2)])
def test_which_states_are_flags_and_which_are_learned(experiment: str, name: str, gate: float | None) -> None:
    """Flags are named so; learned are the estimates and parts that serve nothing else; a gate is none of these."""
    sampled = sampled_of(experiment, name, gate)
    places = sampled.states.places
    flags = {key for key in places if key.endswith(".is_running")}
    assert sampled.flags == [places[key].start for key in places if key in flags]
    learned = {key for key, place in places.items() if sampled.learned[place].all()}
    assert learned == {key for key, place in places.items() if sampled.learned[place].any()}
    assert learned == {key for key in places if key == "theta_hat" or key.split(".")[0] in sampled.law.learning}
    assert "gate.y" not in learned
    assert ("gate.y" in places) == (gate is not None)
    assert set(sampled.flags) <= set(sampled.of_the_moment)
    silent = set(sampled.silent)
    for part in sampled.law.learning:
        own = {key: place for key, place in places.items() if key.startswith(f"{part}.")}
        expected = [key for key in own if key in flags] or list(own)
        for key, place in own.items():
            assert (set(range(place.start, place.stop)) <= silent) == (key in expected)
    assert not silent & set(range(places["theta_hat"].start, places["theta_hat"].stop))


def study(drive: list[Any], **options: Any) -> SampledLaw:
    loop = load_experiment("study_1").loops["AFL"]
    return SampledLaw(loop.model, loop.law, loop.reference, loop.sample_time, drive, **options)


def test_what_was_last_sent_to_the_drive_is_of_the_moment() -> None:
    """A restart finds the drive at rest; limits without a memory have nothing to forget."""
    slow = study([CommandLimits(2, most=9.0, room=1.0)])
    place = slow.states.places["command_limits.last"]
    assert set(slow.of_the_moment) == {*slow.flags, *range(place.start, place.stop)}
    assert slow.of_the_moment == sorted(slow.of_the_moment)
    plain = study([InputLimits(2, 9.0)])
    assert plain.of_the_moment == sorted(plain.flags)
    assert (slow.is_limited, plain.is_limited, study([]).is_limited) == (True, True, False)


def test_a_late_drive_is_known_to_the_law_and_does_not_delay_what_is_returned(tmp_path: Path) -> None:
    """Limits are done to the voltages; what is under way goes on by a sample."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    drive = "[uncertainties]\ninput_delay = { seconds = 0.04 }\ninput_limits = { volts = 0.5 }\n\n[shared]"
    (tmp_path / "late.toml").write_text(text.replace("[shared]", drive, 1))
    loop = load_experiment(tmp_path / "late.toml").loops["AFL"]
    sampled = onboard(loop)
    z = sampled.states.unpack(sampled.start)
    (key,) = [name for name in z if name.startswith("input_delay.")]
    x = np.array([15.0, 25.0, 0.1, 0.2, 0.05])
    sent = []
    for _ in range(4):
        z, told = stepped(sampled, z, sampled.sample_time, x)
        assert np.abs(told["command"]).max() > 0.5
        np.testing.assert_array_equal(told["u"], np.clip(told["command"], -0.5, 0.5))
        sent.append(told["command"])
    under_way = [tuple(one) for one in np.reshape(z[key], (2, 2))]
    assert sorted(under_way) == sorted(tuple(one) for one in sent[-2:])


@pytest.mark.parametrize(
    ("sample_time", "max_gap"),
    [(0.0, None), (-0.1, None), (np.inf, None), (np.nan, None), (0.02, 0.019), (0.02, np.nan), (0.02, -1.0)],
)
def test_times_that_make_no_sense_are_refused(sample_time: float, max_gap: float | None) -> None:
    """The longest gap is a sample time at least, and ten unless given."""
    loop = load_experiment("study_1").loops["AFL"]
    with pytest.raises(WmrError, match="choose 0 < sample_time <= max_gap"):
        SampledLaw(loop.model, loop.law, loop.reference, sample_time, max_gap=max_gap)
    assert SampledLaw(loop.model, loop.law, loop.reference, 0.02, max_gap=0.02).max_gap == 0.02
    assert SampledLaw(loop.model, loop.law, loop.reference, 0.02).max_gap == pytest.approx(0.2)
    assert SampledLaw(loop.model, loop.law, loop.reference, 0.02, max_gap=np.inf).max_gap == np.inf


def test_numbers_of_law_drive_and_gate_stand_side_by_side() -> None:
    """An observer refuses outliers itself, and its bound is the one that counts."""
    sampled = study([InputLimits(2, 9.0)], gate=0.25)
    assert sampled.values["gate.bound"].tolist() == [0.25]
    assert sampled.values["input_limits.volts"].tolist() == [9.0, 9.0]
    assert sampled.surprise_bound == "gate.bound"
    assert study([]).surprise_bound == ""
    pose = sampled_of("study_2_pose", "pose")
    assert pose.surprise_bound in pose.values
    assert pose.surprise_bound.startswith("observer")
    loop = load_experiment("study_2_pose").loops["pose"]
    with pytest.raises(WmrError, match="an observer refuses outliers itself"):
        SampledLaw(loop.model, loop.law, loop.reference, loop.sample_time, gate=0.2)


def test_what_reached_the_motors_is_minded_by_laws_that_learn_from_it() -> None:
    """Not by one that looks at the command alone."""
    assert sampled_of("track_car", "composite").minds_applied
    assert not sampled_of("study_1", "AFL").minds_applied


@pytest.mark.parametrize("bound", [0.0, -0.1, np.nan])
def test_a_gate_needs_a_positive_bound(bound: float) -> None:
    with pytest.raises(WmrError, match=r"the gate's bound is .*choose a positive number"):
        Gate(2, bound)


def test_a_gate_is_surprised_by_what_the_velocities_do_not_explain() -> None:
    """|y - y_ - dt (y' + y'_)/2|, the largest of the outputs, angles the shorter way; of the first sample nothing."""
    gate = Gate(2, 0.3)
    model: Any = SimpleNamespace(
        arrays=load_experiment("study_1").loops["AFL"].model.in_library("numpy").arrays, coordinate_count=2,
        output=lambda q, c: q, output_rate=lambda x, c: x[2:], output_units={"a": "m", "b": "rad"},
    )  # fmt: skip
    z = SimpleNamespace(y=np.array([1.0, 0.2]), y_rate=np.array([2.0, -1.0]), is_running=np.ones(1))
    x = np.array([1.6, 0.1, 3.0, 1.0])
    surprise, after = gate.look(x, z, np.zeros(0), model, 0.2)
    assert surprise == pytest.approx(0.1)  # both outputs, the one by 1.6 - 1 - 0.5, the other by 0.1 - 0.2
    assert gate.look(x + np.array([-0.3, 0.0, 0.0, 0.0]), z, np.zeros(0), model, 0.2)[0] == pytest.approx(0.2)
    assert gate.look(x + np.array([0.0, 0.0, 0.0, 3.0]), z, np.zeros(0), model, 0.2)[0] == pytest.approx(0.4)
    assert gate.look(x + np.array([0.0, 2.0 * np.pi, 0.0, 0.0]), z, np.zeros(0), model, 0.2)[0] == pytest.approx(0.1)
    assert after["y"].tolist() == [1.6, 0.1]
    assert after["y_rate"].tolist() == [3.0, 1.0]
    assert np.asarray(after["is_running"]).tolist() == [1.0]
    assert {name: np.shape(value) for name, value in after.items()} == {n: v.shape for n, v in gate.states.items()}
    z.is_running = np.zeros(1)
    assert gate.look(x + 9.0, z, np.zeros(0), model, 0.2)[0] == 0.0
    assert not any(value.any() for value in gate.states.values())
