"""Voltages that determine a robot's numbers, within the voltage and the space there is.

    u_j(t) = fade(t) (a_j0 + sum_k a_jk cos w_k t + b_jk sin w_k t)
    max logdet sum_t A^T A   s.t. |u| <= volts, |x|, |y| <= room, angles within limits, at rest at the end      (I11)

by single shooting with CasADi and IPOPT. What is found is tried on many robots that are not as they were guessed. Those
that break a limit worst get constraints of their own, and the design is repeated; the voltages of the guess alone would
have to be far smaller to keep all robots within limits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.errors import ArgumentError, WmrError
from wmr_afl.identification.excursions import (
    SPREAD,
    Space,
    SteeringLoop,
    moved,
    others,
    space_of,
    steering_gains,
    substeps,
)
from wmr_afl.identification.information import Unknowns, condition, deviations, log_determinant, unknowns
from wmr_afl.identification.voltages import Loop, Voltages
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import shown

SAMPLE = 0.05  # [s] over which a voltage is held
FADE = 1.0  # [s] at both ends
COAST = 2.0  # [s] without voltage behind the end, in which robots that are tried may still go on
HIGHEST = 1.6  # [Hz] of the frequencies that are chosen where none are given
SHORTEST, LONGEST = 4.0, 120.0  # [s] of a design
SIZES = (1e-3, 1e4)  # [V, m] that can be given
REST = 0.02  # [m/s, rad/s] that is left at the end
NOISE = 0.1  # [V] of a row and sample, for which deviations are told
DETERMINED = 0.3  # relative deviation: what is above it counts as not determined
ROBOTS = 64  # that are tried, the guessed one among them
ROUNDS = 6  # of design and trial
SETTLED = 1.1  # of a limit: where no robot goes farther, a round is brought to its end
ADDED = 2  # robots that get constraints, for each limit that was broken
USED = 0.99  # of each limit: there is more between the samples that are looked at
MOST_LESSENED = 60  # times, by up to a half
FINE = 1.03  # between what keeps within limits and what does not
EVERY = 2  # samples of which one is looked at
LEAST = 1e-9  # [V^2] that is added to the information, so that it has a logarithm
ITERATIONS = 200  # of IPOPT in a round whose robots are settled
BRIEF = 40  # in a round before, which only finds out which robots matter
MORE = "give more room, voltage or seconds"
IPOPT: dict[str, Any] = {
    "ipopt.hessian_approximation": "limited-memory",
    "ipopt.limited_memory_max_history": 6,
    "ipopt.tol": 1e-3,
    "ipopt.constr_viol_tol": 1e-4,
    "ipopt.acceptable_tol": 0.1,
    "ipopt.acceptable_constr_viol_tol": 1e-4,
    "ipopt.acceptable_obj_change_tol": 1e-3,
    "ipopt.acceptable_iter": 5,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_resto_iter": 20,  # of a search for what is feasible at all: rounds do that
    "print_time": False,
    "show_eval_warnings": False,  # of robots that are lost on the way: IPOPT shortens its steps there
}

Progress = Callable[[int, int], None]  # rounds done, of how many

UNFINISHED = "not converged"
STOPPED = "User_Requested_Stop", "NonIpopt_Exception_Thrown"
SAID = {
    "Solve_Succeeded": "converged",
    "Solved_To_Acceptable_Level": "hardly better any more",
    "Maximum_Iterations_Exceeded": UNFINISHED,
    "Infeasible_Problem_Detected": "not feasible",
}


@dataclass(frozen=True, repr=False)
class Excitation:
    """Voltages to drive, what they tell, and how far robots go with them that are not as guessed.

    A motor that turns a joint is driven by `voltages` plus its loop, all within `volts`:
    u = feedforward + gain (reference - angle), once a sample.
    """

    robot: str
    volts: float
    inputs: tuple[str, ...]
    states: tuple[str, ...]  # their names
    time: Floats  # (T,) [s]
    voltages: Floats  # (T, n_u) [V], each held over a sample, zero in the last one
    state: Floats  # (T, 2n-m) of the guessed robot
    loops: tuple[SteeringLoop, ...]
    tried: Floats  # (T + coast, N, k) what is limited of all robots that were tried, the guessed one first
    limits: Mapping[str, tuple[float, float]]  # of position and angles [m, rad]
    log_determinants: tuple[float, float]  # of a random multisine that keeps all robots within limits, and of this one
    conditions: tuple[float, float]  # of their columns
    deviations: Mapping[str, float]  # standard deviation of each number, relative to its guess, for NOISE
    rounds: int  # of design and trial
    status: str  # of IPOPT in the round that is handed out

    @property
    def sample_time(self) -> float:
        """[s]."""
        return float(self.time[1] - self.time[0])

    @property
    def played(self) -> Voltages:
        """What to play: voltages, and loops around angles."""
        loops = (
            Loop(self.inputs.index(one.motor), self.states.index(one.coordinate), np.full(len(self.time), one.gain),
                 one.reference)
            for one in self.loops
        )  # fmt: skip
        return Voltages(self.time, self.voltages, tuple(loops))

    @property
    def excursions(self) -> dict[str, tuple[float, float]]:
        """The lowest and the highest of what is limited, of all robots that were tried [m, rad]."""
        least, most = self.tried.min(axis=(0, 1)).tolist(), self.tried.max(axis=(0, 1)).tolist()
        return dict(zip(self.limits, zip(least, most, strict=True), strict=True))

    @property
    def is_within_limits(self) -> bool:
        """Whether all robots that were tried stayed within all limits."""
        return not self._broken()

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Numbers whose deviation is above DETERMINED."""
        return tuple(name for name, deviation in self.deviations.items() if deviation > DETERMINED)

    @property
    def verdict(self) -> str:
        """In one line."""
        tried = f"{ROBOTS} robots whose parameters are up to {SPREAD:.0%} off"
        if broken := self._broken():
            kept = f"NOT within limits: some of {tried} go beyond that of {', '.join(broken)}"
        else:
            kept = f"{tried} stay within limits"
        if self.undetermined:
            return f"{kept}; not determined: {', '.join(self.undetermined)} ({MORE})"
        return f"{kept}; every number is determined"

    def _broken(self) -> list[str]:
        found = zip(self.limits.items(), self.excursions.values(), strict=True)
        return [name for (name, (lower, upper)), (least, most) in found if not lower <= least <= most <= upper]

    def __repr__(self) -> str:
        return f"<Excitation of {self.robot}: {self.time[-1]:g} s, {self.verdict}>"

    def __str__(self) -> str:
        (before, now), (loose, tight) = self.log_determinants, self.conditions
        lines = [
            f"{self.robot}: {self.time[-1]:g} s within {self.volts:g} V, {self.rounds} rounds, IPOPT: {self.status}",
            f"log determinant {before:.1f} (random multisine) -> {now:.1f}, condition {loose:.0f} -> {tight:.0f}",
        ]
        lines += [
            f"{name}: {least:.3g} to {most:.3g}, may be {self.limits[name][0]:.3g} to {self.limits[name][1]:.3g}"
            for name, (least, most) in self.excursions.items()
        ]
        lines += [f"{loop.motor}: {loop.gain:.3g} V/rad on the angle of {loop.joint}" for loop in self.loops]
        lines += [f"relative deviations for {NOISE:g} V of noise:"]
        lines += [f"  {name} {deviation:.2%}" for name, deviation in self.deviations.items()]
        return "\n".join([*lines, self.verdict])


