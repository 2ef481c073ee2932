"""What makes a run doubtful that did not fail: saturated motors, estimates that drift or lie at their bounds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from wmr_afl.controllers.direct_adaptation import guessed_inertia
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop

OFTEN = 0.05  # share of samples from which limits shape a run instead of cutting off its start
GROWN = 30.0  # times the largest first estimate, or true value: no estimate that means anything gets there
STUCK = 0.5  # share of the last samples at a bound: the bound tells the estimate, not the robot
AT_STOP = 1e-3  # [rad]
LATE = 2.0 / 7.0  # the end of a run, in which it should have settled


def warning_signs(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> tuple[str, ...]:
    """One line for each sign, with a remedy; `signals` (T, ...) and `numbers` of the robot, by name."""
    if not len(signals["x"]):
        return ()
    estimates = _estimates(loop, signals, numbers) if loop.law.adapts else ()
    return (*_inputs(loop, signals, numbers), *_joints(loop, signals, numbers), *estimates)


def _inputs(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    volts = numbers.get("input_limits.volts")
    if volts is None:
        return
    share = float(np.mean(np.any(np.abs(signals["u"]) >= volts, axis=1)))
    if share > OFTEN:
        remedy = "follow a slower reference, start closer to it, or lower the gains"
        yield f"a motor is at its limit in {share:.0%} of the samples; {remedy}"


def _joints(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    model = loop.model.in_library("numpy")
    if not model.has("joint_stops"):
        return
    left = np.asarray(model.joint_stops(signals["x"][:, : model.coordinate_count], numbers["p"]))
    share = float(np.mean(left.min(axis=1) < AT_STOP))
    if share > 0.0:
        yield f"a joint is at its stop in {share:.1%} of the samples; follow a reference that turns less sharply"


def _estimates(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    names, estimate = list(loop.law.knowledge.units), signals["theta_hat"]
    truth = loop.law.knowledge.truth(numbers["p"])
    low = numbers.get("projection.lower", np.full(len(names), -np.inf))
    high = numbers.get("projection.upper", np.full(len(names), np.inf))
    outside = np.flatnonzero(~((low <= truth) & (truth <= high)))
    if len(outside):
        first = outside[0]
        others = f" and the values of {', '.join(names[i] for i in outside[1:])}" if len(outside) > 1 else ""
        excluded = f"{names[first]} = {truth[first]:.3g}{others}"
        yield f"the bounds {low[first]:g} to {high[first]:g} exclude {excluded} of this robot; widen them"
    sizes, usual = np.abs(estimate).max(axis=0), np.maximum(np.abs(estimate[0]), np.abs(truth))
    worst = int(np.argmax(sizes / np.maximum(usual, np.abs(truth).max() * 1e-3)))
    if sizes[worst] > GROWN * max(usual[worst], np.abs(truth).max() * 1e-3):
        remedy = "bound the estimates, add leakage or lower the adaptation gain"
        yield f"the estimate of {names[worst]} grew from {estimate[0, worst]:.3g} to {sizes[worst]:.3g}; {remedy}"
    late = estimate[int((1.0 - LATE) * len(estimate)) :]
    for index, name in enumerate(names):
        share = float(np.mean((late[:, index] <= low[index]) | (late[:, index] >= high[index])))
        if share > STUCK:
            yield f"the estimate of {name} lies at its bound in {share:.0%} of the last samples; widen its bounds"
    if "direct.inertia" in numbers:
        yield from _guessed_inertia(loop, signals, numbers, truth)
    if "adaptation.Gamma" in numbers:
        yield from _step_size(loop, signals, numbers)


def _guessed_inertia(
    loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats], truth: Floats
) -> Iterator[str]:
    """In steps of dt direct adaptation lessens the energy only if kappa dt N0/N < 2 - lambda dt."""
    model = loop.model.in_library("numpy")
    inertia = guessed_inertia(model, signals["x"][0], truth, numbers["c"])
    times = float(np.max(numbers["direct.inertia"] / inertia))
    step = loop.sample_time
    speed, room = numbers["direct.gain"][0] * step * times, 2.0 - numbers["error.rate"][0] * step
    if not speed < room:
        figures = f"{times:.3g} times too large: {speed:.3g} is not below {room:.3g}"
        yield f"the guess has an inertia {figures}; guess a smaller one, sample faster or lower the rate"


def _step_size(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    """In steps of dt the law (25) lessens the Lyapunov function (43) only if dt eig_max(W Gamma W^T) < alpha."""
    model = loop.model.in_library("numpy")
    Gamma = numbers["adaptation.Gamma"]
    gain = np.diag(Gamma) if Gamma.ndim == 1 else Gamma
    with np.errstate(all="ignore"):  # far away W Gamma W^T overflows: faster than any sample
        W = np.asarray(model.regressor(signals["x"][0], signals["command"][0], numbers["c"]))
        change = W @ gain @ W.T
    speed = loop.sample_time * float(np.linalg.eigvalsh(change).max()) if np.isfinite(change).all() else np.inf
    alpha = float(numbers["outer_loop.alpha"].min())
    if speed > alpha:
        remedy = "sample faster, lower the adaptation gain, or start closer to the reference"
        figures = f"{speed:.3g} 1/s, alpha is {alpha:.3g}"
        yield f"the adaptation is too fast for the sample time at the start ({figures}); {remedy}"
