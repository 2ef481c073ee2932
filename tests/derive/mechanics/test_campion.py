"""The five types move as Campion, Bastin, d'Andrea-Novel publish it, IEEE Trans. Robotics and Automation 12(1), 1996.

Their posture kinematic models give z' = B(z) [eta; zeta] for z = (x, y, theta, steering angles): the posture's rates
are Sigma(theta, beta) eta, and zeta are the rates of steering. Pseudo-velocities are a choice: the matrices may differ,
the spaces that their columns span may not.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from wmr_afl import Model, load_model

COUNT = 20  # random configurations
TOLERANCE = 1e-9  # sine of the largest angle between the spaces
QUARTER = np.pi / 2
Place = dict[str, float]  # coordinates and parameters of ours by name
Published = Callable[..., np.ndarray]  # Sigma(theta, steering angles, L), (3, degree of mobility)


def sigma_3_0(theta: float) -> np.ndarray:
    """R(theta)^T: the posture's rates from velocities along the platform's axes."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def sigma_2_0(theta: float) -> np.ndarray:
    """Along the wheels, which roll along the platform's axis Y, and turning."""
    return np.array([[-np.sin(theta), 0], [np.cos(theta), 0], [0, 1]])


def sigma_2_1(theta: float, beta: float) -> np.ndarray:
    """Along the steered wheel, and turning about it."""
    return np.array([[-np.sin(theta + beta), 0], [np.cos(theta + beta), 0], [0, 1]])


def sigma_1_1(theta: float, beta: float, L: float) -> np.ndarray:
    """About the point where the axles of the fixed and of the steered wheels meet."""
    return np.array([[-L * np.sin(theta) * np.sin(beta)], [L * np.cos(theta) * np.sin(beta)], [np.cos(beta)]])


def sigma_1_2(theta: float, beta1: float, beta2: float, L: float) -> np.ndarray:
    """About the point where the axles of the two steered wheels meet."""
    lateral, both = 2 * L * np.sin(beta1) * np.sin(beta2), L * np.sin(beta1 + beta2)
    return np.array([
        [-lateral * np.cos(theta) - both * np.sin(theta)],
        [-lateral * np.sin(theta) + both * np.cos(theta)],
        [np.sin(beta2 - beta1)],
    ])  # fmt: skip


@dataclass(frozen=True)
class Type:
    """One of the five types: the published matrix, and its angles in ours."""

    robot: str
    steered: tuple[str, ...]  # our steering angles, which differ from theirs by constants
    published: Published
    angles: Callable[[Place], tuple[float, ...]]  # theta, their steering angles, and L


# Their wheel stands at the distance l and the angle alpha from the platform's axis X, and beta is the angle from there
# to the axle: the axle points along theta + alpha + beta, the wheel rolls along theta + alpha + beta + 90 degrees. Ours
# rolls along phi, or along phi + beta on a steered frame. Rolling directions are lines: 180 degrees more are the same.
TYPES = (
    # No wheel constrains the platform: the posture moves freely, whatever the axes.
    Type("type_3_0", (), sigma_3_0, lambda our: (our["phi"],)),
    # Fixed wheels at alpha = 0 and 180, beta = 0: X is the axle, theta + 90 = phi.
    Type("type_2_0", (), sigma_2_0, lambda our: (our["phi"] - QUARTER,)),
    # The steered wheel stands below the reference point, l = 0 and alpha = 0, in theirs and in ours:
    # with theta = phi - 90 it rolls along theta + beta + 90 = phi + beta.
    Type("type_2_1", ("beta",), sigma_2_1, lambda our: (our["phi"] - QUARTER, our["beta"])),
    # Fixed wheels on the axis X, and the steered one at alpha = 270, l = L = a. Ours stands ahead: theta + 270 = phi,
    # so their axis Y points to our rear. It rolls along theta + 270 + their beta + 90 = phi + our beta.
    Type(
        "type_1_1",
        ("beta",),
        sigma_1_1,
        lambda our: (our["phi"] - 3 * QUARTER, our["beta"] - QUARTER, our["a"]),
    ),
    # Steered wheels at alpha = 0 and 180, l = L = a. Ours stand ahead and behind: theta = phi. They roll along
    # theta + their beta1 + 90 = phi + our beta1 and theta + 180 + their beta2 + 90 = phi + our beta2 (+ 180).
    Type(
        "type_1_2",
        ("beta1", "beta2"),
        sigma_1_2,
        lambda our: (our["phi"], our["beta1"] - QUARTER, our["beta2"] - QUARTER, our["a"]),
    ),
)


