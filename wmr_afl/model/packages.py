"""Where the derivation and the generated models stand: inside an installed wmr_afl, beside it in a checkout.

Both are imported under names inside `wmr_afl` only: another package called `derive` or `generated` on a user's machine
changes nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

from wmr_afl.errors import WmrError

_PACKAGE = Path(__file__).resolve().parents[1]  # the folder wmr_afl


def generated() -> ModuleType:
    """`wmr_afl.generated`, the package of the shipped models: `from wmr_afl.generated.car import numpy_model`."""
    return _package("generated", shipped_models())


def shipped_models() -> Path:
    """The folder of the shipped models."""
    return _folder("generated", "generated")


def derivation(module: str) -> ModuleType:
    """A module of the derivation by its name there, `codegen.write`; it is imported only when it is asked for.

    Raises:
        WmrError: if a package that it needs, such as SymPy, is not installed.
    """
    package = _package("_derive", _folder("_derive", "derive"))
    try:
        return import_module(f"{package.__name__}.{module}")
    except ModuleNotFoundError as error:
        raise WmrError(f"{error.name} is not installed", 'pip install "wmr-afl[derive]"') from None


def _folder(inside: str, beside: str) -> Path:
    installed = _PACKAGE / inside
    return installed if installed.is_dir() else _PACKAGE.parent / beside


def _package(name: str, folder: Path) -> ModuleType:
    """The package `wmr_afl.<name>` whose modules are those in `folder`."""
    whole = f"wmr_afl.{name}"
    if whole not in sys.modules:
        specification = ModuleSpec(whole, None, is_package=True)
        specification.submodule_search_locations = [str(folder)]
        sys.modules[whole] = module_from_spec(specification)
    return sys.modules[whole]
