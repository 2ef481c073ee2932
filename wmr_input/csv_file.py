"""Tables of numbers as CSV, columns by the names in the header; each mistake told in one line with its place."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from .errors import InputError

LARGEST = 64_000_000  # bytes of a file
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}  # that other programs write between cells
SHORT = 30  # characters of a cell in a message


def read_columns(path: Path) -> dict[str, list[float]]:
    """The columns of a CSV file by name; a unit in brackets behind a name, as `t [s]`, is left out.

    Raises:
        InputError: if the file cannot be read, or a row does not fit the header or holds no finite number.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(str(path), "", "is too large", f"stay within {LARGEST // 1_000_000} MB")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(str(path), "", f"cannot be read ({type(error).__name__})", "check the path") from None
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    if len(rows) < 2:
        raise InputError(str(path), "", "holds no points", "write a header, as t,y1,y2, and a line for each point")
    check_separator(str(path), 1, rows[0])
    names = [cell.partition("[")[0].strip() for cell in rows[0]]
    if any(not name or _is_number(name) for name in names) or len(set(names)) < len(names):
        raise InputError(str(path), "line 1", f"{', '.join(rows[0])[:SHORT]} is no header", "name each column once")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise InputError(str(path), f"point {number - 1}", f"{len(row)} cells for {len(names)} columns", "fill it")
        for name, cell in zip(names, row, strict=True):
            if not _is_number(cell):
                problem = f"{cell.strip()[:SHORT]!r} is no finite number"
                raise InputError(str(path), f"point {number - 1}, {name}", problem, "write numbers, as 1.5")
            columns[name].append(float(cell))
    return columns


def check_separator(file: str, line: int, header: Sequence[str]) -> None:
    """Check that cells are separated by commas, by the header as it was read with them.

    Raises:
        InputError: if it is one cell that others would separate into several.
    """
    for separator, name in () if len(header) != 1 else SEPARATORS.items():
        if separator in header[0].strip():
            remedy = "write commas between cells, and points in numbers"
            raise InputError(file, f"line {line}", f"has {name} between its cells", remedy)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
