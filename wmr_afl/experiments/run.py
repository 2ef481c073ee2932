"""Experiment in, runs out: one of each controller, or many robots under one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from wmr_afl.controllers.reference import Reference
from wmr_afl.experiments.load import load_experiment
from wmr_afl.experiments.vary import Differences, vary
from wmr_afl.numerics.arguments import checked, to_write
from wmr_afl.simulation.batch import BatchOptions, BatchResult, advance_all
from wmr_afl.simulation.closed_loop import sample_times
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate
from wmr_afl.simulation.trajectories import recording

Progress = Callable[[str, int, int], None]  # controller, samples done, of how many


@checked
def run(
    experiment: str | Path,
    backend: str = "auto",
    controllers: Iterable[str] | str | None = None,
    progress: Progress = lambda controller, done, total: None,
    reference: Reference | None = None,
) -> dict[str, Run]:
    """Run every controller of an experiment, or those named, one after the other.

    `experiment`: the name of a shipped experiment or a TOML file; `backend`: "numpy" runs step by step, "casadi" traces
    the step once and runs it by CasADi's virtual machine, "compiled" as machine code, "auto" chooses the faster one of
    these by the number of samples. `reference` takes the place of the file's.

    Raises:
        InputError: if the file has a mistake.
        UnknownNameError: if there is no such experiment, controller or backend, or the reference names another output.
        WmrError: if an output has no reference.
    """
    loaded = load_experiment(experiment)
    duration, loops = loaded.experiment.simulation.duration, loaded.loops
    if reference is not None:
        loops = {name: replace(loop, reference=reference) for name, loop in loops.items()}
    chosen = [controllers] if isinstance(controllers, str) else list(() if controllers is None else controllers)
    chosen = [loaded.name(name) for name in chosen or loops]
    runs = {}
    for name in chosen:
        total, done = len(sample_times(loops[name], duration)), 0

        def report(count: int, name: str = name, total: int = total) -> None:
            nonlocal done
            done += count
            progress(name, done, total)

        runs[name] = simulate(loops[name], duration, name, backend, report)
    return runs


@checked
def run_batch(
    experiment: str | Path,
    controller: str | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, ArrayLike] | None = None,
    values: Mapping[str, ArrayLike] | None = None,
    seeds: ArrayLike | None = None,
    since: float = 0.0,
    threads: int = 1,
    backend: str = "auto",
    progress: Callable[[int], None] = lambda done: None,
    trajectories: str | Path | None = None,
    scale: Mapping[str, ArrayLike] | None = None,
) -> BatchResult:
    """Run one controller of an experiment (the first unless named) for many robots that differ in numbers.

    `parameters`, `start`: physical parameters and states by name, (N,) each; the controller knows the known constants
    of each robot, and exact or guessed estimates follow. `values`: gains by name (b1, Gamma ...), (N, ...); `scale`:
    factors (N,) on parameters or gains by name, `parameters.b1` or `gains.b1` if both have the name; `seeds` (N,) of
    the measurement noise. Errors count since `since` [s]. `backend`: "compiled", "casadi", or "auto". `trajectories`:
    an HDF5 file that takes all samples of all runs, chunk by chunk, whatever their number.

    Raises:
        InputError: if the file has a mistake.
        UnknownNameError: if there is no such experiment, controller, backend, parameter, state or gain.
        ShapeError: if the numbers of robots differ.
        WmrError: if no robot can have these numbers, or the file cannot be written.
    """
    loaded = load_experiment(experiment)
    name = loaded.name(controller)
    loop = loaded.loops[name]
    options = BatchOptions(loaded.experiment.simulation.duration, since, threads, backend, progress)
    differences = Differences(parameters or {}, start or {}, values or {}, scale or {}, seeds)
    ensemble = vary(loaded.experiment, name, loop, differences)
    if trajectories is None:
        return advance_all(loop, ensemble, options)
    file, times = to_write("trajectories", trajectories), sample_times(loop, options.duration)
    with recording(file, loop, times, ensemble.count) as record:
        return advance_all(loop, ensemble, options, record)
