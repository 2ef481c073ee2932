"""`python -m benchmarks.embedded [--page docs/robot.md] [--hosts]`: exported controllers on a Cortex-M, in QEMU.

Every controller is built without a warning, replays what Python did, and gives the same bits on each core as here.
`--hosts`: instead, every shipped controller on this machine, by each of its compilers.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from benchmarks import misra
from benchmarks.microcontroller import (
    BOARD,
    M4F,
    M7,
    SHIFT,
    Core,
    EmbeddedError,
    Replay,
    cost_told,
    cross_objects,
    in_qemu,
    install,
    linked,
    replayed_on_core,
    replayed_on_host,
    size,
)
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.errors import WmrError
from wmr_afl.experiments.experiment import list_experiments
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard.export import export

EXAMPLE = BOARD.parent / "main.c"
REFERENCE_COST = Path(__file__).with_name("reference_cost.c")
REACHED = "STOPPED, and at rest"  # what the example prints at its end
HEADINGS = (
    *("controller", "precision", "core", "code [B]", ".data, .bss [B]", "stack of a step [B]"),
    *("instructions a step, least", "mean", "most"),
)


@dataclass(frozen=True)
class Case:
    """A controller of an experiment, and what a step may cost on an M4F in single precision."""

    experiment: str
    controller: str
    most: int | None = None  # instructions

    @property
    def name(self) -> str:
        return f"{self.experiment}, {self.controller}"


CASES = (
    Case("study_1", "AFL", most=700),  # the paper's law
    Case("study_2", "robust AFL"),  # with the robust term and leakage
    Case("track_tractor_3_trailers", "exact"),  # the longest equations, without adaptation
    Case("track_mecanum", "AFL"),  # four motors for three velocities
    Case("track_car", "composite", most=6000),  # least squares and a reference model: the most states
)


def precision(is_single: bool) -> str:
    return "float" if is_single else "double"


def exported(experiment: str, controller: str, is_single: bool, folder: Path) -> Path:
    """The folder of an export."""
    out = folder / f"{experiment}_{controller}_{precision(is_single)}".replace(" ", "_")
    export(experiment, controller, out / "export", is_single=is_single, is_unlimited=True)
    return out


def on_hosts(folder: Path, name: str) -> Replay:
    """What a replay prints on this machine.

    Raises:
        EmbeddedError: if its compilers do not give the same bits.
    """
    compilers = [compiler for compiler in ("gcc", "clang") if shutil.which(compiler)]
    if not compilers:
        raise EmbeddedError("there is no gcc or clang for this machine")
    found = {compiler: replayed_on_host(compiler, folder / "export", folder) for compiler in compilers}
    if len({one.bits for one in found.values()}) > 1:
        told = ", ".join(f"{compiler} {one.bits}" for compiler, one in found.items())
        raise EmbeddedError(f"{name}: not the same bits: {told}")
    return found[compilers[0]]


def measured(case: Case, is_single: bool, core: Core, host: Replay, folder: Path) -> list[str]:
    """A row of the table.

    Raises:
        EmbeddedError: if bits differ from the host's, a step costs more than it may, or an object holds data.
    """
    name = f"{case.name} in {precision(is_single)} on {core.name}"
    out = folder / core.name
    out.mkdir()
    replay, code, cost = replayed_on_core(core, folder / "export", out)
    if replay.bits != host.bits:
        raise EmbeddedError(f"{name}: bits {replay.bits}, {host.bits} on this machine")
    if case.most is not None and is_single and core == M4F and cost.most > case.most:
        raise EmbeddedError(f"{name}: {cost.most} instructions a step instead of {case.most}")
    held = sum(one.data + one.bss for one in map(size, out.glob("*.o")))
    if held:
        raise EmbeddedError(f"{name}: {held} B of .data and .bss")
    numbers = (code.code, held, cost.stack, cost.least, cost.mean, cost.most)
    return [case.name, precision(is_single), core.name, *map(str, numbers)]


def beside(out: Path) -> Iterator[list[str]]:
    """Rows of what is called beside a step, for an export in single precision."""
    for name, *flags in (("buffer asked once",), ("reference, in double", "-DOF_REFERENCE")):
        for core in (M4F, M7):
            objects = cross_objects(core, out / "export", out)
            image = linked(core, REFERENCE_COST, objects, [out / "export"], out, f"-DSHIFT={SHIFT}", *flags)
            cost = cost_told(in_qemu(core, image, folder=out))
            yield [name, core.name, *map(str, (cost.stack, cost.least, cost.mean, cost.most))]


def example(out: Path) -> str:
    """What the example with an interrupt prints until the robot has stopped, for an export in single precision.

    Raises:
        EmbeddedError: if it does not stop.
    """
    objects = cross_objects(M4F, out / "export", out)
    image = linked(M4F, EXAMPLE, objects, [out / "export"], out)
    printed = in_qemu(M4F, image, folder=out, patience=60.0).rstrip()
    if not printed.endswith(REACHED):
        raise EmbeddedError(f"the example ended with {printed[-80:]!r}")
    return printed


def of_the_example(folder: Path) -> Path:
    """The folder of the controller that the example uses."""
    return exported("track_type_2_0", "AFL", True, folder)


def shipped(folder: Path) -> Iterator[list[str]]:
    """A row for each shipped controller and precision: what its replay prints on this machine."""
    for experiment in list_experiments():
        for controller in load_experiment(experiment).loops:
            for is_single in (False, True):
                name = f"{experiment}, {controller} in {precision(is_single)}"
                try:
                    out = exported(experiment, controller, is_single, folder)
                    host = on_hosts(out, name)
                    row = [f"{host.off:.1e}", host.bits]
                    shutil.rmtree(out)
                except (EmbeddedError, WmrError) as error:
                    row = [str(error), ""]
                yield [experiment, controller, precision(is_single), *row]


class Pages:
    """Where tables go: the terminal, and between marks of pages."""

    def __init__(self, pages: list[Path]) -> None:
        self.pages, self.console = pages, Console(width=150)

    def put(self, name: str, title: str, headings: tuple[str, ...], rows: list[list[str]], left: int) -> None:
        self.console.print(title, in_terminal(headings, rows))
        marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
        for page in self.pages:
            if marks[0] in page.read_text(encoding="utf-8"):
                replace_between(page, marks, f"{title}:\n\n{in_markdown(headings, rows, left)}")


def embedded(pages: Pages, folder: Path) -> None:
    """Measure all cases, check them against MISRA rules, and run the example."""
    install()
    rows, broken = list[list[str]](), set[str]()
    for case in CASES:
        for is_single in (True, False):
            out = exported(case.experiment, case.controller, is_single, folder)
            host = on_hosts(out, case.name)
            rows += [measured(case, is_single, core, host, out) for core in (M4F, M7)]
            pages.console.print(f"{case.name}, {precision(is_single)}: bits {host.bits} everywhere")
            if misra.is_there():
                broken |= misra.deviations(out / "export", out)
    pages.put("embedded", "One step with diagnostics, gcc -O2, counted in QEMU", HEADINGS, rows, left=3)
    if misra.is_there():
        reasons = [[rule, reason] for rule, reason in misra.DEVIATIONS.items() if rule in broken]
        pages.put("misra", "Advisory rules of MISRA C:2012 that exported C breaks", ("rule", "reason"), reasons, left=2)
    else:
        pages.console.print("cppcheck is not installed: MISRA rules were not looked at")
    out = of_the_example(folder)
    headings = ("beside the step", "core", "stack [B]", "instructions, least", "mean", "most")
    pages.put("beside", "What is called beside the step, figure eight", headings, list(beside(out)), left=2)
    pages.console.print("examples/microcontroller, in QEMU:", example(out), sep="\n", markup=False)


def main() -> int:
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--page", type=Path, action="append", default=[], help="takes the tables between its marks")
    reader.add_argument("--hosts", action="store_true", help="every shipped controller on this machine instead")
    given = reader.parse_args()
    pages = Pages(given.page)
    with tempfile.TemporaryDirectory() as folder:
        try:
            if given.hosts:
                for row in shipped(Path(folder)):
                    pages.console.print(*row, sep=", ", markup=False, soft_wrap=True)
            else:
                embedded(pages, Path(folder))
        except (EmbeddedError, WmrError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
