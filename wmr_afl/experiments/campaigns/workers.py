"""The blocks of a campaign, run by this process or by the workers of a Dask cluster. The numbers are the same."""

from __future__ import annotations

import asyncio
import logging
import queue
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from numpy.typing import NDArray

from wmr_afl.errors import BackendWarning, WmrError
from wmr_afl.experiments.campaigns.job import Job, run_block

ANSWER = 10.0  # [s] to wait for a scheduler; enough for a slow network
HELP = 300.0  # [s] to wait for the first worker, or for another one if all are gone; enough for a machine to start
LOOK = 2.0  # [s] between looks at the workers while no block is finished
_TALKATIVE = ("asyncio", "distributed", "tornado")  # loggers that print tracebacks of what is reported here
Columns = dict[str, NDArray[Any]]  # by name, one row a run
Finished = Iterator[tuple[int, Columns]]  # number of a block, its results
Wanted = Sequence[tuple[int, int]]  # number of a block, how many of its runs


def here(job: Job, wanted: Wanted, threads: int) -> Finished:
    """One block after the other, in this process."""
    for block, count in wanted:
        yield block, run_block(job, block, count, threads)


def on_cluster(job: Job, wanted: Wanted, threads: int, scheduler: str) -> Finished:
    """Blocks in the order in which workers finish them; if a worker dies, another one begins its block again.

    Raises:
        WmrError: if no scheduler answers, it has no workers, the connection is lost, or a worker fails.
    """
    try:
        import distributed
    except ImportError:
        raise WmrError("a scheduler needs Dask, which is not installed", 'pip install "wmr-afl[cluster]"') from None
    gone = (
        OSError, TimeoutError, distributed.client.CancelledError, distributed.client.FutureCancelledError
    )  # fmt: skip
    with _quiet():
        client = _client(distributed, scheduler)
        futures: dict[Any, int] = {}
        try:
            _wait_for_a_worker(client, scheduler)
            for block, count in wanted:
                futures[client.submit(run_block, job, block, count, threads, pure=False)] = block
            yield from _as_finished(client, futures, scheduler)
        except gone as error:
            cause = _first_line(error)
            raise WmrError(f"the scheduler at {scheduler} was lost ({cause})", "finished blocks are kept") from None
        finally:
            with suppress(Exception):  # it may be gone
                client.cancel(list(futures), force=True)
            with suppress(Exception):
                client.close(timeout=ANSWER)


def _client(distributed: Any, scheduler: str) -> Any:
    """A connection to the scheduler; what is no scheduler may answer anything, or nothing."""
    answer: queue.SimpleQueue[BaseException | None] = queue.SimpleQueue()

    def ask() -> None:
        try:
            asyncio.run(asyncio.wait_for(_greet(distributed, scheduler), ANSWER))
            answer.put(None)
        except Exception as error:
            answer.put(error)

    threading.Thread(target=ask, daemon=True).start()  # a thread, because the caller may have an event loop
    try:
        error = answer.get(timeout=ANSWER + 1.0)
        if error is None:
            return distributed.Client(scheduler, timeout=ANSWER, set_as_default=False)
    except Exception as cause:
        error = TimeoutError() if isinstance(cause, queue.Empty) else cause
    silent = isinstance(error, TimeoutError) and not str(error)
    why = f"silent for {ANSWER:g} s" if silent else _first_line(error)
    raise WmrError(f"no scheduler answers at {scheduler} ({why})", "start one there")


async def _greet(distributed: Any, scheduler: str) -> None:
    """Ask what is there, before a client is made, which would wait for an answer whatever its time limit."""
    arguments = distributed.Security().get_connection_args("client")
    comm = await distributed.comm.connect(scheduler, timeout=ANSWER, **arguments)
    try:
        await comm.write({"op": "identity", "reply": True})
        found = await comm.read()
        if not isinstance(found, dict) or found.get("type") != "Scheduler":
            raise ValueError("it is no scheduler")
    finally:
        comm.abort()


def _wait_for_a_worker(client: Any, scheduler: str) -> None:
    if client.nthreads():
        return
    warnings.warn(f"the scheduler at {scheduler} has no workers yet; waiting", BackendWarning, stacklevel=4)
    try:
        client.wait_for_workers(1, timeout=HELP)
    except TimeoutError:
        raise _no_worker(scheduler) from None


def _as_finished(client: Any, futures: Mapping[Any, int], scheduler: str) -> Finished:
    """Numbers and results of blocks as they are finished."""
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    for future in futures:
        future.add_done_callback(finished.put)
    left, helped = len(futures), time.monotonic()
    while left:
        try:
            future = finished.get(timeout=LOOK)
        except queue.Empty:
            if client.nthreads():
                helped = time.monotonic()
            elif time.monotonic() - helped > HELP:
                raise _no_worker(scheduler) from None
            continue
        left, helped = left - 1, time.monotonic()
        if future.status == "error":
            raise _at_a_worker(future.exception(), futures[future])
        yield futures[future], future.result()
        future.release()


def _no_worker(scheduler: str) -> WmrError:
    return WmrError(f"the scheduler at {scheduler} has had no worker for {HELP:g} s", "start workers")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from printing what is reported in one line anyway."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in _TALKATIVE]
    loggers = [logging.getLogger(name) for name in (*_TALKATIVE, *names)]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _at_a_worker(error: BaseException, block: int) -> WmrError:
    """An error that was raised at a worker, as one line with its remedy."""
    if isinstance(error, WmrError):
        return error
    if isinstance(error, ModuleNotFoundError):
        return WmrError(f"a worker has no {error.name}", "install wmr-afl there as it is here")
    if type(error).__name__ == "KilledWorker":
        return WmrError(f"workers died on block {block} again and again", "look at their memory and logs")
    return WmrError(
        f"a worker failed on block {block} ({type(error).__name__}: {_first_line(error)})", "look at its log"
    )


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
