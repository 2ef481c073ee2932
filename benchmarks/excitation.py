"""`python -m benchmarks.excitation [ROBOT ...] [--page docs/identification.md]`: designed voltages, and what they tell.

Each row is one design: random multisine -> D-optimal, both kept within limits by all robots that are tried. Then
FRESH other robots, up to 30 % off as well, drive the voltages: how many of those go beyond a limit, and how far the
worst one. Times are of the processor and depend on the machine.
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
from benchmarks.tables import in_markdown, in_terminal, replace_between, three_digits
from wmr_afl.identification.excursions import moved, others, substeps
from wmr_afl.identification.voltage_design import Excitation
from wmr_afl.numerics.arrays import Floats

MARKS = "<!-- excitation -->", "<!-- end of excitation -->"
FRESH = 400  # robots that the design has not seen

Limits = tuple[float, float, dict[str, float]]  # volts, room [m], angles [rad]
LIMITS: dict[str, Limits] = {
    "type_2_0": (12.0, 2.0, {}),
    "type_2_0_uneven": (12.0, 2.0, {}),
    "type_2_0_caster": (12.0, 3.0, {}),
    "type_2_1": (12.0, 2.0, {"beta": 1.5}),
    "type_3_0": (12.0, 2.0, {}),
    "mecanum": (12.0, 2.0, {}),
    "type_1_1": (12.0, 2.0, {"beta": 1.2}),
    "type_1_2": (12.0, 2.0, {"beta1": 1.0, "beta2": 1.0}),
    "car": (24.0, 12.0, {"beta": 0.5}),
    "tractor_trailer": (12.0, 6.0, {"beta": 1.0}),
    "tractor_3_trailers": (12.0, 8.0, {"beta1": 1.0, "beta2": 1.0, "beta3": 1.0}),
}
HEADINGS = (
    "robot", "limits", "log det, random", "designed", "condition, random", "designed", "worst deviation",
    "largest share of a limit", "fresh robots beyond", "largest share", "rounds", "IPOPT, round that is handed out",
    "time [s]",
)  # fmt: skip


def rows(robots: Sequence[str]) -> Iterator[list[str]]:
    """One design each."""
    for name in robots:
        volts, room, angles = LIMITS[name]
        start = time.process_time()
        limits = ", ".join([f"{volts:g} V", f"{room:g} m", *(f"{angle} {value:g}" for angle, value in angles.items())])
        try:
            found = wmr_afl.excite(name, volts, room, angles)
        except wmr_afl.WmrError as error:
            yield [name, limits, *[""] * 9, str(error), f"{time.process_time() - start:.0f}"]
            continue
        seconds = time.process_time() - start
        bounds = np.array([upper for _, upper in found.limits.values()])
        worst = max(found.deviations, key=lambda one: found.deviations[one])
        fresh = shares_of_others(found)
        row = [
            name, limits, *(f"{one:.1f}" for one in found.log_determinants), *map(three_digits, found.conditions),
            f"{worst}: {found.deviations[worst]:.1%}", f"{(np.abs(found.tried) / bounds).max():.2f}",
            f"{(fresh > 1.0).mean():.1%}", f"{fresh.max():.2f}", str(found.rounds), found.status, f"{seconds:.0f}",
        ]  # fmt: skip
        print(" | ".join(row), file=sys.stderr, flush=True)  # a table takes minutes
        yield row


def shares_of_others(found: Excitation) -> Floats:
    """How much of a limit each of FRESH robots uses that the design has not seen, (FRESH,)."""
    model = wmr_afl.load_model(found.robot)
    robots, x = others(model, model.parameters(), FRESH, seed=777), np.tile(found.state[0], (FRESH, 1))
    count = substeps(model, model.parameters(), found.state[0], found.sample_time)
    places, bounds = [found.states.index(name) for name in found.limits], [upper for _, upper in found.limits.values()]
    largest = np.zeros(FRESH)
    for k in range(len(found.tried) - 1):
        row = min(k, len(found.voltages) - 1)
        u = np.tile(found.voltages[row], (FRESH, 1))
        for loop in found.loops:
            error = loop.reference[row] - x[:, found.states.index(loop.coordinate)]
            u[:, found.inputs.index(loop.motor)] += loop.gain * error
        x = moved(model, robots, x, np.clip(u, -found.volts, found.volts), found.sample_time, count)
        largest = np.fmax(largest, np.nan_to_num(np.abs(x[:, places]) / bounds, nan=np.inf).max(axis=1))
    return largest


def main() -> None:
    """Print the table; with --page into the page as well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=tuple(LIMITS), metavar="ROBOT")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    found = list(rows(given.robots))
    Console(width=230).print(
        in_terminal(HEADINGS, found, "Voltages within limits, from a random multisine to D-optimal")
    )
    if given.page:
        replace_between(given.page, MARKS, in_markdown(HEADINGS, found, 2))


if __name__ == "__main__":
    main()
