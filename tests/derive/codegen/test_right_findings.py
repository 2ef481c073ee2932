"""What is found out about a robot follows from the mathematics, not from the way in which it was written down."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from derive.codegen.write import files_of
from derive.control import internal_dynamics
from derive.derivation import derive_robot
from derive.mechanics import mobility
from tests.conftest import DESCRIPTIONS
from tests.derive.descriptions import (
    ACKERMANN,
    AHEAD,
    ALONG_THE_BODY,
    CRAB,
    CRAB_OUTPUTS,
    CRAB_PARTS,
    derived,
    lawful_model,
    motor,
    part,
    robot,
    steered,
    wheel,
)
from wmr_afl import Model, load_model
from wmr_input import InputError


def model_of(text: str, folder: Path) -> Model:
    """The derived model; it obeys every law."""
    return lawful_model(derived(text, folder))


@pytest.mark.parametrize("v", [None, ALONG_THE_BODY], ids=["chosen v", "v along the body"])
def test_a_forward_form_is_found_however_a_denominator_is_written(v: dict[str, str] | None, tmp_path: Path) -> None:
    """Along the body the inertia is c (sin^2/cos + cos)^2: one function of the state times one of the parameters."""
    model = model_of(robot(*CRAB_PARTS, angles=("beta",), outputs=CRAB_OUTPUTS, v=v), tmp_path)
    assert model.parametrization == "forward"


def test_velocities_without_a_pole_are_chosen_where_a_loses_rank(tmp_path: Path) -> None:
    model = model_of(CRAB, tmp_path)
    assert model.findings["kinematic_singularities"] == []
    assert model.findings["degenerate_configurations"] == ["cos(beta) = 0"]
    assert np.isfinite(model.kinematic_matrix([0.1, 0.2, 0.3, np.pi / 2], model.parameters())).all()


@pytest.mark.parametrize("third", ["4*pi/3", "pi"])
def test_rows_that_follow_from_others_almost_everywhere_count_elsewhere(third: str, tmp_path: Path) -> None:
    """Three wheels at one angle around a circle: two of their rows are the same where the third one's is not."""
    angles = {"s0": "0", "s1": "2*pi/3", "s2": third}
    frames = [steered(name, (f"a*cos({at})", f"a*sin({at})"), "beta") for name, at in angles.items()]
    wheels = [wheel(f"w_{name}", name) for name in angles]
    outputs = {"y1": "x + L*cos(phi + beta)", "y2": "y + L*sin(phi + beta)"}
    text = robot(*frames, *wheels, motor("w_s0"), motor("s0"), angles=("beta",), outputs=outputs)
    found = model_of(text, tmp_path).findings
    assert found["degenerate_configurations"] == []
    assert found["kinematic_singularities"] == []


def test_a_root_of_the_state_hinders_nothing(tmp_path: Path) -> None:
    """At half of all random states the root does not exist; and 2 + cos(beta) vanishes nowhere."""
    car = (steered("fork", ("a", "0"), "beta"), wheel("rear"), wheel("front", "fork"), motor("rear"), motor("fork"))
    v = {"v": "sqrt(2 + cos(beta))*(x_dot*cos(phi) + y_dot*sin(phi))", "s": "beta_dot"}
    outputs = {"y1": "x + a*cos(phi) + L*cos(phi + beta)", "y2": "y + a*sin(phi) + L*sin(phi + beta)"}
    found = model_of(robot(*car, angles=("beta",), outputs=outputs, v=v), tmp_path).findings
    assert found["parametrization_obstacle"]["is_proof"]
    assert found["kinematic_singularities"] == ["cos(beta) = 0"]


def test_roots_of_parameters_hinder_no_choice_of_velocities(tmp_path: Path) -> None:
    """Random parameters are drawn again until their roots exist."""
    caster = part("frames", name="caster", parent="body", at=["sqrt(a**2 + e**2)", "0"], angle="g")
    wheels = (wheel("left", at=("0", "sqrt(b**2 + e**2)")), wheel("w", "caster", ("-sqrt(r**2 + e**2)", "0")))
    assert model_of(robot(caster, *wheels, angles=("g",)), tmp_path).findings["type"] == "(2,0)"


