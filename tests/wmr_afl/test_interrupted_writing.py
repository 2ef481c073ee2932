"""Whatever stops a command while it writes, a full disk or a kill at any line: the old state stands, or the new one."""

from __future__ import annotations

import functools
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import wmr_afl
from derive.codegen.write import write
from tests.conftest import ROOT
from tests.fuzzing import SEED, TIMES
from tests.wmr_afl.junk import answered
from tests.wmr_afl.test_junk_arguments import SHORT
from tests.wmr_input.interruptions import full_disk, interrupted
from wmr_afl import WmrError
from wmr_afl.analysis import animation, campaign_plots, plots
from wmr_afl.analysis.files import keep_only, renewed, write_results
from wmr_afl.experiments.campaigns.ledger import Ledger
from wmr_input import whole_files
from wmr_input.whole_files import write_whole

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, and the exchange of folders")
STRIDE = 20  # lines
State = dict[str, bytes]
Act = Callable[[Path, bool], object]  # into a folder: the old state, or the new one


def state(folder: Path) -> State:
    """All files below a folder, except locks and what is still being written."""
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name != ".lock" and ".unfinished-" not in str(file.relative_to(folder))
    }


@functools.cache
def experiment(folder: Path) -> Path:
    """Study 1 for five samples."""
    folder.mkdir(exist_ok=True)
    (folder / "short.toml").write_text(SHORT)
    return folder / "short.toml"


@functools.cache
def _runs(folder: Path) -> dict[str, wmr_afl.Run]:
    return wmr_afl.run(experiment(folder), "casadi")


def derived(folder: Path, new: bool) -> None:
    """A model that is derived again, besides a file of its user."""
    (folder / "mine.txt").write_text("mine")
    write({f"robot/{name}": f"{new}" * 99 for name in ("model.json", "numpy_model.py")}, folder)


def simulated(folder: Path, new: bool) -> None:
    """An experiment that is run again with one controller less, whose samples go."""
    runs = _runs(folder.parent / "experiment")
    with renewed(folder / "results") as beside:
        keep_only(write_results({name: runs[name] for name in list(runs)[: 1 if new else 2]}, beside), beside)


def block(folder: Path, new: bool) -> None:
    """A block of a campaign that is computed again."""
    Ledger(folder / "campaign", "a fingerprint").write(0, {"rms": np.full((3, 2), float(new))})


@functools.cache
def _drawn(folder: Path, runs: int) -> wmr_afl.CampaignResult:
    return wmr_afl.campaign(experiment(folder), runs, backend="casadi")


def summary(folder: Path, new: bool) -> None:
    """The summary of a campaign that has gone on; text stands for its figures."""

    def save(figure: object, stem: Path) -> list[Path]:
        write_whole(stem.with_suffix(".png"), f"{new}")
        return [stem.with_suffix(".png")]

    with patch.multiple(campaign_plots, draw_errors=str, draw_success=str), patch.object(plots, "save", save):
        campaign_plots.write(_drawn(folder.parent / "experiment", 8 if new else 4), folder / "campaign")


def trajectories(folder: Path, new: bool) -> None:
    """Trajectories of a batch that is run again."""
    file = experiment(folder.parent / "experiment")
    wmr_afl.run_batch(file, scale={"m_C": [1.1 if new else 1.0]}, backend="casadi", trajectories=folder / "runs.h5")


SCENES: dict[str, Act] = {
    "derive": derived,
    "simulate": simulated,
    "block of a campaign": block,
    "summary of a campaign": summary,
    "trajectories": trajectories,
}


def die() -> None:
    """As the system kills a process that takes too much memory."""
    os.kill(os.getpid(), signal.SIGKILL)


