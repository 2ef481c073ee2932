"""Why a closed loop failed: the first cause along the loop, and what helps against it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.integrators import euler
from wmr_afl.simulation.closed_loop import ClosedLoop

SINGULAR = "the {}decoupling matrix is singular"
KEEP_AWAY = "keep away from where it is singular (wmr-afl show)"
BOUND = "bound the estimates"


def cause(loop: ClosedLoop, t: float, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> str:
    """Why a run fails at its first sample that is not sound, at time t [s].

    `signals` are those of this sample, `numbers` those of the robot, by name.
    """
    adapts = loop.law.adapts
    if not np.isfinite(signals["x"]).all():
        return f"the state is not finite: the loop diverged; {_remedy(loop, numbers)}"
    if not np.isfinite(signals["theta_hat"]).all():
        return f"the estimate is not finite: the adaptation diverged; {BOUND}, lower its gain or sample faster"
    if not all(np.isfinite(part).all() for part in loop.reference.over([t])):
        return "the reference, or a derivative of it, is not finite there; choose an expression that is smooth there"
    if not np.isfinite(signals["e"]).all():
        return "the output is not finite there"
    if "surprise" in signals and not signals["surprise"][0] < numbers["observer.bound"][0]:
        return _lost(loop, float(signals["surprise"][0]), numbers)
    if not signals["regularity"][0] > 0.0:
        when = " at the start" if t == 0.0 else ""
        if "error.rate" in numbers:  # a law that inverts no estimate
            return f"the output map E or the allocation R is singular{when}; {KEEP_AWAY}"
        return f"{SINGULAR.format('estimated ' if adapts else '')}{when}; {BOUND if adapts else KEEP_AWAY}"
    return f"the input is not finite: the loop diverged; {_remedy(loop, numbers)}"


def _lost(loop: ClosedLoop, surprise: float, numbers: Mapping[str, Floats]) -> str:
    """What is said of an observer that no longer follows its robot."""
    rate, bound = numbers["observer.rate"][0], numbers["observer.bound"][0]
    return (
        f"the observer is lost: a sample differs by {surprise:.3g} m or rad from what was expected, "
        f"its bound is {bound:g}; look at the guess, at delays and noise that are not told, and at the rate of the "
        f"observer, {rate:g} /s at samples of {loop.sample_time:g} s"
    )


def _remedy(loop: ClosedLoop, numbers: Mapping[str, Floats]) -> str:
    """What helps against divergence."""
    b1, b2 = _gains(numbers)
    growth = outer_loop_growth(b1, b2, loop.sample_time, loop.plant.integrator is euler)
    if np.any(growth >= 1.0):
        worst = int(np.argmax(growth))
        return (
            f"a sample time of {loop.sample_time:g} s is too long for b1 = {b1[worst]:g}, b2 = {b2[worst]:g}; "
            "sample faster or lower them"
        )
    if loop.law.adapts:
        return f"{BOUND}, lower the gains or sample faster"
    return "correct the estimates, lower the gains or sample faster"


def _gains(numbers: Mapping[str, Floats]) -> tuple[Floats, Floats]:
    """b1, b2 of (27), or of the law whose errors fade at one rate."""
    if "error.rate" in numbers:
        return 2.0 * numbers["error.rate"], numbers["error.rate"] ** 2
    return numbers["outer_loop.b1"], numbers["outer_loop.b2"]


def outer_loop_growth(b1: Floats, b2: Floats, step: float, by_euler: bool) -> Floats:
    """By what factor e'' + b1 e' + b2 e = 0 (33) changes from sample to sample if eta is held, (n-m,); stable below 1.

    By Euler's rule, as the paper integrates, or exactly.
    """
    squared = 0.0 if by_euler else 0.5 * step * step
    growth = [
        np.abs(np.linalg.eigvals([[1.0 - squared * b, step - squared * a], [-step * b, 1.0 - step * a]])).max()
        for a, b in zip(b1, b2, strict=True)
    ]
    return np.array(growth)
