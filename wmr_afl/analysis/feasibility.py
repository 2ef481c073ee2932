"""Whether a robot can follow a reference: what its motors would need if everything were known and nothing disturbed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wmr_afl.controllers.outer_loop import OuterLoopTable
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.tables import ControllerTable
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.model.grip import FLOOR, friction_along, has_grip
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.order import UncertaintiesTable
from wmr_afl.simulation.closed_loop import ClosedLoop, sample_times
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate

RATE = 10.0  # [1/s] of the law that knows everything, or a fifth of 1/(sample time) where that is less
SETTLED = 5.0  # time constants of the reference model, after which the robot is where the reference wants it
JOINED = 10.0  # time constants, after which what joining took of friction is gone
JUMP = 1e-2  # [m, rad], and of velocities [m/s, rad/s]: more within a sample than derivatives tell is a jump
MOST = 4  # of a kind are told one by one
BEND = 0.2  # of the change that derivatives tell, which a curve may differ from it within a sample


@dataclass(frozen=True)
class Doubt:
    """Something that the robot cannot follow."""

    what: str
    first: float  # [s]
    last: float  # [s]

    def __str__(self) -> str:
        when = f"at {self.first:g} s" if self.first == self.last else f"between {self.first:g} s and {self.last:g} s"
        return f"{self.what} {when}"


@dataclass(frozen=True)
class Demand:
    """What following needs."""

    volts: dict[str, float]  # the largest of each motor [V], once the robot is on its way
    limits: dict[str, float]  # [V], infinite where there is none
    doubts: tuple[Doubt, ...]
    friction: dict[str, float] = field(default_factory=dict)  # the largest share of its load that each wheel needs
    since: float = 0.0  # [s], from when on friction is judged: before, the law comes from where the robot starts


def demand(experiment: Experiment, path: Path, reference: Reference | None = None) -> Demand:
    """What the reference of the experiment in `path` asks of its robot, with true parameters and undisturbed.

    `reference` takes the place of the experiment's.

    Raises:
        InputError: if the experiment does not fit its robot.
    """
    loop = _knowing(experiment, path)
    loop = loop if reference is None else replace(loop, reference=reference)
    motors = list(loop.model.input_units)
    least, most = _limits(experiment.uncertainties, len(motors))
    run = simulate(loop, experiment.simulation.duration, "exact", "casadi")
    late = run.time >= SETTLED / _rate(experiment)
    lowest, highest = run.command[late].min(axis=0, initial=0.0), run.command[late].max(axis=0, initial=0.0)
    is_below = (lowest / least > highest / most) | ((lowest / least == highest / most) & (-lowest > highest))
    needed, bounds = np.where(is_below, -lowest, highest), np.where(is_below, -least, most)
    doubts = [*_jumps(loop.reference, sample_times(loop, experiment.simulation.duration))]
    since, end = JOINED / _rate(experiment), float(run.time.max(initial=0.0))  # a run may fail at its first sample
    if run.failure is None and end < since:
        what = f"nothing of the reference is judged, for a law takes {since:g} s to come to it: let it last longer,"
        doubts.append(Doubt(what, 0.0, end))
    doubts += [*_beyond(run, late, (least, most), motors)]
    friction = _friction(run, loop.sample_time)
    friction[run.time[: len(friction)] < since] = 0.0
    wheels = list(loop.model.metadata["geometry"]["wheels"]) if len(friction) and end >= since else []
    doubts += [*_slips(friction, run.time, wheels)]
    if run.failure is not None:
        doubts.append(Doubt(f"{run.failure.cause},", run.failure.time, run.failure.time))
    doubts += [Doubt(warning, 0.0, end) for warning in run.warnings if "at its stop" in warning]
    return Demand(
        dict(zip(motors, needed.tolist(), strict=True)),
        dict(zip(motors, bounds.tolist(), strict=True)),
        tuple(doubts),
        dict(zip(wheels, friction.max(axis=0, initial=0.0).tolist(), strict=False)),
        since,
    )


def _rate(experiment: Experiment) -> float:
    return min(RATE, 0.2 / experiment.simulation.sample_time)


def _knowing(experiment: Experiment, path: Path) -> ClosedLoop:
    """The loop of a law that knows the robot and meets nothing that disturbs it."""
    rate = _rate(experiment)
    passive = ControllerTable(law="frozen", rate=rate, reference_rate=rate)
    linearizing = ControllerTable(outer_loop=OuterLoopTable(bandwidth=rate), reference_rate=rate)
    changes = {"uncertainties": UncertaintiesTable(), "shared": ControllerTable(), "campaign": None}
    quiet = experiment.model_copy(update={**changes, "controllers": {"exact": linearizing}})
    loop = assemble(quiet, path)["exact"]
    if not loop.model.has("passivity_regressor"):
        return loop
    return assemble(quiet.model_copy(update={"controllers": {"exact": passive}}), path)["exact"]


def _jumps(reference: Reference, times: Floats) -> Iterator[Doubt]:
    """Where the reference, or its velocity, moves by more than its derivatives tell, which may jump themselves."""
    step = np.diff(times)[:, None]
    parts = reference.over(times)
    for name, value, rate in (("the reference", *parts[:2]), ("the velocity of the reference", *parts[1:])):
        moved, least, most = np.diff(value, axis=0), *np.sort([step * rate[:-1], step * rate[1:]], axis=0)
        off = np.maximum(np.maximum(least - moved, moved - most), 0.0)
        where = np.flatnonzero((off > JUMP + BEND * np.maximum(np.abs(least), np.abs(most))).any(axis=1))
        for index in where[:MOST]:
            yield Doubt(f"{name} jumps by {off[index].max():.3g}", float(times[index + 1]), float(times[index + 1]))


def _limits(uncertainties: UncertaintiesTable, motors: int) -> tuple[Floats, Floats]:
    """What each motor gets at least and at most [V], of what software and drive allow; infinite without limits."""
    least, most = np.full(motors, -np.inf), np.full(motors, np.inf)
    if uncertainties.input_limits is not None:
        volts = np.broadcast_to(uncertainties.input_limits.volts, motors)
        least, most = np.maximum(least, np.negative(volts)), np.minimum(most, volts)
    if uncertainties.command_limits is not None:
        table = uncertainties.command_limits
        lowest = np.negative(table.most) if table.least is None else table.least
        least = np.maximum(least, np.broadcast_to(lowest, motors))
        most = np.minimum(most, np.broadcast_to(table.most, motors))
    return least, most


def _beyond(run: Run, late: NDArray[np.bool_], limits: tuple[Floats, Floats], motors: list[str]) -> Iterator[Doubt]:
    """Each stretch of time in which a motor would need more than it has; stretches closer than a second are one."""
    for index, name in enumerate(motors):
        u, (least, most) = run.command[:, index], (one[index] for one in limits)
        stretches = _stretches(late & ((u > most) | (u < least)), run.time)
        for stretch in stretches[:MOST]:
            farthest = u[stretch][np.argmax(np.maximum(u[stretch] / most, u[stretch] / least))]
            what = f"{name} would need up to {abs(farthest):.3g} V of {most if farthest > 0 else -least:g} V"
            yield Doubt(what, float(run.time[stretch[0]]), float(run.time[stretch[-1]]))
        if len(stretches) > MOST:
            first, last = stretches[MOST][0], stretches[-1][-1]
            yield Doubt(f"{name} {len(stretches) - MOST} times more,", float(run.time[first]), float(run.time[last]))


def _friction(run: Run, step: float) -> Floats:
    """The share of its load that each wheel needs at each sample, (T-1, wheels); empty if forces cannot be told."""
    if not has_grip(run.model) or len(run.time) < 2:
        return np.zeros((0, 0))
    return friction_along(run.model, run.state[:-1], run.state[1:], run.input[:-1], run.parameters, step)


def _slips(friction: Floats, time: Floats, wheels: list[str]) -> Iterator[Doubt]:
    """Each stretch of time in which a wheel would need more friction than floors have."""
    for index, name in enumerate(wheels):
        needed = friction[:, index]
        for stretch in _stretches(needed > FLOOR, time)[:MOST]:
            what = (
                f"wheel {name} would need a friction of up to {needed[stretch].max():.2g}, a dry floor has {FLOOR:g}: "
                "follow a slower reference, or one that turns less sharply,"
            )
            yield Doubt(what, float(time[stretch[0]]), float(time[stretch[-1]]))


def _stretches(where: NDArray[np.bool_], time: Floats) -> list[NDArray[np.int_]]:
    """The samples of each stretch of time, those closer than a second being one."""
    samples = np.flatnonzero(where)
    if not len(samples):
        return []
    return np.split(samples, np.flatnonzero(np.diff(time[samples]) > 1.0) + 1)
