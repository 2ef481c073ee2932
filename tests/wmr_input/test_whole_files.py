"""What takes the place of a file or folder: links, modes, what is kept, what is removed, and what is refused."""

import json
import os
import stat
import time
from pathlib import Path

import pytest

from tests.wmr_input.interruptions import NEW, OLD, content, scene
from wmr_input import whole_files
from wmr_input.whole_files import remove_abandoned, renewing, replacing, write_folder, write_whole


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


@pytest.mark.parametrize(("before", "after"), [(0o600, 0o600), (0o644, 0o644), (0o755, 0o755), (0o440, 0o640)])
def test_a_file_keeps_its_mode_and_can_be_written_again(before: int, after: int, tmp_path: Path) -> None:
    """A private file stays private, a program a program."""
    file = tmp_path / "metrics.json"
    file.write_text("")
    file.chmod(before)
    write_whole(file, json.dumps({}))
    assert stat.S_IMODE(file.stat().st_mode) == after


@pytest.mark.parametrize("is_link", [True, False])
def test_a_new_file_has_the_usual_mode(is_link: bool, tmp_path: Path) -> None:
    """That of a file that is opened for writing; a link has none to keep, and of what it names none is taken."""
    (tmp_path / "usual").write_text("")
    if is_link:
        (tmp_path / "private").write_text("")
        (tmp_path / "private").chmod(0o600)
        (tmp_path / "new").symlink_to("private")
    write_whole(tmp_path / "new", "")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_a_name_may_be_as_long_as_the_system_allows(tmp_path: Path) -> None:
    """What is written beside it has a shorter one, with the same ending."""
    file = tmp_path / ("x" * 251 + ".csv")
    with replacing(file) as beside:
        assert beside.suffix == ".csv"
        beside.write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize("kind", ["folder", "file", "link"])
@pytest.mark.parametrize("days", [0.0, 0.9, 1.1])
def test_what_a_killed_process_left_is_removed_after_a_day(kind: str, days: float, tmp_path: Path) -> None:
    """Not before, for then it may be at work; and nothing else, however old, nor what a link names."""
    precious = tmp_path / "precious"
    precious.mkdir()
    for name in (".unfinished-1-robot", "robot"):
        path = tmp_path / name
        if kind == "folder":
            path.mkdir()
            (path / "file").write_text("")
        elif kind == "file":
            path.write_text("")
        else:
            path.symlink_to("precious")
        then = time.time() - days * 24 * 3600
        os.utime(path, (then, then), follow_symlinks=False)
    remove_abandoned(tmp_path)
    stays = {".unfinished-1-robot"} if days < 1.0 else set()
    assert {path.name for path in tmp_path.iterdir()} == {"robot", "precious"} | stays


class System:
    """A system's library with one call, which remembers its arguments."""

    def __init__(self, name: str, status: int) -> None:
        self.asked: list[tuple[object, ...]] = []
        setattr(self, name, lambda *arguments: self.asked.append(arguments) or status)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [("renameat2", (-100, b"one", -100, b"other", 2)), ("renamex_np", (b"one", b"other", 2))],
)
@pytest.mark.parametrize("status", [0, -1])
def test_each_system_is_asked_for_an_exchange_in_its_own_way(
    name: str, arguments: tuple[object, ...], status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """AT_FDCWD and RENAME_EXCHANGE on Linux, RENAME_SWAP on macOS; a status other than zero says that it could not."""
    system = System(name, status)
    monkeypatch.setattr(whole_files.ctypes, "CDLL", lambda _: system)
    assert whole_files._exchange(Path("one"), Path("other")) is (status == 0)
    assert system.asked == [arguments]


def test_a_system_without_an_exchange_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_files.ctypes, "CDLL", lambda _: System("rename", 0))
    assert not whole_files._exchange(Path("one"), Path("other"))


def test_a_file_is_on_the_disk_before_it_takes_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a crash of the machine could leave its name without its content."""
    order: list[tuple[str, int, int]] = []
    fsync, replace = os.fsync, os.replace

    def told(what: str, seen: os.stat_result) -> None:
        order.append((what, seen.st_ino, seen.st_size))

    monkeypatch.setattr(os, "fsync", lambda file: (told("on the disk", os.fstat(file)), fsync(file)))
    monkeypatch.setattr(os, "replace", lambda one, other: (told("in its place", os.stat(one)), replace(one, other)))
    for text in ("a text", "another one"):
        order.clear()
        whole_files.write_whole(tmp_path / "file", text)
        found = (tmp_path / "file").stat()
        assert order == [(what, found.st_ino, len(text)) for what in ("on the disk", "in its place")]


@pytest.mark.parametrize("exchange", [True, False])
def test_what_the_new_folder_lacks_is_gone_afterwards(
    exchange: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it is left out from the beginning or removed on the way; files and folders, and nothing else."""
    if not exchange:
        monkeypatch.setattr(whole_files, "_exchange_call", lambda: None)
    folder = tmp_path / "folder"
    for name in ("kept", "left_out", "removed", "inside/kept", "without/inside"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("old")
    with renewing(folder, without=["left_out", "without"]) as beside:
        (beside / "removed").unlink()
        (beside / "new").write_text("new")
    assert content(tmp_path) == {"folder/inside/kept": "old", "folder/kept": "old", "folder/new": "new"}
    assert sorted(path.name for path in folder.iterdir()) == ["inside", "kept", "new"]
