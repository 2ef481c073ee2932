"""`python -m benchmarks.pose [--runs N] [--page FILE]`: control from the pose alone, beside laws that see more.

All rows of a table meet the same draws: robots off by 30 %, first estimates wrong by up to three, up or down, starts
within a metre and a radian; on a seed that was not used to choose any number.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape

import wmr_afl
from benchmarks.laws import scored, with_controllers
from benchmarks.tables import in_markdown, in_terminal, replace_between, three_digits
from wmr_afl.analysis.monte_carlo import OFF, Crowd, Draws, robots_around, wrong_guesses
from wmr_afl.analysis.paper.beyond import (
    CALM_MEASURED,
    CALM_POSE,
    ENCODERS,
    JUDGED,
    KALMAN,
    MEASURED,
    OBSERVING,
    POSE,
    SETTLED,
    frozen,
    judged,
    quantiles,
)
from wmr_afl.experiments.campaigns.result import wilson
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.simulation.closed_loop import ClosedLoop

SEED = 5151
STUDY = {
    "pose": POSE,
    "pose, d^ not cancelled": POSE + "observer = { cancel = false }",
    "pose, cancelled and kept in the data": POSE + "observer = { separate = false }",
    "pose, Kalman": KALMAN,
    "pose and encoders, Kalman": ENCODERS,
    "pose, linearizing, frozen": 'measures = "pose"\nreference_rate = 1.0\nouter_loop = { bandwidth = 15.0 }',
    "v measured, with observer, rate = 20": OBSERVING,
    "v measured, composite, rate = 20": MEASURED + "rate = 20.0\nlearning = { noise = 3.0, gain = 0.3 }",
    **{f"v measured, frozen (25), w = {w}": frozen(w) for w in (30, 40)},
}
CALM = POSE + "rate = 9.0635\nobserver = { rate = 20.0 }"  # the rule for noise of a millimetre and more: 20, 10
CALM_KALMAN = KALMAN.replace("{ kind", "{ rate = 20.0, kind")
NOISY = {
    "pose": POSE,
    "pose, observer 20, loop 10": CALM,
    "pose, observer 12, loop 12": CALM_POSE,
    "pose, Kalman": KALMAN,
    "pose, Kalman, observer 20, loop 15": CALM_KALMAN,
    "pose and encoders, Kalman": ENCODERS,
    "v measured, composite, rate = 10": CALM_MEASURED,
    "v measured, frozen (25), w = 20": frozen(20),
}
DELAYED = {
    "pose": POSE,
    "pose, Kalman": KALMAN,
    "pose, predicted": POSE + "observer = { predict = true }",
    "pose, predicted, loop 15": POSE + "rate = 12.96\nobserver = { predict = true }",
    "v measured, composite": MEASURED,
    "v measured, composite, rate = 15": MEASURED + "rate = 15.0\nlearning = { noise = 0.5, filter = 0.5, gain = 0.3 }",
}
NOMINAL = {
    "pose": POSE,
    "v measured, with observer, rate = 20": OBSERVING,
    **{f"v measured, frozen (25), w = {w}": frozen(w) for w in (20, 30, 40)},
}
NOMINAL_NOISY = {
    "pose, observer 12, loop 12": CALM_POSE,
    "v measured, composite, rate = 10": CALM_MEASURED,
    **{f"v measured, frozen (25), w = {w}": frozen(w) for w in (15, 20, 30)},
}
LOST = 0.05  # [m]: a run above this has failed as well


def study(name: str, laws: Mapping[str, str], runs: int, folder: Path, more: str = "") -> Iterator[list[str]]:
    """A row for each law: RMS after 10 s of the worse output, and how far inputs travel."""
    changes = {"[uncertainties]\n": f"[uncertainties]\n{more}"}
    return scored(with_controllers(name, laws, folder, changes), laws, runs, SEED)


def nominal(runs: int, folder: Path) -> Iterator[list[str]]:
    """Study 2 where every law begins with the parameters of the experiment, from which robots are off by 30 %."""
    model = wmr_afl.load_model(load_experiment("study_2").experiment.robot)
    usual = load_experiment("study_2").experiment.parameters
    known = ", ".join(f"{name} = {value}" for name, value in usual.items() if name not in model.known_units)
    for size, laws in ((0.0, NOMINAL), (1e-2, NOMINAL_NOISY)):
        told = {law: f"{table.rstrip()}\nguess = {{ {known} }}" for law, table in laws.items()}
        changes = {"[uncertainties]\n": f"[uncertainties]\n{noise(size) if size else ''}"}
        file = with_controllers("study_2", told, folder, changes)
        loaded = load_experiment(file)
        crowd = replace(Crowd.drawn(next(iter(loaded.loops.values())), SEED, runs), guesses={})
        for law, loop in loaded.loops.items():
            scores = crowd.score(loaded.experiment, law, loop, (SETTLED,), threads=2)
            yield [law, f"{100.0 * size:g} cm" if size else "none", *judged(scores)]


def limits(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each case that is hard: how many runs fail or err by more than 50 mm, and how far inputs travel."""
    wide = "learning = { box = 30.0 }\n"
    slow, edge = {"sample_time = 0.02 ": "sample_time = 0.04 "}, {"sin(3*t)": "sin(10*t)"}
    limited = {"[simulation]\n": "[uncertainties]\ninput_limits = { volts = 24.0 }\n\n[simulation]\n"}
    cases: tuple[tuple[str, str, str, dict[str, str], bool], ...] = (
        ("study 2", "study_2", POSE, {}, False),
        ("samples of 40 ms", "study_2", POSE, slow, False),
        ("force of 10 rad/s", "study_2", POSE, edge, False),
        ("force of 10 rad/s, frozen (25), w = 40", "study_2", frozen(40), edge, False),
        ("each physical parameter wrong by three, box 4", "study_2", POSE, {}, True),
        ("each physical parameter wrong by three, box 30", "study_2", POSE + wide, {}, True),
        ("study 1", "study_1", POSE, {}, False),
        ("study 1, each physical parameter wrong by three, box 4", "study_1", POSE, {}, True),
        ("study 1, each physical parameter wrong by three, box 30", "study_1", POSE + wide, {}, True),
        ("study 1 with 24 V", "study_1", POSE, limited, False),
        ("study 1 with 24 V, each physical parameter wrong by three, box 4", "study_1", POSE, limited, True),
    )
    for case, name, table, changes, is_physical in cases:
        file = with_controllers(name, {"law": table}, folder, changes)
        loaded = load_experiment(file)
        loop = loaded.loops["law"]
        crowd = Crowd.drawn(loop, SEED, runs)
        if is_physical:
            crowd = replace(crowd, guesses={loop.law.knowledge.estimated: physical_guesses(loop, crowd, runs)})
        since = SETTLED if name == "study_2" else (100.0, np.inf)
        scores = crowd.score(loaded.experiment, "law", loop, (since,), threads=2)
        lost = ~(scores.worse[0] < LOST)
        rate, low, high = wilson(int(lost.sum()), runs, 0.95)
        share = f"{100 * rate:.1f} ({100 * low:.1f} to {100 * high:.1f})"
        yield [case, *map(three_digits, quantiles(scores.worse[0])), share, f"{np.median(scores.travel):.0f}"]


