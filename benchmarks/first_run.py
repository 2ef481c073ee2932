"""What the first run of a loop costs: a fresh process and a fresh cache, without Python's start and its imports."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

SCRIPT = """
import sys, time
import casadi, numpy, wmr_afl
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.simulation.simulate import simulate
told, path = read_experiment("study_1")
loop = assemble(told, path)["AFL"]
before = time.perf_counter()
simulate(loop, told.simulation.duration, backend=sys.argv[1])
print(time.perf_counter() - before)
"""


def first_runs(turns: int = 3) -> dict[str, float]:
    """Seconds of study 1's first run: on the virtual machine, compiled, and compiled with the library in the cache."""
    times: dict[str, list[float]] = {"virtual machine": [], "compiled": [], "compiled, cached": []}
    for _ in range(turns):
        with TemporaryDirectory() as cache:
            for name, backend in zip(times, ("casadi", "compiled", "compiled"), strict=True):
                times[name].append(_once(backend, cache))
    return {name: min(each) for name, each in times.items()}


def _once(backend: str, cache: str) -> float:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, backend], cwd=Path(__file__).parents[1], capture_output=True, text=True,
        check=True, env={**os.environ, "WMR_AFL_CACHE": cache},
    )  # fmt: skip
    return float(done.stdout)
