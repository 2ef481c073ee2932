"""Rows of text as a table for the terminal or for a Markdown page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

Rows = Iterable[Sequence[str]]


def three_digits(value: float) -> str:
    """Three significant digits, without an exponent where it can be."""
    return f"{float(f'{value:.3g}'):g}"


def in_terminal(headings: Sequence[str], rows: Rows, title: str = "") -> Table:
    """For rich."""
    table = Table(*map(escape, headings), title=title or None, title_justify="left")
    for row in rows:
        table.add_row(*row)
    return table


def in_markdown(headings: Sequence[str], rows: Rows, left: int = 0) -> str:
    """For a page; the first `left` columns are text, the others numbers."""
    ruler = ["--" if i < left else "--:" for i in range(len(headings))]
    return "\n".join("| " + " | ".join(row) + " |" for row in [headings, ruler, *rows])


def replace_between(page: Path, marks: tuple[str, str], text: str) -> None:
    """Puts `text` between two marks in a page."""
    before, first, rest = page.read_text(encoding="utf-8").partition(marks[0])
    _, last, after = rest.partition(marks[1])
    if not (first and last):
        raise ValueError(f"{page}: the marks {marks[0]} and {marks[1]} are missing")
    page.write_text(f"{before}{first}\n\n{text}\n\n{last}{after}", encoding="utf-8")