@dataclass(frozen=True)
class Configuration:
    """The two matrices at one configuration: rows x, y, heading and steering angles, columns pseudo-velocities."""

    ours: np.ndarray
    theirs: np.ndarray

    def deviation(self) -> float:
        """How far the two column spaces differ: the sine of their largest angle, 1 where their dimensions differ."""
        return float(np.linalg.norm(projector(self.ours) - projector(self.theirs), 2))

    def posture(self) -> "Configuration":
        """The rows x, y and heading alone."""
        return Configuration(self.ours[:3], self.theirs[:3])


@pytest.fixture(params=TYPES, ids=lambda kind: kind.robot)
def kind(request: pytest.FixtureRequest) -> Type:
    return request.param


@pytest.fixture
def configurations(kind: Type) -> list[Configuration]:
    return configurations_of(kind)


def random_places(model: Model) -> list[Place]:
    """Coordinates, away from steering angles of 90 degrees where pseudo-velocities may be singular, and parameters."""
    random = np.random.default_rng(5)
    names = list(model.state_units)[: model.coordinate_count]
    p = model.parameters() * random.uniform(0.8, 1.2, (COUNT, len(model.parameter_units)))
    places = []
    for parameters in p:
        place = dict(zip(names, random.uniform(-1.3, 1.3, len(names)), strict=True))
        place["phi"] = random.uniform(-np.pi, np.pi)
        places.append(place | dict(zip(model.parameter_units, parameters, strict=True)))
    return places


def configurations_of(kind: Type, turned: float = 0.0) -> list[Configuration]:
    """Both matrices at random places; `turned` sets their theta wrong [rad]."""
    model = load_model(kind.robot)
    names = list(model.state_units)[: model.coordinate_count]
    rows = [names.index(name) for name in ("x", "y", "phi", *kind.steered)]
    found = []
    for place in random_places(model):
        S = model.kinematic_matrix([place[name] for name in names], [place[name] for name in model.parameter_units])
        theta, *rest = kind.angles(place)
        found.append(Configuration(S[rows], with_steering(kind.published(theta + turned, *rest), len(kind.steered))))
    return found


def with_steering(sigma: np.ndarray, count: int) -> np.ndarray:
    """B = diag(Sigma, 1)."""
    mobility = sigma.shape[1]
    return np.block([[sigma, np.zeros((3, count))], [np.zeros((count, mobility)), np.eye(count)]])


def projector(matrix: np.ndarray) -> np.ndarray:
    """Onto the space that the columns span."""
    left, values, _ = np.linalg.svd(matrix)
    basis = left[:, : int(np.sum(values > 1e-9 * values[0]))]
    return basis @ basis.T


def test_postures_move_in_the_published_directions(configurations: list[Configuration]) -> None:
    assert max(one.posture().deviation() for one in configurations) <= TOLERANCE


def test_postures_and_steering_angles_move_in_the_published_directions(configurations: list[Configuration]) -> None:
    """Steering rates are free of each other and of the posture's."""
    assert max(one.deviation() for one in configurations) <= TOLERANCE


def test_the_degrees_of_mobility_and_steerability_are_the_published_ones(
    kind: Type, configurations: list[Configuration]
) -> None:
    found, steerability = load_model(kind.robot).findings, len(kind.steered)
    mobility = configurations[0].theirs.shape[1] - steerability
    assert (found["degree_of_mobility"], found["degree_of_steerability"]) == (mobility, steerability)


def test_a_microradian_between_the_headings_is_noticed(kind: Type) -> None:
    if kind.robot == "type_3_0":
        pytest.skip("its posture moves in every direction")
    for one in configurations_of(kind, turned=1e-6):
        assert one.posture().deviation() > TOLERANCE


def test_a_missing_motion_is_noticed(configurations: list[Configuration]) -> None:
    for one in configurations:
        assert Configuration(one.ours[:, 1:], one.theirs).deviation() > TOLERANCE
        assert Configuration(one.ours, one.theirs[:, 1:]).deviation() > TOLERANCE
