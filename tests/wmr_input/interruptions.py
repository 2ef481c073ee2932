"""What writes a folder anew, and what stops it at any line, for tests of files that are written whole or not at all."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from wmr_input import whole_files
from wmr_input.whole_files import write_folder

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
