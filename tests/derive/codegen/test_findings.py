"""What is found out about the robots of the catalogue, against what the literature says of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from derive.codegen.findings import findings
from derive.codegen.write import generate_one, write
from derive.derivation import Derivation, derive_robot
from tests.conftest import DESCRIPTIONS
from wmr_afl import MissingTermError, load_model
from wmr_afl.controllers import Knowledge
from wmr_afl.model.laws import LAWS, Situation
from wmr_input import InputError

# type, degree of nonholonomy, parametrization; the degrees by Campion et al. 1996 and, for trailers on axle, n+2 for n
# of them (Jean 1996); type (3,0) has no constraint.
KNOWN = {
    "car": ("(1,1)", 3, "inverse"),
    "mecanum": ("(3,0)", 1, "forward"),
    "tractor_3_trailers": ("(2,0)", 5, "inverse"),
    "tractor_trailer": ("(2,0)", 3, "inverse"),
    "type_1_1": ("(1,1)", 3, "inverse"),
    "type_1_2": ("(1,2)", 2, "inverse"),
    "type_2_0": ("(2,0)", 2, "forward"),
    "type_2_0_caster": ("(2,0)", 3, "inverse"),
    "type_2_0_uneven": ("(2,0)", 2, "forward"),
    "type_2_1": ("(2,1)", 2, "inverse"),
    "type_3_0": ("(3,0)", 1, "forward"),
}


@pytest.fixture
def found(derivation: Derivation) -> dict[str, Any]:
    return findings(derivation)


def test_type_and_degree_of_nonholonomy_are_the_published_ones(robot: str, found: dict[str, Any]) -> None:
    assert (found["type"], found["degree_of_nonholonomy"], found["parametrization"]) == KNOWN[robot]
    assert found["controllable"]


def test_robots_without_a_forward_form_have_the_proof(found: dict[str, Any]) -> None:
    obstacle = found["parametrization_obstacle"]
    assert (obstacle is None) == (found["parametrization"] == "forward")
    assert obstacle is None or obstacle["is_proof"]


def test_only_two_independently_steered_wheels_can_be_degenerate(robot: str, found: dict[str, Any]) -> None:
    expected = ["cos(beta1) = 0 and cos(beta2) = 0"] if robot == "type_1_2" else []
    assert found["degenerate_configurations"] == expected


def test_in_degenerate_configurations_the_rank_of_a_drops() -> None:
    model = load_model("type_1_2")
    quarter = np.pi / 2
    places = [[0, 0, 0.3, quarter, -quarter], [0, 0, 0.3, quarter, 0.2], [0, 0, 0.3, 0.7, 0.7]]
    ranks = [np.linalg.matrix_rank(model.constraint_matrix(q, model.parameters()), tol=1e-12) for q in places]
    assert ranks == [1, 2, 2]


def test_chosen_pseudo_velocities_are_smooth_where_a_smooth_choice_exists(robot: str, found: dict[str, Any]) -> None:
    """None exists where A is degenerate somewhere; the car's are its author's, with the speed of the rear axle."""
    expected = {"type_1_2": ["cos(beta2) = 0"], "car": ["cos(beta) = 0"]}
    assert found["kinematic_singularities"] == expected.get(robot, [])


def test_what_follows_is_stable_forward_and_unstable_backward(robot: str, found: dict[str, Any]) -> None:
    line = found["straight_line"]
    if not found["internal_coordinates"]:
        assert line is None
        return
    assert line["backward"] == "unstable"
    assert line["forward"] == ("not decided by the linearization" if robot == "type_1_2" else "stable")


def test_internal_dynamics_move_as_their_linearization_says() -> None:
    """A trailer's angle under perfect tracking, by numbers: z' = S_z E^-1 yr' along a straight line."""
    model = load_model("tractor_trailer")
    p = model.parameters()
    c, names = model.known(p), list(model.state_units)
    free = [names.index(z) for z in model.findings["internal_coordinates"]]

    def rate(z: np.ndarray) -> np.ndarray:
        q = np.zeros(4)
        q[free] = z
        kinematic = model.kinematic_matrix(q, p)
        return (kinematic @ np.linalg.solve(model.output_jacobian(q, c) @ kinematic, [1.0, 0.0]))[free]

    jacobian = np.array([(rate(1e-6 * e) - rate(-1e-6 * e)) / 2e-6 for e in np.eye(len(free))]).T
    stated = sorted(model.findings["straight_line"]["eigenvalues_at_defaults"])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(jacobian).real), stated, rtol=1e-6)


AXLE = 'y1 = "x"\ny2 = "y"\n'


def test_a_structurally_singular_decoupling_matrix_is_refused_with_what_would_help(tmp_path: Path) -> None:
    path = tmp_path / "axle.toml"
    path.write_text(DESCRIPTIONS["type_2_0"].read_text().split("y1 =")[0] + AXLE)
    with pytest.raises(InputError, match=r"do not see omega.*look-ahead.*dynamically.*controller = false"):
        derive_robot(path)


def test_a_model_without_a_controller_obeys_its_laws_and_controls_nothing(tmp_path: Path) -> None:
    path = tmp_path / "axle.toml"
    path.write_text("controller = false\n" + DESCRIPTIONS["type_2_0"].read_text().split("y1 =")[0] + AXLE)
    write({f"axle/{name}": text for name, text in generate_one(path).items()}, tmp_path)
    situation = Situation(tmp_path / "axle")
    laws = [law for law in LAWS if law.applies(situation.numpy)]
    assert len(laws) > 10
    assert [law.name for law in laws if not law.deviation(situation) <= law.tolerance] == []
    model = situation.numpy
    p = model.parameters()
    with pytest.raises(MissingTermError, match="no outputs to track"):
        Knowledge(model, model.known(p), model.base_parameters(p))


def test_a_holonomic_constraint_is_named(tmp_path: Path) -> None:
    """A wheel that stands across its own motion lets a robot only turn about it: x and y follow from the heading."""
    path = tmp_path / "anchored.toml"
    text = DESCRIPTIONS["mecanum"].read_text().replace('name = "mecanum"', 'name = "anchored"\ncontroller = false')
    path.write_text(text.split("[outputs]")[0] + '[[constraints]]\nexpression = "x_dot + y_dot"\n')
    found = findings(derive_robot(path))
    assert found["constraints"] == "holonomic"
    assert found["holonomic_rows"] == ["constraint number 1"]
    assert not found["controllable"]


def test_every_robot_of_the_catalogue_is_compared() -> None:
    assert set(KNOWN) == set(DESCRIPTIONS)
