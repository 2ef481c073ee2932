"""`python -m benchmarks.pose [--runs N] [--page FILE]`: control from the pose alone, beside laws that see more.

All rows of a table meet the same draws: robots off by 30 %, first estimates wrong by up to three, up or down, starts
within a metre and a radian; on a seed that was not used to choose any number.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

import wmr_afl
from benchmarks.laws import somewhat_different, starts_around, travels, with_controllers, wrong_guesses
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment

SEED = 5151
POSE = 'law = "composite"\nmeasures = "pose"\nreference_rate = 1.0\n'
MEASURED = 'law = "composite"\nreference_rate = 1.0\n'
FROZEN = "outer_loop = {{ b1 = {0}.0, b2 = {1}.0 }}\n"
STUDY = {
    "pose": POSE,
    "pose, d^ not cancelled": POSE + "observer = { cancel = false }",
    "pose, cancelled and kept in the data": POSE + "observer = { separate = false }",
    "pose, linearizing, frozen": 'measures = "pose"\nreference_rate = 1.0\nouter_loop = { bandwidth = 15.0 }',
    "v measured, with observer, rate = 20": MEASURED + "rate = 20.0\nobserver = {}\nlearning = { noise = 1.0 }",
    "v measured, composite, rate = 20": MEASURED + "rate = 20.0\nlearning = { noise = 3.0, gain = 0.3 }",
    "v measured, frozen (25), w = 30": FROZEN.format(60, 900),
    "v measured, frozen (25), w = 40": FROZEN.format(80, 1600),
}
CALM = POSE + "rate = 9.0635\nobserver = { rate = 20.0 }"  # the rule for noise of a millimetre and more: 20, 10
NOISY = {
    "pose": POSE,
    "pose, observer 20, loop 10": CALM,
    "pose, observer 12, loop 12": POSE + "rate = 10.66\nobserver = { rate = 12.0 }",
    "v measured, composite, rate = 10": MEASURED + "rate = 10.0\nlearning = { noise = 0.5, filter = 0.5, gain = 0.3 }",
    "v measured, frozen (25), w = 20": FROZEN.format(40, 400),
}
DELAYED = {
    "pose": POSE,
    "pose, predicted": POSE + "observer = { predict = true }",
    "pose, predicted, loop 15": POSE + "rate = 12.96\nobserver = { predict = true }",
    "v measured, composite": MEASURED,
    "v measured, composite, rate = 15": MEASURED + "rate = 15.0\nlearning = { noise = 0.5, filter = 0.5, gain = 0.3 }",
}


def study(name: str, laws: Mapping[str, str], runs: int, folder: Path, more: str = "") -> Iterator[list[str]]:
    """A row for each law: RMS after 10 s of the worse output, and how far inputs travel."""
    file = with_controllers(name, laws, folder, {"[uncertainties]\n": f"[uncertainties]\n{more}"})
    random = np.random.default_rng(SEED)
    start, robots = starts_around(file, random, runs), somewhat_different("type_2_0", random, runs)
    guesses = wrong_guesses("type_2_0", random, runs)
    theta = wrong_guesses("type_2_0", random, runs, "base_parameters")
    seeds = SEED + np.arange(runs)
    for law, table in laws.items():
        scale = {**robots, **(guesses if "law =" in table else theta)}
        batch = wmr_afl.run_batch(
            file, law, scale=scale, start=start, since=10.0, seeds=seeds if "noise" in more else None
        )
        rms = np.where(batch.failed, np.inf, batch.rms.max(axis=1)) * 1e3
        travel = travels(file, law, scale, start, folder)
        figures = [f"{np.median(rms):.2f}", f"{np.quantile(rms, 0.99, method='higher'):.2f}", f"{rms.max():.2f}"]
        yield [law, *figures, f"{100 * np.mean(rms > 10.0):.1f}", f"{np.median(travel):.0f}"]


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
        for table, noise in ((POSE, 0.0), (CALM, 1e-3), (MEASURED + "rate = 15.0\nobserver = {}", 0.0)):
            told = forces
            if noise:
                deviation = [noise] * len(loop.model.state_units)
                told += f"measurement_noise = {{ deviation = {deviation}, seed = 5 }}\n"
            changes = {"[uncertainties]\n": told, f"duration = {duration}": "duration = 80.0"}
            laws = {"law": table.replace("reference_rate = 1.0", "reference_rate = 3.0")}
            file = with_controllers(f"track_{robot}", laws, folder, changes)
            random = np.random.default_rng(SEED)
            scale = {**somewhat_different(robot, random, runs), **wrong_guesses(robot, random, runs)}
            seeds = SEED + np.arange(runs) if noise else None
            batch = wmr_afl.run_batch(file, scale=scale, since=40.0, seeds=seeds)
            rms = np.where(batch.failed, np.inf, np.linalg.norm(batch.rms, axis=1)) * 1e3
            fails = int(np.count_nonzero(~(rms < 50.0)))
            row.append(f"{np.median(rms):.2f} ({rms.max():.2f})" + (f", {fails} fail" if fails else ""))
        yield row


HEADINGS = ("law", "median [mm]", "99 %", "worst", "above 10 mm [%]", "travel [V/s]")


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
    "pose, robots": (
        "Tracks under friction and a force of 3 rad/s, RMS of the last 40 s [mm], median (worst)",
        ("robot", "pose alone", "with noise of 1 mm, observer 20, loop 10", "v measured, with observer"),
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
                Console(width=160).print(title, in_terminal(headings, found))
                if given.page is not None:
                    marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
                    replace_between(given.page, marks, f"{title}:\n\n{in_markdown(headings, found, left=1)}")


if __name__ == "__main__":
    main()
