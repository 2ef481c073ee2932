"""The machine that something was measured on, without its name."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from wmr_afl.simulation.kernels.c_compiler import compiler

PACKAGES = ("numpy", "casadi", "numba", "jax", "control")


def machine() -> dict[str, str | int]:
    """Processor, cores, compiler, Python and packages."""
    found: dict[str, str | int] = {
        "processor": _processor(),
        "architecture": platform.machine(),
        "cores": os.cpu_count() or 1,
        "system": platform.system(),
        "compiler": _compiler(),
        "Python": platform.python_version(),
    }
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def described(found: dict[str, str | int]) -> str:
    """One sentence of it."""
    packages = ", ".join(f"{name} {found[name]}" for name in ("Python", *PACKAGES) if name in found)
    return (
        f"{found['processor']}, {found['architecture']}, {found['cores']} cores, {found['system']}; "
        f"{found['compiler']}; {packages}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


def _compiler() -> str:
    command = compiler()
    if command is None:
        return "no C compiler"
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return next(iter(done.stdout.splitlines()), "a C compiler that does not say its version")
