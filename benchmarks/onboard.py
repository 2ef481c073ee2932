"""`python -m benchmarks.onboard [--page docs/robot.md] [--steps 10000000]`: what exported C is worth.

A robot in double precision under laws in single precision beside Python's own; how much rounding the measurements alone
to single precision changes; and any bits in every argument under sanitizers.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.exported import Law, fuzzed, tracked
from benchmarks.tables import in_markdown, in_terminal, replace_between, three_digits
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard.export import AMPLIFIED, export, vectors
from wmr_afl.onboard.export import onboard as on_the_robot
from wmr_afl.simulation.closed_loop import ClosedLoop

TRACKED = [
    ("study_1", "AFL"), ("study_1_laws", "composite"), ("track_tractor_3_trailers", "exact"),
    ("track_tractor_3_trailers", "composite"), ("track_car", "composite"), ("track_mecanum", "direct"),
    ("study_2_pose", "pose"),
]  # fmt: skip
FUZZED = [
    ("study_1", "AFL"), ("study_2", "robust AFL"), ("track_mecanum", "AFL"), ("track_car", "composite"),
    ("study_2_pose", "pose"), ("track_type_2_1", "direct"), ("track_tractor_3_trailers", "exact"),
]  # fmt: skip
SECONDS = 30.0
HEADINGS = [
    "controller", "error, double [mm]", "error, float [mm]", "u: rounded inputs", "u: float", "theta: rounded inputs",
    "theta: float",
]  # fmt: skip
MARKS = "<!-- single precision -->", "<!-- end of single precision -->"


def rows(folder: Path) -> Iterator[list[str]]:
    """What single precision makes of each controller."""
    for experiment, name in TRACKED:
        loop = load_experiment(experiment).loops[name]
        samples = round(SECONDS / loop.sample_time)
        law = Law(loop, folder / f"{experiment} {name}".replace(" ", "_"), True)
        rms = [np.sqrt(np.mean(tracked(loop, one, samples)[samples // 2 :] ** 2)) for one in (None, law)]
        sizes = deviations(loop, Law(loop, folder / f"again {experiment} {name}".replace(" ", "_"), True), samples)
        yield [f"{experiment}, {name}", *(three_digits(1e3 * one) for one in rms), *(f"{one:.1e}" for one in sizes)]


def deviations(loop: ClosedLoop, law: Law, samples: int) -> tuple[float, float, float, float]:
    """By how much rounding the inputs alone, and single precision, change voltages, then estimates, of the largest."""
    sampled = on_the_robot(loop)
    exact, _ = vectors(loop, sampled, samples)
    rounded, _ = vectors(loop, sampled, samples, is_single=True)
    measured, outputs = len(sampled.measured), len(loop.model.output_units)
    u = slice(1 + measured + 3 * outputs, 1 + measured + 3 * outputs + law.u.size)
    place = sampled.states.places["theta_hat"]
    theta = slice(u.stop + place.start, u.stop + place.stop)
    single = exact.copy()
    for row, given in zip(single, rounded, strict=True):
        law.step(given[0], given[1 : 1 + measured], given[1 + measured : u.start])
        row[u], row[theta] = law.u, law.state[place]
    size = np.abs(exact).max(axis=0)
    off = [np.abs(one - exact).max(axis=0) / np.where(size > 0.0, size, 1.0) for one in (rounded, single)]
    return off[0][u].max(), off[1][u].max(), off[0][theta].max(), off[1][theta].max()


def fuzz(folder: Path, steps: int) -> Iterator[str]:
    """A line for each controller and precision."""
    each = -(-steps // (2 * len(FUZZED)))
    for experiment, name in FUZZED:
        for is_single in (False, True):
            out = folder / f"fuzz {experiment} {name} {is_single}".replace(" ", "_")
            export(experiment, name, out, is_single=is_single, is_unlimited=True, has_reference=False, samples=1)
            counts = fuzzed(out, each)
            real = "float" if is_single else "double"
            yield f"{experiment}, {name}, {real}: {sum(counts)} steps, {counts[0]} OK, nothing wrong"


def main() -> None:
    reader = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reader.add_argument("--page", type=Path, help="the page whose table is replaced")
    reader.add_argument("--steps", type=int, default=0, help="steps with any bits, over all controllers")
    given, console = reader.parse_args(), Console(width=170, markup=False, highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        if given.steps:
            for line in fuzz(Path(folder), given.steps):
                console.print(line)
        found = list(rows(Path(folder)))
    console.print(in_terminal(HEADINGS, found))
    console.print(f"a replay in single precision allows {AMPLIFIED:g} times what rounding the inputs alone changes")
    if given.page:
        replace_between(given.page, MARKS, in_markdown(HEADINGS, found, left=1))


if __name__ == "__main__":
    main()
