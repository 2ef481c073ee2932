"""Beyond the paper: the error of each controller if something else goes wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import Experiment, read_experiment
from wmr_afl.model.model import Model
from wmr_afl.plant.input_delay import InputDelayTable
from wmr_afl.plant.measurement_noise import MeasurementNoiseTable
from wmr_afl.plant.payload_change import PayloadTable
from wmr_afl.simulation.batch import rms_of_many
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.simulate import simulate

RANDOM_ROBOTS = 100  # enough for a mean and a worst case, few enough to be assembled one by one
SPREAD = 0.3  # of every parameter of a random robot, relative, uniform to both sides


@dataclass(frozen=True)
class Row:
    """One trouble, and each controller's RMS error as text."""

    trouble: str
    errors: dict[str, str]


def beyond(study: str, seed: int = 0) -> Iterator[Row]:
    """The study again with a payload, with noise, with a delay, and with random robots."""
    experiment, path = read_experiment(study)
    heavy = _doubled_masses(experiment, path)
    uncertainties = experiment.uncertainties
    half = experiment.simulation.duration / 2.0
    troubles: dict[str, dict[str, Any]] = {
        "as it stands": {},
        f"every mass and inertia doubles at {half:g} s": {"payload": PayloadTable(time=half, parameters=heavy)},
        "measurement noise of 2 cm, 0.02 rad and 0.02 m/s": {
            "measurement_noise": MeasurementNoiseTable(deviation=0.02, seed=seed)
        },
        "40 ms between command and motor": {"input_delay": InputDelayTable(seconds=0.04)},
    }
    for trouble, added in troubles.items():
        changed = experiment.model_copy(update={"uncertainties": uncertainties.model_copy(update=added)})
        yield Row(trouble, dict(_one_by_one(changed, path)))
    yield Row(
        f"{RANDOM_ROBOTS} robots, every parameter within {SPREAD:.0%}: mean (worst) of the larger RMS",
        dict(_random_robots(experiment, path, seed)),
    )


def _doubled_masses(experiment: Experiment, path: Path) -> dict[str, float]:
    model = _model(experiment, path)
    p = dict(zip(model.parameter_units, model.parameters(**experiment.parameters).tolist(), strict=True))
    masses = [name for name, unit in model.parameter_units.items() if unit in ("kg", "kg m^2")]
    return {name: 2.0 * p[name] for name in masses if name not in model.known_units}


def _model(experiment: Experiment, path: Path) -> Model:
    return next(iter(assemble(experiment, path).values())).model


def _one_by_one(experiment: Experiment, path: Path) -> Iterator[tuple[str, str]]:
    for name, loop in assemble(experiment, path).items():
        run = simulate(loop, experiment.simulation.duration, name)
        half = experiment.simulation.duration / 2.0
        yield name, str(run.failure) if run.failure else f"{_metres(run.rms())} ({_metres(run.rms(since=half))}) m"


def _metres(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def _random_robots(experiment: Experiment, path: Path, seed: int) -> Iterator[tuple[str, str]]:
    """Each robot has its own parameters; the controller knows the known constants (look-ahead, wheelbase) of each."""
    random = np.random.default_rng(seed)
    model = _model(experiment, path)
    base = dict(zip(model.parameter_units, model.parameters(**experiment.parameters).tolist(), strict=True))
    loops: dict[str, list[ClosedLoop]] = {}
    for _ in range(RANDOM_ROBOTS):
        drawn = {name: value * random.uniform(1.0 - SPREAD, 1.0 + SPREAD) for name, value in base.items()}
        for name, loop in assemble(experiment.model_copy(update={"parameters": drawn}), path).items():
            loops.setdefault(name, []).append(loop)
    for name, many in loops.items():
        worst = rms_of_many(many, experiment.simulation.duration).max(axis=1)
        lost = int(np.isinf(worst).sum())
        kept = worst[np.isfinite(worst)]
        mean = f"{kept.mean():.3f} m ({kept.max():.3f} m)" if len(kept) else "-"
        yield name, mean + (f"; {lost} lost" if lost else "")
