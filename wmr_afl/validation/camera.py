"""Pictures of the engine's robot as it drives, drawn without a display."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import WmrError
from wmr_afl.validation.engine import Engine, mujoco

Picture = NDArray[np.uint8]  # (height, width, 3)
DISTANCE = 2.0  # of the camera, in sizes of the robot
DOWN, ASIDE = -35.0, 120.0  # [deg], where it looks


class Camera:
    """Follows the robot and hands a picture on every `period` [s]."""

    def __init__(self, take: Callable[[Picture], None], period: float, size: tuple[int, int]) -> None:
        """`size`: width and height in pixels."""
        self._take, self._period, self._size, self._count = take, period, size, 0
        self._renderer: Any = None

    def __call__(self, engine: Engine, time: float) -> None:
        """Look at the engine at a time [s].

        Raises:
            WmrError: if the engine cannot draw here.
        """
        if time < (self._count - 0.01) * self._period:
            return
        self._count += 1
        if self._renderer is None:
            self._open(engine)
        root = engine.data.body(engine.mechanism.frames[0].name)
        self._view.lookat[:] = [*root.xpos[:2], engine.mechanism.axle_height]
        self._renderer.update_scene(engine.data, self._view)
        self._take(self._renderer.render())

    def close(self) -> None:
        """Give the engine's means of drawing back."""
        if self._renderer is not None:
            self._renderer.close()

    def _open(self, engine: Engine) -> None:
        width, height = self._size
        try:
            self._renderer = mujoco().Renderer(engine.model, height, width)
        except Exception as error:  # of OpenGL, of the window system or of the engine, as the machine is
            why = str(error).strip().splitlines()
            problem = f"the engine cannot draw here ({why[0] if why else type(error).__name__})"
            raise WmrError(
                problem, "install EGL (libegl1 and libgl1), or set MUJOCO_GL=osmesa, or leave video out"
            ) from None
        self._view = mujoco().MjvCamera()
        model = engine.model
        reach = np.zeros(model.nbody)  # from the root, of the robot stretched out; parents stand first
        for k, (parent, at) in enumerate(zip(model.body_parentid, model.body_pos, strict=True)):
            reach[k] = reach[parent] + np.hypot(*at[:2])
        size = 2.0 * float(reach.max()) + engine.mechanism.axle_height
        self._view.distance, self._view.elevation, self._view.azimuth = DISTANCE * size, DOWN, ASIDE
