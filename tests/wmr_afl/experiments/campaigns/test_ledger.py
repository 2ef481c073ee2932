"""A campaign's folder belongs to one campaign and one process; what the numbers depend on is in its fingerprint."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROOT
from tests.wmr_afl.experiments.campaigns.test_campaigns import STUDY_1, same, start, wait_for_blocks
from wmr_afl import WmrError
from wmr_afl.experiments.campaigns import identity, job
from wmr_afl.experiments.campaigns.ledger import Ledger, locked
from wmr_afl.experiments.distributions import BLOCK


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """Study 1's campaign with runs of 2 s, on a model in a folder of its own."""
    shutil.copytree(ROOT / "generated" / "type_2_0", tmp_path / "models" / "type_2_0")
    file = tmp_path / "short.toml"
    text = STUDY_1.replace("duration = 140.0", "duration = 2.0").replace("since = 100.0", "since = 1.0")
    file.write_text(text.replace('robot = "type_2_0"', 'robot = "models/type_2_0"'))
    return file


def test_the_second_process_in_a_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    folder = tmp_path / "results" / "study_1" / "campaign_AFL"
    first = start("study_1", "--runs", 200 * BLOCK, cwd=tmp_path)
    try:
        wait_for_blocks(folder, 1, first)
        for more in ([], ["--fresh"]):
            _, errors = start("study_1", "--runs", 10, *more, cwd=tmp_path).communicate(timeout=60)
            assert errors.startswith("error: ")
            assert "another process runs a campaign in this folder; wait until it ends, or name another --out" in errors
            assert len(errors.splitlines()) == 1
        assert (folder / "block_000000.npz").exists()
    finally:
        first.send_signal(signal.SIGKILL)
        first.communicate(timeout=60)
    _, errors = start("study_1", "--runs", 10, cwd=tmp_path).communicate(timeout=60)
    assert errors == ""  # the lock of a process that is dead counts for nothing


def test_a_thread_of_this_process_is_refused_too(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(WmrError, match="another process"), locked(tmp_path):
        pytest.fail("two at once")
    with locked(tmp_path):
        pass


@pytest.mark.parametrize("what", ["wmr_afl", "code of wmr_afl", "numpy", "casadi", "compiler", "model"])
def test_a_folder_of_other_code_is_refused_and_says_what_differs(
    short: Path, tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = job.identity_of
    there = "0" * 64 if what in ("code of wmr_afl", "model") else "0.0"
    with monkeypatch.context() as patch:
        patch.setattr(job, "identity_of", lambda *given: {**before(*given), what: there})
        wmr_afl.campaign(short, 10, tmp_path / "out", backend="compiled")
    with pytest.raises(WmrError, match=rf"have changed since \(here is .*{what}") as caught:
        wmr_afl.campaign(short, 10, tmp_path / "out", backend="compiled")
    assert "\n" not in str(caught.value)
    same(wmr_afl.campaign(short, 10, tmp_path / "out", backend="compiled", fresh=True), wmr_afl.campaign(short, 10))


def test_a_model_derived_again_is_another_campaign(short: Path, tmp_path: Path) -> None:
    wmr_afl.campaign(short, 10, tmp_path / "out")
    file = tmp_path / "models" / "type_2_0" / "model.json"
    content = json.loads(file.read_text())
    content["about"]["r"] = "radius"
    file.write_text(json.dumps(content))
    with pytest.raises(WmrError, match=r"here is another model"):
        wmr_afl.campaign(short, 10, tmp_path / "out")


def test_the_digest_covers_what_numbers_depend_on(tmp_path: Path) -> None:
    """A changed line of the runtime changes it, one of the command line does not."""
    for name in ("wmr_afl", "wmr_input", "generated"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    script = "from wmr_afl.experiments.campaigns.identity import code_digest; print(code_digest())"

    def digest() -> str:
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return done.stdout.strip()

    found = [identity.code_digest(), digest()]
    assert found[0] == found[1]
    for place, is_covered in (
        ("wmr_afl/cli/show.py", False),
        ("wmr_afl/plant/friction.py", True),
        ("wmr_afl/simulation/kernels/arithmetic.h", True),
        ("wmr_afl/simulation/kernels/kernel.c.jinja", True),
        ("wmr_input/expression.py", True),
    ):
        with open(tmp_path / place, "a") as file:
            file.write("\n")
        found.append(digest())
        assert (found[-1] != found[-2]) == is_covered, place


def test_beginning_anew_leaves_no_summary_of_what_was_there(short: Path, tmp_path: Path) -> None:
    start(short, "--runs", 10, cwd=tmp_path).communicate(timeout=60)
    folder = tmp_path / "results" / "short" / "campaign_AFL"
    (folder / "notes.txt").write_text("mine")
    assert (folder / "summary.json").exists()

    def interrupt(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        wmr_afl.campaign(short, 10, folder, fresh=True, progress=interrupt)
    assert {path.name for path in folder.iterdir()} - {".lock"} == {"block_000000.npz", "campaign.json", "notes.txt"}


@pytest.mark.parametrize(
    "note", ["", "{", "[]", "3", '{"fingerprint": 3}', '{"identity": {}}', '{"fingerprint": "x", "identity": [1]}',
             "[" * 100_000, '{"fingerprint": "x", "identity": {"numpy": {}}}'],
)  # fmt: skip
def test_a_note_of_any_kind_ends_in_one_line(tmp_path: Path, note: str) -> None:
    (tmp_path / "campaign.json").write_text(note)
    with pytest.raises(WmrError, match=r"is damaged; remove|holds another campaign") as caught:
        Ledger(tmp_path, "a fingerprint", {"numpy": "2.0"})
    assert "\n" not in str(caught.value)


def test_a_block_is_never_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("precious")
    ledger = Ledger(tmp_path / "out", "a fingerprint")
    (tmp_path / "out" / "block_000000.npz").symlink_to(tmp_path / "precious")
    ledger.write(0, {"rms": np.zeros((1, 2))})
    assert (tmp_path / "precious").read_text() == "precious"
    assert ledger.read(0, 1)["rms"].shape == (1, 2)
