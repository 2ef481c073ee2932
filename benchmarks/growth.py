"""The cost of growth: a tractor with N trailers hitched on the axles, N = 0, 1, 2, ...; seconds and operations.

`python -m benchmarks.growth` prints the table; it can also put it into a Markdown page and draw it.
"""

from __future__ import annotations

import json
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rich.console import Console
from rich.table import Table

from benchmarks.tables import in_markdown, in_terminal, replace_between
from derive.codegen.module import operation_count
from derive.codegen.quantities import quantities
from derive.codegen.write import generate_one, write
from derive.derivation import derive_robot
from wmr_afl.analysis.plots import COLOURS, new_figure, styled
from wmr_afl.model.laws import LAWS, Situation

TRACTOR = Path(__file__).parents[1] / "derive" / "robots" / "type_2_0.toml"
MOST = 8  # trailers
CHECKED = 3  # trailers of the model that must obey every law before anything is measured
COMPARED = 4  # trailers of the figures measured elsewhere, never by this benchmark
ELSEWHERE = {  # operations and how they grow
    "Kane's method in SymPy, matrix and forcing alone": (741, "as N²"),
    "a recursion over body-frame velocities, by hand": (274, "linearly"),
}
MARKS = "<!-- growth -->", "<!-- end of growth -->"  # in a page, around the table
HEADINGS = (
    "trailers N", "states", "derive and generate [s]", "time / time at N = 0", "operations of x'(x, u, w)",
    "added by the last trailer",
)  # fmt: skip


@dataclass(frozen=True)
class Cost:
    """What a tractor with this many trailers costs."""

    trailers: int
    seconds: float  # to derive and generate, without Python's start and its imports
    operations: int  # of the generated state_derivative

    @property
    def states(self) -> int:
        """x, y, phi, an angle for each trailer, v, omega."""
        return 5 + self.trailers


def description(trailers: int) -> str:
    """The catalogue's differential drive with trailers, each hitched to the middle of the axle before it, as TOML."""
    robot = tomllib.loads(TRACTOR.read_text(encoding="utf-8"))
    robot |= {"name": f"tractor_{trailers}_trailers", "title": f"Tractor with {trailers} trailers", "source": ""}
    parent, hitch = robot["frames"][0]["name"], "0"
    for i in range(1, trailers + 1):
        frame, axle = f"trailer_{i}", [f"-d_{i}", "0"]
        robot["coordinates"][f"beta{i}"] = "rad"
        robot["parameters"] |= {
            f"d_{i}": {"value": 1.2, "unit": "m", "about": f"length of trailer {i}"},
            f"m_{i}": {"value": 16.0, "unit": "kg", "about": f"mass of trailer {i}"},
            f"I_{i}": {"value": 4.0, "unit": "kg m^2", "about": f"inertia of trailer {i}"},
        }
        robot["frames"].append({"name": frame, "parent": parent, "at": [hitch, "0"], "angle": f"beta{i}"})
        robot["bodies"].append({"frame": frame, "at": axle, "mass": f"m_{i}", "inertia": f"I_{i}"})
        robot["wheels"].append({"name": f"axle_{i}", "frame": frame, "at": axle, "radius": "r"})
        parent, hitch = frame, axle[0]
    return "".join(f"{key} = {_toml(value)}\n" for key, value in robot.items())


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def operations(trailers: int) -> int:
    """Operations of the generated `state_derivative` of a tractor with this many trailers."""
    with TemporaryDirectory() as folder:
        derivation = derive_robot(_described(trailers, Path(folder)))
    derivative = next(one for one in quantities(derivation) if one.name == "state_derivative")
    return operation_count(derivative, derivation.terms)


def check(trailers: int) -> None:
    """The generated model of a tractor with this many trailers obeys every law."""
    with TemporaryDirectory() as folder:
        files = generate_one(_described(trailers, Path(folder)))
        write(files, Path(folder))
        situation = Situation(Path(folder))
        for law in LAWS:
            if law.applies(situation.numpy):
                assert law.deviation(situation) <= law.tolerance, f"{trailers} trailers: {law.statement}"


