"""Beyond the paper: its studies 2 and 3 under its own laws, at high gain, adapting, and from the pose alone.

One robot from the paper's start, and many at random, all laws of a table with the same draws, on a seed that was not
used to choose any number of a law.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wmr_afl.analysis.monte_carlo import (
    ANGLE,
    DISTANCE,
    SPREAD,
    Crowd,
    Scores,
    Window,
)
from wmr_afl.analysis.plots import Runs
from wmr_afl.controllers.tables import ControllerTable
from wmr_afl.errors import SimulationError
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import Experiment, read_experiment
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.input_delay import InputDelayTable
from wmr_afl.plant.measurement_noise import MeasurementNoiseTable
from wmr_afl.plant.order import UncertaintiesTable
from wmr_afl.plant.payload_change import PayloadTable
from wmr_afl.simulation.kernels.c_compiler import compiler
from wmr_afl.simulation.result import Run
from wmr_afl.simulation.simulate import simulate

STUDY, SLIPPING = "study_2", "study_3"  # which differ by the slip only
SEED = 7070
RUNS = 200  # robots at random unless told otherwise; 1000 take a minute
INTERPRETED_RUNS = 20  # without a C compiler
SETTLED: Window = (10.0, np.inf)  # [s]
WHOLE: Window = (0.0, np.inf)
SLIP: Window = (50.0, 70.0)
CLAIMED = 100.0  # [mm] in x and in y, over the whole run
LIMIT = (7.3, 17.5)  # [mm] over the whole run: a local optimum with 24 V and 20 ms that IPOPT found, not proved
GUESS = "guess = { m_C = 20.0, I_C = 1.5, K1 = 0.174 }\n"  # of one robot: twice, half, and two thirds of what is true
ONES = "estimate = 1.0\n"  # the paper's first estimates

# Laws as tables of an experiment. Those of the paper are study 2's, as they are shipped, from estimates of 1.
POSE = 'law = "composite"\nmeasures = "pose"\nreference_rate = 1.0\n'
CALM_POSE = POSE + "rate = 10.66\nobserver = { rate = 12.0 }\n"  # both at 12 /s
MEASURED = 'law = "composite"\nreference_rate = 1.0\n'
OBSERVING = MEASURED + "rate = 20.0\nobserver = {}\nlearning = { noise = 1.0 }\n"
CALM_MEASURED = MEASURED + "rate = 10.0\nlearning = { noise = 0.5, filter = 0.5, gain = 0.3 }\n"


def frozen(w: float) -> str:
    """The paper's law (25), which does not adapt, with b1 = 2 w and b2 = w^2: the baseline."""
    return f"outer_loop = {{ b1 = {2.0 * w}, b2 = {float(w * w)} }}\n"


SHIPPED = ("AFL with leakage", "robust AFL")
FROZEN = {f"frozen (25), w = {w}": frozen(w) for w in (30, 40)}
LAWS = {
    **dict.fromkeys(SHIPPED, ""),
    **FROZEN,
    "composite, v measured": OBSERVING,
    "composite, pose alone": POSE,
}
ONE_ROBOT = {**LAWS, "composite, pose alone, swift": POSE.replace("reference_rate = 1.0", "reference_rate = 5.0")}
NOISY = {
    "frozen (25), w = 20": frozen(20),
    "composite, v measured, rate 10": CALM_MEASURED,
    "composite, pose alone": POSE,
    "composite, pose alone, 12 /s": CALM_POSE,
}
DELAYED = {
    "frozen (25), w = 15": frozen(15),
    "composite, v measured": MEASURED,
    "composite, pose alone": POSE,
}
NOISES = {"1 mm": 1e-3, "3 mm": 3e-3, "1 cm": 1e-2}  # in m, rad, m/s and rad/s
DELAY = 0.04  # [s]


@dataclass(frozen=True)
class Sheet:
    """A table as text; `note` says what its numbers are."""

    title: str
    note: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Beyond:
    """All that is measured."""

    runs: Mapping[str, Runs]  # of the paper's robot, by study
    scores: Mapping[str, Mapping[str, Scores]]  # of robots at random, by study and law
    sheets: Sequence[Sheet]

    @property
    def count(self) -> int:
        """How many robots were drawn."""
        return len(next(iter(self.scores[STUDY].values())).travel)