def test_a_default_whose_root_no_exact_field_holds(tmp_path: Path) -> None:
    """sqrt(1 + (101/293)^2) has no root in the field of exact evaluation; the inertia is there all the same."""
    text = DESCRIPTIONS["type_2_0"].read_text().replace('mass = "m_C"', 'mass = "m_C*sqrt(1 + d**2/b**2)"')
    lines = [
        line.split("{")[0] + f'{{ value = {0.101 if line[0] == "d" else 0.293}, unit = "m" }}'
        if line.startswith(("d = ", "b = "))
        else line
        for line in text.splitlines()
    ]
    model_of("\n".join(lines).replace('name = "type_2_0"', 'name = "small"'), tmp_path)


def test_what_is_defined_nowhere_is_named(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(robot(wheel("w"), part("constraints", expression="x_dot/(sin(phi)**2 + cos(phi)**2 - 1)")))
    with pytest.raises(InputError, match=r"sin\(phi\).*not defined at random configurations; check its roots"):
        derive_robot(path)


CASTERS = [
    part("frames", name=f"c{k}", parent="body", at=list(at), angle=f"g{k}") for k, at in enumerate(("ab", "bL", "La"))
]
FREE = [wheel(f"cw{k}", f"c{k}", ("-e", "0")) for k in range(3)]
TWO = (wheel("left", at=("0", "b")), wheel("right", at=("0", "-b")), motor("left"), motor("right"))


def test_eigenvalues_may_be_repeated(tmp_path: Path) -> None:
    """Three equal casters that nothing drives: -1/e three times, and -1/L."""
    text = robot(*CASTERS, *FREE, *TWO, angles=("g0", "g1", "g2"), outputs=AHEAD)
    line = model_of(text, tmp_path).findings["straight_line"]
    assert line["eigenvalues_at_defaults"] == [-20.0, -20.0, -20.0, -2.5]
    assert line["forward"] == "stable"


@pytest.mark.parametrize(
    ("module", "function", "finding"),
    [
        (mobility, "bracket_growth", "growth_vector"),
        (mobility, "degenerate_configurations", "degenerate_configurations"),
        (internal_dynamics, "_straight_line", "straight_line"),
        (internal_dynamics, "_equation", "internal_dynamics"),
    ],
)
def test_a_finding_that_only_informs_stops_nothing(
    module: Any, function: str, finding: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*arguments: object) -> None:
        raise AttributeError("whatever computer algebra raises")

    monkeypatch.setattr(module, function, fails)
    path = tmp_path / "small.toml"
    path.write_text(robot(*TWO, outputs=AHEAD))
    derivation = derive_robot(path)
    assert derivation.missed == {finding: "AttributeError: whatever computer algebra raises"}
    assert '"not_found_out"' in files_of(derivation, path)["model.json"]


@pytest.mark.parametrize("ratio", ["-0.5", "-0.37", "1/3", "7/3", "-e/b", "17/19"])
def test_two_steered_frames_may_share_one_angle_at_any_ratio(ratio: str, tmp_path: Path) -> None:
    parts = (steered("front", ("a", "0"), "beta"), steered("back", ("-a", "0"), f"{ratio}*beta"))
    wheels = (wheel("w_front", "front"), wheel("w_back", "back"))
    model = model_of(robot(*parts, *wheels, motor("w_front"), motor("front"), angles=("beta",)), tmp_path)
    assert model.findings["type"] == "(1,1)"
    assert model.findings["degenerate_configurations"] in ([], None)


SLEIGH = (wheel("edge"),)
ROLLER_RACER = (part("frames", name="bar", parent="body", at=["a", "0"], angle="beta"), wheel("w", "bar", ("-e", "0")))
BAR = part("bodies", frame="bar", at=["-e/2", "0"], mass="m/9", inertia="I/9")


@pytest.mark.parametrize("driven", [(), (motor("bar"),)], ids=["no motor", "one motor"])
def test_a_model_alone_may_have_fewer_motors_than_speeds(driven: tuple[str, ...], tmp_path: Path) -> None:
    model = model_of(robot(wheel("rear"), *ROLLER_RACER, BAR, *driven, angles=("beta",)), tmp_path)
    assert model.pseudo_velocity_count == 2
    assert len(model.input_units) == len(driven)
    x, w = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), np.zeros(2)
    assert np.isfinite(model.state_derivative(x, np.ones(len(driven)), w, model.parameters())).all()


