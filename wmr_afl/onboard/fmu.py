"""FMUs, units for co-simulation by FMI 2.0 and 3.0: ZIP files of a description, C99 and a binary for this system."""

from __future__ import annotations

import io
import platform
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from math import isinf, isnan
from typing import Any
from uuid import UUID

from wmr_afl.errors import CompilerError
from wmr_afl.onboard.c_source import TEMPLATES, decimal
from wmr_afl.simulation.kernels.c_compiler import portable_library

PROCESSORS = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
SYSTEMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("win", "dll")}
UNIX_FILE = 0o100644 << 16  # what a ZIP file tells of each file in it
DAY_ONE = (1980, 1, 1, 0, 0, 0)  # the first time that a ZIP file knows: the same content, the same bytes


@dataclass(frozen=True)
class Variable:
    """A value that others see."""

    name: str
    about: str
    causality: str  # input, parameter or output
    variability: str = "discrete"
    unit: str = ""
    value: float = 0.0
    kind: str = "Real"

    @property
    def initial(self) -> str:
        """Where its first value comes from, as FMI puts it; nothing for inputs."""
        return {"parameter": "exact", "output": "calculated"}.get(self.causality, "")

    @property
    def start(self) -> str:
        """Its first value as XML; nothing for what is computed."""
        if self.causality not in ("input", "parameter"):
            return ""
        if self.kind == "Boolean":
            return "true" if self.value else "false"
        if isnan(self.value):
            return "NaN"
        return repr(float(self.value)) if not isinf(self.value) else "INF" if self.value > 0 else "-INF"


@dataclass(frozen=True)
class Fmu:
    """An FMU before it is packed.

    `groups`: its numbers, group by group, in the order in which FMI refers to them: those that may be set at any time,
    those that may be set before the simulation begins, and those that are computed. `wholes` and `truths` follow.
    """

    name: str
    title: str
    about: str
    template: str
    groups: dict[str, list[Variable]]
    wholes: list[Variable]
    truths: list[Variable]
    sample_time: float
    duration: float  # of a run, as a proposal [s]
    context: Mapping[str, Any]  # what the template reads besides
    sources: Mapping[str, str]  # C that it stands on, file by file
    is_any_step: bool = True  # of co-simulation; else a step is a whole number of samples

    @property
    def variables(self) -> list[Variable]:
        """All that others see, in the order of their references."""
        time = Variable("time", "of the simulation", "independent", "continuous", "s")
        return [time, *(one for group in self.groups.values() for one in group), *self.wholes, *self.truths]

    def files(self, version: int) -> dict[str, str]:
        """The text files; the token that names the FMU is made of the content of all."""
        nameless = self._files(version, UUID(int=0))
        content = "\0".join(part for pair in nameless.items() for part in pair)
        return self._files(version, UUID(bytes=sha256(content.encode()).digest()[:16]))

    def _files(self, version: int, token: UUID) -> dict[str, str]:
        variables, places, end = self.variables, dict[str, int](), 1
        glue = f"{self.name}_fmu.c"
        for name, group in self.groups.items():
            places[name], end = end, end + len(group)
        open_ones = [one for one in variables[:end] if one.causality in ("input", "parameter")]
        tunable = [one for one in open_ones if one.variability != "fixed"]
        context: dict[str, Any] = {
            **self.context,
            "version": version, "name": self.name, "title": self.title, "about": self.about,
            "token": f"{{{token}}}", "layout": f"{token.int >> 96:08x}",
            "headers": [name for name in self.sources if name.endswith(".h")],
            "compiled": [name for name in [*self.sources, glue] if name.endswith(".c")],
            "places": places, "fixed": 1 + len(tunable), "found": 1 + len(open_ones), "reals": end,
            "truths": end + len(self.wholes), "all": len(variables),
            "first_reals": [decimal(one.value, False) for one in variables[:end]],
            "first_wholes": [int(one.value) for one in variables[end:]],
            "sample_time": decimal(self.sample_time, False), "duration": repr(self.duration),
            "variables": variables, "units": sorted({one.unit for one in variables} - {""}),
            "outputs": [i for i, one in enumerate(variables) if one.causality == "output"],
            "is_any_step": self.is_any_step,
        }  # fmt: skip
        texts = {"modelDescription.xml": f"fmi{version}.xml.jinja", f"sources/{glue}": self.template}
        if version == 3:
            texts["sources/buildDescription.xml"] = "build_description.xml.jinja"
        rendered = {name: TEMPLATES.get_template(template).render(context) for name, template in texts.items()}
        return rendered | {f"sources/{name}": text for name, text in self.sources.items()}


def binary(name: str, files: Mapping[str, str], version: int) -> dict[str, bytes]:
    """The shared library for this system, by its place in the ZIP file.

    Raises:
        CompilerError: if it cannot be built, or FMI knows no name for this system.
    """
    processor, system = PROCESSORS.get(platform.machine().lower()), platform.system()
    if processor is None or system not in SYSTEMS:
        raise CompilerError(f"FMI has no place for a binary of {system} on {platform.machine()}")
    short, ending = SYSTEMS[system]
    folder = f"{short}64" if version == 2 else f"{processor}-{'windows' if short == 'win' else short}"
    sources = {path.removeprefix("sources/"): text for path, text in files.items() if path.startswith("sources/")}
    return {f"binaries/{folder}/{name}.{ending}": portable_library(sources)}


def packed(files: Mapping[str, str | bytes]) -> bytes:
    """A ZIP file; the same content gives the same bytes."""
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, DAY_ONE)
            entry.create_system, entry.external_attr, entry.compress_type = 3, UNIX_FILE, zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])
    return memory.getvalue()