def measure(
    runs: int | None = None, backend: str = "auto", threads: int = 2, seed: int = SEED,
    report: Callable[[str], None] = lambda text: None,
) -> Beyond:  # fmt: skip
    """Run all of it, with so many robots at random; `report` is told what is run next.

    Raises:
        UnknownNameError: if there is no such backend.
    """
    is_compiled = backend == "compiled" or (backend == "auto" and compiler() is not None)
    count = runs or (RUNS if is_compiled else INTERPRETED_RUNS)
    crowd = Crowd.drawn(next(iter(assemble(*read_experiment(STUDY)).values())), seed, count)
    how = threads, backend if is_compiled else "casadi"
    single: dict[str, Runs] = {}
    for study in (STUDY, SLIPPING):
        report(f"one robot, {study}")
        single[study] = one_robot(Trouble(study), ONE_ROBOT, backend)
    report("one robot in more trouble")
    troubled = {title: one_robot(trouble, ONE_ROBOT, backend) for title, trouble in _more_trouble(seed).items()}
    scores: dict[str, dict[str, Scores]] = {}
    cases = {
        STUDY: (Trouble(STUDY), LAWS, (SETTLED,)),
        SLIPPING: (Trouble(SLIPPING), LAWS, (SETTLED, SLIP)),
        **{f"noise {size}": (Trouble(STUDY, noise=value), NOISY, (SETTLED,)) for size, value in NOISES.items()},
        "delay": (Trouble(STUDY, delay=DELAY), DELAYED, (SETTLED,)),
    }
    for name, (trouble, laws, windows) in cases.items():
        scores[name] = {}
        experiment, path = trouble.experiment(laws)
        for law, loop in assemble(experiment, path).items():
            report(f"{count} robots, {name}, {law}")
            scores[name][law] = crowd.score(experiment, law, loop, windows, *how)
    return Beyond(single, scores, list(_sheets(single, troubled, scores, count, seed)))


@dataclass(frozen=True)
class Trouble:
    """One of the paper's studies, and what goes wrong besides."""

    study: str = STUDY
    noise: float = 0.0  # of everything that is measured [m, rad, m/s, rad/s]
    delay: float = 0.0  # [s]
    payload_at: float | None = None  # [s], when every mass and inertia doubles
    seed: int = 0

    def experiment(self, laws: Mapping[str, str]) -> tuple[Experiment, Path]:
        """The study under these laws."""
        described, path = read_experiment(self.study)
        own, _ = read_experiment(STUDY)
        tables = {
            law: own.controller(law) if law in SHIPPED else ControllerTable.model_validate(tomllib.loads(table))
            for law, table in laws.items()
        }
        changes = {"uncertainties": self._besides(described, path), "shared": ControllerTable(), "controllers": tables}
        return described.model_copy(update=changes), path

    def _besides(self, described: Experiment, path: Path) -> UncertaintiesTable:
        added: dict[str, object] = {}
        if self.noise:
            added["measurement_noise"] = MeasurementNoiseTable(deviation=self.noise, seed=self.seed)
        if self.delay:
            added["input_delay"] = InputDelayTable(seconds=self.delay)
        if self.payload_at is not None:
            model = next(iter(assemble(described, path).values())).model
            added["payload"] = PayloadTable(time=self.payload_at, parameters=doubled_masses(described, model))
        return described.uncertainties.model_copy(update=added)


def doubled_masses(experiment: Experiment, model: Model) -> dict[str, float]:
    """Every mass and inertia that the controller does not know, twice as large."""
    p = dict(zip(model.parameter_units, model.parameters(**experiment.parameters).tolist(), strict=True))
    masses = [name for name, unit in model.parameter_units.items() if unit in ("kg", "kg m^2")]
    return {name: 2.0 * p[name] for name in masses if name not in model.known_units}


def one_robot(trouble: Trouble, laws: Mapping[str, str], backend: str = "auto") -> dict[str, Run]:
    """The paper's robot from the paper's start: law (25) begins with `ONES`, the composite one with `GUESS`."""
    guesses = {law: GUESS if table.startswith("law") else ONES for law, table in laws.items()}
    experiment, path = trouble.experiment({law: table + guesses[law] for law, table in laws.items()})
    loops = assemble(experiment, path)
    return {name: simulate(loop, experiment.simulation.duration, name, backend) for name, loop in loops.items()}


def _more_trouble(seed: int) -> dict[str, Trouble]:
    return {
        "masses double at 70 s": Trouble(payload_at=70.0),
        "noise of 2 cm": Trouble(noise=0.02, seed=seed),
        "40 ms late": Trouble(delay=DELAY),
    }


def quantiles(errors: Floats) -> tuple[float, float, float]:
    """Median, 99 % and worst of errors [m], in mm; failed runs are infinite."""
    mm = 1e3 * errors
    return float(np.median(mm)), float(np.quantile(mm, 0.99, method="higher")), float(mm.max())


def judged(scores: Scores, window: int = 0) -> tuple[str, ...]:
    """Median, 99 %, worst [mm], share above 10 mm [%] and travel [V/s]: a row without its name."""
    errors = scores.worse[window]
    share, path = 100.0 * np.mean(errors > 0.01), np.median(scores.travel)
    return (*(f"{value:.2f}" for value in quantiles(errors)), f"{share:.1f}", f"{path:.0f}")


