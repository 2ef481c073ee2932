"""The compiler is the user's, is stopped if it hangs, and its cache holds the user's own code, and not for ever."""

import ctypes
import os
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROOT
from tests.wmr_afl.simulation.kernels.test_compiled import START, forget, one_line
from wmr_afl import CompilerError
from wmr_afl.simulation.kernels import c_compiler as build

CC = shutil.which("cc") or shutil.which("gcc")
pytestmark = [
    pytest.mark.skipif(CC is None, reason="no C compiler"),
    pytest.mark.skipif(os.name != "posix", reason="owner and mode"),
]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of this test's own, and nothing remembered in this process."""
    monkeypatch.setenv("WMR_AFL_CACHE", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    forget()
    build._own_folder.cache_clear()
    yield tmp_path / "wmr-afl"
    monkeypatch.undo()
    forget()


def four(number: int = 4) -> float:
    library = build.library(f"double f(void) {{ return {number}.0; }}")
    library.f.restype = ctypes.c_double
    return float(library.f())


def script(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def test_the_cache_is_its_users_alone(cache: Path) -> None:
    before = os.umask(0)
    try:
        assert four() == 4.0
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o722])
def test_a_cache_that_others_can_write_is_not_used(cache: Path, mode: int) -> None:
    """What lies there may be anybody's code, although its name and digest are right."""
    assert four() == 4.0
    (planted,) = cache.iterdir()
    other = build._build("double f(void) { return 666.0; }", cache, "other", build.FLAGS)
    other.rename(cache / f"{planted.stem.partition('-')[0]}-{other.stem.partition('-')[2]}.so")
    planted.unlink()
    cache.chmod(mode)
    before = sorted(cache.iterdir())
    with one_line("wmr-afl can be written by other users; machine code is built again in every process"):
        assert four() == 4.0
    assert sorted(cache.iterdir()) == before
    own = build._own_folder()
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    assert len(list(own.iterdir())) == 1


def test_a_cache_of_another_user_is_not_used(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert four() == 4.0
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    with one_line("wmr-afl belongs to another user; machine code is built again"):
        assert four() == 4.0


def test_a_batch_runs_as_machine_code_although_the_cache_is_not_trusted(cache: Path) -> None:
    first = wmr_afl.run_batch("study_1", start=START, backend="compiled")
    cache.chmod(0o777)
    forget()
    with one_line("can be written by other users"):
        second = wmr_afl.run_batch("study_1", start=START, backend="compiled")
    assert first.final_state.tobytes() == second.final_state.tobytes()


def test_what_was_not_used_for_long_is_removed(cache: Path) -> None:
    for number in (1, 2):
        four(number)
    old, used = sorted(cache.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    for path in (old, used):
        os.utime(path, (time.time() - 1.01 * build.UNUSED,) * 2)
    forget()
    assert four(2) == 2.0  # which was used now
    (cache / ".unfinished-killed").mkdir()
    os.utime(cache / ".unfinished-killed", (0, 0))
    four(3)
    assert not old.exists()
    assert used.exists()
    assert len(list(cache.iterdir())) == 2


def test_the_oldest_are_removed_beyond_the_room_that_there_is(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    four(1)
    (first,) = cache.iterdir()
    os.utime(first, (time.time() - 100.0,) * 2)
    four(2)
    monkeypatch.setattr(build, "ROOM", 1.5 * first.stat().st_size)
    four(3)
    assert not first.exists()
    assert len(list(cache.iterdir())) == 2


def test_a_compiler_that_hangs_is_stopped_with_all_that_it_started(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alive = tmp_path / "alive"
    text = f'[ "$1" = --version ] && exit 0\n(while :; do date > "{alive}"; sleep 0.05; done) &\nsleep 1000'
    monkeypatch.setenv("CC", str(script(tmp_path / "slow_cc", text)))
    monkeypatch.setattr(build, "PATIENCE", 1.0)
    forget()
    with one_line(r"slow_cc did not end within 1 s; running on CasADi's virtual machine"):
        assert not wmr_afl.run_batch("study_1", start=START).failed.any()
    with pytest.raises(CompilerError, match="did not end within 1 s; run with backend casadi"):
        wmr_afl.run("study_1", backend="compiled")
    alive.unlink()
    time.sleep(0.3)
    assert not alive.exists()


def test_a_compiler_that_hangs_at_its_version_is_stopped(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", str(script(tmp_path / "slow_cc", "sleep 1000")))
    monkeypatch.setattr(build, "PATIENCE", 0.5)
    forget()
    with pytest.raises(CompilerError, match="did not end within"):
        four()


def test_options_and_wrappers_in_the_environment_are_used(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrapper = script(tmp_path / "wrap", f'echo "$@" >> {tmp_path}/calls\nexec "$@"')
    for command, words in ((f"{CC} -DHERE=1", (CC, "-DHERE=1")), (f"{wrapper} {CC}", (str(wrapper), CC))):
        monkeypatch.setenv("CC", command)
        forget()
        assert build.compiler() == words
        assert four(len(words[1])) == len(words[1])
    assert str(CC) in (tmp_path / "calls").read_text()
    spaced = tmp_path / "my compilers"
    spaced.mkdir()
    monkeypatch.setenv("CC", str(script(spaced / "cc", f'exec {CC} "$@"')))
    forget()
    assert build.compiler() == (str(spaced / "cc"),)
    for nonsense in ("'", "nowhere -m64", " "):
        monkeypatch.setenv("CC", nonsense)
        forget()
        assert build.compiler() == (CC,)


def test_another_option_is_another_library(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "double f(void) { return HERE; }"
    for value in (1, 2):
        monkeypatch.setenv("CC", f"{CC} -DHERE={value}")
        forget()
        library = build.library(text)
        library.f.restype = ctypes.c_double
        assert library.f() == value
        assert f"-DHERE={value}" in build.compiler_version()


@pytest.mark.parametrize(
    ("printed", "name"),
    [("gcc (Box 1) 12.2.0\nCopyright\n", "(Box 1) 12.2.0"), ("clang version 17", "version 17"), ("", "")],
)
def test_a_compiler_is_known_by_its_version_whatever_it_is_called_by(
    printed: str, name: str, cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first line of it without its first word, then the options."""
    (tmp_path / "version").write_text(printed)
    monkeypatch.setenv("CC", f"{script(tmp_path / 'my_cc', f'cat {tmp_path}/version')} -m64")
    forget()
    assert build.compiler_version() == " ".join((name, "-m64", *build.FLAGS))


def test_an_interrupt_stops_the_compiler(cache: Path, tmp_path: Path) -> None:
    text = f'[ "$1" = --version ] && exit 0\necho $$ > {tmp_path}/pid\nexec sleep 1000'
    slow = script(tmp_path / "slow_cc", text)
    code = (
        "import os, signal, threading, time\n"
        "from wmr_afl.simulation.kernels import c_compiler as build\n"
        "def interrupt():\n"
        f"    while not os.path.exists({str(tmp_path / 'pid')!r}): time.sleep(0.01)\n"
        "    time.sleep(0.2)\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "threading.Thread(target=interrupt).start()\n"
        "try:\n"
        "    build.library('int f;')\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n"
    )
    environment = {**os.environ, "CC": str(slow), "WMR_AFL_CACHE": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout == "interrupted\n", done.stderr
    compiling = int((tmp_path / "pid").read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(compiling, 0)
    np.testing.assert_array_equal(list(cache.iterdir()), [])
