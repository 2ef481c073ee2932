"""What is no scheduler, has no workers or other code ends in one line, in a time that is known, without a traceback."""

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.cluster import Cluster
from tests.conftest import ROOT
from wmr_afl import BackendWarning, WmrError
from wmr_afl.experiments.campaigns import workers
from wmr_afl.experiments.campaigns.job import loop_of, prepare

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")  # of the library's own, on its threads and sockets

ANSWERS: dict[str, Callable[[socket.socket], object]] = {
    "nothing": lambda connection: None,
    "a web page": lambda connection: connection.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n"),
    "junk": lambda connection: connection.sendall(bytes(range(256)) * 40),
    "a frame": lambda connection: connection.sendall(b"\1" + bytes(7) + b"\5" + bytes(7) + b"hello"),
    "a closed door": lambda connection: connection.close(),
}


@pytest.fixture(params=ANSWERS)
def stranger(request: pytest.FixtureRequest) -> Iterator[str]:
    """The address of something that accepts connections and is no scheduler."""
    listening, connections = socket.create_server(("127.0.0.1", 0)), []

    def serve() -> None:
        while True:
            try:
                connections.append(listening.accept()[0])
                ANSWERS[request.param](connections[-1])
            except OSError:
                return

    threading.Thread(target=serve, daemon=True).start()
    yield f"tcp://127.0.0.1:{listening.getsockname()[1]}"
    for one in (listening, *connections):
        one.close()


SCRIPT = """
import sys
from wmr_afl.experiments.campaigns import workers
workers.ANSWER = 2.0
sys.argv = ["wmr-afl", "campaign", "study_1", "--runs", "10", "--scheduler", sys.argv[1]]
from wmr_afl.cli import app
app()
"""


def test_a_stranger_is_told_from_a_scheduler_in_one_line(stranger: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, stranger], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: no scheduler answers at {stranger} (")
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    yield made
    made.stop()


def test_a_scheduler_without_workers_is_waited_for_and_then_reported(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "HELP", 1.0)
    job = prepare("study_1")
    with pytest.warns(BackendWarning, match="has no workers yet; waiting"), pytest.raises(WmrError) as caught:
        list(workers.on_cluster(job, [(0, 10)], 1, cluster.address))
    assert str(caught.value) == f"the scheduler at {cluster.address} has had no worker for 1 s; start workers"
    monkeypatch.setattr(workers, "HELP", 60.0)
    threading.Timer(1.0, cluster.add_worker).start()
    assert [block for block, _ in workers.on_cluster(job, [(0, 10)], 1, cluster.address)] == [0]


def test_workers_that_are_all_gone_are_reported(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "LOOK", 0.5)
    cluster.add_worker()
    finished = workers.on_cluster(prepare("study_1"), [(block, 1024) for block in range(300)], 1, cluster.address)
    next(finished)
    monkeypatch.setattr(workers, "HELP", 2.0)
    cluster.workers[0].kill()
    with pytest.raises(WmrError, match="has had no worker for 2 s; start workers"):
        list(finished)


@pytest.mark.parametrize(
    ("what", "there", "words"),
    [
        ("numpy", "1.26.0", "it has numpy .* instead of 1.26.0"),
        ("casadi", "3.6.0", "it has casadi .* instead of 3.6.0"),
        ("compiler", "gcc 4.8", "it has compiler .* instead of gcc 4.8"),
        ("code of wmr_afl", "0" * 64, "it has another code of wmr_afl"),
        ("model", "0" * 64, "it has another model"),
    ],
)
def test_a_process_that_would_compute_other_numbers_refuses_and_says_why(what: str, there: str, words: str) -> None:
    """As a worker does it."""
    job = prepare("study_1", backend="compiled")
    other = replace(job, identity={**job.identity, what: there}, fingerprint=f"of {what}")
    with pytest.raises(WmrError, match=f"this process would compute other numbers: {words}") as caught:
        loop_of(other)
    assert str(caught.value).endswith("; install the same everywhere")