def some_lines() -> range:
    """Every twentieth line of what writes, others with each seed; `test_interrupted_files.py` takes all of them."""
    return range(SEED % STRIDE, 10_000, max(1, STRIDE // TIMES))


def stopped(act: Act, folder: Path, place: int) -> bool:
    """Write the new state, with a full disk from a line on; False if there are fewer lines."""
    try:
        return interrupted(lambda: act(folder, True), place, full_disk)
    except OSError:  # at a line that asks for no room, where no system raises it
        return True


def states(act: Act, folder: Path) -> tuple[State, State]:
    """What stands there before and after."""
    folder.mkdir()
    act(folder, False)
    before = state(folder)
    act(folder, True)
    after = state(folder)
    assert before != after
    shutil.rmtree(folder)
    return before, after


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that was just being closed
@pytest.mark.parametrize("scene", SCENES)
def test_a_full_disk_at_any_line_leaves_the_old_state_or_the_new_one(scene: str, tmp_path: Path) -> None:
    act, seen = SCENES[scene], set()
    before, after = states(act, tmp_path / "whole")
    for place in some_lines():
        folder = tmp_path / str(place)
        folder.mkdir()
        act(folder, False)
        is_stopped, said = answered(f"{scene} {place}", functools.partial(stopped, act, folder, place))
        assert whole_files.MARK not in said
        found = state(folder)
        assert found in (before, after), place
        seen.add(found == after)
        if not is_stopped and not said:
            break
        shutil.rmtree(folder)
    assert seen == {False, True}
    assert place > 10


KILLED = """
import os, shutil, signal, sys, warnings
from pathlib import Path
from tests.wmr_afl.test_interrupted_writing import SCENES, die, interrupted, some_lines, state, states

warnings.simplefilter("ignore")
for name, act in SCENES.items():
    top = Path(sys.argv[1], name)
    top.mkdir()
    before, after = states(act, top / "whole")
    seen = set()
    for place in some_lines():
        folder = top / str(place)
        folder.mkdir()
        act(folder, False)
        child = os.fork()
        if child == 0:
            interrupted(lambda: act(folder, True), place, die)
            os._exit(0)
        status = os.waitpid(child, 0)[1]
        found = state(folder)
        assert found in (before, after), (name, place, {key for key in found if found[key] != before.get(key)})
        seen.add(found == after)
        if not os.WIFSIGNALED(status):
            break
        shutil.rmtree(folder)
    assert seen == {False, True} and place > 10, (name, seen, place)
"""


def test_a_kill_at_any_line_leaves_the_old_state_or_the_new_one(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


# --- the cache of machine code ---------------------------------------------------------------------------------------

BUILT = """
import os, shutil, signal, sys
from tests.wmr_input.interruptions import full_disk, interrupted
from wmr_afl.simulation.kernels import c_compiler

def die():
    os.kill(os.getpid(), signal.SIGKILL)

cache, build = c_compiler._cache(), lambda: c_compiler.library("double f(void) { return 4.0; }")
c_compiler._identity()  # of the compiler, which is asked once in a process
for stop in (full_disk, die):
    seen = set()
    for place in range(*map(int, sys.argv[1:])):
        shutil.rmtree(cache, ignore_errors=True)
        child = os.fork()
        if child == 0:
            os._exit(interrupted(build, place, stop, c_compiler.__file__))
        status = os.waitpid(child, 0)[1]
        libraries = list(cache.glob("*.so"))
        assert len(libraries) <= 1
        for path in libraries:
            assert path.stem.partition("-")[2] == c_compiler._digest(path.read_bytes()), place
        seen.add(len(libraries))
        if status == 0:
            break
    assert seen == {0, 1} and build().f and place > 10, (stop, seen, place)
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_cache_holds_whole_libraries_whatever_stops_the_build(tmp_path: Path) -> None:
    """A full disk and a kill; in processes of their own, which may leave the compiler's pipes open."""
    lines = some_lines()
    done = subprocess.run(
        [sys.executable, "-c", BUILT, *map(str, (lines.start, lines.stop, lines.step))],
        cwd=ROOT, env={**os.environ, "WMR_AFL_CACHE": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]


# --- files that stand alone ------------------------------------------------------------------------------------------


def test_an_animation_that_cannot_be_finished_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, file = _runs(tmp_path / "experiment")["AFL"], tmp_path / "run.gif"
    file.write_text("old")

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animation.animate(run, file, progress=interrupt)
    monkeypatch.setattr(whole_files.os, "fsync", lambda _: full_disk())
    with pytest.raises(WmrError, match=r"run.gif: cannot be written \(No space left on device\); name a file"):
        animation.animate(run, file)
    assert state(tmp_path) == {"run.gif": b"old", "experiment/short.toml": SHORT.encode()}
