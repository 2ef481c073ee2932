"""Exported C against MISRA C:2012, as far as cppcheck knows its rules."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from pathlib import Path

from benchmarks.microcontroller import EmbeddedError, run, sources

# Advisory rules that exported C breaks, and why. A required rule is never broken.
DEVIATIONS = {
    "2.4": "cppcheck counts an enum without a tag, which holds the indices, as a tag that is not used",
    "2.5": "macros that only the user's program reads, such as the sample time",
    "8.7": "functions that the user's program calls, and that one more function of the same file calls",
    "10.5": "a comparison becomes 0 or 1 of the real type: each line is one operation of the traced law",
}
FINDING = re.compile(r"misra-c2012-(\d+\.\d+) (.*)")
LINE = re.compile(r"^ *const (?:float|double) ([a-z]\d+) = (.*);$")
NAME = re.compile(r"\b[wridsc]\d+\b")
NUMBER = re.compile(r"\b\d+\.?\d*(?:e[+-]?\d+)?f?\b")


def is_there() -> bool:
    """Whether cppcheck is installed."""
    return shutil.which("cppcheck") is not None


def deviations(folder: Path, out: Path, prefix: str = "controller") -> set[str]:
    """The advisory rules that an export breaks, its replay not counted.

    cppcheck follows values from line to line, for hours if there are a thousand lines. It is given one line of each
    kind, as the rules do not depend on which value is read.

    Raises:
        EmbeddedError: if cppcheck cannot be run, or another rule is broken.
    """
    given = out / "misra"
    given.mkdir(parents=True, exist_ok=True)
    for header in folder.glob(f"{prefix}*.h"):
        shutil.copy(header, given)
    for source in sources(folder, prefix):
        text = "\n".join(one_of_each_kind(source.read_text(encoding="utf-8").splitlines()))
        (given / source.name).write_text(text + "\n", encoding="utf-8")
    told = run(
        *("cppcheck", "--quiet", "--std=c99", "--enable=style", "--addon=misra", "--platform=arm32-wchar_t4"),
        *("--error-exitcode=0", "--template={id} {file}:{line}", *sorted(file.name for file in given.glob("*.c"))),
        folder=given,
        with_errors=True,
    )
    found = [one for one in map(FINDING.match, told.splitlines()) if one is not None]
    if not found:  # each export has macros that only the user reads
        raise EmbeddedError(f"cppcheck's addon for MISRA has not run: {told.strip()[:80]!r}")
    for rule, place in (one.groups() for one in found):
        if rule not in DEVIATIONS:
            raise EmbeddedError(f"rule {rule} of MISRA C:2012 is broken in {given.name}/{place}, of {folder}")
    return {one[1] for one in found}


def one_of_each_kind(lines: Iterable[str]) -> list[str]:
    """The lines of a program in which each kind of printed line stands once; instead of others the last one is read."""
    kept, kinds, gone, last = [], set[str](), set[str](), ""
    for line in lines:
        match = LINE.match(line)
        if match is not None:
            kind = NUMBER.sub("0", NAME.sub("w", match[2]))
            if kind in kinds:
                gone.add(match[1])
                continue
            kinds.add(kind)
        kept.append(NAME.sub(lambda name, last=last: last if name[0] in gone else name[0], line))  # type: ignore[misc]
        last = match[1] if match is not None else last
    return kept
