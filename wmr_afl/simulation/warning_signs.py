"""What makes a run doubtful that did not fail: saturated motors, estimates that drift or lie at their bounds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from wmr_afl.controllers.outer_loop import within_half_a_turn
from wmr_afl.controllers.tables import OBSERVER_SHARE, SHARE
from wmr_afl.model.grip import FLOOR, friction_along, has_grip
from wmr_afl.numerics.arrays import NUMPY, Floats
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.conditions import Condition

OFTEN = 0.05  # share of samples from which limits shape a run instead of cutting off its start
GROWN = 30.0  # times the largest first estimate, or true value: no estimate that means anything gets there
FAR_BEYOND = 2.0  # times the usual rate: its poles are too fast for the samples
STUCK = 0.5  # share of the last samples at a bound: the bound tells the estimate, not the robot
AT_STOP = 1e-3  # [rad]
WRONG = 0.1  # [m, rad], by which an observed coordinate is off that is not just noisy
LOOKED_AT = 600  # samples at which forces are told, densest at the start, where they are largest
FAR = 1e9  # [m, rad; m/s, rad/s], where a run has long diverged
LATE = 2.0 / 7.0  # the end of a run, in which it should have settled


def warning_signs(
    loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats], conditions: Iterable[Condition]
) -> tuple[str, ...]:
    """One line for each sign, with a remedy; `signals` (T, ...) and `numbers` of the robot, by name."""
    if not len(signals["x"]):
        return ()
    estimates = _estimates(loop, signals, numbers) if loop.law.adapts else ()
    broken = (
        f"{one.statement} is broken at the start ({one.at_start:.3g}, the bound is {one.bound:.3g}); {one.remedy}"
        for one in conditions
        if not one.at_start < one.bound
    )
    seen = (*_inputs(loop, signals, numbers), *_joints(loop, signals, numbers), *_rates(loop, numbers))
    seen = (*seen, *_grip(loop, signals, numbers), *_observed(loop, signals))
    return (*seen, *estimates, *broken)


def _inputs(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    volts = numbers.get("input_limits.volts")
    if volts is None:
        return
    share = float(np.mean(np.any(np.abs(signals["u"]) >= volts, axis=1)))
    if share > OFTEN:
        remedy = "follow a slower reference, start closer to it, or lower the gains"
        yield f"a motor is at its limit in {share:.0%} of the samples; {remedy}"


def _grip(loop: ClosedLoop, signals: Mapping[str, Floats], numbers: Mapping[str, Floats]) -> Iterator[str]:
    x = signals["x"][np.cumprod(np.abs(signals["x"]).max(axis=1) < FAR, dtype=bool)]
    if not has_grip(loop.model) or len(x) < 2:
        return
    k = np.unique(((len(x) - 2) * np.linspace(0.0, 1.0, LOOKED_AT) ** 2).astype(int))
    needed = friction_along(loop.model, x[k], x[k + 1], signals["u"][k], numbers["p"], loop.sample_time)
    sample, wheel = np.unravel_index(int(np.argmax(needed)), needed.shape)
    if needed[sample, wheel] > FLOOR:
        what = f"wheel {list(loop.model.metadata['geometry']['wheels'])[wheel]} would need a friction of"
        when = f"{needed[sample, wheel]:.2g} at {k[sample] * loop.sample_time:g} s"
        remedy = "start on the reference, follow a slower one, or lower the gains"
        yield f"{what} {when}, a dry floor has {FLOOR:g}; {remedy}"


def _rates(loop: ClosedLoop, numbers: Mapping[str, Floats]) -> Iterator[str]:
    if not loop.law.observes:
        return
    usual = {"observer.rate": OBSERVER_SHARE, "error.rate": SHARE}
    for name, share in usual.items():
        rate, bearable = numbers.get(name), share / loop.sample_time
        if rate is not None and rate[0] > FAR_BEYOND * bearable:
            what = "observer" if name == "observer.rate" else "loop"
            figures = f"the rate of the {what} is {rate[0]:g} /s, at samples of {loop.sample_time:g} s"
            yield f"{figures} {bearable:g} /s is usual; choose that, or sample faster"


def _observed(loop: ClosedLoop, signals: Mapping[str, Floats]) -> Iterator[str]:
    """What an observer takes for true and is not: a simulation knows."""
    if "observed" not in signals or loop.law.measurement is None:
        return
    late, names = slice(int((1.0 - LATE) * len(signals["x"])), None), list(loop.model.state_units)
    for index in sorted(set(range(loop.model.coordinate_count)) - set(loop.law.measurement.coordinates)):
        off = signals["observed"][late, index] - signals["x"][late, index]
        if loop.model.state_units[names[index]] == "rad":
            off = within_half_a_turn(off, NUMPY)
        usual = float(np.median(np.abs(off)))
        if usual > WRONG:
            unit = loop.model.state_units[names[index]]
            remedy = f"measure it, or tell where it is at the start (observer.first = {{ {names[index]} = ... }})"
            yield f"{names[index]} as observed is off by {usual:.2g} {unit} at the end; {remedy}"


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
    wider = "raise learning.box" if "direct.inertia" in numbers else "widen its bounds"
    outside = np.flatnonzero(~((low <= truth) & (truth <= high)))
    if len(outside):
        first = outside[0]
        others = f" and the values of {', '.join(names[i] for i in outside[1:])}" if len(outside) > 1 else ""
        excluded = f"{names[first]} = {truth[first]:.3g}{others}"
        yield f"the bounds {low[first]:g} to {high[first]:g} exclude {excluded} of this robot; {wider}"
    sizes, usual = np.abs(estimate).max(axis=0), np.maximum(np.abs(estimate[0]), np.abs(truth))
    worst = int(np.argmax(sizes / np.maximum(usual, np.abs(truth).max() * 1e-3)))
    if sizes[worst] > GROWN * max(usual[worst], np.abs(truth).max() * 1e-3):
        remedy = "bound the estimates, add leakage or lower the adaptation gain"
        if loop.law.knowledge.estimated == "passivity_parameters":
            remedy = "guess closer, lower learning.box or raise learning.noise"
        yield f"the estimate of {names[worst]} grew from {estimate[0, worst]:.3g} to {sizes[worst]:.3g}; {remedy}"
    if "unexplained" in signals:
        left, noise = float(signals["unexplained"][-1, 0]), float(numbers["least_squares.noise"][0])
        if left > noise:
            remedy = f"deviations promise too much; choose learning.noise = {left:.2g}"
            yield f"the equation of motion leaves {left:.2g} V s^1/2 unexplained, {noise:g} was expected: {remedy}"
    late = estimate[int((1.0 - LATE) * len(estimate)) :]
    for index, name in enumerate(names):
        share = float(np.mean((late[:, index] <= low[index]) | (late[:, index] >= high[index])))
        if share > STUCK:
            yield f"the estimate of {name} lies at its bound in {share:.0%} of the last samples; {wider}"