def costs(most: int, turns: int) -> list[Cost]:
    """The cost of 0 to `most` trailers: every derivation in a fresh process, the best time of many turns counts."""
    check(CHECKED)
    every = range(most + 1)
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as fresh:
        counts = list(fresh.map(operations, every))
        times = [list(fresh.map(_seconds, every)) for _ in range(turns)]
    best = [min(each) for each in zip(*times, strict=True)]
    return list(map(Cost, every, best, counts))


def _seconds(trailers: int) -> float:
    """Time to derive and generate a tractor with this many trailers."""
    with TemporaryDirectory() as folder:
        path = _described(trailers, Path(folder))
        start = time.perf_counter()
        generate_one(path)
        return time.perf_counter() - start


def _described(trailers: int, folder: Path) -> Path:
    path = folder / "robot.toml"
    path.write_text(description(trailers), encoding="utf-8")
    return path


def measure(most: int = MOST, turns: int = 1) -> Table:
    """Seconds and operations over the number of trailers."""
    return tabulate(costs(most, turns))


def tabulate(found: list[Cost]) -> Table:
    """The costs as a table for the terminal."""
    table = in_terminal(HEADINGS, _rows(found), "A tractor with N trailers: what growth costs")
    table.caption, table.caption_justify = "\n".join(_elsewhere()), "left"
    return table


def markdown(found: list[Cost]) -> str:
    """The costs as a table for a page."""
    return in_markdown(HEADINGS, _rows(found))


def _rows(found: list[Cost]) -> Iterator[list[str]]:
    for before, cost in zip([None, *found], found, strict=False):
        ratio, added = cost.seconds / found[0].seconds, str(cost.operations - before.operations) if before else ""
        yield [str(cost.trailers), str(cost.states), f"{cost.seconds:.1f}", f"{ratio:.1f}", str(cost.operations), added]


def _elsewhere() -> list[str]:
    said = [f"{what}: {number} operations, growing {how}" for what, (number, how) in ELSEWHERE.items()]
    return [f"Measured elsewhere, at N = {COMPARED}:", *said]


def draw(found: list[Cost]) -> Figure:
    """Operations and time over the number of trailers, side by side."""
    trailers, last = [cost.trailers for cost in found], found[-1]
    with styled():
        figure = new_figure(8.0, 3.4)
        left, right = figure.subplots(1, 2)
        left.plot(trailers, [cost.operations for cost in found], "o-", color=COLOURS[0])
        place = {"textcoords": "offset points", "ha": "right", "fontsize": 8}
        end = last.trailers, last.operations
        left.annotate("generated\nstate_derivative", end, (0, -30), color=COLOURS[0], va="top", **place)
        for (what, (number, _)), marker, colour in zip(ELSEWHERE.items(), "^s", COLOURS[1:], strict=False):
            left.plot([COMPARED], [number], marker, color=colour)
            text = what.replace(", ", ",\n").replace("over ", "over\n")
            left.annotate(text, (COMPARED, number), (-8, 0), color=colour, va="center", **place)
        right.plot(trailers, [cost.seconds for cost in found], "o-", color=COLOURS[0])
        left.set(ylabel="operations")
        right.set(ylabel="time to derive and generate [s]")
        for axes in (left, right):
            axes.margins(y=0.1)
            axes.set(xlabel="number of trailers N", ylim=(0, None))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def main(
    most: Annotated[int, typer.Option(min=0, help="Up to this many trailers.")] = MOST,
    turns: Annotated[int, typer.Option(min=1, help="How often each is timed; the best time counts.")] = 1,
    table: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="A Markdown page whose table is replaced.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Where the figure goes, a PNG file.")] = None,
) -> None:
    """Measure what each further trailer costs, and print it."""
    found = costs(most, turns)
    Console(width=150, markup=False).print(tabulate(found))
    if table is not None:
        replace_between(table, MARKS, markdown(found))
    if plot is not None:
        with styled():
            draw(found).savefig(plot, dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    typer.run(main)
