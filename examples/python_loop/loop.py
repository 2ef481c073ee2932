"""A control loop at 100 Hz in Python: a simulated robot, setpoints from another thread, and a log of what happened.

    python examples/python_loop/loop.py --seconds 10 --log log.csv

The loop owns the controller; the planner's thread only pushes setpoints into the buffer, which locks. On a robot
replace `Robot` by its encoders and motor drivers, and keep everything else: the watch on the clock, what happens when
a sample is refused, and the stop when no setpoints come any more.
"""

from __future__ import annotations

import argparse
import csv
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import wmr_afl
from wmr_afl.controllers.live_reference import BufferState

PERIOD = 0.01  # [s] of the loop
AHEAD = 0.2  # [s] that the planner is ahead: two points at 10 Hz


class Robot:
    """The robot of study 1 as a body that voltages move; its numbers are not those that the controller believes."""

    def __init__(self) -> None:
        self.model = wmr_afl.load_model("type_2_0")
        self.parameters = self.model.parameters(m_C=36.0)
        self.x, self.u, self.time = np.array([17.5, 25.0, np.pi / 2, 0.0, 0.0]), np.zeros(2), 0.0

    def measure(self, t: float) -> np.ndarray:
        """x, y, phi, v, omega [m, m, rad, m/s, rad/s] at time t [s]."""
        steps = max(1, round((t - self.time) / 0.005))
        for _ in range(steps):
            self.move((t - self.time) / steps)
        self.time = t
        return self.x.copy()

    def apply(self, u: np.ndarray) -> None:
        """The voltages of the motors [V] from now on."""
        self.u = u

    def move(self, seconds: float) -> None:
        """What the motors do within this time: classical Runge-Kutta."""

        def rate(x: np.ndarray) -> np.ndarray:
            return self.model.state_derivative(x, self.u, np.zeros(2), self.parameters)

        a = rate(self.x)
        b = rate(self.x + 0.5 * seconds * a)
        c = rate(self.x + 0.5 * seconds * b)
        d = rate(self.x + seconds * c)
        self.x = self.x + seconds / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def plan(buffer: wmr_afl.ReferenceBuffer, now: Callable[[], float], until: float) -> None:
    """A planner that pushes a circle at 10 Hz, each point two periods ahead, and then falls silent."""
    k = 0
    while now() < until:
        t = 0.1 * k
        angle = 0.05 * t
        circle = np.array([np.cos(angle), np.sin(angle)])
        tangent = np.array([-np.sin(angle), np.cos(angle)])
        buffer.push(t, np.array([10.0, 25.0]) + 7.5 * circle, 0.375 * tangent, -0.01875 * circle)
        k += 1
        while now() < 0.1 * k - AHEAD and now() < until:
            time.sleep(0.001)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seconds", type=float, default=10.0, help="how long the planner sends setpoints")
    options.add_argument("--log", type=Path, default=Path("log.csv"), help="where the log is written")
    chosen = options.parse_args()
    if not 0.1 <= chosen.seconds <= 3600.0:
        options.error("--seconds must be from 0.1 to 3600")
    chosen.log.touch()  # what cannot be written is told before anything moves

    loop = wmr_afl.Controller.from_experiment("study_1_laws", "composite", is_live=True)
    live = wmr_afl.LiveReference(["y1", "y2"])
    controller = wmr_afl.Controller(loop.model, loop.law, live, PERIOD, hears_applied=True)
    buffer, robot = wmr_afl.ReferenceBuffer(["y1", "y2"], timeout=0.5, stop=2.0), Robot()
    begin = time.perf_counter()

    def now() -> float:
        return time.perf_counter() - begin

    planner = threading.Thread(target=plan, args=(buffer, now, chosen.seconds), daemon=True)
    planner.start()
    names = [*controller.measured, *controller.model.input_units, "e1", "e2", "state", "late"]
    rows, refused, u, applied, k = [], 0, np.zeros(2), None, 0
    while buffer.state is not BufferState.STOPPED:
        k += 1
        time.sleep(max(0.0, PERIOD * k - now()))
        t = now()
        x = robot.measure(t)
        try:
            u = applied = controller.update(t, x, buffer, applied=applied)
        except wmr_afl.WmrError:  # no setpoint yet, or a sample that is not sound: no voltage, and go on
            u, applied, refused = (
                np.zeros(2),
                None,
                refused + 1,
            )  # after zero volts nobody knows what there was on average
        robot.apply(u)
        rows.append([t, *x, *u, *controller.diagnostics.error, buffer.state.value, t - PERIOD * k])
    with chosen.log.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", *names])
        writer.writerows(rows)
    late = np.array([row[-1] for row in rows])
    driven = np.array([row[-4:-2] for row in rows if row[-2] == "fresh"])
    settled = np.linalg.norm(driven[len(driven) // 2 :], axis=1)
    print(f"{len(rows)} samples, {refused} refused")
    print(f"late by {1e3 * np.median(late):.2f} ms (median), {1e3 * late.max():.2f} ms at most")
    print(f"error {1e3 * np.median(settled):.1f} mm (median of the second half)")
    print(f"{buffer.state.value}: {abs(robot.x[3]):.4f} m/s, {np.abs(u).max():.3f} V; log in {chosen.log}")


if __name__ == "__main__":
    main()
