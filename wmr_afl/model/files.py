"""The files of generated models: where they are, and how they are read and checked."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np
from casadi import Function

from wmr_afl.errors import InputError, UnknownNameError
from wmr_afl.model.metadata import damage
from wmr_afl.model.packages import shipped_models

AGAIN = "derive the robot again"  # the remedy for every damage
LARGEST_FILE = 20_000_000  # bytes; the largest of a shipped model has 70 thousand


def list_models() -> list[str]:
    """The names of the shipped models."""
    return sorted(path.parent.name for path in shipped_models().glob("*/model.json"))


def is_path(name: str | Path) -> bool:
    """Whether this is a path and no name: it has a separator, or was made as a path."""
    return isinstance(name, Path) or any(separator and separator in name for separator in ("/", os.sep, os.altsep))


def model_folder(name: str | Path, beside: Path | None = None) -> Path:
    """The folder of a shipped model by its name, or a folder that `derive` has written by its path.

    `beside`: a folder from which the path may start, too, or in which a model that is not shipped has this name.

    Raises:
        UnknownNameError: if there is neither.
        InputError: if the folder holds several models.
    """
    if not is_path(name) and name in list_models():
        return shipped_models() / name
    if beside is not None and holds_model(beside / name):
        return beside / name
    folder = Path(name)
    if is_path(name) and holds_model(folder):
        return folder
    if str(name) in list_models():
        return shipped_models() / name
    below = sorted(path.parent.as_posix() for path in folder.glob("*/model.json")) if os.path.isdir(folder) else []
    if below:
        raise InputError(str(folder), "", "holds several models", f"name one of {', '.join(below)}")
    hint = f"write ./{name} for the folder here" if holds_model(folder) else ""
    raise UnknownNameError("model or model folder", str(name), list_models(), hint)


def holds_model(folder: Path) -> bool:
    """Whether a model stands in this folder."""
    return os.path.isfile(folder / "model.json")  # unlike Path.is_file, no error if the name is too long


def is_shipped(folder: Path) -> bool:
    """Whether a model's folder comes with the package."""
    return folder.resolve().parent == shipped_models()


def open_model(folder: Path, file: str) -> tuple[dict[str, Any], ModuleType]:
    """The content of a folder's `model.json`, and the module in one of its files.

    Raises:
        InputError: if a file is missing or damaged, or the module is not the one that was derived.
    """
    metadata = read_metadata(folder)
    try:
        source = _read_derived(folder / file, metadata)
    except InputError:
        again = read_metadata(folder)
        if again == metadata:
            raise
        metadata, source = again, _read_derived(folder / file, again)  # derived anew in between
    module = import_module(folder / file, source)
    _check_module(module, folder / file, metadata)
    return metadata, module


def import_module(path: Path, source: str) -> ModuleType:
    """The Python module with this source; nothing that Python has compiled before is used.

    Raises:
        InputError: if it cannot be imported.
    """
    module = ModuleType(f"{path.parent.name}_{path.stem}")
    module.__file__ = str(path)
    try:
        exec(_compiled(source, str(path)), module.__dict__)  # noqa: S102, a model folder is code
    except Exception as error:
        raise InputError(str(path), "", f"cannot be imported ({error})", AGAIN) from None
    return module


@functools.lru_cache(maxsize=32)
def _compiled(source: str, path: str) -> CodeType:
    return compile(source, path, "exec", dont_inherit=True)


def read_metadata(folder: Path) -> dict[str, Any]:
    """The content of `model.json`.

    Raises:
        InputError: if the file is missing or damaged.
    """
    path = folder / "model.json"
    content = _parsed(path, _read(path))
    place = damage(content)
    if place is not None:
        raise InputError(str(path), place, "is missing or damaged", AGAIN)
    return content


def read_trusted_values(folder: Path, metadata: dict[str, Any], sizes: Mapping[str, int]) -> dict[str, Any]:
    """The content of `trusted_values.json`, which belongs to this `model.json`; `sizes`: of each argument.

    Raises:
        InputError: if the file is missing or damaged, or not the one that was derived.
    """
    path = folder / "trusted_values.json"
    content, functions = _parsed(path, _read_derived(path, metadata)), metadata["functions"]
    arguments = {name: (sizes[name],) for one in functions.values() for name in one["arguments"]}
    values = {name: tuple(one["size"]) for name, one in functions.items()}
    for key, shapes in (("arguments", arguments), ("values", values)):
        table = content.get(key) if isinstance(content, dict) else None
        for name, shape in shapes.items():
            there = table.get(name) if isinstance(table, dict) else None
            if not _is_array(there, shape):
                raise InputError(str(path), f"{key} {name}", "is missing or damaged", AGAIN)
    return content


def _is_array(value: Any, shape: tuple[int, ...]) -> bool:
    """Whether nested lists hold numbers of this shape."""
    try:
        array = np.array(value)
    except (ValueError, OverflowError):  # of lists that do not fit each other, or nested too deeply
        return False
    return array.dtype.kind in "fi" and array.size == math.prod(shape) and bool(np.isfinite(array).all())


def _read_derived(path: Path, metadata: dict[str, Any]) -> str:
    """The text of a file whose digest stands in `model.json`."""
    text = _read(path)
    if hashlib.sha256(text.encode()).hexdigest() != metadata["files_sha256"].get(path.name):
        raise InputError(str(path), "", "is not the one that was derived", AGAIN)
    return text


def _read(path: Path) -> str:
    if not os.path.isfile(path):
        raise InputError(str(path), "", "no such file", "derive the robot again into this folder")
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(str(path), "", f"is larger than {LARGEST_FILE} bytes", AGAIN)
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(str(path), "", f"cannot be read ({error})", AGAIN) from None


def _parsed(path: Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(str(path), "", f"cannot be read ({error})", AGAIN) from None


def _check_module(module: ModuleType, path: Path, metadata: dict[str, Any]) -> None:
    """Check that a module belongs to the `model.json` beside it and has all its functions."""
    for key in ("name", "parametrization", "state", "inputs", "outputs", "parameters", "known", "base_parameters"):
        there, expected = getattr(module, key.upper(), None), metadata[key]
        if there != expected or (isinstance(expected, dict) and list(there or ()) != list(expected)):
            raise InputError(str(path), key.upper(), "is not that of model.json beside it", AGAIN)
    missing = [name for name in metadata["functions"] if not callable(getattr(module, name, None))]
    if missing:
        raise InputError(str(path), "", f"has no {missing[0]}", AGAIN)
    for name, entry in metadata["functions"].items():
        if _arguments(getattr(module, name)) != entry["arguments"]:
            raise InputError(str(path), name, "has other arguments than in model.json beside it", AGAIN)


def _arguments(function: Any) -> list[str]:
    """The names of a generated function's arguments."""
    if isinstance(function, Function):
        return list(function.name_in())
    code = getattr(inspect.unwrap(function), "__code__", None)
    return [] if code is None else list(code.co_varnames[: code.co_argcount])
