"""What the project promises of its speed, each promise beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.contenders import CONTROL, GENERATED, LITERAL, MAPACCUM, NUMPY, OWN, OWN_CASADI, Contender
from benchmarks.contest import Result
from benchmarks.tables import three_digits


@dataclass(frozen=True)
class Target:
    """A promise: `measured` must be at least, or at most, `limit`."""

    promise: str
    measured: float
    limit: float
    at_least: bool
    unit: str = ""

    @property
    def met(self) -> bool:
        return bool(self.measured >= self.limit if self.at_least else self.measured <= self.limit)

    def row(self) -> list[str]:
        """For a table."""
        limit = f"{'at least' if self.at_least else 'at most'} {self.limit:g} {self.unit}".rstrip()
        return [
            self.promise,
            limit,
            f"{three_digits(self.measured)} {self.unit}".rstrip(),
            "met" if self.met else "NOT MET",
        ]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "met": self.met}


def of_contests(results: Sequence[Result]) -> list[Target]:
    """Promises about whole loops; those whose rival is not installed are left out."""
    time = {(r.experiment, r.controller, r.kind, r.contender): r.nanoseconds for r in results}
    found: list[Target] = []

    def faster(experiment: str, controller: str, kind: str, rival: Contender, limit: float) -> None:
        place = experiment, controller, kind
        if (*place, rival.name) in time:
            robots = "one robot, logged" if kind == "one" else "many robots, end and RMS"
            promise = f"{experiment} {controller}, {robots}: times as fast as {rival.name}"
            measured = time[*place, rival.name] / time[*place, OWN.name]
            found.append(Target(promise, measured, limit, at_least=True))

    faster("study_1", "AFL", "one", LITERAL, 1.0)
    faster("study_1", "AFL", "one", CONTROL, 400.0)
    faster("study_1", "AFL", "many", LITERAL, 8.0)
    faster("study_1", "AFL", "many", NUMPY, 15.0)
    faster("track_tractor_3_trailers", "exact", "many", GENERATED, 5.0)
    faster("track_mecanum", "exact", "many", GENERATED, 5.0)
    for kind, robots in (("one", "one robot"), ("many", "many robots")):
        ratio = time["study_1", "AFL", kind, OWN_CASADI.name] / time["study_1", "AFL", kind, MAPACCUM.name]
        promise = f"study_1 AFL, {robots}, without a compiler: time over that of {MAPACCUM.name} called bare"
        found.append(Target(promise, ratio, 1.3, at_least=False))
    return found


def of_updates(rounds: np.ndarray) -> list[Target]:
    """Promises about the controller's own step, from seconds (rounds, calls): the best round counts."""
    calls = f"controller.update from Python, best of {len(rounds)} rounds of {rounds.shape[1]} calls"
    median, rare = (float(1e6 * np.percentile(rounds, share, axis=1).min()) for share in (50.0, 99.9))
    return [
        Target(f"{calls}: median", median, 3.0, at_least=False, unit="us"),
        Target(f"{calls}: 99.9th percentile", rare, 20.0, at_least=False, unit="us"),
    ]


def of_first_runs(seconds: dict[str, float]) -> list[Target]:
    """Promises about what building costs."""
    more = seconds["compiled"] - seconds["virtual machine"]
    cached = 1e3 * seconds["compiled, cached"]
    return [
        Target("first compiled run: more than on the virtual machine", more, 2.0, at_least=False, unit="s"),
        Target("first compiled run with its library in the cache", cached, 50.0, at_least=False, unit="ms"),
    ]
