"""`python -m benchmarks.laws [--runs N] [--page docs/control.md]`: every law on every robot and on the paper's studies.

All laws of a table meet the same draws, whose seeds were not used to choose any number of a law.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

import wmr_afl
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.experiments.experiment import find_experiment

Draws = dict[str, NDArray[np.float64]]
SEED = 4242
SAMPLES_LOGGED = 100  # runs of which the inputs are recorded, for their travel
PAPER = "frozen (25), b1 = 2 w, b2 = w^2"
OFF = 3.0  # first estimates are wrong by up to this factor, up or down


def wrong_guesses(robot: str, random: np.random.Generator, count: int, base: str = "passivity_parameters") -> Draws:
    """Factors on every entry of the first estimate, as likely too small as too large."""
    names = wmr_afl.load_model(robot).units_of(base)
    return {f"estimates.{name}": OFF ** random.uniform(-1.0, 1.0, count) for name in names}


def somewhat_different(robot: str, random: np.random.Generator, count: int) -> Draws:
    """Robots whose uncertain parameters are off by up to 30 %."""
    model = wmr_afl.load_model(robot)
    uncertain = [name for name in model.parameter_units if name not in model.known_units]
    return {f"parameters.{name}": random.uniform(0.7, 1.3, count) for name in uncertain}


def starts_around(experiment: Path, random: np.random.Generator, count: int) -> Draws:
    """Within a metre and a radian of an experiment's start."""
    from wmr_afl.experiments.load import load_experiment

    loop = next(iter(load_experiment(experiment).loops.values()))
    start = dict(zip(loop.model.state_units, loop.plant.start, strict=True))
    angle, distance = random.uniform(0.0, 2.0 * np.pi, count), np.sqrt(random.uniform(0.0, 1.0, count))
    return {
        "x": start["x"] + distance * np.cos(angle),
        "y": start["y"] + distance * np.sin(angle),
        "phi": start["phi"] + random.uniform(-1.0, 1.0, count),
    }


def with_controllers(name: str, controllers: Mapping[str, str], folder: Path, changes: Mapping[str, str]) -> Path:
    """A shipped experiment with other controllers; `changes` replace texts."""
    text = find_experiment(name).read_text(encoding="utf-8")
    text = text[: text.index("[shared]")]
    for old, new in changes.items():
        if old not in text:
            raise ValueError(f"{name} does not say {old!r}")
        text = text.replace(old, new, 1)
    file = folder / f"{name}.toml"
    tables = (f'\n[controllers."{controller}"]\n{table}\n' for controller, table in controllers.items())
    file.write_text(text + "".join(tables), encoding="utf-8")
    return file


def spread(rms: NDArray[np.float64], failed: NDArray[np.bool_]) -> str:
    """Median (worst), and how many failed."""
    sizes = np.where(failed, np.inf, rms)
    text = f"{np.median(sizes):.1e} ({sizes.max():.1e})" if not failed.any() else f"{np.median(sizes):.1e}"
    return f"{text}, {failed.sum()} fail" if failed.any() else text


def robots(runs: int, folder: Path, noise: float) -> Iterator[list[str]]:
    """A row for each robot: RMS of the last 40 s of its track, without force."""
    laws = ("exact", "frozen", "direct", "composite")
    tables = {law: f'law = "{"frozen" if law == "exact" else law}"\nreference_rate = 1.0' for law in laws}
    for robot in wmr_afl.list_models():
        random = np.random.default_rng(SEED)
        units = wmr_afl.load_model(robot).state_units
        coordinates = wmr_afl.load_model(robot).coordinate_count
        deviation = [noise] * coordinates + [5.0 * noise] * (len(units) - coordinates)
        told = (
            f"[uncertainties]\nmeasurement_noise = {{ deviation = {deviation}, seed = 5 }}\n"
            if noise
            else "[uncertainties]\n"
        )
        duration = find_experiment(f"track_{robot}").read_text(encoding="utf-8").split("duration = ")[1].split()[0]
        changes = {"[uncertainties]\n": told, f"duration = {duration}": "duration = 90.0"}
        file = with_controllers(f"track_{robot}", tables, folder, changes)
        guesses, row = wrong_guesses(robot, random, runs), [robot]
        for law in laws:
            factors = {name: np.ones(1) for name in guesses} if law == "exact" else guesses
            batch = wmr_afl.run_batch(file, law, scale=factors, since=50.0)
            row.append(spread(np.linalg.norm(batch.rms, axis=1), np.isfinite(batch.failure_time)))
        yield row