@checked
def excite(
    robot: str | Path | Model,
    volts: float,
    room: float,
    limits: Mapping[str, float] | None = None,
    seconds: float = 20.0,
    parameters: Mapping[str, float] | None = None,
    frequencies: Sequence[float] | None = None,
    seed: int = 0,
    progress: Progress = lambda done, total: None,
) -> Excitation:
    """Propose voltages that determine a robot's parameters within the voltage and the space there is.

    The robot starts at rest and has `room` [m] to each side in x and y. `limits`: largest angles [rad] by coordinate,
    besides those of the description. `parameters`: guesses that differ from the description. `frequencies` [Hz]: six
    between two periods and 1.6 Hz unless given. `progress(done, total)` hears of each round of design and trial; fewer
    than `total` may do. The same arguments give the same voltages.

    Where no design tells more than the random multisine that it starts from, that one is handed out; `status` says so.

    Raises:
        UnknownNameError: if there is no such robot, parameter or coordinate.
        WmrError: if an argument is no voltage, length, angle or time that can be had, the robot has no effort form, or
            no voltages are found that determine at least half of the numbers.
    """
    model = robot if isinstance(robot, Model) else load_model(robot)
    model = model.in_library("numpy")
    for name, value, (least, most), unit in (
        ("volts", volts, SIZES, "V"),
        ("room", room, SIZES, "m"),
        ("seconds", seconds, (SHORTEST, LONGEST), "s"),
    ):
        if not least <= value <= most:
            raise WmrError(f"{name} is {value:g} {unit}", f"choose {least:g} to {most:g} {unit}")
    if not 0 <= seed < 2**63:
        raise ArgumentError(f"seed is {shown(seed)}", "give a whole number from 0")
    p = model.parameters(**(parameters or {}))
    check_robots(model, {}, p)
    task = _Task(model, p, volts, space_of(model, p, room, limits or {}), seconds, _checked(frequencies, seconds), seed)
    start = task.within(task.random())
    if task.space.fractions(task.tried(start)).max() > 1.0:
        raise WmrError(f"no voltages were found that keep {model.name} within its limits", MORE)
    told = _told(task, start, *_designed(task, start, progress))
    if 2 * len(told.undetermined) > len(told.deviations):
        problem = f"within {room:g} m, {volts:g} V and the limits of angles nothing determines {model.name}"
        raise WmrError(f"{problem} ({len(told.undetermined)} of {len(told.deviations)} numbers are not)", MORE)
    return told


