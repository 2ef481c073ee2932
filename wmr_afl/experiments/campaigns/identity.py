"""What the numbers of a campaign depend on besides its experiment: versions, code, and the compiler."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

import wmr_input
from wmr_afl.model.model import Model
from wmr_afl.simulation.kernels.c_compiler import compiler_version

Identity = Mapping[str, str]  # what -> its version or digest

_RUNTIME = Path(__file__).resolve().parents[2]  # the folder wmr_afl
_NO_NUMBERS = ("_derive", "analysis", "cli", "generated")  # folders of it on which no number of a run depends
_SOURCES = (".py", ".jinja", ".h")
_DIGIT_COUNT = 64  # of a digest


def identity_of(backend: str, model: Model | None = None) -> Identity:
    """What a process would compute with; without a model, as far as it does not depend on it.

    Raises:
        CompilerError: if the backend is "compiled" and there is no compiler.
    """
    found = {
        "wmr_afl": _version("wmr-afl"),
        "code of wmr_afl": code_digest(),
        "numpy": np.__version__,
        "casadi": _version("casadi"),
    }
    if backend == "compiled":
        found["compiler"] = compiler_version()
    if model is not None:
        text = json.dumps(model.metadata, sort_keys=True)  # with the digests of the model's code
        found["model"] = hashlib.sha256(text.encode()).hexdigest()
    return found


def difference(there: Identity, here: Identity) -> str:
    """What differs, for a message; empty if nothing does."""
    found = []
    for what in (*there, *(other for other in here if other not in there)):
        one, other = there.get(what), here.get(what)
        if one != other and None not in (one, other):
            is_digest = len(str(one)) == _DIGIT_COUNT
            found.append(f"another {what}" if is_digest else f"{what} {other} instead of {one}")
    return ", ".join(found)


@functools.cache
def code_digest() -> str:
    """The digest of the sources on which the numbers of runs depend."""
    content = hashlib.sha256()
    for root in (_RUNTIME, Path(wmr_input.__file__).resolve().parent):
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            if path.suffix in _SOURCES and place.parts[0] not in _NO_NUMBERS and path.is_file():
                content.update(f"{root.name}/{place.as_posix()}\0{path.read_text(encoding='utf-8')}\0".encode())
    return content.hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # a checkout on the path, not installed
        return "not installed"
