"""What is found out about robots that are made to have it, against the same computed by numbers."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

from derive.codegen.findings import findings
from derive.control.internal_dynamics import StraightLine
from derive.control.linearization import relative_degree
from derive.derivation import Derivation, derive_robot
from tests.conftest import DESCRIPTIONS
from wmr_input import InputError


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Derivation]:
    """A robot of the catalogue with parts of its description replaced, derived once."""

    @cache
    def derived(robot: str, changes: tuple[tuple[str, str], ...], added: str = "") -> Derivation:
        text = DESCRIPTIONS[robot].read_text()
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path: Path = tmp_path_factory.mktemp("robots") / "made.toml"
        path.write_text(text + added)
        return derive_robot(path)

    return derived


def value(derivation: Derivation, matrix: sp.Matrix | sp.Expr, numbers: dict[sp.Symbol, float]) -> np.ndarray:
    """A matrix at these numbers and the default parameters."""
    expand = derivation.terms.expand
    whole = matrix.applyfunc(expand) if isinstance(matrix, sp.MatrixBase) else expand(matrix)
    defaults = {p: number for p, number in derivation.robot.defaults.items() if p not in numbers}
    found = whole.xreplace({**defaults, **numbers})
    return np.array(found.tolist() if isinstance(found, sp.MatrixBase) else found, dtype=float)


def at_random(derivation: Derivation, seed: int = 0) -> dict[sp.Symbol, float]:
    """A state and base parameters."""
    random = np.random.default_rng(seed)
    symbols = [*derivation.state, *derivation.adaptive.theta]
    return dict(zip(symbols, map(sp.Float, random.uniform(0.3, 1.2, len(symbols))), strict=True))


TURRET = """
[[frames]]
name = "turret"
parent = "platform"
at = ["0", "0"]
angle = "gamma"

[[bodies]]
frame = "turret"
at = ["0", "0"]
mass = "0"
inertia = "I_t"

[[motors]]
input = "u_t"
drives = "turret"
torque_gain = "K1"
back_emf = "K2"
"""


def test_a_part_without_mass_has_its_inertia(made) -> None:
    """A turret that is an inertia alone adds it to the platform's, and moves with it."""
    changes = (
        ("[parameters]", 'gamma = "rad"\n[parameters]\nI_t = { value = 2.0, unit = "kg m^2", about = "turret" }'),
        ('omega = "phi_dot"', 'omega = "phi_dot"\nturning = "gamma_dot"'),
        ('y1 = "x', 'y3 = "gamma"\ny1 = "x'),
    )
    text = dict(changes)
    derivation = made("type_2_0", tuple(text.items()), TURRET)
    plain = made("type_2_0", ())
    inertia = value(derivation, derivation.dynamics.inertia_matrix, at_random(derivation))
    expected = np.zeros((3, 3))
    expected[:2, :2] = value(plain, plain.dynamics.inertia_matrix, at_random(plain))
    expected[1:, 1:] += 2.0
    np.testing.assert_allclose(inertia, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("robot", "changes"),
    [
        ("mecanum", (('y1 = "x"', 'y1 = "2*x + y"'), ('y2 = "y"', 'y2 = "3*y"'))),
        ("type_2_0", (('y1 = "x', 'y1 = "2*x'), ("y1 = ", "y1 = "))),
    ],
)
def test_the_reported_determinant_is_that_of_the_decoupling_matrix(made, robot: str, changes: tuple) -> None:
    """det D, or with more motors than outputs det(D D^T), where the outputs stretch the plane."""
    derivation = made(robot, changes)
    found = findings(derivation)
    for seed in range(3):
        numbers = at_random(derivation, seed)
        D = value(derivation, derivation.control.linearization.output_map * derivation.adaptive.gain, numbers)
        square = D if found["determinant_of"] == "D" else D @ D.T
        assert (D.shape[0] == D.shape[1]) == (found["determinant_of"] == "D")
        reported = value(derivation, derivation.control.determinant.whole, numbers)
        np.testing.assert_allclose(reported, np.linalg.det(square), rtol=1e-9)
        text = sp.sympify(found["det_decoupling_matrix"], locals={s.name: s for s in numbers})
        names = {p.name: p for p in derivation.robot.parameters}
        text = text.xreplace({s: names[s.name] for s in text.free_symbols if s.name in names})
        np.testing.assert_allclose(value(derivation, text, numbers), np.linalg.det(square), rtol=1e-9)


BEHIND = (("L*cos(phi)", "(-L)*cos(phi)"), ("L*sin(phi)", "(-L)*sin(phi)"))


def test_an_output_behind_the_axle_is_stable_backward_only(made) -> None:
    """The mirror of the look-ahead point: eigenvalues change their sign."""
    ahead, behind = (findings(made("type_2_0", changes))["straight_line"] for changes in ((), BEHIND))
    assert (ahead["forward"], ahead["backward"]) == ("stable", "unstable")
    assert (behind["forward"], behind["backward"]) == ("unstable", "stable")
    assert behind["eigenvalues_at_defaults"] == [-one for one in ahead["eigenvalues_at_defaults"]]
    assert (ahead["eigenvalues"], behind["eigenvalues"]) == (["-1/L"], ["1/L"])