JUDGED = ("median [mm]", "99 %", "worst", "above 10 mm [%]", "travel [V/s]")


def _sheets(
    single: Mapping[str, Runs],
    troubled: Mapping[str, Runs],
    scores: Mapping[str, Mapping[str, Scores]],
    count: int,
    seed: int,
) -> Iterator[Sheet]:
    yield _of_the_paper(single)
    yield _in_more_trouble(single[STUDY], troubled)
    crowd = (
        f"Robots off by {100 * SPREAD:.0f} %, starts within {DISTANCE:g} m and {ANGLE:g} rad, seed {seed}. The paper's "
        "laws begin with estimates of 1, the others with every entry wrong by up to three. RMS error of the worse "
        "output since 10 s."
    )
    many = f"{count} robots"
    rows = {law: judged(one) for law, one in scores[STUDY].items()}
    yield Sheet(f"Study 2, {many}", crowd, ("law", *JUDGED), _named(rows))
    slips = {law: judged(one, 1)[:4] for law, one in scores[SLIPPING].items()}
    text = "The same robots, while the wheels slip from 50 s to 70 s."
    yield Sheet(f"Study 3 under slip, {many}", text, ("law", *JUDGED[:4]), _named(slips))
    rows = {law: judged(one) for law, one in scores[SLIPPING].items()}
    yield Sheet(f"Study 3, {many}", "The same robots since 10 s, slip and all.", ("law", *JUDGED), _named(rows))
    noisy = [(law, size, *judged(scores[f"noise {size}"][law])) for law in NOISY for size in NOISES]
    text = (
        "The same robots with noise of this size in m and rad; of laws that measure velocities also in m/s and rad/s."
    )
    yield Sheet(f"Study 2 with noise, {many}", text, ("law", "noise", *JUDGED), tuple(noisy))
    late = {law: judged(one) for law, one in scores["delay"].items()}
    text = "The same robots; the composite laws know of the delay."
    yield Sheet(f"Study 2 with motors that are 40 ms late, {many}", text, ("law", *JUDGED), _named(late))


def _named(rows: Mapping[str, Sequence[str]]) -> tuple[tuple[str, ...], ...]:
    return tuple((name, *row) for name, row in rows.items())


def _of_the_paper(single: Mapping[str, Runs]) -> Sheet:
    """RMS of x, y of the paper's robot, beside the claim and the limit."""
    bound = f"< {CLAIMED:.0f}, < {CLAIMED:.0f}"
    rows = [
        ("the paper's claim", bound, "", "", ""),
        ("clairvoyant limit", ", ".join(map(str, LIMIT)), "0, 0", "", ""),
    ]
    for law, run in single[STUDY].items():
        slipping = single[SLIPPING][law]
        errors = (_both(run, WHOLE), _both(run, SETTLED), _both(slipping, SLIP))
        rows.append((law, *errors, f"{travel(run):.0f}" if run.failure is None else ""))
    return Sheet(
        "The paper's robot from the paper's start",
        "RMS error of x, y [mm] in study 2, and in study 3 while the wheels slip; travel since 10 s. Laws of the form "
        "(25) begin with estimates of 1, the composite ones with twice the mass, half the inertia and two thirds of "
        "the torque. "
        "The limit is what could be done if everything were known before: a local optimum found by IPOPT with 24 V and "
        "20 ms, not proved; all of its error lies in the first 0.6 s. The swift law has its reference model at 5 /s "
        "instead of 1 /s: it comes to the reference as fast as the motors allow.",
        ("law", "whole run", "since 10 s", "slip", "travel [V/s]"),
        tuple(rows),
    )


def _in_more_trouble(usual: Runs, troubled: Mapping[str, Runs]) -> Sheet:
    late = (70.0, np.inf)
    rows = {law: [_worse(runs[law], late) for runs in (usual, *troubled.values())] for law in usual}
    return Sheet(
        "The same robot in more trouble",
        "RMS error of the worse output [mm] since 70 s in study 2, with one more thing that goes wrong.",
        ("law", "as it stands", *troubled),
        _named(rows),
    )


def travel(run: Run, since: float = SETTLED[0]) -> float:
    """How far an input travels [V/s], a mean over the motors."""
    late = run.time >= since
    steps = np.abs(np.diff(run.input[late], axis=0)).sum(axis=0)
    return float(steps.mean() / np.ptp(run.time[late]))


def _both(run: Run, window: Window) -> str:
    try:
        return ", ".join(f"{1e3 * value:.3g}" for value in run.rms(*window))
    except SimulationError:
        return str(run.failure)


def _worse(run: Run, window: Window) -> str:
    try:
        return f"{1e3 * run.rms(*window).max():.3g}"
    except SimulationError:
        return str(run.failure)
