"""Where generated models stand, and how their files are read."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

from wmr_afl.errors import InputError, UnknownNameError, WmrError

_NEEDED = ("name", "title", "state", "inputs", "outputs", "parameters", "defaults", "known", "findings")


def list_models() -> list[str]:
    """The names of the shipped models."""
    return sorted(path.parent.name for path in _shipped().glob("*/model.json"))


def model_folder(name: str | Path) -> Path:
    """The folder of a shipped model, or a folder that `derive` has written.

    Raises: UnknownNameError, where there is neither.
    """
    folder = Path(name)
    if (folder / "model.json").is_file():
        return folder
    if str(name) not in list_models():
        raise UnknownNameError("model or model folder", str(name), list_models())
    return _shipped() / name


def import_module(path: Path) -> ModuleType:
    """The Python module in the file at `path`.

    Raises: InputError.
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


def read_metadata(folder: Path) -> dict[str, Any]:
    """The content of `model.json`.

    Raises: InputError.
    """
    path = folder / "model.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(str(path), "", f"cannot be read ({error})", "derive the robot again") from None
    missing = [key for key in _NEEDED if not isinstance(content, dict) or key not in content]
    if missing:
        raise InputError(str(path), missing[0], "is missing", "derive the robot again")
    return content


def _shipped() -> Path:
    """The folder of the shipped models."""
    specification = importlib.util.find_spec("generated")
    if specification is None or not specification.submodule_search_locations:
        raise WmrError("the package 'generated' is not installed; install wmr-afl again")
    return Path(next(iter(specification.submodule_search_locations)))