def _checked(frequencies: Sequence[float] | None, seconds: float) -> Floats:
    """Frequencies [Hz].

    Raises:
        ArgumentError: if some cannot be driven.
    """
    if frequencies is None:
        return np.geomspace(2.0 / seconds, HIGHEST, 6)
    given = real_numbers("frequencies", list(frequencies), "give a list of Hz")
    if not (1 <= given.size <= 30 and np.all((given > 0.0) & (given <= 0.25 / SAMPLE))):
        wanted = f"give 1 to 30 between 0 and {0.25 / SAMPLE:g} Hz"
        raise ArgumentError(f"frequencies are {shown(frequencies)}", wanted)
    return given


def _designed(task: _Task, start: Floats, progress: Progress) -> tuple[Floats, str, int]:
    """The weights that tell most among the start and those of all rounds, what is said of them, and how many rounds."""
    used = np.full(len(task.space.names), USED)
    chosen = set(task.space.fractions(task.tried(start)).argmax(axis=0).tolist())
    found = [(log_determinant(task.information(start)), start, "nothing better than the random multisine was found")]
    weights, rounds, is_settled = start, 0, False
    while rounds < ROUNDS:
        progress(rounds, ROUNDS)
        rounds += 1
        iterations = ITERATIONS if is_settled or rounds == ROUNDS else BRIEF
        weights, status = _Program(task, sorted(chosen), iterations).solved(weights, used)
        if not np.all(np.isfinite(weights)):
            break
        fractions = task.space.fractions(task.tried(weights))
        kept = task.within(weights)
        if task.is_at_rest(kept):
            share = np.abs(kept).max() / np.abs(weights).max()
            said = status if share == 1.0 else f"{status}, then lessened to {share:.0%}"
            found.append((log_determinant(task.information(kept)), kept, said))
        if fractions.max() <= 1.0 and (iterations == ITERATIONS or not status.startswith(UNFINISHED)):
            break
        is_settled = is_settled or bool(fractions.max() <= SETTLED)
        had = set(chosen)
        for k in np.flatnonzero(fractions.max(axis=0) > 1.0):
            worst = [one for one in fractions[:, k].argsort()[-ADDED:].tolist() if fractions[one, k] > 1.0]
            if worst[-1] in had:  # between the samples that are looked at, or IPOPT left it there
                used[k] *= USED / min(fractions[worst[-1], k], 2.0)
            chosen.update(worst)
        weights = kept
    _, weights, status = max(found, key=lambda one: one[0])
    return weights, status, rounds


def _told(task: _Task, start: Floats, weights: Floats, status: str, rounds: int) -> Excitation:
    before, after = task.information(start), task.information(weights)
    states, space = task.predicted(weights), task.space
    limits = zip(space.lower.tolist(), space.upper.tolist(), strict=True)
    numbers = deviations(after, NOISE).tolist()
    return Excitation(
        robot=task.model.name,
        volts=task.volts,
        inputs=tuple(task.model.input_units),
        states=tuple(task.model.state_units),
        time=task.time,
        voltages=np.concatenate([task.voltages(weights), np.zeros((1, task.motors))]),
        state=states,
        loops=task.loops(states),
        tried=space.values(task.tried(weights)),
        limits=dict(zip(space.names, limits, strict=True)),
        log_determinants=(log_determinant(before), log_determinant(after)),
        conditions=(condition(before), condition(after)),
        deviations=dict(zip(task.unknowns.names, numbers, strict=True)),
        rounds=rounds,
        status=status,
    )


