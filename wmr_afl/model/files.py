"""The files of generated models: where they are, and how they are read and checked."""

from __future__ import annotations

import importlib.util
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from wmr_afl.errors import InputError, UnknownNameError
from wmr_afl.model.packages import shipped_models

# Keys of model.json that the runtime reads, with their types.
_NEEDED: dict[str, type] = {
    "name": str,
    "title": str,
    "source": str,
    "parametrization": str,
    **dict.fromkeys(("state", "inputs", "outputs", "parameters", "motors", "defaults", "about", "known"), dict),
    **dict.fromkeys(("base_parameters", "base_parameter_formulas", "functions", "geometry", "findings"), dict),
}


def list_models() -> list[str]:
    """The names of the shipped models."""
    return sorted(path.parent.name for path in shipped_models().glob("*/model.json"))


def model_folder(name: str | Path) -> Path:
    """The folder of a shipped model, or a folder that `derive` has written.

    Raises:
        UnknownNameError: if there is neither.
        InputError: if the folder holds several models.
    """
    folder = Path(name)
    if os.path.isfile(folder / "model.json"):  # unlike Path.is_file, no error if the name is too long
        return folder
    if os.path.isfile(shipped_models() / name / "model.json") and Path(name).name == str(name):
        return shipped_models() / name
    below = sorted(path.parent.as_posix() for path in folder.glob("*/model.json")) if os.path.isdir(folder) else []
    if below:
        raise InputError(str(folder), "", "holds several models", f"name one of {', '.join(below)}")
    raise UnknownNameError("model or model folder", str(name), list_models())


def is_shipped(folder: Path) -> bool:
    """Whether a model's folder comes with the package."""
    return folder.resolve().parent == shipped_models()


def import_module(path: Path) -> ModuleType:
    """The Python module in the file at `path`.

    Raises:
        InputError: if there is no such file, or it cannot be imported.
    """
    specification = importlib.util.spec_from_file_location(f"{path.parent.name}_{path.stem}", path)
    if specification is None or specification.loader is None or not path.is_file():
        raise InputError(str(path), "", "no such file", "derive the robot again into this folder")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        raise InputError(str(path), "", f"cannot be imported ({error})", "derive the robot again") from None
    return module


def check_module(module: ModuleType, path: Path, metadata: dict[str, Any]) -> None:
    """Check that a module belongs to the `model.json` beside it and has all its functions.

    Raises:
        InputError: if it does not.
    """
    for key in ("name", "parametrization", "state", "inputs", "outputs", "parameters", "known", "base_parameters"):
        there, expected = getattr(module, key.upper(), None), metadata[key]
        if there != expected or (isinstance(expected, dict) and list(there or ()) != list(expected)):
            raise InputError(str(path), key.upper(), "is not that of model.json beside it", "derive the robot again")
    missing = [name for name in metadata["functions"] if not hasattr(module, name)]
    if missing:
        raise InputError(str(path), "", f"has no {missing[0]}", "derive the robot again")


def read_metadata(folder: Path) -> dict[str, Any]:
    """The content of `model.json`.

    Raises:
        InputError: if the file is missing or damaged.
    """
    return _read_json(folder / "model.json", _NEEDED)


def read_trusted_values(folder: Path) -> dict[str, Any]:
    """The content of `trusted_values.json`.

    Raises:
        InputError: if the file is missing or damaged.
    """
    return _read_json(folder / "trusted_values.json", {"arguments": dict, "values": dict})


def _read_json(path: Path, needed: Mapping[str, type]) -> dict[str, Any]:
    """The content of a model's file, checked to hold at least the `needed` keys."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(str(path), "", f"cannot be read ({error})", "derive the robot again") from None
    for key, kind in needed.items():
        if not isinstance(content, dict) or not isinstance(content.get(key), kind):
            raise InputError(str(path), key, "is missing or damaged", "derive the robot again")
    return content
