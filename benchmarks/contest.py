"""A contest: contenders run the same work, must agree, and then take turns in being timed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.contenders import Contender
from benchmarks.contenders.agreement import TOLERANCE, deviation
from benchmarks.contenders.work import Summary, Work
from benchmarks.timing import best_times


@dataclass(frozen=True)
class Result:
    """What a contender took."""

    experiment: str
    controller: str
    kind: str  # "one": a trajectory is logged; "many": final states and RMS errors are left
    robots: int
    steps: int
    contender: str
    nanoseconds: float  # per robot and step
    deviation: float  # from the first contender, relative
    reference: str  # the contender that ratios are taken to
    times_as_fast: float = 1.0  # as the reference


def hold(
    work: Work, kind: str, contenders: Sequence[Contender], reference: Contender, seconds: float, turns: int
) -> list[Result]:
    """Results of the contenders that are installed; the first is the one that all must agree with."""
    installed = [contender for contender in contenders if contender.installed]
    works = {one.name: work.few(one.robots) if kind == "many" and one.robots else work for one in installed}
    calls: dict[str, Callable[[], Any]] = {one.name: one.prepared(kind, works[one.name]) for one in installed}
    expected = calls[installed[0].name]()
    deviations = {}
    for name, call in calls.items():
        deviations[name] = deviation(work, call(), _first(expected, works[name].robots))
        if not deviations[name] <= TOLERANCE:
            raise AssertionError(f"{name} deviates by {deviations[name]:.1e} in {work.file.stem}")
    each = {
        name: 1e9 * seconds / (works[name].robots * len(work.times))
        for name, seconds in best_times(calls, seconds, turns).items()
    }
    return [
        Result(
            work.file.stem, work.controller, kind, works[name].robots, len(work.times), name, nanoseconds,
            deviations[name], reference.name, each[reference.name] / nanoseconds,
        )
        for name, nanoseconds in each.items()
    ]  # fmt: skip


def _first(result: Any, robots: int) -> Any:
    """The result of the first robots."""
    return Summary(result.final[:robots], result.rms[:robots]) if isinstance(result, Summary) else result
