"""`python -m benchmarks.beyond [--runs N] [--page FILE]`: the report's tables beyond the paper, for a page."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from benchmarks.tables import in_markdown, in_terminal, replace_between
from wmr_afl.analysis.paper.beyond import measure

MARKS = "<!-- beyond -->", "<!-- end of beyond -->"


def main() -> None:
    """Measure, print the tables, and write them into the page if one is named."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--runs", type=int, default=1000)
    reader.add_argument("--page", type=Path)
    given = reader.parse_args()
    sheets = measure(given.runs).sheets
    for sheet in sheets:
        Console(width=160).print(sheet.title, in_terminal(sheet.headings, sheet.rows))
    if given.page is not None:
        parts = (f"**{one.title}.** {one.note}\n\n{in_markdown(one.headings, one.rows, left=1)}" for one in sheets)
        replace_between(given.page, MARKS, "\n\n".join(parts))


if __name__ == "__main__":
    main()
