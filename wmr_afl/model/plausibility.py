"""Numbers that no robot can have are refused before a run, instead of giving a strange one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


def check_robots(model: Model, start: Mapping[str, float], parameters: Floats) -> None:
    """Check that masses are not negative, base parameters finite, the inertia matrix positive definite at the start.

    `parameters`: p (n_p,), or (N, n_p) for N robots.

    Raises:
        WmrError: if a robot fails the check; the text describes the first one.
    """
    names, robots = list(model.parameter_units), np.atleast_2d(parameters)
    for column, (name, unit) in enumerate(model.parameter_units.items()):
        if unit in ("kg", "kg m^2") and np.any(robots[:, column] < 0.0):
            value = robots[np.argmax(robots[:, column] < 0.0), column]
            raise WmrError(f"{name} = {value:g} {unit} is negative", "choose a mass or inertia that a robot can have")

    def described(wrong: np.ndarray) -> str:
        robot = robots[np.argmax(wrong)]
        defaults = model.parameters()
        changed = [f"{n} = {v:g}" for n, v, default in zip(names, robot, defaults, strict=True) if v != default]
        return ", ".join(changed) or "the defaults"

    states = list(model.state_units)[: model.coordinate_count]
    q = np.broadcast_to([start.get(name, 0.0) for name in states], (len(robots), len(states)))
    with np.errstate(all="ignore"):
        theta, inertia = model.base_parameters(robots), model.inertia_matrix(q, robots)
    strange = ~np.isfinite(theta).all(axis=1)
    if strange.any():
        problem = f"the base parameters are not finite with {described(strange)}"
        raise WmrError(problem, "choose values that a robot can have")
    strange = ~np.isfinite(inertia).all(axis=(1, 2))
    if not strange.any():
        strange = np.linalg.eigvalsh(inertia)[:, 0] <= 0.0
    if strange.any():
        raise WmrError(
            f"the inertia matrix is not positive definite with {described(strange)}", "choose positive masses"
        )
