"""Running a closed loop from its start to its end, or to its failure."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping

import numpy as np

from wmr_afl.errors import SimulationError
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.measurement_noise import normal_samples
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times
from wmr_afl.simulation.conditions import conditions
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.failures import cause
from wmr_afl.simulation.layout import Layout
from wmr_afl.simulation.result import Failure, Run
from wmr_afl.simulation.steppers import Stepper, stepper
from wmr_afl.simulation.warning_signs import warning_signs

# The cause of a failure by the first signal that shows it, in the order from cause to effect.
_CAUSES = {
    "x": "the state is not finite: the loop diverged",
    "theta_hat": "the estimate is not finite",
    "e": "the reference or the output is not finite there",
    "regularity": "the estimated decoupling matrix is singular; bound the estimates",
    "command": "the input is not finite: the loop diverged; bound the estimates, lower the gains or sample faster",
}
Progress = Callable[[int], None]  # called with the number of samples that were done


class SimulationWarning(UserWarning):
    """A run ended before its time."""


def simulate(
    loop: ClosedLoop,
    duration: float,
    name: str = "",
    backend: str | Stepper = "auto",
    progress: Progress = lambda done: None,
    robot: Ensemble | None = None,
) -> Run:
    """Run `loop` for `duration` [s], as it is or with the numbers of one `robot`.

    A singular Dhat or a state that is not finite ends the run: it keeps what was computed up to there, names time and
    cause in `failure`, and a SimulationWarning is given.

    Raises:
        SimulationError: if the run is shorter than a sample.
        UnknownNameError: if there is no such backend.
    """
    if loop.sample_time > duration:
        problem = f"a sample of {loop.sample_time:g} s is longer than the run of {duration:g} s"
        raise SimulationError(problem, "choose a shorter sample or a longer run")
    times, signals = sample_times(loop, duration), loop.signal_layout
    robot = robot or _as_it_is(loop)
    noise = normal_samples(robot.generator(0), len(times), loop.plant.samples) if loop.plant.samples else None
    numbers = Layout(loop.values).unpack(robot.values[:, 0])
    blocks, done, failure = [], 0, None
    with np.errstate(all="ignore"):  # `_failure` looks for what is not finite
        for chunk in stepper(backend)(loop, robot, times, noise):
            blocks.append(chunk.rows)
            failure = None if chunk.is_sound else _failure(chunk.rows, times[done:], loop, numbers)
            done = done + len(chunk.rows) if failure is None else int(np.searchsorted(times, failure.time))
            progress(len(chunk.rows))
            if failure is not None:
                warnings.warn(f"{name or loop.model.name} {failure}", SimulationWarning, stacklevel=2)
                break
    rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    logged = {signal: rows[:done, place] for signal, place in signals.places.items()}
    found = tuple(conditions(loop, logged, numbers))
    return Run(
        controller=name,
        model=loop.model,
        time=times[:done],
        state=logged["x"],
        input=logged["u"],
        command=logged["command"],
        error=logged["e"],
        estimate=logged["theta_hat"],
        deviation=logged.get("deviation"),
        unexplained=logged["unexplained"][:, 0] if "unexplained" in logged else None,
        observed=logged.get("observed"),
        unexpected=logged.get("unexpected"),
        surprise=None if "surprise" not in logged else logged["surprise"][:, 0],
        slip=logged.get("slip"),
        slip_true=logged.get("slip_true"),
        slip_names=loop.law.slip_names,
        reference=logged["reference"],
        parameters=numbers["p"].copy(),
        known=numbers["c"].copy(),
        estimated=loop.law.knowledge.estimated,
        failure=failure,
        conditions=found,
        warnings=warning_signs(loop, logged, numbers, found),
    )


@functools.lru_cache(maxsize=32)
def _as_it_is(loop: ClosedLoop) -> Ensemble:
    return Ensemble.of([loop])


def _failure(rows: Floats, times: Floats, loop: ClosedLoop, numbers: Mapping[str, Floats]) -> Failure | None:
    """The failure at the first sample that is singular or not finite; None if there is none."""
    signals = loop.signal_layout
    sound = np.isfinite(rows).all(axis=1) & (rows[:, signals.places["regularity"].start] > 0.0)
    if sound.all():
        return None
    first = int(np.argmin(sound))
    time = float(times[first])
    return Failure(time, cause(loop, time, signals.unpack(rows[first]), numbers))
