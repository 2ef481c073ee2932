"""Paths without times: how fast they are driven within limits of speed and acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from wmr_afl.controllers.waypoints import Waypoints, check_points, columns_of
from wmr_afl.errors import WmrError
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats

FINE, FINEST = 20, 1000  # places between two points, and on the way to full speed, at which speed is found
FASTEST = 1e-100, 1e100  # beyond, a limit cannot be squared
SPREAD = 0.2  # [s] over which acceleration changes unless told otherwise
KNOT = 0.02  # [s] between points once the path has its times
LONGEST = 1e5  # [s] that a drive may take
STRAIGHT = 1e-12  # [1/m], curvature of what counts as straight


@checked
def along(
    points: Mapping[str, ArrayLike],
    speed: float,
    acceleration: float,
    lateral: float | None = None,
    jerk: float | None = None,
    counts_turns: bool = False,
) -> Waypoints:
    """A smooth path through points, driven from rest to rest as fast as limits allow.

    `speed` [m/s], `acceleration` along the path [m/s^2], `lateral` acceleration, v^2 times curvature [m/s^2], the same
    unless given; acceleration changes within acceleration/`jerk` [s], a fifth of a second unless given. The first two
    outputs count as the plane of the path, in metres; others go along.

    Raises:
        WmrError: if there are fewer than two points, two in a row are the same, something is not finite, a limit is
            not positive, or the drive takes longer than a day.
    """
    columns = columns_of(points)
    usual = acceleration / SPREAD
    limits = {"speed": speed, "acceleration": acceleration, "lateral": lateral, "jerk": jerk}
    for name, value in limits.items():
        if value is not None and not value > 0.0:
            raise WmrError(f"{name} is {value:g}", "choose a positive limit")
        if value is not None and not FASTEST[0] < value < FASTEST[1]:
            raise WmrError(f"{name} is {value:g}", f"choose a limit between {FASTEST[0]:g} and {FASTEST[1]:g}")
    check_points(np.arange(len(next(iter(columns.values()), ())), dtype=float), columns)
    values = np.stack(list(columns.values()), axis=1)
    chords = np.linalg.norm(np.diff(values[:, :2], axis=0), axis=1)
    if not (chords > 0.0).all():
        same = int(np.argmin(chords)) + 1
        raise WmrError(f"points {same} and {same + 1} are the same", "remove one")
    parameter = np.concatenate([[0.0], np.cumsum(chords)])
    curve = CubicSpline(parameter, values, bc_type="natural")
    on_the_way = 2.0 * acceleration / speed**2 * FINE  # places by metre, from rest to full speed
    counts = np.clip(np.ceil(chords * on_the_way), FINE, FINEST).astype(int) + 1
    pieces = zip(pairwise(parameter), counts, strict=True)
    fine = np.unique(np.concatenate([np.linspace(a, b, count) for (a, b), count in pieces]))
    curvature = _curvature(curve(fine, 1)[:, :2], curve(fine, 2)[:, :2])
    length = _lengths(curve, fine)
    most = np.minimum(speed, np.sqrt((lateral or acceleration) / np.maximum(curvature, STRAIGHT)))
    times, reached = _driven(length, most, acceleration, jerk or usual)
    named = dict(zip(columns, curve(CubicSpline(length, fine)(reached)).T, strict=True))
    return Waypoints(times, named, "cubic", counts_turns=counts_turns)


def _curvature(first: Floats, second: Floats) -> Floats:
    """The curvature [1/m] of a curve in the plane, from its derivatives by any parameter (P, 2); of a line zero."""
    if first.shape[1] == 1:
        return np.zeros(len(first))
    turning = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return np.asarray(np.abs(turning) / np.maximum(np.linalg.norm(first, axis=1), STRAIGHT) ** 3)


def _lengths(curve: CubicSpline, places: Floats) -> Floats:
    """The length of a curve up to each of these places [m], by Gauss' rule between them."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half, middle = 0.5 * np.diff(places), 0.5 * (places[1:] + places[:-1])
    rates = np.linalg.norm(curve(middle[:, None] + half[:, None] * nodes, 1)[..., :2], axis=2)
    return np.concatenate([[0.0], np.cumsum(half * (rates @ weights))])


def _driven(length: Floats, most: Floats, acceleration: float, jerk: float) -> tuple[Floats, Floats]:
    """Times [s] and lengths [m] of the drive from rest to rest: as fast as `most` [m/s] and acceleration allow.

    A moving mean over acceleration/jerk then spreads what acceleration does at once.
    """
    square, pieces = most**2, np.diff(length)
    square[[0, -1]] = 0.0
    for i, piece in enumerate(pieces):  # no faster than it can come to be
        square[i + 1] = min(square[i + 1], square[i] + 2.0 * acceleration * piece)
    for i in reversed(range(len(pieces))):  # no faster than it can slow down from
        square[i] = min(square[i], square[i + 1] + 2.0 * acceleration * pieces[i])
    speeds = np.sqrt(square)
    passed = np.concatenate([[0.0], np.cumsum(2.0 * pieces / (speeds[1:] + speeds[:-1]))])
    if not passed[-1] + acceleration / jerk < LONGEST:
        raise WmrError(f"the drive takes {passed[-1] + acceleration / jerk:.3g} s", "choose higher limits")
    times = np.linspace(0.0, passed[-1], max(2, int(np.ceil(passed[-1] / KNOT))) + 1)
    before = np.clip(np.searchsorted(passed, times, side="right") - 1, 0, len(pieces) - 1)
    since, gain = times - passed[before], (np.diff(square) / (2.0 * pieces))[before]
    reached = np.minimum(length[before] + speeds[before] * since + 0.5 * gain * since**2, length[-1])
    step = times[1]
    width = max(1, int(np.ceil(acceleration / jerk / step)))
    waits = np.concatenate([np.zeros(width), reached, np.full(width, length[-1])])
    smooth = np.convolve(waits, np.full(width + 1, 1.0 / (width + 1)), mode="valid")
    return step * np.arange(len(smooth)), smooth
