"""Experiment in, runs out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from wmr_afl.assembly import assemble
from wmr_afl.errors import UnknownNameError
from wmr_afl.experiment import read_experiment
from wmr_afl.run import Run
from wmr_afl.simulation import simulate

Progress = Callable[[str, int, int], None]  # controller, samples done, of how many


def run(
    experiment: str | Path,
    backend: str = "auto",
    controllers: Iterable[str] | str | None = None,
    progress: Progress = lambda controller, done, total: None,
) -> dict[str, Run]:
    """Runs every controller of an experiment, or those named, one after the other.

    `experiment`: the name of a shipped experiment or a TOML file; `backend`: "numpy" runs step by step, "casadi" traces
    the closed loop and runs it as one function, "auto" takes the faster one.
    Raises: InputError, UnknownNameError.
    """
    told, path = read_experiment(experiment)
    loops = assemble(told, path)
    chosen = (
        list(loops) if controllers is None else [controllers] if isinstance(controllers, str) else list(controllers)
    )
    for name in chosen:
        if name not in loops:
            raise UnknownNameError("controller", name, loops)
    runs = {}
    for name in chosen:
        total, done = round(told.simulation.duration / told.simulation.sample_time) + 1, 0

        def tell(count: int, name: str = name, total: int = total) -> None:
            nonlocal done
            done += count
            progress(name, done, total)

        runs[name] = simulate(loops[name], told.simulation.duration, name, backend, tell)
    return runs
