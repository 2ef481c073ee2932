"""`python -m benchmarks.validation [--robots ROBOT ...] [--pages docs]`: robots against MuJoCo, and controllers in it.

Accelerations at 200 random states and a drive of 10 s, for the description's parameters and for five drawn sets; then
controllers of experiments drive the engine's robot for as long as these last, in the plane, and in space where robots
stand. `--pages` writes a page for each robot with its figure, the tables, and three films. Times are of the processor
and depend on the machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

import wmr_afl
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.analysis import plots
from wmr_afl.analysis.film import filming
from wmr_afl.analysis.validation_report import figure
from wmr_afl.experiments.load import load_experiment
from wmr_afl.validation.drive import drive
from wmr_afl.validation.engine import mujoco
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.tracking import track
from wmr_afl.validation.validate import Validation, drawn, validate

DRAWS, SEED = 5, 7
FILMED = {"mecanum": 6.0, "tractor_3_trailers": 10.0, "type_1_1": 8.0}  # [s]
SIZE, PICTURES = (320, 180), 80  # of a film
HEADINGS = [
    "robot", "accelerations, rms [%]", "bound", "drive [%]", "end of the path [%]", "drawn: accelerations [%]",
    "drawn: drive [%]", "friction needed", "agrees", "time [s]",
]  # fmt: skip
LOOPS = [
    ("study_1", "AFL"), ("study_1_laws", "composite"), ("study_1_laws", "direct"), ("study_2_pose", "pose"),
    *(
        (f"track_{robot}", "composite")
        for robot in (
            "type_2_0_caster", "type_2_1", "type_3_0", "mecanum", "type_1_1", "type_1_2", "car", "tractor_trailer",
            "tractor_3_trailers",
        )
    ),
]  # fmt: skip
OF_LOOPS = [
    "experiment", "controller", "rms error, simulated [mm]", "in MuJoCo, 1 ms", "extrapolated",
    "between them, 1 ms [mm]", "extrapolated [um]", "in space [um]", "friction needed",
]  # fmt: skip


def robots(names: Sequence[str], pages: Path | None) -> Iterator[list[str]]:
    """A row each; their pages are written besides."""
    for name in names:
        start = time.process_time()
        found = validate(name)
        seconds = time.process_time() - start
        model = found.model
        others = [validate(model, parameters=own) for own in drawn(model, DRAWS, SEED)]
        if pages is not None:
            write_page(found, pages)
        worst = max(one.bursts.rms.max() for one in others), max(_drive(one) for one in others)
        row = [
            name, _percent(found.bursts.rms.max()), f"{100 * found.bounds.bursts:g}",
            _percent(found.differences[2].max()), _percent(found.ends[2]), *map(_percent, worst),
            f"{max(found.friction.values()):.2f}", "yes" if all(one.agrees for one in (found, *others)) else "NO",
            f"{seconds:.1f}",
        ]  # fmt: skip
        print(" | ".join(row), file=sys.stderr, flush=True)
        yield row


def loops(names: Sequence[str]) -> Iterator[list[str]]:
    """A row for each controller of these robots."""
    for experiment, controller in LOOPS:
        loaded = load_experiment(experiment)
        loop, duration = loaded.loops[controller], loaded.experiment.simulation.duration
        if loop.model.name not in names:
            continue
        found = track(loop, controller, duration)
        simulated, coarse, _, extrapolated = 1e3 * np.linalg.norm(found.errors, axis=1)
        apart = 1e3 * np.linalg.norm(found.apart, axis=1)
        mechanism = Mechanism(loop.model, loop.plant.parameters)
        in_space = "does not stand"
        if mechanism.stands(loop.plant.start[: loop.model.coordinate_count]):
            in_space = f"{1e6 * np.linalg.norm(track(loop, controller, duration, mechanism.axle_height).apart[2]):.2g}"
        row = [
            experiment, controller, *(f"{one:.3f}" for one in (simulated, coarse, extrapolated)), f"{apart[0]:.2g}",
            f"{1e3 * apart[2]:.2g}", in_space,
            f"{found.grip.friction.max():.2f}",
        ]  # fmt: skip
        print(" | ".join(row), file=sys.stderr, flush=True)
        yield row


def write_page(found: Validation, docs: Path) -> None:
    """`validation/ROBOT.md` with its figure."""
    name, folder = found.model.name, docs / "validation"
    folder.mkdir(exist_ok=True)
    with plots.styled():
        figure(found).savefig(folder / f"{name}.png", dpi=70)
    velocities = in_markdown(
        ["velocity", "acceleration, rms [%]", "worst [%]", "drive, 1 ms [%]", "0.5 ms [%]", "extrapolated [%]"],
        [
            [velocity, *map(_percent, (found.bursts.rms[i], found.bursts.worst[i], *found.differences[:, i]))]
            for i, velocity in enumerate(found.names)
        ],
        1,
    )
    wheels = in_markdown(
        ["wheel", "load at rest [N]", "friction needed, of its load"],
        [[one, f"{wheel['rest']:.1f}", f"{wheel['friction']:.2f}"] for one, wheel in found.wheels.items()],
        1,
    )
    film = f"![{found.model.title} in MuJoCo, {FILMED[name]:g} s]({name}.gif)\n\n" if name in FILMED else ""
    text = f"""# {found.model.title}: against MuJoCo

    wmr-afl validate {name}

{found.verdict}. What is compared, and how: [validation](../validation.md).

{velocities}

{wheels}

![speeds, differences and path of a drive of 10 s in both]({name}.png)

{film}"""
    (folder / f"{name}.md").write_text(text.rstrip("\n") + "\n", encoding="utf-8")


def write_film(name: str, docs: Path) -> None:
    """The first seconds of the drive."""
    model = wmr_afl.load_model(name)
    mechanism = Mechanism(model, np.asarray(model.parameters(), dtype=float))
    seconds = FILMED[name]
    with filming(docs / "validation" / f"{name}.gif", seconds, SIZE, PICTURES) as camera:
        drive(mechanism, np.zeros(model.coordinate_count), seconds, watch=camera)


def _drive(found: Validation) -> float:
    return max(float(found.differences[2].max()), float(found.ends[2]))


def _percent(share: float) -> str:
    return f"{100 * share:.2g}"


def main() -> None:
    """Print both tables; with --pages into the documentation as well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="*", default=list(wmr_afl.list_models()))
    parser.add_argument("--pages", type=Path)
    given = parser.parse_args()
    table, of_loops = list(robots(given.robots, given.pages)), list(loops(given.robots))
    title = f"Against MuJoCo {mujoco().__version__}"
    Console(width=200).print(in_terminal(HEADINGS, table, title), in_terminal(OF_LOOPS, of_loops))
    if given.pages is None:
        return
    linked = [[f"[{row[0]}](validation/{row[0]}.md)", *row[1:]] for row in table]
    page = given.pages / "validation.md"
    replace_between(
        page, ("<!-- robots -->", "<!-- end of robots -->"), f"{title}:\n\n{in_markdown(HEADINGS, linked, 1)}"
    )
    replace_between(page, ("<!-- loops -->", "<!-- end of loops -->"), in_markdown(OF_LOOPS, of_loops, 2))
    for name in FILMED:
        write_film(name, given.pages)


if __name__ == "__main__":
    main()