class _Task:
    """What is to be designed: the robot, its limits, and multisines by their weights ((2 F + 1) n_u,)."""

    def __init__(
        self, model: Model, p: Floats, volts: float, space: Space, seconds: float, frequencies: Floats, seed: int
    ) -> None:
        self.model, self.p, self.volts, self.space, self.seed = model, p, volts, space, seed
        self.samples, self.motors = round(seconds / SAMPLE), len(model.input_units)
        self.unknowns: Unknowns = unknowns(model, p, volts)
        self.gains = steering_gains(model, p, space.start, SAMPLE)
        self.robots = others(model, p, ROBOTS, seed)
        self._steps: dict[tuple[bool, bool], ca.Function] = {}
        self.time = SAMPLE * np.arange(self.samples + 1, dtype=np.float64)
        fade = np.clip(np.minimum(self.time, self.time[-1] - self.time) / FADE, 0.0, 1.0)
        angles = 2.0 * np.pi * np.outer(frequencies, self.time)
        self.basis = (np.concatenate([np.ones((1, len(self.time))), np.cos(angles), np.sin(angles)]) * fade)[:, :-1]

    def voltages(self, weights: Floats) -> Floats:
        """(T - 1, n_u)."""
        free = self.basis.T @ weights.reshape(len(self.basis), self.motors)
        return np.clip(free, -self.volts, self.volts)

    def predicted(self, weights: Floats) -> Floats:
        """States of the guessed robot, (T, 2n-m)."""
        voltages = self.voltages(weights)
        return self._journeys(self.p[None], voltages, np.zeros((len(voltages), len(self.space.start))), False)[:, 0]

    def loops(self, states: Floats) -> tuple[SteeringLoop, ...]:
        """With the angles of the guessed robot as references, so that the loops do nothing while all is as guessed."""
        columns = dict(zip(self.model.state_units, states.T, strict=True))
        return tuple(
            SteeringLoop(motor, joint, coordinate, gain, columns[coordinate])
            for motor, (joint, coordinate, gain) in self.gains.items()
        )

    def information(self, weights: Floats) -> Floats:
        """(k, k)."""
        return self.unknowns.information(self.predicted(weights)[:-1], self.voltages(weights))

    def tried(self, weights: Floats) -> Floats:
        """States of all robots, which coast at the end: (T + coast, N, 2n-m)."""
        coast, states = round(COAST / SAMPLE), self.predicted(weights)
        wanted = np.concatenate([states[:-1], np.repeat(states[-1:], coast, axis=0)])
        voltages = np.concatenate([self.voltages(weights), np.zeros((coast, self.motors))])
        return self._journeys(self.robots, voltages, wanted, True)

    def _journeys(self, robots: Floats, voltages: Floats, wanted: Floats, is_steered: bool) -> Floats:
        """States (T + 1, N, 2n-m) of N robots from voltages (T, n_u), with loops around the angles of `wanted`."""
        samples, start = len(voltages), self.space.start
        p = ca.MX.sym("p", len(self.p))
        u, goal = ca.MX.sym("u", self.motors, samples), ca.MX.sym("wanted", len(start), samples)
        roll = self.step(is_steered, has_slopes=False).mapaccum(samples)
        one = ca.Function("one", [u, goal, p], [roll(ca.DM(start), u, goal, ca.repmat(p, 1, samples))])
        states = one.map("every", "serial", len(robots), [0, 1], [])(voltages.T, wanted.T, robots.T).full()
        by_robot = states.T.reshape(len(robots), samples, -1).transpose(1, 0, 2)
        return np.concatenate([np.broadcast_to(start, (1, *by_robot.shape[1:])), by_robot])

    def random(self) -> Floats:
        """Weights of a random multisine that goes up to the voltage there is."""
        weights = np.random.default_rng(self.seed).normal(size=(len(self.basis), self.motors))
        weights[0] = 0.0
        return (weights * self.volts / np.abs(self.basis.T @ weights).max()).ravel()

    def within(self, weights: Floats) -> Floats:
        """The weights, lessened until all robots stay within limits, and no more than that."""
        share, beyond = 1.0, 1.0
        for _ in range(MOST_LESSENED):
            largest = self.space.fractions(self.tried(share * weights)).max()
            if largest <= 1.0:
                break
            share, beyond = share * float(np.clip(USED / largest, 0.5, USED)), share
        while beyond / share > FINE:
            middle = float(np.sqrt(share * beyond))
            if self.space.fractions(self.tried(middle * weights)).max() <= 1.0:
                share = middle
            else:
                beyond = middle
        return share * weights

    def is_at_rest(self, weights: Floats) -> bool:
        """Whether the guessed robot is, at the end."""
        return bool(np.abs(self.predicted(weights)[-1, self.model.coordinate_count :]).max() < 1.05 * REST)

    def step(self, is_steered: bool, has_slopes: bool) -> ca.Function:
        """(x, u, wanted, p) -> x one sample later; with slopes also derivatives by all weights, from those before.

        Built once for all robots. `wanted`: the state whose angles the loops follow, if they act.
        """
        key = is_steered, has_slopes
        if key in self._steps:
            return self._steps[key]
        made, size = self.model.in_library("casadi"), len(self.space.start)
        x, wanted = ca.SX.sym("x", size), ca.SX.sym("wanted", size)
        u, p = ca.SX.sym("u", self.motors), ca.SX.sym("p", len(self.p))
        count = substeps(self.model, self.p, self.space.start, SAMPLE)
        after = moved(made, p, x, self._steered(x, u, wanted) if is_steered else u, SAMPLE, count)
        if not has_slopes:
            self._steps[key] = ca.Function("step", [x, u, wanted, p], [after])
            return self._steps[key]
        width, weigh = len(self.basis) * self.motors, ca.SX.sym("weigh", len(self.basis))
        by, wanted_by = ca.SX.sym("by", size, width), ca.SX.sym("wanted_by", size, width)
        slopes = ca.jacobian(after, x) @ by + ca.kron(weigh.T, ca.jacobian(after, u))
        slopes += ca.jacobian(after, wanted) @ wanted_by
        given, found = [x, by, u, wanted, p, weigh, wanted_by], [after, ca.densify(slopes)]
        self._steps[key] = ca.Function("step", given, found)
        return self._steps[key]

    def _steered(self, x: ca.SX, u: ca.SX, wanted: ca.SX) -> ca.SX:
        """Voltages with loops around steering."""
        steered = ca.SX(u)
        for motor, (_, coordinate, gain) in self.gains.items():
            i = list(self.model.state_units).index(coordinate)
            steered[list(self.model.input_units).index(motor)] += gain * (wanted[i] - x[i])
        return ca.fmax(ca.fmin(steered, self.volts), -self.volts)


