"""Files and folders are written whole or not at all, whatever happens at whatever line."""

import json
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest

from tests.conftest import ROOT
from wmr_input import whole_files
from wmr_input.whole_files import remove_abandoned, replacing, write_folder, write_whole

OLD = {"numpy_model.py": "old\n" * 9000, "model.json": "{}\n"}
NEW = {"numpy_model.py": "new\n" * 9000, "model.json": '{"new": 1}\n', "derivation.md": "# new\n"}
Content = dict[str, str]


def content(folder: Path) -> Content:
    """All files below a folder, except what is still being written."""
    return {
        file.relative_to(folder).as_posix(): file.read_text()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not any(part.startswith(".unfinished-") for part in file.relative_to(folder).parts)
    }


def interrupted(
    act: Callable[[], object], place: int, stop: Callable[[], None], file: str = whole_files.__file__
) -> bool:
    """Do something, and `stop` before its line number `place` of a file; False if it has fewer lines."""
    count = -1

    def line(frame: FrameType, event: str, argument: object) -> object:
        nonlocal count
        if frame.f_code.co_filename != file:
            return None
        if event == "line":
            count += 1
            if count == place:
                stop()
        return line

    before = sys.gettrace()
    sys.settrace(line)
    try:
        act()
    finally:
        sys.settrace(before)
    return count >= place


def full_disk() -> None:
    raise OSError(28, "No space left on device")


def scene(folder: Path) -> tuple[Callable[[], None], Content, Content]:
    """A folder of a model with a user's own file: what writes it anew, its content before and after."""
    write_folder(folder / "robot", OLD)
    (folder / "robot" / "notes").mkdir()
    (folder / "robot" / "notes" / "mine.md").write_text("mine")
    before = content(folder)
    after = {**before, **{f"robot/{name}": text for name, text in NEW.items()}}
    return lambda: write_folder(folder / "robot", NEW), before, after


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
from tests.wmr_input.test_whole_files import content, interrupted, scene

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


def test_without_an_exchange_of_folders_files_are_replaced_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(whole_files, "_exchange_call", lambda: None)
    act, _, after = scene(tmp_path)
    act()
    assert content(tmp_path) == after
    assert [path.name for path in tmp_path.iterdir()] == ["robot"]


def test_a_link_is_replaced_and_never_written_through(tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("precious")
    (tmp_path / "link.txt").symlink_to("precious.txt")
    write_whole(tmp_path / "link.txt", "new")
    assert not (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "precious.txt").read_text() == "precious"


@pytest.mark.parametrize("exchange", [True, False])
def test_a_link_to_a_folder_is_replaced_and_never_written_through(
    tmp_path: Path, exchange: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not exchange:
        monkeypatch.setattr(whole_files, "_exchange_call", lambda: None)
    write_folder(tmp_path / "precious", OLD)
    (tmp_path / "link").symlink_to("precious")
    write_folder(tmp_path / "link", NEW)
    assert not (tmp_path / "link").is_symlink()
    assert content(tmp_path / "link") == NEW
    assert content(tmp_path / "precious") == OLD
    assert len(list(tmp_path.iterdir())) == 2


def test_what_python_has_compiled_does_not_stay(tmp_path: Path) -> None:
    write_folder(tmp_path / "robot", OLD)
    (tmp_path / "robot" / "__pycache__").mkdir()
    write_folder(tmp_path / "robot", NEW)
    assert content(tmp_path / "robot") == NEW
    assert not (tmp_path / "robot" / "__pycache__").exists()


def test_a_place_that_is_no_file_or_no_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(IsADirectoryError), replacing(tmp_path / "folder"):
        pytest.fail("nothing was refused")
    with pytest.raises(NotADirectoryError):
        write_folder(tmp_path / "file", NEW)
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "file"}


def test_a_private_file_stays_private(tmp_path: Path) -> None:
    file = tmp_path / "metrics.json"
    file.write_text("")
    file.chmod(0o600)
    write_whole(file, json.dumps({}))
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_what_a_killed_process_left_is_removed_after_a_day(tmp_path: Path) -> None:
    for name in (".unfinished-1-robot", ".unfinished-2-robot", "robot"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("")
        if name != ".unfinished-2-robot":
            os.utime(tmp_path / name, (0, 0))
    remove_abandoned(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {".unfinished-2-robot", "robot"}
