"""What a campaign costs beside its kernel, and how it grows with the workers of a cluster."""

from __future__ import annotations

import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.table import Table

import wmr_afl
from benchmarks import tables
from benchmarks.cluster import ROOT, Cluster
from benchmarks.targets import Target
from benchmarks.timing import best_times
from wmr_afl.experiments.distributions import BLOCK
from wmr_afl.experiments.load import load_experiment
from wmr_afl.simulation.batch import kernel_of
from wmr_afl.simulation.closed_loop import sample_times
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.kernels.block import LANES

RUNS = 100_000
WORKERS = (1, 2)
SCRIPT = """
import sys, tempfile, time
import wmr_afl
with tempfile.TemporaryDirectory() as folder:
    wmr_afl.campaign("study_1", 1)
    before = time.perf_counter()
    wmr_afl.campaign("study_1", int(sys.argv[1]), folder)
    seconds = time.perf_counter() - before
with open("/proc/self/status") as status:  # where resource.getrusage tells the parent's memory, too
    memory = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
print(seconds, memory / 1000)
"""


def kernel_seconds() -> float:
    """Seconds of one run of study 1 by the batch's kernel alone, in a block."""
    loaded = load_experiment("study_1")
    loop = loaded.loops["AFL"]
    kernel, times = kernel_of(loop, "compiled", False), sample_times(loop, loaded.experiment.simulation.duration)
    robots = Ensemble.of([loop]).block(slice(0, 1), LANES)
    held = kernel.prepare(robots.values)
    best = best_times({"kernel": lambda: kernel.advance(kernel.start(robots.states), times, None, held)}, 2.0, 20)
    return best["kernel"] / LANES


def of_campaigns(turns: int = 3) -> list[Target]:
    """Promises about a campaign of many runs in a process of its own, its blocks kept on disk."""
    seconds, memory = np.min([_campaign() for _ in range(turns)], axis=0)
    share = 100.0 * RUNS * kernel_seconds() / seconds
    what = f"campaign of {RUNS} runs of study_1"
    return [
        Target(f"{what}: memory", float(memory), 500.0, at_least=False, unit="MB"),
        Target(f"{what}: share of the batch kernel's own rate", float(share), 60.0, at_least=True, unit="%"),
    ]


def _campaign() -> tuple[float, float]:
    """Seconds, and the most memory [MB]."""
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(RUNS)], cwd=ROOT, capture_output=True, check=True)
    seconds, memory = map(float, done.stdout.split())
    return seconds, memory


def over_workers(runs: int = 100 * BLOCK) -> list[tuple[int, float]]:
    """Seconds of the same campaign here (0 workers) and by clusters of workers; only here without Dask."""
    found = [(0, min(_timed(runs, None) for _ in range(2)))]
    if find_spec("distributed") is None:
        return found
    for count in WORKERS:
        with TemporaryDirectory() as folder:
            cluster = Cluster(Path(folder), count)
            try:
                _timed(20 * BLOCK, cluster.address)  # every worker has built the kernel
                found.append((count, min(_timed(runs, cluster.address) for _ in range(2))))
            finally:
                cluster.stop()
    return found


def _timed(runs: int, scheduler: str | None) -> float:
    before = time.perf_counter()
    wmr_afl.campaign("study_1", runs, scheduler=scheduler)
    return time.perf_counter() - before


def rows(found: list[tuple[int, float]]) -> list[list[str]]:
    """For a table."""
    first = found[0][1]
    return [
        [str(count or "none, this process"), tables.three_digits(seconds), tables.three_digits(first / seconds)]
        for count, seconds in found
    ]


HEADINGS = "workers", f"time of {100 * BLOCK} runs of study_1 [s]", "times as fast as this process"


def measure() -> Table:
    """The table for the terminal."""
    return tables.in_terminal(HEADINGS, rows(over_workers()), "Campaigns over workers")