class _Program:
    """The optimization (I11), with constraints on the guessed robot and on some others.

    Where the Jacobian of constraints is wanted, derivatives by weights are carried along with the states,
    dx+ = A dx + B du: that takes a third of the time of differentiating the roll.
    """

    def __init__(self, task: _Task, chosen: Sequence[int], iterations: int) -> None:
        """`chosen`: of the task's robots; `iterations`: at most."""
        self.task, self._chosen = task, chosen
        self._w = ca.MX.sym("w", len(task.basis) * task.motors)
        self._basis = ca.horzcat(task.basis, ca.DM.zeros(len(task.basis), round(COAST / SAMPLE)))
        self._voltages = ca.reshape(self._w, task.motors, len(task.basis)) @ self._basis
        guessed, _ = self._journey(task.p, None, has_slopes=False)
        states = ca.horzcat(ca.DM(task.space.start), guessed[:, : task.samples - 1])
        objective = -_log_determinant(task.unknowns, states, self._voltages[:, : task.samples])
        constraints, _ = self._constraints(has_slopes=False)
        problem: dict[str, Any] = {"x": self._w, "p": ca.MX.sym("none", 0), "f": objective, "g": constraints}
        jacobian = ca.Function(
            "jacobian", [self._w, problem["p"]], self._constraints(has_slopes=True), ["x", "p"], ["g", "jac_g_x"]
        )
        self._solver = ca.nlpsol("design", "ipopt", problem, {**IPOPT, "ipopt.max_iter": iterations, "jac_g": jacobian})

    def solved(self, weights: Floats, used: Floats) -> tuple[Floats, str]:
        """Weights and what IPOPT says, from a start, for the part of each limit (k,) that may be used."""
        limited = np.tile(used, self._looks * (1 + len(self._chosen)))
        bounds = np.concatenate([np.ones(self._solver.size1_in("lbg") - len(limited)), limited])
        answer = self._solver(x0=weights, lbg=-bounds, ubg=bounds)
        stats = self._solver.stats()
        if stats["return_status"] in STOPPED:  # CasADi takes Ctrl-C for the end of a search
            raise KeyboardInterrupt
        said = SAID.get(stats["return_status"], stats["return_status"])
        return answer["x"].full()[:, 0], f"{said} after {stats['iter_count']} iterations"

    @property
    def _looks(self) -> int:
        """At how many samples it is looked how far each robot has gone."""
        return self._basis.shape[1] // EVERY

    def _constraints(self, has_slopes: bool) -> list[Any]:
        """What stays between -1 and 1: voltages, rates at the end, quantities of each robot; and its Jacobian."""
        task, n, width = self.task, self.task.model.coordinate_count, self._w.numel()
        guessed = self._journey(task.p, None, has_slopes)
        journeys = [guessed, *(self._journey(task.robots[k], guessed, has_slopes) for k in self._chosen)]
        seen = [self._seen(*journey) for journey in journeys]
        end = task.samples - 1
        values = [self._voltages[:, : task.samples] / task.volts, guessed[0][n:, end] / REST, *(one for one, _ in seen)]
        if not has_slopes:
            return [ca.vertcat(*map(ca.vec, values)), guessed[1]]
        of_voltages = ca.kron(self._basis[:, : task.samples].T, ca.DM.eye(task.motors))
        at_end = guessed[1][n:, end * width : (end + 1) * width]
        slopes: list[Any] = [of_voltages / task.volts, at_end / REST, *(one for _, one in seen)]
        return [ca.vertcat(*map(ca.vec, values)), ca.vertcat(*slopes)]

    def _journey(self, p: Floats, guessed: tuple[ca.MX, ca.MX] | None, has_slopes: bool) -> tuple[ca.MX, ca.MX]:
        """States after each sample (2n-m, T), and their derivatives by all weights beside each other, or none.

        With loops around what the robot does as `guessed`, or without.
        """
        start, width, samples = ca.DM(self.task.space.start), self._w.numel(), self._basis.shape[1]
        own, before = ca.repmat(ca.DM(p), 1, samples), 0 if guessed is None else ca.horzcat(start, guessed[0][:, :-1])
        step = self.task.step(guessed is not None, has_slopes)
        if not has_slopes:
            return step.mapaccum(samples)(start, self._voltages, before, own), ca.MX(0, 0)
        flat = ca.DM.zeros(start.shape[0], width)
        before_by = 0 if guessed is None else ca.horzcat(flat, guessed[1][:, :-width])
        roll = step.mapaccum("roll", samples, 2)
        states, slopes = roll(start, flat, self._voltages, before, own, self._basis, before_by)
        return states, slopes

    def _seen(self, states: ca.MX, slopes: ca.MX) -> tuple[ca.MX, ca.MX]:
        """How far each quantity is on its way to a limit, at the samples that are looked at, and its derivatives."""
        space, width = self.task.space, self._w.numel()
        x, by = ca.SX.sym("x", states.shape[0]), ca.SX.sym("by", states.shape[0], width)
        value = (space.function(x) - space.middle) / space.half
        if slopes.is_empty():
            return ca.Function("look", [x], [value]).map(self._looks)(states[:, EVERY - 1 :: EVERY]), slopes
        look = ca.Function("look", [x, by], [value, ca.densify((ca.jacobian(value, x) @ by).T)])
        chosen = ca.reshape(slopes, states.shape[0] * width, states.shape[1])[:, EVERY - 1 :: EVERY]
        chosen = ca.reshape(chosen, states.shape[0], width * self._looks)
        values, found = look.map(self._looks)(states[:, EVERY - 1 :: EVERY], chosen)
        return values, found.T


def _log_determinant(numbers: Unknowns, states: ca.MX, voltages: ca.MX) -> ca.MX:
    """Of the information of samples, smooth where something is hardly determined."""
    k, samples = len(numbers.names), states.shape[1]
    x, u = ca.SX.sym("x", states.shape[0]), ca.SX.sym("u", voltages.shape[0])
    columns = numbers.columns(x, u)
    each = ca.Function("information", [x, u], [ca.vec(columns.T @ columns)]).map(samples)
    entries = ca.SX.sym("entries", k * k)
    diagonal, _, _ = ca.ldl(ca.reshape(entries, k, k) + LEAST * ca.SX.eye(k))
    determinant = ca.Function("determinant", [entries], [ca.sum1(ca.log(ca.vec(diagonal)))])
    return determinant(ca.sum2(each(states, voltages)))
