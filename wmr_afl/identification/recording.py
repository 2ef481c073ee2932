"""A drive of a simulated robot as its logger would write it: encoders in steps, a gyroscope with noise, at its rate.

So that every step from a log to a controller can be rehearsed before there is a robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.integrate import simpson

from wmr_afl.errors import SimulationError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.log import Channel, Log, Segment, channel, usual_columns
from wmr_afl.identification.voltages import Voltages
from wmr_afl.model.model import Model
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.sampled_plant import SampledPlant
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.simulate import simulate

SUBSTEPS = 40  # of a sample: friction reverses in between, and angles of motors are integrals of their rates

Commands = Callable[[float, Floats], Floats]  # (t, x) -> u (n_u,) [V]


@dataclass(frozen=True)
class Sensors:
    """What is measured, and how exactly."""

    encoder: float = 2048.0  # steps of a motor's encoder a turn of what it drives; 0 for an exact angle
    joint: float = 4096.0  # steps of a joint's encoder a turn; 0 for an exact one
    gyro: float = 0.01  # [rad/s], standard deviation of a rate
    every: int = 1  # samples of the controller from one row to the next
    seed: int = 0
    measured: tuple[str, ...] = ()  # columns; encoders of motors, angles of joints and the rate of the heading if none

    def __post_init__(self) -> None:
        for name in ("encoder", "joint", "gyro"):
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise WmrError(f"{name} is {value:g}", "choose zero or more")
        if self.every < 1:
            raise WmrError(f"a row every {self.every} samples is no log", "choose 1 or more")


@dataclass(frozen=True)
class Drive:
    """A simulated robot at T samples, the voltages held between them."""

    model: Model
    p: Floats
    time: Floats  # (T,) [s]
    state: Floats  # (T, 2n-m)
    angles: Floats  # (T, n_u) [rad], of what the motors drive
    applied: Floats  # (T, n_u) [V]

    def log(self, sensors: Sensors, name: str = "") -> Log:
        """What a logger would write.

        Raises:
            UnknownNameError: if a measured column's name is unknown.
        """
        names = sensors.measured or tuple(usual_columns(self.model))
        channels = tuple(channel(self.model, one) for one in names)
        random, rows = np.random.default_rng(sensors.seed), slice(None, None, sensors.every)
        columns = [self._measured(one, sensors, random)[rows] for one in channels]
        step = float(self.time[1] - self.time[0]) * sensors.every
        z = np.column_stack(columns)
        segment = Segment(name, 0.0, step, self.applied[rows], z, np.ones(z.shape, dtype=bool))
        return Log(self.model, channels, (segment,), np.zeros(len(channels)))

    def _measured(self, one: Channel, sensors: Sensors, random: np.random.Generator) -> Floats:
        n = self.model.coordinate_count
        q, v = self.state[:, :n], self.state[:, n:]
        if one.matrix == "velocity":
            return v[:, one.index]
        if one.is_rate:
            term = self.model.actuator_rates_matrix if one.matrix == "motor" else self.model.kinematic_matrix
            rate = np.einsum("ti,ti->t", np.asarray(term(q, self.p))[:, one.index], v)
            return np.asarray(rate + sensors.gyro * random.standard_normal(len(rate)))
        exact, steps = (self.angles, sensors.encoder) if one.matrix == "motor" else (q, sensors.joint)
        is_angle = one.matrix == "motor" or list(self.model.state_units.values())[one.index] == "rad"
        column = exact[:, one.index]
        if not steps or not is_angle:
            return np.asarray(column)
        quantum = 2.0 * np.pi / steps
        return np.asarray(np.floor(column / quantum) * quantum)


def drive(loop: ClosedLoop, commands: Commands, samples: int, substeps: int = SUBSTEPS) -> Drive:
    """The robot of a closed loop under other commands; friction, limits and disturbances are the loop's.

    A sample is integrated in `substeps`, unless something of the drive goes by whole samples.

    Raises:
        SimulationError: if the motion grows without bound.
    """
    sampled = SampledPlant(loop)
    step, n = loop.sample_time, len(sampled.model.state_units)
    substeps = 1 if sampled.counts_samples else substeps
    z, values, h = sampled.start, sampled.values.pack(loop.plant.values), step / substeps
    one, applied = sampled.traced(), _applied(sampled)
    many = _repeated(one, substeps, sampled.states.size, sampled.values.size, len(sampled.model.input_units))
    states, voltages = [z[None]], []
    for k in range(samples):
        t, x = k * step, z[:n]
        u = np.asarray(commands(t, x), dtype=float)
        voltages.append(np.asarray(applied(z, u, values)).ravel())
        states.append(np.asarray(many(z, u, t + h * np.arange(substeps), h, values)).T)
        z = states[-1][-1]
        if not np.all(np.isfinite(z)):
            raise SimulationError(f"the motion grows without bound at t = {t:g} s", "choose lower voltages")
    every = np.concatenate(states)[:, :n]
    model, p = sampled.model.in_library("numpy"), loop.plant.parameters
    q, v = every[:, : model.coordinate_count], every[:, model.coordinate_count :]
    rates = np.einsum("tij,tj->ti", np.broadcast_to(model.actuator_rates_matrix(q, p), (len(q), len(u), v.shape[1])), v)
    within = sliding_window_view(rates, substeps + 1, axis=0)[::substeps]  # of each sample, both its ends with it
    turned = np.cumsum(simpson(within, dx=h, axis=-1), axis=0)
    angles = np.concatenate([np.zeros((1, len(u))), turned[:-1]])
    time = np.asarray(step * np.arange(samples), dtype=float)
    return Drive(model, p, time, every[:-1:substeps], angles, np.array(voltages))


def _applied(sampled: SampledPlant) -> ca.Function:
    """(states, commands, values) -> the voltages that reach the motors."""
    model = sampled.model.in_library("casadi")
    z, u = ca.SX.sym("states", sampled.states.size), ca.SX.sym("commands", len(model.input_units))
    numbers = ca.SX.sym("values", sampled.values.size)
    k = sampled.values.unpack_symbols(numbers)
    result = sampled.plant.applied(u, sampled.states.unpack_symbols(z), k, model.arrays)
    return ca.Function("applied", [z, u, numbers], [ca.densify(ca.SX(result))])


def _repeated(one: ca.Function, count: int, states: int, values: int, inputs: int) -> ca.Function:
    """(states, voltages, times, step, values) -> the states after each of `count` steps, side by side."""
    z, u, t = ca.MX.sym("states", states), ca.MX.sym("voltages", inputs), ca.MX.sym("times", count)
    step, numbers = ca.MX.sym("step"), ca.MX.sym("values", values)
    found, now = [], z
    for k in range(count):
        now = one(now, u, t[k], step, numbers)
        found.append(now)
    return ca.Function("repeated", [z, u, t, step, numbers], [ca.horzcat(*found)])


@checked
def record(
    experiment: str | Path,
    *,
    controller: str | None = None,
    commands: Commands | None = None,
    seconds: float | None = None,
    sensors: Sensors | None = None,
) -> Log:
    """Record a run of an experiment, or a drive of its robot under other voltages, as its logger would.

    Without `commands` the named controller (the first one if none is named) drives for the experiment's duration;
    `Voltages`, as `excite` proposes them or `read_voltages` reads them, are played to their end.

    Raises:
        UnknownNameError: if there is no such experiment, controller or column.
        SimulationError: if the run fails, or the motion grows without bound.
    """
    loaded = load_experiment(experiment)
    loop = loaded.loops[loaded.name(controller)]
    # A log is one of a robot, not of Euler's method.
    loop = replace(loop, plant=loop.plant.integrated(loop.model, "rk4"))
    duration = loaded.experiment.simulation.duration if seconds is None else seconds
    if seconds is None and isinstance(commands, Voltages):
        duration = float(commands.time[-1])
    samples = round(duration / loop.sample_time)
    if not 2 <= samples <= 10_000_000:
        raise WmrError(f"a log of {duration:g} s has {samples} samples", "choose a duration of some samples")
    if commands is None:
        run = simulate(loop, duration, name=loaded.name(controller))
        if run.failure is not None:
            raise SimulationError(f"{run.controller} {run.failure}", "record another one")
        given = run.command

        def commands(t: float, x: Floats) -> Floats:
            return np.asarray(given[round(t / loop.sample_time)])

        samples = min(samples, len(given))
    return drive(loop, commands, samples).log(sensors or Sensors())
