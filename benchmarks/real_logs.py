"""`python -m benchmarks.real_logs FOLDER [--page docs/identification.md]`: real robots, beside what teams stated.

FRC teams drove WPILib SysId's tests; kS, kV and kA are what SysId gave them. The logs are not part of this project: the
folder holds frc8744_thomas_linear.csv and frc5409_dunkirk_linear_angular.csv, converted from
github.com/FRC-Team8744/ThomasCanTrack (bc89666) and github.com/FRC5409/2022-Dunkirk (9d2fa76).

How well is foretold: from the forward tests alone, over backward tests (of steps the first second); the stated gains
had seen both.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl import load_model
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import Estimate
from wmr_afl.identification.held_out import score
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log, Segment
from wmr_afl.identification.log_file import read_log
from wmr_afl.identification.motion import with_rest

MARKS = "<!-- real logs -->", "<!-- end of real logs -->"
HEADINGS = ["log", "motion", "", "kS [V]", "kV [V s/m]", "kA [V s^2/m]"]
FITS = ["log", "motion", "stated [%]", "weak form [%]", "output error [%]"]


@dataclass(frozen=True)
class Drivetrain:
    """A log, the robot's lengths [m], and what its team stated for each motion: kS, kV, kA per metre of a wheel."""

    file: str
    radius: float
    half_track: float
    stated: dict[str, tuple[float, float, float]]


ROBOTS = {
    "FRC 8744": Drivetrain(
        "frc8744_thomas_linear.csv", 0.0762, 0.235, {"driving": (0.11161, 2.2496, 0.346)}
    ),
    "FRC 5409": Drivetrain(
        "frc5409_dunkirk_linear_angular.csv", 0.0508, 0.390445,
        {"driving": (0.61192, 5.041, 0.31042), "turning": (0.67602, 5.4268, 0.11118)},
    ),
}  # fmt: skip


def found_from(log: Log, robot: Drivetrain) -> Identified:
    """The centre of mass on the axle, as SysId has it; a motion that is not driven stays as it is described."""
    lengths = {"r": robot.radius, "b": robot.half_track, "d": 0.0}
    return identify(log.model, log, parameters=lengths, hold_out="*backward", partial=True)


def unknown_of(robot: Drivetrain, effort: Effort) -> np.ndarray:
    """The stated gains as base parameters; without turning as the description has it."""
    (s, v, a), turning = robot.stated["driving"], robot.stated.get("turning")
    pi = effort.base(effort.p)
    pi[:2] = 2.0 * a, 2.0 * v
    if turning:
        pi[3], pi[5] = 2.0 * robot.half_track * turning[2], 2.0 * robot.half_track * turning[1]
        s = 0.5 * (s + turning[0])
    return np.concatenate([pi, [s]])


def gains(name: str, folder: Path) -> Iterator[list[str]]:
    """Of each motion what was stated and what is found from all tests."""
    robot = ROBOTS[name]
    found = found_from(read_log(load_model("type_2_0"), folder / robot.file), robot)
    assert found.feedforward is not None
    for one, (motion, stated) in zip(found.feedforward, robot.stated.items(), strict=False):
        yield [name, motion, "stated", *(f"{value:.3f}" for value in stated)]
        pairs = zip((one.kS, one.kV, one.kA), one.interval, strict=True)
        yield [name, motion, found.estimate.method, *(f"{value:.3f} ± {spread:.3f}" for value, spread in pairs)]


def fits(name: str, folder: Path) -> Iterator[list[str]]:
    """How well backward tests are foretold from forward ones."""
    robot = ROBOTS[name]
    log = read_log(load_model("type_2_0"), folder / robot.file)
    found = found_from(log, robot)
    effort, smoother = found.effort, found.smoother
    is_rate = np.array([one.is_rate for one in log.channels])
    stated = Estimate("stated", unknown_of(robot, effort), np.zeros((len(effort.units),) * 2))
    for segment in log.segments:
        if "backward" in segment.name:
            motion = smoother.motion(_transient(with_rest(segment, is_rate)))
            every = [stated, *(one.estimate for one in found.tried)]
            yield [name, segment.name, *(f"{score(smoother, [motion], one).overall:.1f}" for one in every)]


def _transient(segment: Segment) -> Segment:
    """Of a step the second after it and the half before: later nothing changes any more; slow tests as they are."""
    if "fast" not in segment.name:
        return segment
    step = int(np.argmax(np.any(segment.u != 0.0, axis=1)))
    return segment.part(max(0, step - round(0.5 / segment.step)), step + round(1.0 / segment.step))


def main() -> None:
    """Print both tables, and write them into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    told = [row for name in ROBOTS for row in gains(name, given.folder)]
    foretold = [row for name in ROBOTS for row in fits(name, given.folder)]
    means = [f"{np.mean([float(row[k]) for row in foretold]):.1f}" for k in (2, 3, 4)]
    foretold.append(["mean", "", *means])
    console = Console(width=140)
    console.print(in_terminal(HEADINGS, told))
    console.print(in_terminal(FITS, foretold))
    if given.page:
        text = f"{in_markdown(HEADINGS, told, left=3)}\n\n{in_markdown(FITS, foretold, left=2)}"
        replace_between(given.page, MARKS, text)


if __name__ == "__main__":
    main()
