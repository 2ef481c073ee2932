"""`python -m benchmarks.long_log [--robot type_2_0] [--page docs/identification.md]`: time and memory of long logs.

Each log is written by one process and identified by another one, whose largest memory is told.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console

from benchmarks.identification import driven
from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl import load_model
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log_file import write_log
from wmr_afl.identification.recording import Sensors

MINUTES = (1, 15, 60)
HEADINGS = ["log [min]", "rows", "file [MB]", "time [s]", "largest memory [MB]"]
MARKS = "<!-- long logs -->", "<!-- end of long logs -->"
COARSE = 10  # steps of a sample: what is measured here is not the estimate


def written(robot: str, minutes: float, file: Path) -> int:
    """Write a log; its rows."""
    log = driven(robot, 1, 60.0 * minutes, COARSE).log(Sensors())
    write_log(log, file)
    return len(log.segments[0])


def identified(robot: str, file: Path) -> tuple[float, float]:
    """Seconds from file to result, and this process's largest memory [MB]."""
    start = time.perf_counter()
    identify(load_model(robot), file, coulomb="each")
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return time.perf_counter() - start, largest / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="type_2_0")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    fresh, rows = multiprocessing.get_context("spawn"), []
    with tempfile.TemporaryDirectory() as folder:
        for minutes in MINUTES:
            file = Path(folder, f"{minutes}.csv")
            with ProcessPoolExecutor(1, fresh) as one:
                count = one.submit(written, given.robot, minutes, file).result()
            with ProcessPoolExecutor(1, fresh) as one:
                seconds, memory = one.submit(identified, given.robot, file).result()
            size = file.stat().st_size / 1e6
            rows.append([f"{minutes}", f"{count}", f"{size:.1f}", f"{seconds:.1f}", f"{memory:.0f}"])
    Console(width=100).print(in_terminal(HEADINGS, rows))
    if given.page:
        replace_between(given.page, MARKS, in_markdown(HEADINGS, rows, left=0))


if __name__ == "__main__":
    main()