def test_a_sleigh_has_no_motor(tmp_path: Path) -> None:
    assert model_of(robot(*SLEIGH), tmp_path).input_units == {}


def test_a_controller_still_needs_the_motors(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(robot(wheel("left", at=("0", "b")), motor("left"), outputs=AHEAD))
    with pytest.raises(InputError, match=r"1 motors for 2 pseudo-velocities.*no control law.*controller = false"):
        derive_robot(path)


def test_a_linkage_that_keeps_all_axles_on_one_centre_constrains_no_more_than_one_wheel(tmp_path: Path) -> None:
    """Ackermann: the two front wheels' angles follow from one by an arctangent, exactly."""
    model = model_of(ACKERMANN, tmp_path)
    assert (model.findings["type"], model.findings["degree_of_nonholonomy"]) == ("(1,1)", 3)
    p = model.parameters()
    beta, a, b = 0.4, p[1], p[2]
    rates = model.kinematic_matrix([0.0, 0.0, 0.0, beta], p) @ [1.0, 0.0]
    np.testing.assert_allclose(rates[:3], [1.0, 0.0, np.tan(beta) / a], rtol=1e-12)
    assert b > 0


def test_a_torque_may_be_the_input(tmp_path: Path) -> None:
    volts = robot(*TWO, outputs=AHEAD)
    torque = volts.replace('torque_gain = "k"\n', "")
    model = model_of(torque, tmp_path)
    assert model.input_units == {"u_left": "N m", "u_right": "N m"}
    np.testing.assert_array_equal(
        model.input_matrix([0, 0, 0], model.parameters()), model.actuator_rates_matrix([0, 0, 0], model.parameters()).T
    )
    assert "motor torques" in (tmp_path / "small" / "numpy_model.py").read_text()
    mixed = volts.replace('torque_gain = "k"\n', "", 1)
    (tmp_path / "mixed").mkdir()
    assert load_model(derived(mixed, tmp_path / "mixed")).input_units == {"u_left": "N m", "u_right": "V"}


def test_the_limits_of_a_joint_stand_beside_its_angle(tmp_path: Path) -> None:
    fork = steered("fork", ("a", "0"), "beta").replace('angle = "beta"', 'angle = "beta"\nlimits = [-0.6, "a/b - 0.6"]')
    text = robot(fork, wheel("rear"), wheel("front", "fork"), motor("rear"), motor("fork"), angles=("beta",))
    frame = model_of(text, tmp_path).metadata["geometry"]["frames"]["fork"]
    assert (frame["angle"], frame["limits"]) == ("beta", ["-0.6", "-0.6 + a/b"])


LIMITS = {
    "[0.6, -0.6]": "'fork' limits: go from 0.6 to -0.6; put the smaller one first",
    '["-a", "a"]': "'fork' limits: has the unit m; this place takes rad",
    "[0.6]": "'fork' limits: has 1 entries; give 2",
}


@pytest.mark.parametrize("limits", LIMITS)
def test_limits_that_are_none(limits: str, tmp_path: Path) -> None:
    fork = steered("fork", ("a", "0"), "beta") + f"limits = {limits}\n"
    path = tmp_path / "small.toml"
    path.write_text(robot(fork, wheel("front", "fork"), angles=("beta",)))
    with pytest.raises(InputError) as caught:
        derive_robot(path)
    assert LIMITS[limits] in str(caught.value)
