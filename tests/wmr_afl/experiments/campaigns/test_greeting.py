"""Who answers at the address of a scheduler, and what is said of anyone else; with a library that is made up."""

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from wmr_afl import BackendWarning, WmrError
from wmr_afl.experiments.campaigns import workers

PLACE = "tcp://there:1"
SCHEDULER = {"type": "Scheduler", "workers": {}}


def library(answer: Callable[[], Any]) -> SimpleNamespace:
    """What `workers` uses of the library of clusters, where `answer` gives what comes back."""
    made = SimpleNamespace(clients=[], asked=[], closed=[])

    async def write(message: dict[str, Any]) -> None:
        made.asked.append(message)

    async def read() -> Any:
        return answer()

    async def connect(place: str, **named: Any) -> SimpleNamespace:
        assert place == PLACE
        return SimpleNamespace(write=write, read=read, abort=lambda: made.closed.append(place))

    made.Security = lambda: SimpleNamespace(get_connection_args=lambda who: {"who": who})
    made.comm = SimpleNamespace(connect=connect)
    made.Client = lambda place, **named: made.clients.append((place, named["set_as_default"])) or "client"
    return made


def test_a_scheduler_is_asked_who_it_is_and_becomes_nobodys_default() -> None:
    """Before a client is made; the connection that asked is closed."""
    there = library(lambda: SCHEDULER)
    assert workers._client(there, PLACE) == "client"
    assert there.clients == [(PLACE, False)]
    assert there.asked == [{"op": "identity", "reply": True}]
    assert there.closed == [PLACE]


@pytest.mark.parametrize("answer", [None, b"Scheduler", "Scheduler", ["type", "Scheduler"], {}, {"type": "Worker"}])
def test_whoever_says_something_else_is_no_scheduler(answer: Any) -> None:
    there = library(lambda: answer)
    with pytest.raises(WmrError, match=rf"no scheduler answers at {PLACE} \(it is no scheduler\); start one there"):
        workers._client(there, PLACE)
    assert there.clients == []
    assert there.closed == [PLACE]


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (ConnectionRefusedError("refused\nby nobody"), "refused"),
        (TimeoutError("late"), "late"),
        (TimeoutError(), "silent for 0.1 s"),
        (KeyError(), "KeyError"),
    ],
)
def test_why_nobody_answers_is_said_in_one_line(error: Exception, why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first line of what was raised, or its name if it says nothing."""
    monkeypatch.setattr(workers, "ANSWER", 0.1)

    def fails() -> None:
        raise error

    with pytest.raises(WmrError) as caught:
        workers._client(library(fails), PLACE)
    assert str(caught.value) == f"no scheduler answers at {PLACE} ({why}); start one there"


def test_who_never_answers_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if what waits for the answer cannot be stopped."""
    monkeypatch.setattr(workers, "ANSWER", 0.1)
    over = threading.Event()
    try:
        with pytest.raises(WmrError, match=rf"no scheduler answers at {PLACE} \(silent for 0.1 s\)"):
            workers._client(library(lambda: over.wait(20.0)), PLACE)
    finally:
        over.set()


def test_workers_are_waited_for_only_where_there_are_none() -> None:
    """With one line that says so."""
    waited: list[tuple[int, float]] = []

    def client(threads: dict[str, int], *, comes: bool = True) -> SimpleNamespace:
        def wait(count: int, timeout: float) -> None:
            waited.append((count, timeout))
            if not comes:
                raise TimeoutError

        return SimpleNamespace(nthreads=lambda: threads, wait_for_workers=wait)

    workers._wait_for_a_worker(client({"one": 2}), PLACE)
    assert waited == []
    with pytest.warns(BackendWarning, match=f"the scheduler at {PLACE} has no workers yet; waiting"):
        workers._wait_for_a_worker(client({}), PLACE)
    with pytest.warns(BackendWarning), pytest.raises(WmrError, match=r"has had no worker for .* s; start workers"):
        workers._wait_for_a_worker(client({}, comes=False), PLACE)
    assert waited == [(1, workers.HELP)] * 2


class Block:
    """A block under way; `result` is what its worker gives, if one ever does."""

    def __init__(self, result: Any = None) -> None:
        self.status, self.value = "pending" if result is None else "finished", result
        self.is_kept = True

    def add_done_callback(self, done: Callable[[Any], None]) -> None:
        if self.value is not None:
            done(self)

    def result(self) -> Any:
        return self.value

    def release(self) -> None:
        self.is_kept = False


def test_blocks_are_waited_for_as_long_as_there_are_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is finished is given; once all workers are gone for a while, it is told."""
    monkeypatch.setattr(workers, "LOOK", 0.01)
    monkeypatch.setattr(workers, "HELP", 0.03)
    threads = iter([{"one": 2}] * 20 + [{}] * 1000)
    seen = []

    def nthreads() -> dict[str, int]:
        seen.append(next(threads))
        return seen[-1]

    blocks = {(done := Block("columns")): 7, (left := Block()): 8}
    finished = workers._as_finished(SimpleNamespace(nthreads=nthreads), blocks, PLACE)
    assert next(finished) == (7, "columns")
    assert seen == []
    with pytest.raises(WmrError, match=rf"the scheduler at {PLACE} has had no worker for 0.03 s; start workers"):
        next(finished)
    assert len(seen) > 20
    assert (done.is_kept, left.is_kept) == (False, True)  # what was given is not held any longer
