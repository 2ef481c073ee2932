"""Shapes of a robot that is drawn: hulls, rectangles, rollers, against what they must be."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wmr_afl.analysis.geometry import WIDTH, Geometry, _hull, _placed, _rectangle, _roller_lines
from wmr_input import InputError


def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Twice the area of a triangle, positive if it is counter-clockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [3, 4, 9])
def test_a_hull_holds_all_points_and_turns_left_at_each_corner(seed: int, count: int) -> None:
    """Every point lies on the left of every edge, and every corner is one of the points."""
    points = np.random.default_rng(seed).normal(size=(count, 2)) * [3.0, 0.5] + [10.0, -4.0]
    corners = _hull(points)
    assert len(set(corners)) == len(corners) >= 3
    for first, second in zip(corners, [*corners[1:], corners[0]], strict=True):
        assert min(side(points[first], points[second], point) for point in points) > -1e-12


@pytest.mark.parametrize(
    ("points", "corners"),
    [
        ([[0, 0], [1, 0], [2, 0]], {0, 2}),
        ([[0, 0], [1, 1], [2, 2], [3, 3]], {0, 3}),
        ([[0, 0], [2, 0], [1, 0], [2, 2], [0, 2], [1, 1]], {0, 1, 3, 4}),
        ([[5, 7], [5, 7]], {0}),
        ([[0, 2], [0, 0], [0, 1]], {0, 1}),
    ],
)
def test_points_on_an_edge_are_no_corners(points: list, corners: set[int]) -> None:
    """On a line only its ends are; of points that coincide there is one."""
    found = _hull(np.array(points, dtype=float))
    place = {tuple(points[k]) for k in found}
    assert place == {tuple(points[k]) for k in corners}
    assert len(found) == len(corners)


def test_a_wheel_is_a_rectangle_of_its_diameter() -> None:
    """As long as the wheel is high, and narrower."""
    corners = _rectangle(0.5)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [1.0, 0.5 * WIDTH])
    np.testing.assert_allclose(corners.mean(axis=0), 0.0)
    assert side(*corners[:3]) > 0.0


@pytest.mark.parametrize("angle", [0.0, np.pi / 4, -np.pi / 4, 1.2, np.pi / 2])
def test_rollers_cross_the_wheel_at_their_angle(angle: float) -> None:
    """Three parallel lines from edge to edge of the rectangle, the middle one through the hub."""
    radius = 0.5
    lines = _roller_lines(radius, angle)
    assert len(lines) == 3
    half = np.array([radius, WIDTH * radius / 2.0])
    across = np.array([-np.sin(angle), np.cos(angle)])
    offsets = []
    for line in lines:
        direction = line[1] - line[0]
        assert abs(direction @ across) < 1e-12
        assert direction @ [np.cos(angle), np.sin(angle)] > 0.0
        for end in line:
            assert np.all(np.abs(end) <= half + 1e-12)
            assert np.any(np.abs(np.abs(end) - half) < 1e-12)
        offsets.append(float(line[0] @ across))
    reach = float(np.abs(across) @ half)
    np.testing.assert_allclose(offsets, [-0.5 * reach, 0.0, 0.5 * reach], atol=1e-12)


def test_parts_are_turned_and_moved_to_their_pose() -> None:
    """Counter-clockwise by the heading, then to the place, at every time."""
    poses = np.array([[1.0, 2.0, np.pi / 2.0], [0.0, 0.0, 0.0]])
    found = _placed(poses, np.array([[1.0, 0.0], [0.0, 3.0]]))
    np.testing.assert_allclose(found, [[[1.0, 3.0], [-2.0, 2.0]], [[1.0, 0.0], [0.0, 3.0]]], atol=1e-15)


def made_model(folder: Path) -> Any:
    """A cart with a wheel on a steered fork and a bodiless platform, without any file."""
    parts = {
        "frames": {
            "root": {"x": "x", "y": "y", "heading": "phi"},
            "fork": {"x": "x + a*cos(phi)", "y": "y + a*sin(phi)", "heading": "phi + beta", "parent": "root"},
        },
        "wheels": {
            "front": {"x": "x + a*cos(phi)", "y": "y + a*sin(phi)", "heading": "phi + beta", "frame": "fork",
                      "radius": "r"},
            "rear": {"x": "x", "y": "y", "heading": "phi", "frame": "root", "radius": "2*r", "roller_angle": "-pi/4"},
        },
        "bodies": {"load": {"x": "x - 1", "y": "y + 2", "heading": "phi", "frame": "root"}},
    }  # fmt: skip
    return SimpleNamespace(
        folder=folder,
        state_units={"x": "m", "y": "m", "phi": "rad", "beta": "rad", "v": "m/s"},
        coordinate_count=4,
        parameter_units={"a": "m", "r": "m"},
        metadata={"geometry": parts},
    )


def test_poses_are_the_formulas_of_the_model_at_each_time(tmp_path: Path) -> None:
    """Of frames, wheels and bodies; from states or from coordinates alone, with constants at every time."""
    geometry = Geometry(made_model(tmp_path), [0.5, 0.1])
    states = np.array([[1.0, 2.0, np.pi / 2.0, 0.3, 9.0], [0.0, 0.0, 0.0, -0.1, 9.0]])
    expected = {
        "frames": {"root": states[:, :3], "fork": [[1.0, 2.5, np.pi / 2.0 + 0.3], [0.5, 0.0, -0.1]]},
        "wheels": {"front": [[1.0, 2.5, np.pi / 2.0 + 0.3], [0.5, 0.0, -0.1]], "rear": states[:, :3]},
        "bodies": {"load": [[0.0, 4.0, np.pi / 2.0], [-1.0, 2.0, 0.0]]},
    }
    for kind, poses in expected.items():
        for given in (states, states[:, :4]):
            found = getattr(geometry, kind)(given)
            assert list(found) == list(poses)
            for name, pose in poses.items():
                np.testing.assert_allclose(found[name], pose, atol=1e-15)
    assert (geometry.radius("rear"), geometry.roller_angle("rear"), geometry.roller_angle("front")) == (
        0.2, -np.pi / 4.0, None,
    )  # fmt: skip


def test_everything_that_is_fixed_to_a_frame_hangs_on_its_origin(tmp_path: Path) -> None:
    """Links to wheels, bodies and further frames, joints at these, an arrow along the root's heading."""
    states = np.array([[1.0, 2.0, 0.0, 0.3, 0.0]])
    shapes = Geometry(made_model(tmp_path), [0.5, 0.1]).shapes(states)
    ends = {tuple(map(tuple, link[0])) for link in shapes.links}
    root, fork, load = (1.0, 2.0), (1.5, 2.0), (0.0, 4.0)
    assert ends == {(root, root), (root, load), (root, fork), (fork, fork)}
    assert len(shapes.hulls) == 1
    assert {tuple(corner) for corner in shapes.hulls[0][0]} == {root, fork, load}
    assert (len(shapes.wheels), len(shapes.rollers)) == (2, 3)
    np.testing.assert_allclose(shapes.joints, [[fork]])
    reach = np.hypot(1.0, 2.0)
    (arrow,) = shapes.arrow
    np.testing.assert_allclose(arrow[0].max(axis=0), [1.0 + 0.5 * reach, 2.0 + 0.05 * reach])
    count = 2 * len(shapes.links) + 4 * 2 + len(arrow[0]) + 1
    assert shapes.points.shape == (1, count, 2)


@pytest.mark.parametrize("damage", ["frames", "wheels", "bodies", "formula", "name"])
def test_a_damaged_geometry_is_reported_with_its_place(damage: str, tmp_path: Path) -> None:
    """File and key, and what to do."""
    model = made_model(tmp_path)
    parts = model.metadata["geometry"]
    if damage in parts:
        parts[damage] = None
    if damage == "formula":
        parts["wheels"]["front"]["x"] = "x +"
    if damage == "name":
        parts["wheels"]["front"]["x"] = "z"
    with pytest.raises(InputError, match=r"model\.json: geometry (frames|wheels|bodies).*derive the robot again"):
        Geometry(model, [0.5, 0.1]).wheels(np.zeros((1, 4)))
