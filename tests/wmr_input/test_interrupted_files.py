"""Files and folders are written whole or not at all, whatever happens at whatever line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.wmr_input.interruptions import content, full_disk, interrupted, scene
from wmr_input.whole_files import write_whole


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that was just being closed
def test_an_error_at_any_line_leaves_the_old_folder_or_the_new_one(tmp_path: Path) -> None:
    seen = set()
    for place in range(10_000):
        folder = tmp_path / str(place)
        folder.mkdir()
        act, before, after = scene(folder)
        try:
            if not interrupted(act, place, full_disk):
                break
        except OSError:
            pass
        found = content(folder)
        assert found in (before, after), place
        seen.add(found == after)
    assert seen == {False, True}
    assert place > 60


KILLED = """
import os, signal, sys
from pathlib import Path
from tests.wmr_input.interruptions import content, interrupted, scene

def die():
    os.kill(os.getpid(), signal.SIGKILL)

seen = set()
for place in range(10_000):
    folder = Path(sys.argv[1], str(place))
    folder.mkdir()
    act, before, after = scene(folder)
    child = os.fork()
    if child == 0:
        os._exit(0 if interrupted(act, place, die) else 1)
    status = os.waitpid(child, 0)[1]
    found = content(folder)
    assert found in (before, after), (place, found.keys())
    seen.add(found == after)
    if status:
        assert os.WIFSIGNALED(status) or found == after
        if not os.WIFSIGNALED(status):
            break
assert seen == {False, True} and place > 60, (seen, place)
print(place)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_kill_at_any_line_leaves_the_old_folder_or_the_new_one(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that was just being closed
def test_an_error_at_any_line_leaves_the_old_file_or_the_new_one(tmp_path: Path) -> None:
    file = tmp_path / "samples.csv"
    for place in range(1000):
        file.write_text("old")
        try:
            if not interrupted(lambda: write_whole(file, "new"), place, full_disk):
                break
        except OSError:
            pass
        assert content(tmp_path) in ({"samples.csv": "old"}, {"samples.csv": "new"}), place
    assert place > 10
