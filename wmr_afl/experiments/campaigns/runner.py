"""A campaign from its experiment to its result, block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields
from functools import partial
from pathlib import Path

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.experiments.campaigns.job import Columns, Job, ensemble_of, loop_of, prepare
from wmr_afl.experiments.campaigns.ledger import Ledger, clear, locked
from wmr_afl.experiments.campaigns.result import IMPOSSIBLE, CampaignResult
from wmr_afl.experiments.campaigns.workers import here, on_cluster
from wmr_afl.experiments.distributions import BLOCK
from wmr_afl.experiments.experiment import file_name
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arguments import checked, to_write
from wmr_afl.simulation.batch import BatchResult
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate
from wmr_input.errors import shown

MOST_RUNS = 10_000_000  # whose summaries of about 13 doubles each take 1 GB of memory


@checked
def campaign(
    experiment: str | Path,
    runs: int,
    out: str | Path | None = None,
    controller: str | None = None,
    threads: int = 1,
    backend: str = "auto",
    scheduler: str | None = None,
    fresh: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> CampaignResult:
    """Run what the [campaign] of an experiment draws; `progress` is called with the number of runs that were done.

    `out`: a folder that keeps finished blocks, from which the same call goes on after an interruption; `fresh` begins
    anew there. `scheduler`: address of a Dask scheduler, tcp://HOST:PORT, whose workers run the blocks.

    Raises:
        InputError: if the file has a mistake, or there is no such controller.
        UnknownNameError: if there is no such experiment or backend.
        WmrError: if the number of runs is out of range, or the folder or the scheduler fails.
    """
    if not 1 <= runs <= MOST_RUNS:
        raise WmrError(f"{shown(runs)} runs", f"choose 1 to {MOST_RUNS}")
    job = prepare(experiment, controller, backend)
    if out is None:
        return _run(job, runs, threads, scheduler, progress, None)
    folder = to_write("out", out)
    with locked(folder):
        if fresh:
            clear(folder)
        return _run(job, runs, threads, scheduler, progress, Ledger(folder, job.fingerprint, job.identity))


@checked
def compare(
    experiment: str | Path,
    runs: int,
    out: str | Path | None = None,
    controllers: Iterable[str] | str | None = None,
    threads: int = 1,
    backend: str = "auto",
    scheduler: str | None = None,
    fresh: bool = False,
    progress: Callable[[str, int], None] = lambda controller, done: None,
) -> dict[str, CampaignResult]:
    """A campaign of each of several controllers, which meet the same draws; by the controllers' names.

    `controllers`: those of [campaign] unless given. `out`: a folder that holds one for each of them, `campaign_NAME`;
    the other arguments are those of `campaign`.

    Raises:
        InputError: if the file has a mistake.
        UnknownNameError: if there is no such experiment, controller or backend.
        WmrError: if the number of runs is out of range, or the folder or the scheduler fails.
    """
    names = load_experiment(experiment).drawn(controllers)
    for name in names:
        prepare(experiment, name, backend)  # what is wrong with the last one is told before the first one runs
    folders = {name: None if out is None else campaign_folder(to_write("out", out), name) for name in names}
    return {
        name: campaign(experiment, runs, folder, name, threads, backend, scheduler, fresh, partial(progress, name))
        for name, folder in folders.items()
    }


def campaign_folder(out: Path, controller: str) -> Path:
    """Where the campaign of a controller stands below the results of its experiment."""
    return out / f"campaign_{file_name(controller)}"


def _run(
    job: Job, runs: int, threads: int, scheduler: str | None, progress: Callable[[int], None], ledger: Ledger | None
) -> CampaignResult:
    """All runs, except those in blocks that are in the ledger."""
    wanted = [(block, min(BLOCK, runs - block * BLOCK)) for block in range(-(-runs // BLOCK))]
    blocks: dict[int, Columns] = {}
    for block, count in wanted:
        columns = ledger.read(block, count) if ledger is not None else None
        if columns is not None:
            blocks[block] = columns
            progress(count)
    left = [(block, count) for block, count in wanted if block not in blocks]
    finished = on_cluster(job, left, threads, scheduler) if scheduler and left else here(job, left, threads)
    for block, columns in finished:
        if ledger is not None:
            ledger.write(block, columns)
        blocks[block] = columns
        progress(len(columns["failure_time"]))
    return _gathered(job, [blocks[block] for block, _ in wanted])


def _gathered(job: Job, blocks: list[Columns]) -> CampaignResult:
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    model = loop_of(job).model
    results = {field.name: columns.pop(field.name) for field in fields(BatchResult)}
    return CampaignResult(
        job.controller,
        model.output_units,
        model.input_units,
        job.table.seed,
        columns,
        BatchResult(**results),
        job.table.success,
    )


@checked
def replay(experiment: str | Path, index: int, controller: str | None = None, backend: str = "auto") -> Run:
    """Run one run of a campaign again, with all its samples.

    Raises:
        InputError: if the file has a mistake, or there is no such controller.
        UnknownNameError: if there is no such experiment or backend.
        WmrError: if there is no such run.
    """
    if not 0 <= index < MOST_RUNS:
        raise WmrError(f"there is no run {shown(index)}", "runs are counted from 0")
    job = prepare(experiment, controller)
    loop, (block, row) = loop_of(job), divmod(index, BLOCK)
    _, ensemble, faults = ensemble_of(job, loop, block, BLOCK)
    if row in faults:
        problem, remedy = faults[row]
        raise WmrError(f"run {index} is an {IMPOSSIBLE}{problem}", remedy)
    robot = ensemble.block(slice(row, row + 1), 1)
    if backend == "auto":  # as the campaign ran it, so that both end at the same sample
        backend = "lockstep" if job.backend == "compiled" else job.backend
    return simulate(loop, job.experiment.simulation.duration, f"{job.controller}, run {index}", backend, robot=robot)
