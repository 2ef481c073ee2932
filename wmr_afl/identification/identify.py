"""A robot from its log: checks, base parameters by weak form and output error, physical parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import InputError, SimulationError, UnknownNameError, WmrError
from wmr_afl.identification.checks import (
    Finding,
    check_input,
    check_length,
    dead_encoders,
    findings,
    missing_motions,
)
from wmr_afl.identification.dead_time import CLEAR, dead_time, later
from wmr_afl.identification.effort import Coulomb, Effort
from wmr_afl.identification.estimate import Estimate, Prior, prior_of
from wmr_afl.identification.held_out import score, split
from wmr_afl.identification.identified import Identified, Tried
from wmr_afl.identification.log import Log
from wmr_afl.identification.log_file import read_logs
from wmr_afl.identification.mix_ups import POOR, wrong_columns, wrong_size
from wmr_afl.identification.motion import Motion, Smoother, with_rest
from wmr_afl.identification.noise import standard_deviations
from wmr_afl.identification.output_error import WINDOW, OutputError, SimulatedEstimate, windows_of
from wmr_afl.identification.physical import physical
from wmr_afl.identification.weak_form import SHORT, WeakForm
from wmr_afl.identification.weak_form import WINDOW as WEAK_WINDOW
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arguments import checked

TRIED = 2.0  # [s], of the windows of what was held out
HIDDEN = 1e-6  # of the voltages, that a number has which nothing tells
REACH = 1000.0  # times the description's value, that a guess may be away: a million times are too far for the search
HELD = 0.5  # [s] in a row, that are held out at least
TEST = 2.0  # [s]: tests that last no longer have short test functions


@checked
def identify(
    robot: str | Path | Model,
    logs: Log | str | Path | Sequence[str | Path],
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    guess: Mapping[str, ArrayLike] | None = None,
    hold_out: str | float = 0.3,
    coulomb: Coulomb = "grouped",
    delay: float = 0.0,
    partial: bool = False,
) -> Identified:
    """Find a robot's parameters from logs of its motors' voltages and its motion.

    `parameters` replace those of the description and stay: lengths that were measured. `guess` replaces others, from
    which the search begins and to which what no log tells is left. `hold_out` are the segments (by name, `*backward`),
    or the share of the log, on which the two methods are tried; the better one is then made from the whole log. `delay`
    [s] is by how much the motors answer later than the log says. With `partial` a log may lack a motion: what only that
    motion tells stays as the description has it.

    Raises:
        InputError: if a file is wrong, or `hold_out` or `delay`.
        UnknownNameError: if there is no such kind of friction.
        WmrError: if the log cannot serve: too short, at rest, without a motion that is needed; the text says which.
        MissingTermError: if the robot's dynamics are not linear in base parameters.
    """
    if coulomb not in get_args(Coulomb):
        raise UnknownNameError("kind of friction", coulomb, get_args(Coulomb))
    model = robot if isinstance(robot, Model) else load_model(robot)
    p = model.parameters(**{**(guess or {}), **(parameters or {})})
    check_robots(model, {}, p)
    _check_guess(model, guess or {})
    effort = Effort(model, np.asarray(p, dtype=float), coulomb, frozenset(parameters or ()))
    files = [logs] if isinstance(logs, str | Path) else logs
    log = files if isinstance(files, Log) else read_logs(model, files)
    if not -0.5 <= delay <= 0.5:
        raise InputError("delay", f"{delay:g}", "is no dead time of a motor", "give it in seconds, as 0.02")
    check_length(log)
    log, dead = _without_dead(log)
    noise = standard_deviations(log)
    check_input(log, noise)
    smoother = Smoother(effort, log.channels, noise, float(log.periods.max()))
    whole, (train, held) = _motions(smoother, log, delay), _held(smoother, log, hold_out, delay)
    place = repr(hold_out) if isinstance(hold_out, str) else f"{hold_out:g}"
    if _longest(held) < HELD:
        raise InputError("hold_out", place, f"holds out less than {HELD:g} s in a row", "hold out more")
    if len(missing_motions(smoother, held)) == effort.n_v:
        raise InputError("hold_out", place, "holds out no motion", "hold out a part in which the robot moves")
    missing = missing_motions(smoother, whole)
    if missing and not partial:
        problem = f"the log holds no motion of {', '.join(missing)}"
        raise WmrError(problem, "drive such motions too, or take what the rest tells (--partial)")
    window = SHORT if np.median([len(one) * one.step for one in log.segments]) <= TEST else WEAK_WINDOW
    prior = prior_of(effort, max(float(np.abs(segment.u).max()) for segment in log.segments))
    velocities = list(model.state_units)[model.coordinate_count :]
    shown = tuple(i for i, name in enumerate(velocities) if name not in missing)
    form = WeakForm(effort, prior, window, shown)
    described: tuple[str, ...] = ()
    if missing:  # what only motions tell that there are not stays as it is described
        hidden = form.estimate(whole).share < HIDDEN
        described = tuple(name for name, one in zip(effort.units, hidden & prior.is_free, strict=True) if one)
        prior = replace(prior, is_free=prior.is_free & ~hidden)
        form = WeakForm(effort, prior, window, shown)
    tried = tuple(_tried(smoother, held, one, prior) for one in _estimates(smoother, train, form))
    best = min(tried, key=lambda one: one.misfit)
    weak = form.estimate(whole)
    final: Estimate = weak
    found = best.estimate
    if isinstance(found, SimulatedEstimate):
        windows = windows_of(whole, _window(whole))
        final = OutputError(smoother, windows, prior, found.substep).fit(found.unknown)
    share = weak.share * np.abs(final.unknown) / np.maximum(np.abs(weak.unknown), 1e-300)
    sizes = list(wrong_size(effort, weak, prior))
    mixed = list(wrong_columns(smoother, log, whole, form)) if sizes or best.score.overall < POOR else []
    checks = [*mixed, *dead, *findings(smoother, log, whole), _dead_time(smoother, whole, form, delay)]
    checks += [] if mixed else sizes  # signs follow from what was mixed up
    if missing:
        text = f"no motion of {', '.join(missing)}: what only that tells is as in the description"
        checks.append(Finding("motion", text, "drive such motions too"))
    possible = physical(effort, final, described)
    return Identified(smoother, log, tuple(checks), tried, final, share, possible, tuple(held), delay, described)


def _check_guess(model: Model, guess: Mapping[str, ArrayLike]) -> None:
    """Whether a search can begin there.

    Raises:
        InputError: if a value is too far from the description's.
    """
    described = dict(zip(model.parameter_units, np.asarray(model.parameters()).tolist(), strict=True))
    for name, value in guess.items():
        own = float(np.asarray(value))
        if model.parameter_units[name] == "m" or own == 0.0 or described[name] == 0.0:
            continue
        ratio = abs(own / described[name])
        if not 1.0 / REACH <= ratio <= REACH:
            problem = f"is {ratio:.2g} times the description's {described[name]:g}, too far for a search to begin there"
            raise InputError("guess", f"{name} = {own:g}", problem, f"begin within {REACH:g} times")


def _tried(smoother: Smoother, held: list[Motion], estimate: Estimate, prior: Prior) -> Tried:
    windows = windows_of(held, min(TRIED, 0.5 * _longest(held)))
    misfit = OutputError(smoother, windows, prior).misfit(estimate) if windows else np.inf
    return Tried(estimate, score(smoother, held, estimate), misfit if np.isfinite(misfit) else np.inf)


def _estimates(smoother: Smoother, motions: list[Motion], form: WeakForm) -> list[Estimate]:
    """By the weak form, and from there by output error, if there are windows of a second."""
    weak = form.estimate(motions)
    windows = windows_of(motions, _window(motions))
    if not windows:
        return [weak]
    search = OutputError(smoother, windows, form.prior)
    x = np.concatenate([one.x0 for one in windows])
    for share in (1.0, 0.5, 0.0):  # of the way from the description
        start = form.prior.mean + share * (weak.unknown - form.prior.mean)
        if smoother.effort.can_be(start, form.prior.mean, x):
            with suppress(SimulationError, np.linalg.LinAlgError):
                return [weak, search.fit(start)]
    return [weak]


def _window(motions: list[Motion]) -> float:
    """A second, or less where no test lasts so long."""
    return min(WINDOW, 0.5 * _longest(motions))


def _longest(motions: list[Motion]) -> float:
    """[s], of the segment that lasts longest."""
    return max((float(motion.ok.sum()) * motion.segment.step for motion in motions), default=0.0)


def _motions(smoother: Smoother, log: Log, delay: float) -> list[Motion]:
    is_rate = np.array([one.is_rate for one in log.channels])
    return [smoother.motion(later(with_rest(segment, is_rate), delay)) for segment in log.segments]


def _held(smoother: Smoother, log: Log, hold_out: str | float, delay: float) -> tuple[list[Motion], list[Motion]]:
    kept, held = split(log, hold_out)
    return _motions(smoother, kept, delay), _motions(smoother, held, delay)


def _without_dead(log: Log) -> tuple[Log, list[Finding]]:
    """The log without encoders that stand still."""
    dead = dead_encoders(log)
    if not dead:
        return log, []
    names = ", ".join(log.channels[k].name for k in dead)
    kept = [k for k in range(len(log.channels)) if k not in dead]
    if not kept:
        raise WmrError(f"{names} stand still although the motors have voltage", "connect the encoders")
    text = f"{names} stands still although its motor has voltage: left out"
    finding = Finding("dead encoder", text, "connect it, or leave its column out")
    return log.measuring(kept), [finding]


def _dead_time(smoother: Smoother, motions: list[Motion], form: WeakForm, delay: float) -> Finding:
    found, gain = dead_time(smoother, motions, form, _window(motions))
    if gain < CLEAR or abs(found) < 0.25 * motions[0].segment.step:
        return Finding(
            "dead time",
            f"none that the log tells clearly ({1e3 * (found + delay):.0f} ms explain {100 * max(gain, 0.0):.1f} %)",
        )
    total = found + delay
    text = (
        f"motors answer {1e3 * abs(total):.0f} ms {'later' if total > 0 else 'earlier'} than the log has their voltage"
    )
    return Finding("dead time", text, f"use --delay {total:.3f}, or log voltage and motion at the same instant")