def study_1(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each draw of study 1, whose motors have no limit: how many runs fail or err by more than 50 mm."""
    usual, model = load_experiment("study_1").experiment.parameters, wmr_afl.load_model("type_2_0")
    known = ", ".join(f"{name} = {value}" for name, value in usual.items() if name not in model.known_units)
    firsts = {"nominal": f"guess = {{ {known} }}\n", "wrong by three": "", "ones": "estimate = 1.0\n"}
    for law, table in {"pose": POSE, "pose, Kalman": KALMAN}.items():
        for where in ("the draws of study_1", "starts within a metre"):
            for first, told in {**firsts, "each physical parameter wrong by three": ""}.items():
                file = with_controllers("study_1", {"law": table + told}, folder, {})
                loaded = load_experiment(file)
                loop = loaded.loops["law"]
                crowd = Crowd.drawn(loop, SEED, runs)
                if where == "the draws of study_1":
                    crowd = replace(crowd, **shipped_draws(runs))
                if first == "nominal":
                    crowd = replace(crowd, guesses={})
                if first.startswith("each"):
                    crowd = replace(crowd, guesses={"passivity_parameters": physical_guesses(loop, crowd, runs)})
                scores = crowd.score(loaded.experiment, "law", loop, ((100.0, np.inf),), threads=2)
                lost = ~(scores.worse[0] < LOST)
                rate, low, high = wilson(int(lost.sum()), runs, 0.95)
                share = f"{100 * rate:.1f} ({100 * low:.1f} to {100 * high:.1f})"
                yield [law, where, first, *map(three_digits, quantiles(scores.worse[0])), share]


def shipped_draws(runs: int) -> dict[str, Draws]:
    """Starts and robots as `[campaign]` of study 1 has them."""
    random = np.random.default_rng(SEED)
    start = {name: random.uniform(*ends, runs) for name, ends in
             (("x", (14.0, 16.0)), ("y", (24.0, 26.0)), ("phi", (-0.5, 0.5)))}  # fmt: skip
    robots = {f"parameters.{name}": random.uniform(0.5, 2.0, runs) for name in ("m_C", "I_C")}
    return {"start": start, "robots": robots}


def physical_guesses(loop: ClosedLoop, crowd: Crowd, runs: int) -> Draws:
    """Factors on pi if every uncertain physical parameter of a robot is taken for up to three times as much or less."""
    random, model = np.random.default_rng(SEED + 1), loop.model
    names = list(model.units_of("passivity_parameters"))
    true, wrong = np.tile(loop.values["p"], (2, runs, 1))
    for index, name in enumerate(model.parameter_units):
        if name not in model.known_units:
            true[:, index] *= crowd.robots.get(f"parameters.{name}", 1.0)
            wrong[:, index] = true[:, index] * OFF ** random.uniform(-1.0, 1.0, runs)
    factors = model.passivity_parameters(wrong) / model.passivity_parameters(true)
    return {f"estimates.{name}": factors[:, index] for index, name in enumerate(names)}


def robots(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each robot: RMS of the last 40 s of its track under friction and a force, from the pose alone."""
    for robot in wmr_afl.list_models():
        loaded = load_experiment(f"track_{robot}")
        loop = next(iter(loaded.loops.values()))
        q = loop.plant.start[: loop.model.coordinate_count]
        inertia = np.diag(np.asarray(loop.model.inertia_matrix(q, loop.plant.parameters)))
        names = list(loop.model.state_units)[loop.model.coordinate_count :]
        pushes = ", ".join(f'{name} = "{0.3 * m:.6g}*sin(3*t)"' for name, m in zip(names, inertia, strict=True))
        viscous = [float(f"{0.1 * m:.6g}") for m in inertia]
        forces = (
            f'[uncertainties]\nfriction = {{ viscous = {viscous}, coulomb = {viscous}, on = "pseudo_velocities" }}\n'
            f'disturbance = {{ expression = {{ {pushes} }}, on = "pseudo_velocities" }}\n'
        )
        duration = find_experiment(f"track_{robot}").read_text(encoding="utf-8").split("duration = ")[1].split()[0]
        row = [robot]
        for table, noise in (
            (POSE, 0.0),
            (CALM, 1e-3),
            (CALM_KALMAN, 1e-3),
            (MEASURED + "rate = 15.0\nobserver = {}", 0.0),
        ):
            told = forces
            if noise:
                deviation = [noise] * len(loop.model.state_units)
                told += f"measurement_noise = {{ deviation = {deviation}, seed = 5 }}\n"
            changes = {"[uncertainties]\n": told, f"duration = {duration}": "duration = 80.0"}
            laws = {"law": table.replace("reference_rate = 1.0", "reference_rate = 3.0")}
            file = with_controllers(f"track_{robot}", laws, folder, changes)
            random = np.random.default_rng(SEED)
            scale = {**robots_around(loop.model, random, runs), **wrong_guesses(loop.model, random, runs)}
            seeds = SEED + np.arange(runs) if noise else None
            batch = wmr_afl.run_batch(file, scale=scale, since=40.0, seeds=seeds)
            rms = np.where(batch.failed, np.inf, np.linalg.norm(batch.rms, axis=1)) * 1e3
            fails = int(np.count_nonzero(~(rms < 50.0)))
            row.append(f"{np.median(rms):.2f} ({rms.max():.2f})" + (f", {fails} fail" if fails else ""))
        yield row


def further(runs: int, folder: Path) -> Iterator[list[str]]:
    """Study 2 with something else that goes wrong: RMS after 10 s of the worse output, and travel."""
    heavy = "payload = { time = 70.0, parameters = { m_C = 20.0, m_w = 0.4, I_m = 0.012, I_C = 6.0 } }\n"
    rest = 'expressions = { y1 = "2.5 + 2*tanh((t - 20)/8)", y2 = "5.5 + 0.5*tanh((t - 20)/8)" }'
    force = 'disturbance = { expression = "10*sin(3*t)", on = "pseudo_velocities" }'
    here = "figure_eight = { center = [2.5, 5.5], radius = 2.0, rate = 0.05 }"
    cases: tuple[tuple[str, dict[str, str], float], ...] = (
        ("masses double at 70 s", {"[uncertainties]\n": f"[uncertainties]\n{heavy}"}, 10.0),
        ("motors of 9 V, too weak for the force", {"volts = 24.0": "volts = 9.0"}, 10.0),
        ("it stops; friction alone, since 60 s", {force: "", here: rest}, 60.0),
    )
    laws = {"pose": POSE, "pose, Kalman": KALMAN, "v measured, with observer, rate = 20": OBSERVING}
    for case, changes, since in cases:
        file = with_controllers("study_2", laws, folder, changes)
        loaded = load_experiment(file)
        crowd = Crowd.drawn(next(iter(loaded.loops.values())), SEED, runs)
        for law, loop in loaded.loops.items():
            scores = crowd.score(loaded.experiment, law, loop, ((since, np.inf),), threads=2)
            yield [case, law, *judged(scores)]


HEADINGS = ("law", *JUDGED)


def noise(deviation: float) -> str:
    """White noise of this deviation in m, rad, m/s and rad/s."""
    return f"measurement_noise = {{ deviation = {deviation}, seed = 5 }}\n"


def noisy(deviation: float, runs: int, folder: Path) -> Iterator[list[str]]:
    """Study 2 with noise."""
    return study("study_2", NOISY, runs, folder, noise(deviation))


TABLES: dict[str, tuple[str, tuple[str, ...], Callable[[int, Path], Iterator[list[str]]]]] = {
    "pose, study 2": ("Study 2", HEADINGS, lambda runs, folder: study("study_2", STUDY, runs, folder)),
    "pose, study 3": ("Study 3, slip and all", HEADINGS, lambda runs, folder: study("study_3", STUDY, runs, folder)),
    **{
        f"pose, noise {size}": (
            f"Study 2 with noise of {size}",
            HEADINGS,
            partial(noisy, value),
        )
        for size, value in (("1 mm", 1e-3), ("3 mm", 3e-3), ("1 cm", 1e-2))
    },
    "pose, delay": (
        "Study 2 with a drive that is 40 ms late",
        HEADINGS,
        lambda runs, folder: study("study_2", DELAYED, runs, folder, "input_delay = { seconds = 0.04 }\n"),
    ),
    "pose, nominal": (
        "Study 2 where every law begins with nominal parameters, from which robots are off by 30 %",
        ("law", "noise", *JUDGED),
        nominal,
    ),
    "pose, limits": (
        "The law `pose` where it is hard: study 2 since 10 s, study 1 since 100 s; "
        f"lost are runs that failed or are above {1e3 * LOST:g} mm",
        ("case", "median [mm]", "99 %", "worst", "lost [%] (95 %)", "travel [V/s]"),
        limits,
    ),
    "pose, further": (
        "Study 2 with something else that goes wrong",
        ("case", "law", *JUDGED),
        further,
    ),
    "pose, study 1": (
        f"Study 1 since 100 s; lost are runs that failed or are above {1e3 * LOST:g} mm",
        ("law", "draws", "first estimates", "median [mm]", "99 %", "worst", "lost [%] (95 %)"),
        study_1,
    ),
    "pose, robots": (
        "Tracks under friction and a force of 3 rad/s, RMS of the last 40 s [mm], median (worst)",
        (
            "robot",
            "pose alone",
            "noise of 1 mm, observer 20, loop 10",
            "noise of 1 mm, Kalman, observer 20, loop 15",
            "v measured, with observer",
        ),
        lambda runs, folder: robots(max(1, runs // 5), folder),
    ),
}


def main() -> None:
    """Measure, print the tables, and write them into the page if one is named."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--runs", type=int, default=1000)
    reader.add_argument("--only", choices=TABLES)
    reader.add_argument("--page", type=Path)
    given = reader.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name, (title, headings, measured) in TABLES.items():
            if given.only in (None, name):
                found = list(measured(given.runs, Path(folder)))
                Console(width=160).print(escape(title), in_terminal(headings, found))
                if given.page is not None:
                    marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
                    replace_between(given.page, marks, f"{title}:\n\n{in_markdown(headings, found, left=1)}")


if __name__ == "__main__":
    main()
