"""The C of an FMU is that of the standard: its declarations, all of its functions, and no name that meets another."""

import ctypes
import re
import subprocess
from pathlib import Path

import pytest

from tests.wmr_afl.onboard.test_fmu import Exports, Slave, fmpy
from wmr_afl.simulation.kernels import c_compiler

HEADERS = Path(fmpy.__file__).parent / "c-code"  # those of the standard, of both versions
OF_MODEL_EXCHANGE = frozenset(  # functions that co-simulation by FMI 2.0 does not need
    """EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates
    GetDerivatives GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates
    """.split()  # noqa: SIM905, a table of words reads better than a list of strings
)

pytestmark = pytest.mark.skipif(c_compiler.compiler() is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Exports:
    return Exports(tmp_path_factory.mktemp("fmu"))


@pytest.mark.parametrize("version", [2, 3])
def test_its_c_is_the_standards(exports: Exports, version: int, tmp_path: Path) -> None:
    """Its declarations are those of the standard's headers, all functions are there, and two FMUs can be linked."""
    command = [*(c_compiler.compiler() or ()), "-std=c11", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
    command += ["-Wno-unused-parameter", "-fPIC"]
    folder, header = exports.make("study_1", "AFL", version), HEADERS / f"fmi{version}Functions.h"
    wanted = set(re.findall(rf"^ *FMI{version}_Export fmi\w+TYPE\s+(\w+);", header.read_text(), flags=re.M))
    wanted -= {f"fmi2{name}" for name in OF_MODEL_EXCHANGE}
    assert len(wanted) > 30
    objects = []
    for name in ("controller", "plant"):
        one = Slave(folder / f"{name}.fmu", folder / f"{name}_fmu")
        library = ctypes.CDLL(str(next(one.folder.glob("binaries/*/*"))))
        assert [function for function in sorted(wanted) if not hasattr(library, function)] == []
        sources = one.folder / "sources"
        subprocess.run([*command, "-fsyntax-only", "-include", header, sources / f"{name}_fmu.c"], check=True)
        for source in sorted(sources.glob("*.c")):
            objects.append(tmp_path / f"{name}_{source.stem}.o")
            prefix = f"-DFMI{version}_FUNCTION_PREFIX={name}_"
            subprocess.run([*command, prefix, "-c", source, "-o", objects[-1]], check=True)
    subprocess.run([*(c_compiler.compiler() or ()), "-shared", *objects, "-o", tmp_path / "both.so", "-lm"], check=True)
    assert hasattr(ctypes.CDLL(str(tmp_path / "both.so")), f"plant_fmi{version}DoStep")
