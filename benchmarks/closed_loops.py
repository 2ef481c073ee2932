"""Closed loops by backend: one robot, a thousand robots, and one step in real time, as ratios within one run."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from rich.console import Group
from rich.table import Table

import wmr_afl
from wmr_afl.assembly import assemble
from wmr_afl.experiment import read_experiment
from wmr_afl.simulation import simulate

ROBOTS = 1024


def measure() -> Group:
    """Two tables: whole loops, and the real-time controller."""
    table = Table("experiment", "robots", "backend", "time per robot and step [ns]", "times as fast as the first")
    for experiment, controller in (
        ("study_1", "AFL"),
        ("track_tractor_3_trailers", "exact"),
        ("track_mecanum", "exact"),
    ):
        told, path = read_experiment(experiment)
        loop = assemble(told, path)[controller]
        duration = min(told.simulation.duration, 20.0)
        steps = round(duration / told.simulation.sample_time) + 1
        runs = {name: simulate(loop, duration, backend=name) for name in ("casadi", "compiled")}
        agree(runs["casadi"].state, runs["compiled"].state)
        times = {
            f"{name}, tracing included": best(partial(simulate, loop, duration, backend=name)) / steps
            for name in ("casadi", "compiled")
        }
        rows(table, experiment, 1, times)
    experiment = "study_1"
    random = np.random.default_rng(0)
    start = {"x": 15.0 + 0.1 * random.uniform(-1.0, 1.0, ROBOTS)}
    few = {"x": start["x"][:16]}
    agree(*(wmr_afl.run_batch(experiment, start=few, backend=name).rms for name in ("casadi", "compiled")))
    rows(
        table,
        experiment,
        ROBOTS,
        {
            "casadi, one after the other": best(lambda: wmr_afl.run_batch(experiment, start=few, backend="casadi"), 1)
            / (16 * 7001),
            "compiled, in lockstep": best(lambda: wmr_afl.run_batch(experiment, start=start)) / (ROBOTS * 7001),
        },
    )
    return Group(table, real_time())


def rows(table: Table, experiment: str, robots: int, times: dict[str, float]) -> None:
    """One row a backend."""
    first = next(iter(times.values()))
    for name, seconds in times.items():
        table.add_row(experiment, str(robots), name, f"{1e9 * seconds:.3g}", f"{first / seconds:.1f}")


def real_time() -> Table:
    """Quantiles of `controller.update` over many calls."""
    controller, x = wmr_afl.Controller.from_experiment("study_1"), np.array([15.0, 25.0, 0.1, 0.2, 0.0])
    spent = np.empty(100_000)
    for k in range(len(spent)):
        before = time.perf_counter()
        controller.update(0.0, x)
        spent[k] = time.perf_counter() - before
        controller.reset()
    table = Table("controller.update from Python", "[us]")
    for name, share in (("median", 50.0), ("99th percentile", 99.0), ("99.9th percentile", 99.9)):
        table.add_row(name, f"{1e6 * np.percentile(spent, share):.2f}")
    return table


def agree(first: np.ndarray, second: np.ndarray) -> None:
    """Contenders must give the same before they are timed."""
    assert np.max(np.abs(first - second)) <= 1e-9 * max(1.0, np.max(np.abs(first)))


def best(call: Callable[[], object], turns: int = 3) -> float:
    """Seconds of the best of a few turns, after one that is not counted."""
    call()
    times = []
    for _ in range(turns):
        before = time.perf_counter()
        call()
        times.append(time.perf_counter() - before)
    return min(times)
