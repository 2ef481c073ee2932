"""`python -m benchmarks.laws [--runs N] [--page docs/control.md]`: every law on every robot and on the paper's studies.

All laws of a table meet the same draws, whose seeds were not used to choose any number of a law.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

import wmr_afl
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.analysis.campaign_plots import draw_comparison
from wmr_afl.analysis.monte_carlo import Crowd, starts_around, wrong_guesses
from wmr_afl.analysis.paper.beyond import JUDGED, SETTLED, frozen, judged
from wmr_afl.analysis.plots import save
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment

SEED = 4242
LAWS = ("exact", "frozen", "direct", "composite")
PAPER = "frozen (25), b1 = 2 w, b2 = w^2"


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


def spread(errors: NDArray[np.float64]) -> str:
    """Median (worst), and how many failed, whose errors are infinite."""
    failed = int(np.isinf(errors).sum())
    return f"{np.median(errors):.1e}" + (f", {failed} fail" if failed else f" ({errors.max():.1e})")


def robots(runs: int, folder: Path, noise: float, by_entry: bool) -> Iterator[list[str]]:
    """A row for each robot: RMS of the last 40 s of its track, without force.

    First estimates are wrong in every entry by draw, or follow from the wrong guess of the shipped track.
    """
    for robot in wmr_afl.list_models():
        random = np.random.default_rng(SEED)
        told_guess = "" if by_entry else guess_of(robot)
        tables = {
            law: f'law = "{"frozen" if law == "exact" else law}"\nreference_rate = 1.0\n'
            f"{'' if law == 'exact' else told_guess}"
            for law in LAWS
        }
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
        guesses = wrong_guesses(wmr_afl.load_model(robot), random, runs)
        seeds = SEED + np.arange(runs if noise else 1)
        errors = {}
        for law in LAWS:
            known = {name: np.ones(len(seeds)) for name in guesses}
            drawn = guesses if by_entry and law != "exact" else known
            batch = wmr_afl.run_batch(file, law, scale=drawn, since=50.0, seeds=seeds if noise else None)
            errors[law] = np.where(batch.failed, np.inf, np.linalg.norm(batch.rms, axis=1))
        median = {law: float(np.median(errors[law])) for law in LAWS}
        ratios = [median["composite"] / median["exact"], median["frozen"] / median["composite"]]
        yield [robot, *(spread(errors[law]) for law in LAWS), *(f"{ratio:.2g}" for ratio in ratios)]


def guess_of(robot: str) -> str:
    """The line of a robot's track that gives the wrong guess."""
    guess = load_experiment(f"track_{robot}").experiment.shared.guess
    return f"guess = {{ {', '.join(f'{name} = {value}' for name, value in guess.items())} }}"


def agreement(folder: Path) -> Iterator[list[str]]:
    """A row for each robot: by how much whole runs of its track differ between backends, by law."""
    tables = {law: f'law = "{law}"\nreference_rate = 1.0' for law in LAWS[1:]}
    for robot in wmr_afl.list_models():
        told = {law: f"{table}\n{guess_of(robot)}" for law, table in tables.items()}
        file = with_controllers(f"track_{robot}", told, folder, {})
        runs = {backend: wmr_afl.run(file, backend) for backend in ("numpy", "casadi", "compiled")}
        yield [robot, *(f"{max(difference(runs[one][law], runs['numpy'][law]) for one in ('casadi', 'compiled')):.0e}"
                        for law in tables)]  # fmt: skip


def difference(run: wmr_afl.Run, other: wmr_afl.Run) -> float:
    """The largest difference of a signal, relative to the signal's largest value or to 1."""
    signals = ((getattr(one, name) for one in (run, other)) for name in ("state", "input", "estimate", "error"))
    return max(float(np.abs(a - b).max() / max(1.0, np.abs(b).max())) for a, b in signals)


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
    loop = load_experiment(file).loops["direct"]
    start, guesses = starts_around(loop, random, runs), wrong_guesses(loop.model, random, runs)
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
    calm = "noise = 3.0, gain = 0.3"
    laws[f"composite, rate = 20, {calm}"] = laws["composite, rate = 20"] + f"\nlearning = {{ {calm} }}"
    laws["direct, rate = 15"] = 'law = "direct"\nrate = 15\nreference_rate = 1.0'
    laws["frozen, rate = 15"] = 'law = "frozen"\nrate = 15\nreference_rate = 1.0'
    laws |= {f"{PAPER}, w = {w}": frozen(w) for w in (15, 20, 30, 40)}
    return scored(with_controllers("study_2", laws, folder, {}), laws, runs, SEED)


