"""A campaign as one object, of which any process on any machine can run blocks."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import InputError, UnknownNameError, WmrError
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.campaigns.identity import Identity, difference, identity_of
from wmr_afl.experiments.campaigns.result import IMPOSSIBLE
from wmr_afl.experiments.distributions import BLOCK, CampaignTable, draws, noise_seeds
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.experiments.vary import Differences, gain_name, vary_where_possible
from wmr_afl.model.files import is_shipped
from wmr_afl.simulation.batch import BatchOptions, advance_all, kernel_of, watched_signals
from wmr_afl.simulation.closed_loop import ClosedLoop, trace
from wmr_afl.simulation.ensemble import Ensemble
from wmr_afl.simulation.kernels.block import LANES
from wmr_afl.simulation.kernels.compiled import Kernel as CompiledKernel
from wmr_afl.simulation.kernels.compiled import kernel_text
from wmr_afl.simulation.kernels.kernel import KERNELS
from wmr_afl.simulation.layout import Layout
from wmr_input.errors import mistakes_at

Columns = dict[str, NDArray[Any]]  # results and draws of a block's runs, one row a run

# Loops by fingerprint, the last few; the folder holds the model's files for as long as the loop may read them.
_ASSEMBLED: dict[str, tuple[ClosedLoop, tempfile.TemporaryDirectory[str]]] = {}
MOST_ASSEMBLED = 16


@dataclass(frozen=True, eq=False)
class Job:
    """All that a worker needs to know; `fingerprint` is a digest of everything that the numbers depend on."""

    experiment: Experiment
    table: CampaignTable
    controller: str
    model_files: Mapping[str, str]  # name -> text, if the model does not come with the package
    backend: str
    identity: Identity  # versions, code and compiler of the process that made the job
    fingerprint: str


def prepare(experiment: str | Path, controller: str | None = None, backend: str = "auto") -> Job:
    """The campaign of an experiment under one controller, its first one unless named; every name in it is checked.

    Raises:
        InputError: if the file has a mistake or no [campaign], or there is no such controller.
        UnknownNameError: if there is no such experiment or backend.
    """
    if backend not in KERNELS:
        raise UnknownNameError("backend of a campaign", str(backend), KERNELS)
    loaded = load_experiment(experiment)
    described, path, table = loaded.experiment, loaded.path, loaded.experiment.campaign
    if table is None:
        example = "[campaign.scale] with m_C = { uniform = [0.8, 1.2] }"
        raise InputError(str(path), "[campaign]", "is missing", f"say what each run draws, for example {example}")
    name = loaded.drawn(controller)[0]
    loop = loaded.loops[name]
    with mistakes_at(path, "[campaign] since"):
        if table.since > described.simulation.duration:
            raise WmrError(f"is {table.since:g} s", f"a run ends at {described.simulation.duration:g} s")
    files = {}
    if not is_shipped(loop.model.folder):
        files = {file.name: file.read_text(encoding="utf-8") for file in sorted(loop.model.folder.glob("*model.*"))}
    if backend == "auto":  # one backend for all blocks, on every machine
        backend = "compiled" if isinstance(kernel_of(loop, "auto", False), CompiledKernel) else "casadi"
    identity = identity_of(backend, loop.model)
    fingerprint = _fingerprint(described, table, name, loop, backend, identity)
    job = Job(described, table, name, files, backend, identity, fingerprint)
    with mistakes_at(path, "[campaign]"):
        faults = ensemble_of(job, loop, 0, BLOCK)[2]
        if len(faults) == BLOCK:
            raise WmrError(f"draws what no robot can have: {faults[0][0]}", faults[0][1])
    return job


def run_block(job: Job, block: int, count: int, threads: int = 1) -> Columns:
    """The first `count` runs of a block: the same numbers wherever it is run."""
    loop = loop_of(job)
    columns, ensemble, faults = ensemble_of(job, loop, block, count)
    options = BatchOptions(job.experiment.simulation.duration, job.table.since, threads, job.backend)
    result = asdict(advance_all(loop, ensemble, options))
    for run in faults:
        for name in ("rms", "largest_error", "largest_input", "largest_estimate"):
            result[name][run] = np.inf
        result["failure_time"][run] = 0.0
    causes = [
        f"{IMPOSSIBLE}{faults[run][0]}" if run in faults else why for run, why in enumerate(result["failure_cause"])
    ]
    return {**columns, **result, "failure_cause": np.array(causes)}


def ensemble_of(
    job: Job, loop: ClosedLoop, block: int, count: int
) -> tuple[Columns, Ensemble, dict[int, tuple[str, str]]]:
    """What the runs of a block draw, the robots that follow from it, and what those cannot have that are impossible.

    Raises:
        WmrError: if nothing is drawn, or a name is not one of the loop's.
    """
    columns: Columns = dict(draws(job.table, block, count))
    if loop.plant.samples:
        columns["noise_seed"] = noise_seeds(job.table, block, count)
    if not columns:
        raise WmrError("draws nothing, so that all runs are the same", "add parameters, start, gains or scale")

    def drawn(place: str) -> dict[str, NDArray[Any]]:
        return {key.partition(".")[2]: column for key, column in columns.items() if key.startswith(f"{place}.")}

    gains = {
        name: np.multiply.outer(column, np.ones_like(loop.values[gain_name(name, loop)]))
        for name, column in drawn("gains").items()
    }
    differences = Differences(drawn("parameters"), drawn("start"), gains, drawn("scale"), columns.get("noise_seed"))
    return columns, *vary_where_possible(job.experiment, job.controller, loop, differences)


def loop_of(job: Job) -> ClosedLoop:
    """The closed loop of a job, assembled once in a process.

    Raises:
        WmrError: if this process would compute other numbers than the process that made the job.
    """
    if job.fingerprint not in _ASSEMBLED:
        _check_same(job.identity, identity_of(job.backend))  # before another version stumbles over the job
        folder = tempfile.TemporaryDirectory()
        try:
            _ASSEMBLED[job.fingerprint] = _same_loop(job, Path(folder.name)), folder
        except BaseException:
            folder.cleanup()
            raise
        if len(_ASSEMBLED) > MOST_ASSEMBLED:
            _ASSEMBLED.pop(next(iter(_ASSEMBLED)))[1].cleanup()
    return _ASSEMBLED[job.fingerprint][0]


def _same_loop(job: Job, folder: Path) -> ClosedLoop:
    """The closed loop of a job, checked to give the numbers of the process that made it."""
    loop = _assemble(job, folder)
    here = identity_of(job.backend, loop.model)
    _check_same(job.identity, here)
    if _fingerprint(job.experiment, job.table, job.controller, loop, job.backend, here) != job.fingerprint:
        raise WmrError("this process has another version of the model or of wmr_afl", "install the same everywhere")
    return loop


def _check_same(there: Identity, here: Identity) -> None:
    found = difference(there, here)
    if found:
        raise WmrError(f"this process would compute other numbers: it has {found}", "install the same everywhere")


def _assemble(job: Job, folder: Path) -> ClosedLoop:
    experiment = job.experiment
    if job.model_files:
        (folder / "model").mkdir()
        for name, text in job.model_files.items():
            (folder / "model" / name).write_text(text, encoding="utf-8")
        experiment = experiment.model_copy(update={"robot": "model"})
    return assemble(experiment, folder / "experiment.toml")[job.controller]


def _fingerprint(
    experiment: Experiment, table: CampaignTable, controller: str, loop: ClosedLoop, backend: str, identity: Identity
) -> str:
    """The digest of what the numbers depend on: the loop's C text, its start and values, the draws, all code."""
    numbers = Layout(loop.states).pack(loop.states).tobytes() + Layout(loop.values).pack(loop.values).tobytes()
    parts = (
        kernel_text(trace(loop), watched_signals(loop), LANES, False)[0],
        experiment.controller(controller).model_dump_json(),
        experiment.simulation.model_dump_json(),
        experiment.reference.model_dump_json(),
        experiment.uncertainties.model_dump_json(),
        table.model_dump_json(exclude={"success", "controller"}),
        repr((sorted(experiment.parameters.items()), backend, BLOCK, sorted(identity.items()))),
    )
    return hashlib.sha256("\0".join(parts).encode() + numbers).hexdigest()
