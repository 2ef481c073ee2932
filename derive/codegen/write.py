"""Derived robots -> files: everything in memory first, then written, or compared with what is there."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import sympy as sp

from wmr_input import InputError, WmrError
from wmr_input.whole_files import write_folder

from ..derivation import Derivation, Progress, derive_robot, mistakes_named
from ..description.tables import read_description
from .derivation_report import print_report
from .json_text import json_text
from .metadata import Metadata, describe
from .module import print_module
from .program import program
from .python_code import FUNCTIONS
from .quantities import QUANTITIES, Entry, Quantity, quantities
from .targets import TARGETS
from .targets.dialect import Dialect
from .trusted_values import trusted_values

Files = dict[str, str]  # path below the output folder -> text


def generate(robots: Iterable[Path], progress: Callable[[Path], Progress]) -> Files:
    """The files of all `robots`, by path below the output folder.

    Raises:
        InputError: If a description is wrong or two robots share a name.
    """
    files: Files = {}
    origins: dict[str, Path] = {}
    for path in robots:
        name = read_description(path).name
        if name in origins:
            raise InputError(str(path), "name", f"{name!r} is the name of {origins[name]} too", "rename one of them")
        origins[name] = path
        files |= {f"{name}/{file}": text for file, text in generate_one(path, progress(path)).items()}
    return files


def generate_one(path: Path, progress: Progress = lambda step: None) -> Files:
    """The files of one robot."""
    derivation = derive_robot(path, progress)
    with mistakes_named(str(path)):
        return files_of(derivation, path, progress)


def files_of(
    derivation: Derivation,
    path: Path,
    progress: Progress = lambda step: None,
    entries: Iterable[Entry] = QUANTITIES,
    targets: Sequence[Dialect] = TARGETS,
) -> Files:
    """The files of a derived robot whose description is at `path`: a function for each of `entries`."""
    metadata = describe(derivation)
    functions = quantities(derivation, entries)
    progress("statements")
    reserved = {*FUNCTIONS, *(one.name for one in functions), *(name for target in targets for name in target.reserved)}
    programs = [program(one, derivation.terms, reserved) for one in functions]
    files: Files = {}
    for target in targets:
        progress(target.file)
        files[target.file] = print_module(programs, metadata, target)
    progress("values and report")
    files["trusted_values.json"] = json_text(trusted_values(derivation, functions))
    files["model.json"] = _print_json(metadata, functions, path, files)
    files["derivation.md"] = print_report(derivation, metadata, programs)
    return files


def _print_json(metadata: Metadata, functions: list[Quantity], path: Path, files: Files) -> str:
    """The text of `model.json`, with the digests of the `files` that are read beside it."""
    content = {
        "sympy": sp.__version__,
        "description_sha256": _sha256(path.read_text(encoding="utf-8")),
        "files_sha256": {name: _sha256(text) for name, text in files.items()},
        "functions": {one.name: one.signature for one in functions},
        **vars(metadata),
    }
    return json_text(content)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def write(files: Files, out: Path) -> None:
    """Write `files` below `out`, each robot's folder whole or not at all; what else lies in it stays.

    Raises:
        WmrError: If the folder cannot be written.
    """
    folders: dict[str, Files] = {}
    for name, text in files.items():
        robot, _, file = name.partition("/")
        folders.setdefault(robot, {})[file] = text
    for robot, content in folders.items():
        try:
            write_folder(out / robot, content)
        except OSError as error:
            raise WmrError(f"{out / robot}: cannot be written ({error.strerror})", "name a writable folder") from None


def differences(files: Files, out: Path) -> str:
    """What differs between `files` and the folder `out`, as a unified diff; empty if nothing does."""
    present = {
        path.relative_to(out).as_posix(): path
        for path in sorted(out.rglob("*"))
        if path.is_file() and not any(part.startswith((".", "__pycache__")) for part in path.relative_to(out).parts)
    }
    report = []
    for name in sorted(files.keys() | present.keys()):
        if name not in present:
            report.append(f"missing: {out / name}\n")
        elif name not in files:
            report.append(f"left over: {out / name} is not generated from the robots named\n")
        else:
            there = present[name].read_text(encoding="utf-8", errors="replace")
            report.extend(
                difflib.unified_diff(
                    there.splitlines(keepends=True),
                    files[name].splitlines(keepends=True),
                    f"{out / name} (there)",
                    f"{out / name} (derived)",
                )
            )
    return "".join(report)
