"""Experiment in, runs out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from wmr_afl.closed_loop import sample_times
from wmr_afl.loading import load_experiment
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
    the step once and runs it by CasADi's virtual machine, "compiled" as machine code, "auto" takes the
    faster one of these by the number of samples.
    Raises: InputError, UnknownNameError.
    """
    loaded = load_experiment(experiment)
    simulation, loops = loaded.told.simulation, loaded.loops
    chosen = [controllers] if isinstance(controllers, str) else list(controllers or loops)
    for name in chosen:
        loaded.name(name)
    runs = {}
    for name in chosen:
        total, done = len(sample_times(loops[name], simulation.duration)), 0

        def tell(count: int, name: str = name, total: int = total) -> None:
            nonlocal done
            done += count
            progress(name, done, total)

        runs[name] = simulate(loops[name], simulation.duration, name, backend, tell)
    return runs