def scored(file: Path, laws: Iterable[str], runs: int, seed: int) -> Iterator[list[str]]:
    """A row for each law of an experiment, under the draws of a seed; first estimates are wrong by up to three."""
    loaded = load_experiment(file)
    crowd = Crowd.drawn(next(iter(loaded.loops.values())), seed, runs)
    for law in laws:
        yield [law, *judged(crowd.score(loaded.experiment, law, loaded.loops[law], (SETTLED,), threads=2))]


def shipped_draws(runs: int, folder: Path) -> Iterator[list[str]]:
    """A row for each law of `study_1_laws`: failures, and RMS after 100 s of the worse output."""
    for law, result in wmr_afl.compare("study_1_laws", runs, folder / "laws").items():
        one = result.brief()
        low, high = one["failed_95"]
        rate = f"{100 * one['failed']:.1f} ({100 * low:.1f} to {100 * high:.1f})"
        yield [law, rate, *("fails" if one[key] is None else f"{one[key]:.1e}" for key in ("rms_median", "rms_worst"))]


OF_ROBOTS = ("robot", *LAWS, "composite / exact", "frozen / composite")
TABLES = {
    "robots": (
        "Tracks at 20 ms, every entry of pi_hat(0) wrong by up to 3; RMS of the last 40 s, median (worst)",
        OF_ROBOTS,
        lambda runs, folder: robots(max(1, runs // 50), folder, 0.0, True),
    ),
    "noise": (
        "The same with noise of 1 mm and 1 mrad, 5 mm/s and 5 mrad/s",
        OF_ROBOTS,
        lambda runs, folder: robots(max(1, runs // 50), folder, 1e-3, True),
    ),
    "guess": (
        "The shipped tracks, from a guess of the physical parameters that is 50 % off",
        OF_ROBOTS,
        lambda runs, folder: robots(1, folder, 0.0, False),
    ),
    "guess with noise": (
        "The same with that noise, five seeds",
        OF_ROBOTS,
        lambda runs, folder: robots(5, folder, 1e-3, False),
    ),
    "agreement": (
        "Largest difference between the backends over the whole run of each track, relative to the signals' size",
        ("robot", *LAWS[1:]),
        lambda runs, folder: agreement(folder),
    ),
    "study_1_laws": (
        "Study 1, the draws of `study_1_laws`: starts within a metre, robots lighter and heavier by up to two",
        ("law", "failures [%] (95 %)", "RMS after 100 s, median [m]", "worst [m]"),
        shipped_draws,
    ),
    "study 1": (
        "Study 1, starts within 1 m and 1 rad; the paper's law from estimates of 1, the others wrong by up to 3",
        ("law", "failures [%] (95 %)", "RMS after 100 s, median [m]", "worst [m]"),
        study_1,
    ),
    "study 2": (
        "Study 2: robots off by 30 %, first estimates wrong by up to 3, starts within 1 m and 1 rad",
        ("law", *JUDGED),
        study_2,
    ),
}  # fmt: skip


def main() -> None:
    """Measure, print the tables, and write them into the page if one is named."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--runs", type=int, default=1000)
    reader.add_argument("--only", choices=TABLES)
    reader.add_argument("--page", type=Path, action="append", default=[])
    reader.add_argument("--plot", type=Path, help="takes the plot of study_1_laws")
    given = reader.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name, (title, headings, measured) in TABLES.items():
            if given.only not in (None, name):
                continue
            found = list(measured(given.runs, Path(folder)))
            Console(width=160).print(title, in_terminal(headings, found))
            marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
            for page in given.page:
                if marks[0] in page.read_text(encoding="utf-8"):
                    replace_between(page, marks, f"{title}:\n\n{in_markdown(headings, found, left=1)}")
        if given.plot is not None:
            results = wmr_afl.compare("study_1_laws", given.runs, Path(folder, "laws"))
            save(draw_comparison(results), given.plot.with_suffix(""))
            given.plot.with_suffix(".svg").unlink()  # which `save` writes, too


if __name__ == "__main__":
    main()
