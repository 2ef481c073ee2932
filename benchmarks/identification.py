"""`python -m benchmarks.identification [--seeds 20] [--page docs/identification.md]`: what a log tells.

Synthetic logs of ten robots: 60 s of multisine voltages, 20 ms, encoders of 2048 steps a turn, joints of 4096, a
gyroscope with 0.01 rad/s of noise, Coulomb friction of 6 % of the amplitude that holds a motor at rest. Seeds are
fresh. Beside it stands naive least squares: differences of what was measured, put into the same equation.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log, log_of
from wmr_afl.identification.recording import Commands, Drive, Sensors, drive
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value
from wmr_afl.plant.friction import Friction
from wmr_afl.plant.plant import Plant

FREQUENCIES = (0.05, 0.08, 0.13, 0.21, 0.34, 0.55, 0.89, 1.44, 2.33)  # [Hz]
SLOW = (0.05, 0.11, 0.23, 0.41)  # [Hz], of angles that are followed
FRICTION = 0.06  # of a motor's amplitude
SECONDS, OTHER = 60.0, 30.0  # [s], of the log and of the one on which voltages are foretold
STEP = 0.02  # [s]
FINE = 200  # steps of a sample: with 40, what friction does between them bends numbers by twice their intervals
FLAGGED = 5.0  # per cent, beyond which a number has to be flagged


@dataclass(frozen=True)
class Plan:
    """How a robot is driven: volts and a constant for each motor, and angles that steering motors follow."""

    volts: Mapping[str, float]
    offset: Mapping[str, float] = field(default_factory=dict)
    steering: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)  # joint, gain [V/rad], angle [rad]


TWO = {"u_r": 4.0, "u_l": 4.0}
PLANS = {
    "type_2_0": Plan({"u_r": 10.0, "u_l": 10.0}),
    "type_2_0_caster": Plan({"u_r": 6.0, "u_l": 6.0}, TWO),
    "type_2_1": Plan(
        {"u_drive": 8.0, "u_steer": 2.0, "u_caster": 8.0}, {"u_drive": 4.0}, {"u_steer": ("beta", 20.0, 0.6)}
    ),
    "type_3_0": Plan(dict.fromkeys(("u_1", "u_2", "u_3"), 8.0)),
    "type_1_1": Plan({"u_drive": 8.0, "u_steer": 2.0}, {"u_drive": 4.0}, {"u_steer": ("beta", 20.0, 0.6)}),
    "type_1_2": Plan(
        {"u_drive": 8.0, "u_front": 2.0, "u_rear": 2.0}, {"u_drive": 4.0},
        {"u_front": ("beta1", 20.0, 0.6), "u_rear": ("beta2", 20.0, 0.6)},
    ),
    "car": Plan({"u_drive": 12.0, "u_steer": 2.0}, {"u_drive": 8.0}, {"u_steer": ("beta", 30.0, 0.4)}),
    "tractor_trailer": Plan(TWO, {"u_r": 8.0, "u_l": 8.0}),
    "tractor_3_trailers": Plan(TWO, {"u_r": 8.0, "u_l": 8.0}),
    "mecanum": Plan(dict.fromkeys(("u_fl", "u_fr", "u_rl", "u_rr"), 8.0)),
}  # fmt: skip


def multisine(random: np.random.Generator, frequencies: tuple[float, ...]) -> tuple[Floats, Floats, Floats]:
    """Amplitudes of a sum that rarely exceeds one, frequencies [rad/s] and phases."""
    size = 1.0 / np.sqrt(np.arange(1, len(frequencies) + 1))
    size /= 1.8 * np.sqrt(0.5 * np.sum(size**2))
    return size, 2.0 * np.pi * np.array(frequencies), random.uniform(0.0, 2.0 * np.pi, len(frequencies))


def commands_of(robot: str, seed: int) -> Commands:
    """Voltages of a plan: multisines, and a loop around each angle that is followed."""
    plan, random, loop = PLANS[robot], np.random.default_rng(seed), load_experiment(f"track_{robot}").loops
    model = next(iter(loop.values())).model
    names = list(model.state_units)
    own = {motor: multisine(random, FREQUENCIES) for motor in model.input_units}
    followed = {motor: multisine(random, SLOW) for motor in plan.steering}

    def wave(parts: tuple[Floats, Floats, Floats], t: float) -> float:
        size, rate, phase = parts
        return float(size @ np.sin(rate * t + phase))

    def commands(t: float, x: Floats) -> Floats:
        u = []
        for motor in model.input_units:
            volts = plan.volts[motor] * wave(own[motor], t) + plan.offset.get(motor, 0.0)
            if motor in plan.steering:
                joint, gain, angle = plan.steering[motor]
                volts += gain * (angle * wave(followed[motor], t) - x[names.index(joint)])
            u.append(volts)
        return np.array(u)

    return commands


def driven(
    robot: str, seed: int, seconds: float, substeps: int = FINE, step: float = STEP, rows: Floats | None = None
) -> Drive:
    """A drive of a robot from rest, with friction at its motors; voltages change at each `step` [s], or at `rows`."""
    loop = next(iter(load_experiment(f"track_{robot}").loops.values()))
    model, plan = loop.model, PLANS[robot]
    p = model.parameters()
    values = dict(zip(model.parameter_units, p, strict=True))
    gains = [float(numpy_value(motor["torque_gain"], values)) for motor in model.metadata["motors"].values()]
    coulomb = [FRICTION * plan.volts[motor] * gain for motor, gain in zip(model.input_units, gains, strict=True)]
    plant = Plant(model, p, np.zeros(len(model.state_units)), "rk4", [Friction(model, 0.0, coulomb, "wheels")])
    commands, loop = commands_of(robot, seed), dataclasses.replace(loop, plant=plant, sample_time=step)
    return drive(loop, commands if rows is None else held(commands, step, rows), round(seconds / step), substeps)


def held(commands: Commands, step: float, rows: Floats) -> Commands:
    """The same, held from one of the `rows` (steps of a drive) to the next."""
    now, last = set(rows.tolist()), np.empty(0)

    def kept(t: float, x: Floats) -> Floats:
        nonlocal last
        if round(t / step) in now:
            last = commands(t, x)
        return last

    return kept


def truth(robot: str, effort: Effort) -> Floats:
    """What is to be found, friction in volts."""
    motors = list(effort.model.input_units)
    friction = [FRICTION * PLANS[robot].volts[motors[group[0]]] for group in effort.friction_groups.values()]
    return np.concatenate([effort.base(effort.p), friction])


def naive(effort: Effort, log: Log) -> Floats:
    """Least squares of the same equation with differences of what was measured, nothing smoothed."""
    from wmr_afl.identification.motion import Smoother
    from wmr_afl.identification.noise import standard_deviations

    smoother = Smoother(effort, log.channels, standard_deviations(log), width=0.0, least=1)
    motion = smoother.motion(log.segments[0])
    x, u = motion.x[motion.ok], motion.u[motion.ok]
    a = np.gradient(x[:, effort.n :], log.segments[0].step, axis=0)
    regressor = np.asarray(effort.model.effort_regressor(x, a, effort.c))
    r = np.asarray(effort.model.effort_map(x[:, : effort.n], effort.c))
    sign = np.tanh(effort.rates(x) / 0.1)
    friction = np.stack([(r * sign[:, None])[..., group].sum(-1) for group in effort.friction_groups.values()], -1)
    matrix = np.concatenate([regressor, friction], axis=-1).reshape(-1, len(effort.units))
    return np.asarray(np.linalg.lstsq(matrix, np.einsum("tij,tj->ti", r, u).ravel(), rcond=None)[0])


@dataclass(frozen=True)
class Errors:
    """How far an estimate is off [%]."""

    u: float  # of the voltages that bring about another drive
    median: float  # of the base parameters
    each: Floats


def errors(robot: str, effort: Effort, found: Floats, other: Drive) -> Errors:
    """Errors of an estimate, tried on another drive."""
    true, n = truth(robot, effort), effort.n
    rows = slice(None, -1, 5)
    x, u = other.state[rows], other.applied[rows]
    rates = effort.rates(x)
    moving = np.all(np.abs(rates) > 0.1, axis=1)
    x, u, sign = x[moving], u[moving], np.sign(rates[moving])
    volts = np.array([FRICTION * PLANS[robot].volts[motor] for motor in effort.model.input_units])
    load = np.einsum("tji,tj->ti", effort.motor_rates(x[:, :n]), sign * volts * _gains(effort))
    a = np.asarray(effort.model.state_derivative(x, u, load, effort.p))[:, n:]
    regressor = np.asarray(effort.model.effort_regressor(x, a, effort.c))
    r = np.asarray(effort.model.effort_map(x[:, :n], effort.c))
    friction = np.stack([(r * sign[:, None])[..., group].sum(-1) for group in effort.friction_groups.values()], -1)
    matrix = np.concatenate([regressor, friction], axis=-1)
    wrong, right = matrix @ (found - true), matrix @ true
    relative = 100.0 * np.abs(found - true) / np.abs(true)
    size = np.linalg.norm(right, axis=0)  # rows have units of their own
    return Errors(
        u=float(100.0 * np.sqrt(np.mean((np.linalg.norm(wrong, axis=0) / size) ** 2))),
        median=float(np.median(relative[: effort.n_pi])),
        each=relative,
    )


def _gains(effort: Effort) -> Floats:
    values = dict(zip(effort.model.parameter_units, effort.p, strict=True))
    motors = effort.model.metadata["motors"].values()
    return np.array([float(numpy_value(motor["torque_gain"], values)) for motor in motors])


@dataclass(frozen=True)
class Tried:
    """One log of one robot."""

    robot: str
    identified: Identified
    found: Errors
    plain: Errors
    covered: Floats  # whether each interval holds the truth
    seconds: float


def tried(robot: str, seed: int) -> Tried:
    """A log with this seed, and what it tells."""
    made = driven(robot, 1000 + seed, SECONDS)
    log = made.log(Sensors(seed=seed))
    start = time.perf_counter()
    identified = identify(made.model, log, coulomb="each")
    seconds = time.perf_counter() - start
    other, effort = driven(robot, 5000 + seed, OTHER), identified.effort
    estimate = identified.estimate
    covered = np.abs(estimate.unknown - truth(robot, effort)) <= estimate.interval
    found, plain = (errors(robot, effort, one, other) for one in (estimate.unknown, naive(effort, log)))
    return Tried(robot, identified, found, plain, covered, seconds)


HEADINGS = [
    "robot", "numbers", "naive: u, pi [%]", "u [%]", "median pi [%]", "noise left", "foretold [%]", "covered",
    "over 5 % off", "of these flagged", "time [s]",
]  # fmt: skip


def row(robot: str, logs: list[Tried]) -> list[str]:
    """Medians over the logs of one robot."""
    first = logs[0].identified
    wrong = [one.found.each > FLAGGED for one in logs]
    flagged = [np.array([answer in ("roughly", "no") for answer in one.identified.told()]) for one in logs]
    off, told = sum(int(w.sum()) for w in wrong), sum(int((w & f).sum()) for w, f in zip(wrong, flagged, strict=True))

    def median(values: list[float]) -> float:
        return float(np.median(values))

    return [
        robot,
        f"{first.effort.n_pi}+{len(first.names) - first.effort.n_pi}",
        f"{median([one.plain.u for one in logs]):.1f}, {median([one.plain.median for one in logs]):.1f}",
        f"{median([one.found.u for one in logs]):.3f}",
        f"{median([one.found.median for one in logs]):.3f}",
        f"{median([one.identified.estimate.cost or np.nan for one in logs]):.2f}",
        f"{median([one.identified.chosen.score.overall for one in logs]):.1f}",
        f"{100 * np.mean([one.covered for one in logs]):.0f} %",
        str(off),
        str(told),
        f"{median([one.seconds for one in logs]):.1f}",
    ]


def rows(seeds: range, robots: list[str]) -> Iterator[list[str]]:
    """Of each robot what its logs tell."""
    for robot in robots:
        found = row(robot, [tried(robot, seed) for seed in seeds])
        print(" | ".join(found), file=sys.stderr, flush=True)
        yield found


FAULTS = ["log", "what the check says", "largest error of pi [%]"]


def faults() -> Iterator[list[str]]:
    """What a log of type_2_0 may do wrong, what is said of it, and what it does to the base parameters."""
    made = driven("type_2_0", 1000, SECONDS)
    log = made.log(Sensors(seed=0))
    (one,) = log.segments
    dead = one.z.copy()
    dead[:, 1] = dead[0, 1]
    radius = float(made.model.parameters()[list(made.model.parameter_units).index("r")])
    every, kept = np.arange(len(one)) // 4 * 4, np.random.default_rng(0).uniform(size=len(one))
    fine = 0.001  # [s]
    early_or_late = np.round(np.random.default_rng(0).uniform(-0.3, 0.3, len(one) - 1) * STEP / fine).astype(int)
    uneven = round(STEP / fine) * np.arange(len(one)) + np.append(0, early_or_late)
    jittery = (
        driven("type_2_0", 1000, SECONDS, round(FINE * fine / STEP), fine, uneven).log(Sensors(seed=0)).segments[0]
    )
    early, jumping = dataclasses.replace(one, u=np.roll(one.u, -2, axis=0)), one.z.copy()
    jumping[len(one) // 2, 0] += 5.0
    for name, word, segment, rows, options in (
        ("as it is", "dead time", one, slice(None), {}),
        ("voltages 40 ms early", "dead time", early, slice(None), {}),
        ("the same, --delay 0.04", "dead time", early, slice(None), {"delay": 0.04}),
        ("wheel radius 3 % wrong", "encoders", one, slice(None), {"parameters": {"r": 1.03 * radius}}),
        ("gyroscope reversed", "encoders", dataclasses.replace(one, z=one.z * [1.0, 1.0, -1.0]), slice(None), {}),
        ("an encoder dead", "dead encoder", dataclasses.replace(one, z=dead), slice(None), {}),
        ("one cell of an encoder 5 rad off", "spikes", dataclasses.replace(one, z=jumping), slice(None), {}),
        ("rows up to 30 % of a sample early or late", "rows", jittery, uneven, {}),
        ("a tenth of the rows lost at random", "rows", one, kept >= 0.1, {}),
        ("a fifth of the rows lost at random", "rows", one, kept >= 0.2, {}),
        (
            "written four times as often as measured",
            "repeated",
            dataclasses.replace(one, z=one.z[every]),
            slice(None),
            {},
        ),
    ):
        columns = {channel.name: column[rows] for channel, column in zip(log.channels, segment.z.T, strict=True)}
        read = log_of(made.model, segment.time[rows], segment.u[rows], columns)
        found = identify(made.model, read, coulomb="each", **options)  # type: ignore[arg-type]
        said = next(str(check) for check in found.checks if check.name.startswith(word))
        pi = found.effort.base(made.model.parameters())
        worst = 100.0 * np.abs(found.estimate.unknown[: len(pi)] / pi - 1.0).max()
        yield [name, said, f"{worst:.2g}"]


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=100, help="seed")
    parser.add_argument("--robots", nargs="*", default=list(PLANS))
    parser.add_argument("--page", type=Path)
    parser.add_argument("--faults", action="store_true", help="logs that are wrong, instead")
    given = parser.parse_args()
    if given.faults:
        told = list(faults())
        Console(width=160).print(in_terminal(FAULTS, told))
        if given.page:
            replace_between(
                given.page, ("<!-- faults -->", "<!-- end of faults -->"), in_markdown(FAULTS, told, left=2)
            )
        return
    found = list(rows(range(given.first, given.first + given.seeds), given.robots))
    Console(width=200).print(in_terminal(HEADINGS, found))
    if given.page:
        marks = "<!-- synthetic logs -->", "<!-- end of synthetic logs -->"
        replace_between(given.page, marks, in_markdown(HEADINGS, found, left=1))


if __name__ == "__main__":
    main()
