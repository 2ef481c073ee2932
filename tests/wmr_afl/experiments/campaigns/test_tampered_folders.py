"""Whatever is changed in a campaign's folder or in a folder of results, the next command works or ends in one line."""

import os
import random
import shutil
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.fuzzing import SEED, budget, stream
from tests.wmr_afl.experiments.campaigns.test_campaigns import STUDY_1, same
from tests.wmr_afl.model.test_tampered_models import answer
from wmr_afl import CampaignResult
from wmr_afl.analysis.files import keep_only, write_results
from wmr_afl.experiments.distributions import BLOCK

ROUNDS = budget(20)


def damage(file: Path, chosen: random.Random) -> str:
    """Do something to a file that disks, people and other programs do."""
    kind = chosen.choice(["cut", "flip", "empty", "text", "folder", "link", "remove", "read-only", "long"])
    content = file.read_bytes() if file.is_file() else b""
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)
    if kind == "cut":
        file.write_bytes(content[: chosen.randrange(len(content) + 1)])
    elif kind == "flip":
        changed = bytearray(content or b"\0")
        for _ in range(chosen.randrange(1, 40)):
            changed[chosen.randrange(len(changed))] ^= 1 << chosen.randrange(8)
        file.write_bytes(bytes(changed))
    elif kind == "empty":
        file.write_bytes(b"")
    elif kind == "text":
        file.write_text(chosen.choice(["{", "[]", "null", "\0", "[" * 9999, '{"fingerprint": {}}', '{"sha256": [1]}']))
    elif kind == "folder":
        file.mkdir()
    elif kind == "link":
        file.symlink_to(chosen.choice(["nowhere", ".", "/dev/null", file.name]))
    elif kind == "read-only":
        file.write_bytes(content)
        file.chmod(0o400)
    elif kind == "long":
        file.write_bytes(content + os.urandom(chosen.randrange(2000)))
    return kind


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, CampaignResult]:
    """A short campaign of two blocks that is finished: its file, its folder, its result."""
    folder = tmp_path_factory.mktemp("campaign")
    text = STUDY_1.replace("duration = 140.0", "duration = 0.2").replace("since = 100.0", "since = 0.1")
    (folder / "short.toml").write_text(text)
    result = wmr_afl.campaign(folder / "short.toml", BLOCK + 10, folder / "whole")
    return folder / "short.toml", folder / "whole", result


def test_no_change_of_a_campaigns_folder_gives_a_traceback_or_other_numbers(
    campaign: tuple[Path, Path, CampaignResult], tmp_path: Path
) -> None:
    chosen, (experiment, whole, expected) = stream("campaigns"), campaign
    names = ["campaign.json", "block_000000.npz", "block_000001.npz"]
    found: list[CampaignResult] = []
    for number in range(ROUNDS):
        out = tmp_path / str(number)
        shutil.copytree(whole, out)
        changed = [(name, damage(out / name, chosen)) for name in chosen.sample(names, chosen.randrange(1, 3))]
        found.clear()
        said = answer(
            f"{SEED}:{number} {changed}",
            lambda out=out: found.append(wmr_afl.campaign(experiment, BLOCK + 10, out)),
        )
        if not said:
            same(found[0], expected)
    for name in names:
        assert (whole / name).exists()


def test_no_change_of_a_folder_of_results_gives_a_traceback(
    campaign: tuple[Path, Path, CampaignResult], tmp_path: Path
) -> None:
    chosen = stream("results")
    runs = wmr_afl.run(campaign[0], "numpy", "AFL")
    files: list[Path] = []
    for number in range(ROUNDS):
        out = tmp_path / str(number)
        keep_only(write_results(runs, out), out)
        (out / "mine.txt").write_text("mine")
        changed = [
            (name, damage(out / name, chosen))
            for name in chosen.sample(["AFL.csv", "metrics.json", "written.json"], chosen.randrange(1, 4))
        ]

        def again(out: Path = out) -> None:
            files[:] = write_results(runs, out)
            keep_only(files, out)

        said = answer(f"{SEED}:{number} {changed}", again)
        assert (out / "mine.txt").read_text() == "mine"
        if not said:
            table = np.loadtxt(files[0], delimiter=",", skiprows=1)
            np.testing.assert_array_equal(table[:, 1:6], runs["AFL"].state)
