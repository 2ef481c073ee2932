"""Logs as CSV files: one row a sample, names of columns as in `log`, lines that begin with # for people.

A unit may stand behind a name, `phi [rad]`. The samples of a run as `simulate` writes them are such a file, too: the
voltages that were applied, and the state.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from wmr_afl.errors import ArgumentError, InputError, UnknownNameError, WmrError
from wmr_afl.identification.log import Log, channel, log_of, measurable
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_input.csv_file import check_separator
from wmr_input.whole_files import write_whole

TIME = ("t", "time")
OF_A_RUN = (
    "command_",
    "reference_",
    "error_",
    "estimate_",
    "deviation_",
    "observed_",
    "unexpected_",
    "surprise",
    "slip",
)
ROWS = 10_000_000  # that a log may have: 55 hours at 50 Hz


def read_logs(model: Model, files: Iterable[str | Path]) -> Log:
    """The segments of all files; of several files each has its name before those of its segments.

    Raises:
        InputError: if a file cannot be read, a column is missing or unknown, a unit is not the model's, or a cell is
            not a number, or a log is given twice.
        WmrError: if the files do not measure the same, or time does not go on.
    """
    try:
        paths = [Path(file) for file in files]
    except TypeError:
        raise ArgumentError("logs are no names of files", "give the path of a CSV file, or several") from None
    if not paths:
        raise WmrError("no log is given", "name a CSV file")
    logs = [read_log(model, path) for path in paths]
    if len(logs) > 1:
        logs = [_named(log, path.stem) for log, path in zip(logs, paths, strict=True)]
    for (path, log), (other, again) in combinations(zip(paths, logs, strict=True), 2):
        if _is_same(log, again):
            raise InputError(str(other), "", f"holds the same rows as {path}", "give each log once")
    whole = logs[0]
    for log in logs[1:]:
        whole = whole.joined(log)
    return whole


def _is_same(one: Log, other: Log) -> bool:
    """Whether two logs hold the same, so that one would count twice."""
    if one.channels != other.channels or len(one.segments) != len(other.segments):
        return False
    pairs = zip(one.segments, other.segments, strict=True)
    return all(np.array_equal(a.u, b.u) and np.array_equal(a.z, b.z) for a, b in pairs)


def _named(log: Log, name: str) -> Log:
    """With the file's name before those of the segments."""
    return log.of([replace(one, name=f"{name} {one.name}".strip()) for one in log.segments])


def read_log(model: Model, path: str | Path) -> Log:
    """A log from a CSV file, or standard input if it is `-`.

    Raises:
        InputError: as `read_logs`.
    """
    file = str(path)
    names, lines, rows = table(file)
    plain = [_name(model, name, file) for name in names]
    _check_names(model, plain, file)
    cells = numbers(names, lines, rows, file, text={i for i, name in enumerate(plain) if name == "segment"})
    columns = dict(zip(plain, cells.T, strict=True))
    labels = [row[plain.index("segment")].strip() for row in rows] if "segment" in plain else None
    u = np.column_stack([columns[name] for name in model.input_units])
    used = {*TIME, "segment", *model.input_units}
    measured = {name: columns[name] for name in plain if name not in used and not name.startswith(OF_A_RUN)}
    time = next(columns[name] for name in TIME if name in columns)
    try:
        return log_of(model, time, u, measured, labels)
    except WmrError as error:
        raise InputError(file, "", error.problem, error.remedy) from None


def write_log(log: Log, path: Path, about: Sequence[str] = ()) -> None:
    """Write a log as a CSV file; `about` are lines for people.

    Raises:
        WmrError: if the file cannot be written.
    """
    names = ["segment", "t", *log.model.input_units, *(one.name for one in log.channels)]
    lines = [*(f"# {line}" for line in about), ",".join(names)]
    for segment in log.segments:
        table = np.column_stack([segment.time, segment.u, segment.z])
        lines += [",".join([segment.name, *(f"{number:.10g}" for number in row)]) for row in table.tolist()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise WmrError(f"{path}: cannot be written ({error.strerror})", "name a file in a writable folder") from None


def table(file: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Names of the columns, and number and cells of each line."""
    try:
        with open(0 if file == "-" else file, encoding="utf-8-sig", newline="", closefd=file != "-") as stream:
            reader = csv.reader(stream)
            names: list[str] = []
            lines: list[int] = []
            rows: list[list[str]] = []
            for row in reader:
                if not row or row[0].lstrip().startswith("#"):
                    continue
                if not names:
                    names = [cell.strip() for cell in row]
                    check_separator(file, reader.line_num, names)
                    continue
                if len(row) != len(names):
                    problem = f"has {len(row)} cells for {len(names)} columns"
                    raise InputError(file, f"line {reader.line_num}", problem, "write one cell a column")
                lines.append(reader.line_num)
                rows.append(row)
                if len(rows) > ROWS:
                    raise InputError(file, "", f"has more than {ROWS} rows", "give a part of it")
    except OSError as error:
        raise InputError(file, "", f"cannot be read ({error.strerror})", "name a CSV file") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(file, "", "is no CSV file", "write text in UTF-8, with commas between cells") from None
    except ValueError:  # a zero byte in the name
        raise InputError(repr(file), "", "is no path", "name a CSV file") from None
    if not names:
        raise InputError(file, "", "is empty", "begin with a line that names the columns, as t,u_r,u_l,angle:u_r")
    return names, lines, rows


def _name(model: Model, text: str, file: str) -> str:
    """A column's name without its unit, which is the model's."""
    name, _, unit = text.partition("[")
    name, unit = name.strip(), unit.rstrip("]").strip()
    if not unit or name.startswith(OF_A_RUN):
        return name
    kind, _, of = name.rpartition(":")
    if name in TIME:
        expected = "s"
    elif kind:
        expected = "rad" if of in model.input_units else model.state_units.get(of, unit)
        expected += "/s" if kind == "rate" else ""
    else:
        expected = {**model.input_units, **model.state_units}.get(name, unit)
    if unit != expected:
        raise InputError(file, f"column {name}", f"is in {unit}", f"convert it to {expected}")
    return name


def _check_names(model: Model, names: list[str], file: str) -> None:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(file, f"column {twice[0]}", "stands there twice", "leave one out")
    if not any(name in names for name in TIME):
        raise InputError(file, "column t", "is missing", "add the time of each row in seconds")
    for name in model.input_units:
        if name not in names:
            raise InputError(file, f"column {name}", "is missing", f"add the voltage of each motor of {model.name}")
    for name in names:
        if name not in (*TIME, "segment", *model.input_units) and not name.startswith(OF_A_RUN):
            try:
                channel(model, name)
            except WmrError:
                known = ["segment", "t", *model.input_units, *measurable(model)]
                error = UnknownNameError("column", name, known)
                raise InputError(file, "", error.problem, error.remedy) from None


def numbers(names: list[str], lines: list[int], rows: list[list[str]], file: str, text: Collection[int] = ()) -> Floats:
    """The cells as numbers; those of text are zero."""
    cells = [["0" if i in text else cell for i, cell in enumerate(row)] for row in rows] if text else rows
    try:
        numbers = np.array(cells, dtype=float).reshape(len(rows), len(names))
    except ValueError:
        numbers = np.array([[_number(cell) for cell in row] for row in cells]).reshape(len(rows), len(names))
    bad = np.argwhere(~np.isfinite(numbers))
    if len(bad):
        row, column = bad[0]
        problem = f"holds {rows[row][column].strip()[:40]!r}"
        raise InputError(
            file, f"line {lines[row]}, column {names[column]}", problem, "write a number, or leave the row out"
        )
    return numbers


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