@pytest.mark.parametrize(
    ("values", "forward", "backward"),
    [
        ((-1.0, -2.0), "stable", "unstable"),
        ((1.0, 2.0), "unstable", "stable"),
        ((-1.0, 2.0), "unstable", "unstable"),
        ((-1.0, 0.0), "not decided by the linearization", "unstable"),
        ((1.0, 0.0), "unstable", "not decided by the linearization"),
        ((0.0,), "not decided by the linearization", "not decided by the linearization"),
        ((-1.0 + 3.0j, -1.0 - 3.0j), "stable", "unstable"),
    ],
)
def test_a_verdict_is_that_of_the_largest_real_part(values: tuple, forward: str, backward: str) -> None:
    """Backward, the signs are the other way round."""
    line = StraightLine(sp.zeros(1), sp.zeros(1), (), tuple(map(complex, values)))
    assert (line.forward, line.backward) == (forward, backward)


def test_symbolic_eigenvalues_are_those_at_the_defaults(derivation: Derivation) -> None:
    """And both are those of the matrix, for every robot that has internal dynamics."""
    line = derivation.control.internal.straight_line
    if line is None:
        return
    matrix = np.array(line.matrix.xreplace(derivation.robot.defaults).tolist(), dtype=float)
    expected = np.sort_complex(np.linalg.eigvals(matrix).astype(complex))
    np.testing.assert_allclose(np.sort_complex(np.array(line.values)), expected, atol=1e-9)
    symbolic = [complex(one.xreplace(derivation.robot.defaults)) for one in line.eigenvalues]
    assert len(symbolic) in (0, len(expected))
    if symbolic:
        np.testing.assert_allclose(np.sort_complex(np.array(symbolic)), expected, atol=1e-9)


def test_inputs_appear_in_the_second_derivative_if_the_row_of_d_does_not_vanish(derivation: Derivation) -> None:
    """Relative degree two for every output of the catalogue, and none for a row of zeros."""
    found = findings(derivation)
    assert found["relative_degree"] == dict.fromkeys(derivation.robot.outputs, 2)
    assert relative_degree(sp.zeros(1, 3), derivation.kinematics) is None
    assert relative_degree(sp.Matrix([[0, derivation.kinematics.q[0]]]), derivation.kinematics) == 2


CASTER = """
[[frames]]
name = "arm"
parent = "platform"
at = ["0", "0"]
angle = "alpha"

[[frames]]
name = "fork"
parent = "arm"
at = ["h", "0"]
angle = "beta"

[[wheels]]
name = "trail"
frame = "fork"
at = ["{place}", "0"]
radius = "r"
mass = "m_w"
inertia = "I_m"

[[bodies]]
frame = "arm"
at = ["0", "0"]
mass = "m_C"
inertia = "I_C"

[[motors]]
input = "u_arm"
drives = "arm"
torque_gain = "K1"
back_emf = "K2"
{motor}
"""
STEER = '[[motors]]\ninput = "u_fork"\ndrives = "fork"\ntorque_gain = "K1"\nback_emf = "K2"\n'


@pytest.mark.parametrize(("place", "steerability"), [("-h", 0), ("0", 1)])
def test_only_centred_wheels_steer(made, place: str, steerability: int) -> None:
    """A wheel on a swinging arm that trails its fork turns by itself; below the fork's axis it is steered."""
    text = DESCRIPTIONS["type_2_0"].read_text()
    changes = (
        ('name = "type_2_0"', 'name = "made"\ncontroller = false'),
        ("[parameters]", 'alpha = "rad"\nbeta = "rad"\n[parameters]\nh = { value = 0.3, unit = "m", about = "arm" }'),
        (text[text.index("[pseudo_velocities]") :], ""),
    )
    found = findings(made("type_2_0", changes, CASTER.format(place=place, motor=STEER if steerability else "")))
    assert found["degree_of_steerability"] == steerability
    assert found["degree_of_mobility"] == 2


def test_base_parameters_join_without_division_where_there_is_a_choice(derivation: Derivation) -> None:
    """A known length may be zero, so no base parameter is divided by one alone; all are positive at the defaults."""
    for parameter in derivation.adaptive.base_parameters:
        if derivation.adaptive.kind == "physical":
            continue
        assert derivation.at_defaults(parameter) > 0.0


def test_more_motors_than_motions_and_too_few_are_told_apart(made) -> None:
    """Each pseudo-velocity needs a motor."""
    text = DESCRIPTIONS["type_2_0"].read_text()
    last = text[text.rindex("[[motors]]") : text.index("[pseudo_velocities]")]
    with pytest.raises(InputError, match="1 motors for 2 pseudo-velocities"):
        made("type_2_0", ((last, ""),))
    more: dict[str, Any] = findings(made("type_2_0", ((last, last + last.replace("u_l", "u_more")),)))
    assert more["determinant_of"] == "D D^T"


def test_conditions_of_singularity_are_where_the_determinant_vanishes(derivation: Derivation) -> None:
    """At each condition of angles that is named, the motors or the outputs lose a direction."""
    found = findings(derivation)
    terms, q = derivation.terms, {s.name: s for s in derivation.kinematics.q}
    for condition in found["singular_where"]:
        factor = sp.sympify(condition.removesuffix(" = 0"), locals=q)
        angles = factor.free_symbols & set(q.values())
        if factor.func not in (sp.cos, sp.sin) or len(angles) != 1:
            continue
        (angle,) = angles
        place = sp.pi / 2 if factor.func is sp.cos else sp.S.Zero
        numbers = {**at_random(derivation), angle: place}
        E = terms.expand(derivation.control.linearization.output_map.det())
        reach = derivation.dynamics.input_matrix
        lost = []
        for matrix in (derivation.control.linearization.output_map, reach * reach.T):
            try:
                lost.append(abs(np.linalg.det(value(derivation, matrix, numbers))) < 1e-9)
            except (TypeError, ValueError):  # not finite there
                lost.append(True)
        assert any(lost), (condition, E)
