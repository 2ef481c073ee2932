"""Folders of results: what takes whose place, what is removed, and what stays."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.wmr_afl.analysis.test_samples import MODEL, TIME, run
from wmr_afl.analysis import files as files_module
from wmr_afl.analysis import plots
from wmr_afl.analysis.files import NOTE, check_writable, columns, keep_only, renewed, write_results
from wmr_input import WmrError


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("is_linked", [False, True])
@pytest.mark.parametrize("is_there", [False, True])
def test_a_renewed_folder_takes_its_place_at_once(is_there: bool, is_linked: bool, tmp_path: Path) -> None:
    """Until then the old one stands there; what else lies in it stays; a link goes on to name its folder."""
    real = tmp_path / ("elsewhere" if is_linked else "results")
    if is_linked:
        (tmp_path / "results").symlink_to(real)
        real.mkdir()
    if is_there:
        real.mkdir(exist_ok=True)
        (real / "mine.txt").write_text("mine")
        (real / "a.txt").write_text("old")
    before = content(real) if real.is_dir() else {}
    with renewed(tmp_path / "results") as beside:
        assert beside.parent == real.parent
        assert beside != real
        (beside / "b.txt").write_text("new")
        assert (content(real) if real.is_dir() else {}) == before
    assert content(tmp_path / "results") == {**before, "b.txt": "new"}
    assert (tmp_path / "results").is_symlink() == is_linked
    assert not any(path.name.startswith(".") for path in tmp_path.iterdir())


@pytest.mark.parametrize("inside", [".", "within"])
def test_a_folder_that_one_stands_in_stays_the_same(
    inside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a shell would stand in a folder that is gone."""
    (tmp_path / "within").mkdir()
    monkeypatch.chdir(tmp_path / inside)
    before = tmp_path.stat().st_ino
    with renewed(tmp_path) as beside:
        (beside / "b.txt").write_text("new")
    assert tmp_path.stat().st_ino == before
    assert (tmp_path / "b.txt").read_text() == "new"


def test_a_folder_that_is_gone_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line, before anything runs."""
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(WmrError, match="the folder that you are in is gone; change to one that is there"):
        check_writable(Path("results"))


@pytest.mark.parametrize("why", ["a mount", "no room beside"])
def test_where_nothing_can_stand_beside_it_is_written_into(
    why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another disk, or a folder whose parent is closed; one that is not there yet is made as ever."""
    folder = tmp_path / "results"
    folder.mkdir()
    if why == "a mount":
        monkeypatch.setattr(os.path, "ismount", lambda path: Path(path) == folder)
    else:
        usual = os.access
        monkeypatch.setattr(os, "access", lambda path, how: Path(path) != tmp_path and usual(path, how))
    with renewed(folder) as place:
        assert place == folder
    with renewed(tmp_path / "new") as place:
        assert place != tmp_path / "new"


def test_a_mistake_inside_names_the_folder_and_leaves_what_was_there(tmp_path: Path) -> None:
    """Not the one that was to take its place."""
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "a.txt").write_text("old")

    def fail() -> None:
        with renewed(folder) as beside:
            (beside / "b.txt").write_text("new")
            raise WmrError(f"{beside}/b.txt: cannot be written", "make room")

    with pytest.raises(WmrError) as caught:
        fail()
    assert (caught.value.problem, caught.value.remedy) == (f"{folder}/b.txt: cannot be written", "make room")
    with (
        pytest.raises(WmrError, match=r"results: cannot be written .No space left.*name a writable folder"),
        renewed(folder),
    ):
        raise OSError(28, "No space left on device")
    assert content(folder) == {"a.txt": "old"}


