"""Columns that were mixed up: reversed, exchanged, in other units; told by what the equation makes of the log then."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from wmr_afl.identification.alike import motor_kinds
from wmr_afl.identification.checks import Finding
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import Prior
from wmr_afl.identification.log import Log, Segment
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.weak_form import WeakEstimate, WeakForm

POOR = 80.0  # [%] of what was held out, that is foretold where nothing is mixed up
BETTER = 0.5  # of what the weak form leaves, that it may leave of columns put right
MUCH = 0.05  # of the voltage: a number that carries as much has the sign of its kind
FAR = 8.0  # times the description's numbers: more than a robot of its kind differs

Change = Callable[[Segment], Segment]


def wrong_columns(smoother: Smoother, log: Log, motions: Sequence[Motion], form: WeakForm) -> Iterator[Finding]:
    """The reversal or exchange of columns with which the log fits much better, if there is one."""
    left = form.estimate(motions).left
    tried = [(form.estimate([smoother.motion(change(one.segment)) for one in motions]).left, text, do)
             for change, text, do in _changes(log)]  # fmt: skip
    best, text, do = min(tried, key=lambda one: one[0])
    if best < BETTER * left:
        yield Finding("columns", f"the log fits {left / best:.0f} times better with {text}", do)


def wrong_size(effort: Effort, weak: WeakEstimate, prior: Prior) -> Iterator[Finding]:
    """Numbers of the wrong sign, or far from those of the description, by what they have in the voltages."""
    told = np.flatnonzero(((prior.mean != 0.0) & prior.is_free & (weak.share > 0.0))[: effort.n_pi])
    if len(told) == 0:
        return
    ratio, share = weak.unknown[told] / prior.mean[told], weak.share[told]
    order = np.argsort(ratio)
    middle = float(ratio[order][np.searchsorted(np.cumsum(share[order]), 0.5 * share.sum())])
    names = list(effort.units)[: effort.n_pi]  # friction is no base parameter
    turned = [names[k] for k, one, own in zip(told.tolist(), ratio, share, strict=True) if one < 0.0 and own > MUCH]
    if middle < 0.0:
        yield Finding("signs", "voltages run against the motion", "multiply all voltages by -1, or all measurements")
    elif turned:
        text = f"{', '.join(turned)} have the opposite sign of the description's"
        yield Finding("signs", text, "exchange the motors' columns if they were mixed up, or those of their encoders")
    elif not 1.0 / FAR < middle < FAR:
        text = f"the numbers are {middle:.2g} times those of the description"
        units = "degrees make them 57 times smaller, shares of a 12 V battery 12 times, milliseconds 1000 times larger"
        yield Finding("size", text, f"look at the units ({units}), or describe this robot first")


def _changes(log: Log) -> Iterator[tuple[Change, str, str]]:
    """What may have been mixed up: how to put it right, in words, and what to do."""
    names = list(log.model.input_units)
    for j, name in enumerate(names):
        yield partial(_reversed_input, j), f"{name} reversed", f"multiply {name} by -1"
    for k, channel in enumerate(log.channels):
        if channel.matrix == "motor":
            yield partial(_reversed_channel, k), f"{channel.name} reversed", f"multiply {channel.name} by -1"
    for kind in motor_kinds(log.model):
        for one, other in combinations(kind, 2):
            text = f"{names[one]} and {names[other]} exchanged"
            yield partial(_exchanged, one, other), text, "exchange these columns, or those of their encoders"


def _reversed_input(j: int, segment: Segment) -> Segment:
    return replace(segment, u=np.where(np.arange(segment.u.shape[1]) == j, -1.0, 1.0) * segment.u)


def _reversed_channel(k: int, segment: Segment) -> Segment:
    return replace(segment, z=np.where(np.arange(segment.z.shape[1]) == k, -1.0, 1.0) * segment.z)


def _exchanged(one: int, other: int, segment: Segment) -> Segment:
    u = segment.u.copy()
    u[:, [one, other]] = segment.u[:, [other, one]]
    return replace(segment, u=u)
