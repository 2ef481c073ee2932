"""Campaigns on a Dask cluster of real processes: the same numbers, also if workers die."""

import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from benchmarks.cluster import Cluster
from tests.conftest import ROOT
from tests.wmr_afl.experiments.campaigns.test_campaigns import STUDY_1, same
from wmr_afl import WmrError
from wmr_afl.experiments.campaigns import workers
from wmr_afl.experiments.campaigns.job import prepare
from wmr_afl.experiments.distributions import BLOCK

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # of the library's own, on its threads and sockets


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path, workers=2)
    yield made
    made.stop()


def test_a_cluster_gives_the_same_numbers_also_if_a_worker_dies(cluster: Cluster, tmp_path: Path) -> None:
    runs, done = 60 * BLOCK, []

    def kill_one(count: int) -> None:
        done.append(count)
        if len(done) == 5:
            cluster.workers[0].send_signal(signal.SIGKILL)

    result = wmr_afl.campaign("study_1", runs, tmp_path / "out", scheduler=cluster.address, progress=kill_one)
    assert cluster.workers[0].wait(10) == -signal.SIGKILL
    assert len(done) == 60  # every block once
    same(result, wmr_afl.campaign("study_1", runs))
    same(wmr_afl.campaign("study_1", runs, tmp_path / "out"), result)  # all of it is kept


def test_a_robot_of_a_users_own_travels_to_the_workers(cluster: Cluster, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    for file in (ROOT / "generated" / "type_2_0").glob("*model.*"):
        (tmp_path / "mine" / file.name).write_text(file.read_text())
    text = STUDY_1.replace('robot = "type_2_0"', 'robot = "mine"').replace("duration = 140.0", "duration = 101.0")
    (tmp_path / "own.toml").write_text(text)
    there = wmr_afl.campaign(tmp_path / "own.toml", 1500, scheduler=cluster.address)
    same(there, wmr_afl.campaign(tmp_path / "own.toml", 1500))


def test_what_fails_at_a_worker_is_reported_in_one_line(cluster: Cluster, tmp_path: Path) -> None:
    """A model that the workers read differently, and a job that no worker can do."""
    job = prepare("study_1")
    for broken, words in (
        (replace(job, fingerprint="of another version"), "another version of the model or of wmr_afl"),
        (replace(job, experiment=None), r"a worker failed on block 3 \(AttributeError"),
    ):
        with pytest.raises(WmrError, match=words) as caught:
            list(workers.on_cluster(broken, [(3, 10)], 1, cluster.address))
        assert "\n" not in str(caught.value)


def test_a_scheduler_that_is_lost_is_reported_and_finished_blocks_are_kept(cluster: Cluster, tmp_path: Path) -> None:
    done = []

    def kill_scheduler(count: int) -> None:
        done.append(count)
        if len(done) == 3:
            cluster.scheduler.kill()

    with pytest.raises(WmrError, match=r"was lost .*; finished blocks are kept") as caught:
        wmr_afl.campaign("study_1", 200 * BLOCK, tmp_path / "out", scheduler=cluster.address, progress=kill_scheduler)
    assert "\n" not in str(caught.value)
    assert len(list((tmp_path / "out").glob("block_*.npz"))) >= 3
    whole = wmr_afl.campaign("study_1", 5 * BLOCK, tmp_path / "out")
    np.testing.assert_array_equal(whole.runs.rms, wmr_afl.campaign("study_1", 5 * BLOCK).runs.rms)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "tcp://", "http://127.0.0.1:80"])
def test_an_unreachable_scheduler_is_reported_in_one_line(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "ANSWER", 2.0)
    with pytest.raises(WmrError, match=f"no scheduler answers at {address}") as caught:
        wmr_afl.campaign("study_1", 10, scheduler=address)
    assert "\n" not in str(caught.value)