def test_what_an_earlier_run_left_is_removed_if_it_is_as_it_was_written(tmp_path: Path) -> None:
    """Not what was edited, what a link names, what was never written here, nor what is kept."""
    names = ("kept", "left", "edited", "linked", "vanished")
    files = write_results({name: run() for name in names}, tmp_path)
    noted = json.loads((tmp_path / NOTE).read_text())["sha256"]
    assert noted == {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    (tmp_path / "edited.csv").write_text("mine")
    (tmp_path / "vanished.csv").unlink()
    (tmp_path / "linked.csv").rename(tmp_path / "precious.csv")
    (tmp_path / "linked.csv").symlink_to(tmp_path / "precious.csv")
    keep_only([tmp_path / "kept.csv"], tmp_path)
    left = {"kept.csv", "edited.csv", "linked.csv", "precious.csv", NOTE}
    assert {path.name for path in tmp_path.iterdir()} == left
    assert json.loads((tmp_path / NOTE).read_text())["sha256"] == {"kept.csv": noted["kept.csv"]}


def test_results_of_several_calls_are_noted_together(tmp_path: Path) -> None:
    """And belong to the program until they are not kept."""
    for name in ("a", "b"):
        write_results({name: run()}, tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    assert set(json.loads((folder / NOTE).read_text())["sha256"]) == {"a.csv", "b.csv", "metrics.json"}
    keep_only([folder / "metrics.json"], folder)
    assert {path.name for path in folder.iterdir()} == {"metrics.json", NOTE}


@pytest.mark.parametrize(
    "note",
    ["", "[]", "{}", '{"sha256": 3}', '{"sha256": {"../precious.csv": "DIGEST"}}', '{"sha256": {"folder": "0"}}'],
)
def test_a_note_that_is_damaged_removes_nothing(note: str, tmp_path: Path) -> None:
    (tmp_path / "precious.csv").write_text("precious")
    folder = tmp_path / "results"
    (folder / "folder").mkdir(parents=True)
    (folder / NOTE).write_text(note.replace("DIGEST", hashlib.sha256(b"precious").hexdigest()))
    keep_only([], folder)
    assert (tmp_path / "precious.csv").read_text() == "precious"
    assert (folder / "folder").is_dir()


def test_a_folder_may_be_written_if_it_or_what_is_above_it_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A link that names nothing is there, too, and cannot be made a folder."""
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    with pytest.raises(WmrError, match="dangling: cannot be written; name a writable folder"):
        check_writable(tmp_path / "dangling" / "a")
    monkeypatch.chdir(tmp_path)
    check_writable(Path("a/b"))
    monkeypatch.setattr(os, "access", lambda path, how: False)
    with pytest.raises(WmrError, match=f"{tmp_path.name}: cannot be written"):
        check_writable(tmp_path / "a" / "b")


@pytest.mark.parametrize("part", [1, 3, 4, 11, 100])
def test_samples_are_the_same_in_parts_of_any_size(part: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With every signal that only some runs have, in the order of the header."""
    random = np.random.default_rng(1)
    names = ("slip_r", "slip_l")
    sizes: dict[str, int] = {"deviation": 6, "observed": 5, "unexpected": 2, "slip": 2, "slip_true": 2}
    signals: dict[str, Any] = {name: random.normal(size=(len(TIME), size)) for name, size in sizes.items()}
    one = run(surprise=random.normal(size=len(TIME)), slip_names=names, **signals)
    monkeypatch.setattr(files_module, "SAMPLES", part)
    (file, _) = write_results({"a": one}, tmp_path)
    header, *rows = file.read_text().splitlines()
    assert header.split(",") == columns(one)
    table = dict(zip(columns(one), np.array([row.split(",") for row in rows], dtype=float).T, strict=True))
    assert len(rows) == len(TIME)
    groups = {
        "deviation": ("deviation_", MODEL.base_parameter_units), "observed": ("observed_", MODEL.state_units),
        "unexpected": ("unexpected_", {name: f"{unit}/s^2" for name, unit in MODEL.output_units.items()}),
        "slip": ("slip_", one.slip_units), "slip_true": ("slip_true_", one.slip_units),
    }  # fmt: skip
    for signal, (before, units) in groups.items():
        found = np.column_stack([table[f"{before}{name} [{unit}]"] for name, unit in units.items()])
        np.testing.assert_array_equal(found, signals[signal])
    np.testing.assert_array_equal(table["surprise [m or rad]"], one.surprise)
    assert len(table) == 1 + 5 + 2 + 2 + 2 + 2 + 6 + sum(sizes.values()) + 1


def test_a_figure_has_pixels_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    """Without a window; nothing in its files tells when or by what they were drawn."""
    files = []
    for name in ("one", "other"):
        figure = plots.new_figure(2.0, 1.0)
        plots.draw_inputs(figure.subplots(), run())
        figure.canvas.draw()
        assert np.ptp(np.asarray(figure.canvas.buffer_rgba())) > 0  # type: ignore[attr-defined]
        files.append(plots.save(figure, tmp_path / name))
    for one, other in zip(*files, strict=True):
        assert one.read_bytes() == other.read_bytes()
    svg = files[0][1].read_text()
    assert "<dc:date>" not in svg
    assert "<text" in svg  # letters, not outlines
    assert b"Software" not in files[0][0].read_bytes()


def test_settings_of_plots_end_with_the_drawing() -> None:
    """What a user has set is as it was."""
    before = dict(plots.mpl.rcParams)
    with plots.styled():
        assert plots.mpl.rcParams["axes.grid"] is True
        assert (plots.mpl.rcParams["axes.spines.top"], plots.mpl.rcParams["legend.frameon"]) == (False, False)
    assert dict(plots.mpl.rcParams) == before
