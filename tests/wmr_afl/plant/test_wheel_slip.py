"""Slip of single wheels: told speeds are what contacts have, the others slip as little as that allows."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROBOTS
from tests.derive.descriptions import derived, motor, wheel
from tests.derive.descriptions import robot as described
from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.laws import Situation
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.slip import is_driven, wheel_rows
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import NOTHING, by_part
from wmr_afl.plant import LateralSlip, Plant, WheelSlip
from wmr_afl.plant.wheel_slip import Told


def told(**speeds: str) -> Told:
    """`told(right_sideways="1")`."""
    found: dict[str, dict[str, str]] = {}
    for name, text in speeds.items():
        wheel_, _, direction = name.rpartition("_")
        found.setdefault(wheel_, {})[direction] = text
    return found


def one_by_one(model: Model) -> list[tuple[int, WheelSlip]]:
    """The slip of each wheel in each direction that it has alone, at 0.3 m/s, after its row."""
    return [
        (row, WheelSlip(model, {name.split()[0]: {name.split()[1]: "0.1*t"}}, model.parameters()))
        for name, row in wheel_rows(model).items()
    ]


def slipping(slip: WheelSlip, x: Floats, p: Floats, model: Model) -> Floats:
    """b (n,) at 3 s."""
    return np.asarray(slip.rate(3.0, x, p, NOTHING, model))[: model.coordinate_count]


def is_free_of(model: Model, row: int, other: int, situation: Situation) -> bool:
    """Whether two wheels can slip by themselves, for all that the other rows hold."""
    Z = np.asarray(model.slip_matrix(situation.q, situation.p))
    held = [k for k in range(Z.shape[1]) if k not in (row, other)]
    whole, without = (np.linalg.matrix_rank(Z[:, [*held, *k]], tol=1e-8) for k in ([row, other], [other]))
    return bool(np.all(whole > without))


def test_a_wheel_slips_as_told_and_v_does_as_before(situation: Situation) -> None:
    model, n = situation.numpy, situation.numpy.coordinate_count
    for row, slip in one_by_one(model):
        for x, p in zip(situation.x, situation.p, strict=True):
            added = slip.rate(3.0, x, p, NOTHING, model)
            np.testing.assert_allclose(model.slip_matrix(x[:n], p)[row] @ added[:n], 0.3, rtol=1e-13)
            np.testing.assert_array_equal(added[n:], 0.0)


def test_other_wheels_stay_without_slip_where_they_can(situation: Situation) -> None:
    """All but those of the same axle, unless there are more rows than a robot moves in ways; least squares then."""
    model, n = situation.numpy, situation.numpy.coordinate_count
    Z = np.asarray(model.slip_matrix(situation.q, situation.p))
    for row, slip in one_by_one(model):
        for x, p, rows in zip(situation.x, situation.p, Z, strict=True):
            others = np.delete(rows, row, axis=0)
            held = [*others, *model.constraint_matrix(x[:n], p)]
            weights = np.vstack([1e6 * rows[row], *held])  # the told row as good as exact
            expected = np.linalg.lstsq(weights, np.array([3e5, *np.zeros(len(held))]), rcond=None)[0]
            found = slipping(slip, x, p, model)
            np.testing.assert_allclose(rows @ found, rows @ expected, atol=1e-6)
        for other in range(Z.shape[1]):
            if other != row and is_free_of(model, row, other, situation):
                every = zip(situation.x, situation.p, Z, strict=True)
                left = [rows[other] @ slipping(slip, x, p, model) for x, p, rows in every]
                np.testing.assert_allclose(left, 0.0, atol=1e-8)


def test_sideways_slip_of_an_axle_is_that_of_the_paper(situation: Situation) -> None:
    """(96), where the root stands on the only axle."""
    model = situation.numpy
    if model.name != "type_2_0":
        return
    one, other = WheelSlip(model, told(right_sideways="0.3*t"), model.parameters()), LateralSlip(model, "0.3*t")
    for x, p in zip(situation.x, situation.p, strict=True):
        np.testing.assert_allclose(
            one.rate(2.0, x, p, NOTHING, model), other.rate(2.0, x, p, NOTHING, model), rtol=0.0, atol=1e-12
        )


def test_a_wheel_that_spins_falls_behind(situation: Situation) -> None:
    """Along is positive where the contact moves forward faster than the wheel rolls: radius times X v is less."""
    model, p = situation.numpy, situation.p[0]
    for name, row in wheel_rows(model).items():
        if not is_driven(model, row):
            continue
        slip = WheelSlip(model, {name.split()[0]: {"along": "-0.1*t"}}, model.parameters())
        plant = Plant(model, p, situation.x[0], uncertainties=[slip])
        x_dot = plant.rate(3.0, situation.x[0], situation.u[0], by_part(plant.values), model)
        q, v = situation.q[0], situation.v[0]
        contact = model.slip_matrix(q, p)[row] @ x_dot[: len(q)]
        rolling = model.slip_matrix(q, p)[row] @ model.kinematic_matrix(q, p) @ v
        assert contact - rolling == pytest.approx(-0.3)


def test_both_libraries_give_the_same(situation: Situation) -> None:
    for _, slip in one_by_one(situation.numpy):
        x, p = situation.x[0], situation.p[0]
        found = slip.rate(ca.SX(3.0), ca.SX(x), ca.SX(p), NOTHING, situation.casadi)
        np.testing.assert_allclose(
            ca.evalf(found).full()[:, 0], slip.rate(3.0, x, p, NOTHING, situation.numpy), rtol=1e-9, atol=1e-12
        )


def test_the_plant_tells_the_slip_that_it_has(situation: Situation) -> None:
    """Z (q' - S v), whatever makes it."""
    model, x, p = situation.numpy, situation.x[0], situation.p[0]
    made = [LateralSlip(model, "0.2*t"), *(slip for _, slip in one_by_one(model)[:1])]
    plant = Plant(model, p, x, uncertainties=made)
    assert plant.slips
    assert not Plant(model, p, x).slips
    k, n = by_part(plant.values), model.coordinate_count
    change = plant.rate(3.0, x, situation.u[0], k, model)[:n] - model.kinematic_matrix(x[:n], p) @ x[n:]
    np.testing.assert_allclose(plant.slip(3.0, x, k, model), model.slip_matrix(x[:n], p) @ change, atol=1e-12)


def track(name: str, folder: Path, uncertainties: str, duration: float = 1.0, integrator: str = "rk4") -> Path:
    """The shipped track of a robot under uncertainties, with its law `frozen`."""
    text = find_experiment(f"track_{name}").read_text()
    begin = text.index("duration = ")
    text = text[:begin] + f"duration = {duration}\n" + text[text.index("\n", begin) :]
    text = text.replace("[uncertainties]\n", f"[uncertainties]\n{uncertainties}\n", 1)
    file = folder / f"{name}.toml"
    file.write_text(text.replace('"rk4"', f'"{integrator}"'))
    return file


@pytest.mark.parametrize(
    ("robot", "integrator"), [*((robot, "euler") for robot in ROBOTS), ("type_2_0", "rk4"), ("mecanum", "rk4")]
)
def test_all_backends_give_the_same_run(robot: str, integrator: str, tmp_path: Path) -> None:
    """One wheel of every robot slips; batches are as many runs."""
    wheel_, direction = next(iter(wheel_rows(load_model(robot)))).split()
    slip = f'wheel_slip = {{ {wheel_} = {{ {direction} = "0.05*sin(3*t)" }} }}'
    file = track(robot, tmp_path, slip, integrator=integrator)
    law = next(iter(load_experiment(file).loops))
    runs = [wmr_afl.run(file, backend=backend)[law] for backend in ("numpy", "casadi", "compiled")]
    assert runs[0].failure is None
    for run in runs[1:]:
        for signal in ("state", "input", "error"):
            expected = getattr(runs[0], signal)
            assert np.abs(getattr(run, signal) - expected).max() < 1e-9 * max(1.0, np.abs(expected).max()), signal
    parameter = next(name for name, unit in runs[0].model.parameter_units.items() if unit == "m")
    batch = wmr_afl.run_batch(file, scale={f"parameters.{parameter}": [1.0, 1.1]})
    np.testing.assert_allclose(batch.rms[0], runs[0].rms(), rtol=1e-7)


@pytest.mark.parametrize(
    ("model", "given", "error", "words"),
    [
        ("type_2_0", told(), WmrError, "names no wheel; name one of right, left"),
        ("type_2_0", told(rihgt_along="1"), UnknownNameError, "did you mean 'right'"),
        ("mecanum", told(front_left_sideways="1"), WmrError, "on its rollers: that is no slip; tell along"),
        ("type_2_0_caster", told(caster_wheel_along="1"), WmrError, "rolls freely: it slips sideways only"),
        ("type_2_0", told(right_sideways="1", left_sideways="t"), WmrError, "right and left share an axle; tell one"),
        ("type_1_1", told(rear_left_sideways="1", front_along="1", rear_right_sideways="1"), WmrError, "share an axle"),
        ("type_2_0", told(right_along="1", right_sideways="1", left_along="u"), WmrError, "left along: unknown name"),
        (
            "mecanum",
            told(front_left_along="1", front_right_along="1", rear_left_along="1", rear_right_along="1"),
            WmrError,
            "depends on each other: .*rear_right along; leave out rear_right along, or another",
        ),
    ],
)
def test_what_cannot_slip_is_refused_with_a_remedy(model: str, given: Told, error: type[WmrError], words: str) -> None:
    loaded = load_model(model)
    with pytest.raises(error, match=words):
        WheelSlip(loaded, given, loaded.parameters())


def test_as_many_wheels_slip_as_the_robot_moves_in_ways(situation: Situation) -> None:
    """All told rows at once are exact."""
    model, n = situation.numpy, situation.numpy.coordinate_count
    given: dict[str, dict[str, str]] = {}
    rows: list[int] = []
    for number, (name, row) in enumerate(wheel_rows(model).items()):
        more = {**given, name.split()[0]: {**given.get(name.split()[0], {}), name.split()[1]: f"{number + 1}"}}
        try:
            WheelSlip(model, more, model.parameters())
        except WmrError:
            continue
        given = more
        rows.append(row)
    slip = WheelSlip(model, given, model.parameters())
    speeds = dict(zip(slip.rows.values(), slip._speeds(0.0)[0], strict=True))
    for x, p in zip(situation.x, situation.p, strict=True):
        found = model.slip_matrix(x[:n], p) @ slipping(slip, x, p, model)
        np.testing.assert_allclose([found[row] for row in rows], [speeds[row] for row in rows], rtol=1e-10)


def test_of_a_passive_pair_rollers_do_not_slip_and_free_wheels_do(tmp_path: Path) -> None:
    text = described(wheel("free", at=("0", "b"), roller_angle="pi/4"), wheel("rear", at=("-a", "0")), motor("rear"))
    model = load_model(derived(text, tmp_path))
    with pytest.raises(WmrError, match="free rolls freely: it does not slip"):
        WheelSlip(model, told(free_along="1"), model.parameters())
    assert list(wheel_rows(model)) == ["rear sideways", "rear along"]


def test_what_no_row_sees_is_held(tmp_path: Path) -> None:
    """A body with one wheel may turn about its contact: it does not."""
    model = load_model(derived(described(wheel("one"), motor("one")), tmp_path))
    slip = WheelSlip(model, told(one_sideways="2"), model.parameters())
    x = np.array([1.0, 2.0, 0.4, 0.3, 0.2])
    b = slipping(slip, x, model.parameters(), model)
    np.testing.assert_allclose(b, [-2.0 * np.sin(0.4), 2.0 * np.cos(0.4), 0.0], atol=1e-11)