def study_1(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each law: failures, and RMS after 100 s."""
    adapted = "outer_loop = { b1 = 2.0, b2 = 1.0 }\nprojection = { lower = 0.1 }\nestimate = 1.0\n"
    gain = "gain = [10.0, 5.0, 10.0, 10.0, 1.0, 10.0]"
    laws = {
        "the paper's AFL": f"{adapted}adaptation = {{ {gain} }}",
        "AFL, late order": f'{adapted}adaptation = {{ {gain}, order = "late" }}',
        "AFL behind a reference model": f"{adapted}adaptation = {{ {gain} }}\nreference_rate = 1.0",
        "direct": 'law = "direct"\nreference_rate = 1.0',
        "composite": 'law = "composite"\nreference_rate = 1.0',
    }
    file = with_controllers("study_1", laws, folder, {})
    random = np.random.default_rng(SEED)
    start, guesses = starts_around(file, random, runs), wrong_guesses("type_2_0", random, runs)
    for law in laws:
        factors = guesses if law in ("direct", "composite") else {"estimates.theta1": np.ones(runs)}
        batch = wmr_afl.run_batch(file, law, scale=factors, start=start, since=100.0)
        rms = batch.rms.max(axis=1)
        failed = ~(rms < 0.05)
        rate, low, high = wmr_afl.experiments.campaigns.result.wilson(int(failed.sum()), runs, 0.95)
        worst = "" if failed.any() else f"{rms.max():.1e}"
        yield [law, f"{100 * rate:.1f} ({100 * low:.1f} to {100 * high:.1f})", f"{np.median(rms):.1e}", worst]


def study_2(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each law: RMS after 10 s of the worse output, and how far inputs travel."""
    laws = {f"composite, rate = {rate}": f'law = "composite"\nrate = {rate}\nreference_rate = 1.0' for rate in (15, 20)}
    laws["composite, rate = 20, noise = 0.5"] = laws["composite, rate = 20"] + "\nlearning = { noise = 0.5 }"
    laws["direct, rate = 15"] = 'law = "direct"\nrate = 15\nreference_rate = 1.0'
    laws["frozen, rate = 15"] = 'law = "frozen"\nrate = 15\nreference_rate = 1.0'
    for w in (15, 20, 30, 40):
        laws[f"{PAPER}, w = {w}"] = f"outer_loop = {{ b1 = {2 * w}.0, b2 = {w * w}.0 }}"
    file = with_controllers("study_2", laws, folder, {})
    random = np.random.default_rng(SEED)
    start, robots = starts_around(file, random, runs), somewhat_different("type_2_0", random, runs)
    guesses = wrong_guesses("type_2_0", random, runs)
    theta = wrong_guesses("type_2_0", random, runs, "base_parameters")
    for law in laws:
        scale = {**robots, **(theta if law.startswith(PAPER) else guesses)}
        batch = wmr_afl.run_batch(file, law, scale=scale, start=start, since=10.0)
        rms = np.where(np.isfinite(batch.failure_time), np.inf, batch.rms.max(axis=1)) * 1e3
        travel = travels(file, law, scale, start, folder)
        figures = [f"{np.median(rms):.2f}", f"{np.quantile(rms, 0.99, method='higher'):.2f}", f"{rms.max():.2f}"]
        yield [law, *figures, f"{100 * np.mean(rms > 10.0):.1f}", f"{np.median(travel):.0f}"]


def travels(file: Path, law: str, scale: Draws, start: Draws, folder: Path) -> NDArray[np.float64]:
    """How far the inputs of some of the runs travel after 10 s [V/s], a mean over the motors."""
    some = slice(0, SAMPLES_LOGGED)
    log = folder / "runs.h5"
    wmr_afl.run_batch(
        file, law, scale={name: column[some] for name, column in scale.items()},
        start={name: column[some] for name, column in start.items()}, trajectories=log,
    )  # fmt: skip
    with h5py.File(log) as runs:
        late = runs["time"][:] >= 10.0
        inputs, time = runs["input"][:][:, late], runs["time"][:][late]
    log.unlink()
    return np.asarray(np.abs(np.diff(inputs, axis=1)).sum(axis=1).mean(axis=1) / (time[-1] - time[0]))


TABLES = {
    "robots": (
        "Tracks at 20 ms, every entry of pi_hat(0) wrong by up to 3; RMS of the last 40 s, median (worst)",
        ("robot", "exact", "frozen", "direct", "composite"),
        lambda runs, folder: robots(max(1, runs // 50), folder, 0.0),
    ),
    "noise": (
        "The same with noise of 1 mm and 1 mrad, 5 mm/s and 5 mrad/s",
        ("robot", "exact", "frozen", "direct", "composite"),
        lambda runs, folder: robots(max(1, runs // 50), folder, 1e-3),
    ),
    "study 1": (
        "Study 1, starts within 1 m and 1 rad; the paper's law from estimates of 1, the others wrong by up to 3",
        ("law", "failures [%] (95 %)", "RMS after 100 s, median [m]", "worst [m]"),
        study_1,
    ),
    "study 2": (
        "Study 2: robots off by 30 %, first estimates wrong by up to 3, starts within 1 m and 1 rad",
        ("law", "median [mm]", "99 %", "worst", "above 10 mm [%]", "travel [V/s]"),
        study_2,
    ),
}  # fmt: skip


def main() -> None:
    """Measure, print the tables, and write them into the page if one is named."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--runs", type=int, default=1000)
    reader.add_argument("--only", choices=TABLES)
    reader.add_argument("--page", type=Path)
    given = reader.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name, (title, headings, measured) in TABLES.items():
            if given.only not in (None, name):
                continue
            found = list(measured(given.runs, Path(folder)))
            Console(width=160).print(title, in_terminal(headings, found))
            if given.page is not None:
                marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
                replace_between(given.page, marks, f"{title}:\n\n{in_markdown(headings, found, left=1)}")


if __name__ == "__main__":
    main()
