"""The blocks of a campaign, run by this process or by the workers of a Dask cluster. The numbers are the same."""

from __future__ import annotations

import asyncio
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

from numpy.typing import NDArray

from wmr_afl.errors import BackendWarning, WmrError
from wmr_afl.experiments.campaigns.job import Job, run_block

ANSWER = 10.0  # [s] to wait for a scheduler; enough for a slow network
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
        WmrError: if no scheduler answers, the connection is lost, or a worker fails.
    """
    try:
        import distributed
    except ImportError:
        raise WmrError("a scheduler needs Dask, which is not installed", 'pip install "wmr-afl[cluster]"') from None
    gone = (OSError, TimeoutError, asyncio.TimeoutError)
    try:
        client = distributed.Client(scheduler, timeout=ANSWER, set_as_default=False)
    except (*gone, ValueError) as error:
        raise WmrError(f"no scheduler answers at {scheduler} ({_first_line(error)})", "start one there") from None
    with client:
        if not client.nthreads():
            warnings.warn(f"the scheduler at {scheduler} has no workers yet; waiting", BackendWarning, stacklevel=2)
        futures = {client.submit(run_block, job, block, count, threads, pure=False): block for block, count in wanted}
        try:
            for future in distributed.as_completed(list(futures), loop=client.loop):
                if future.status == "error":
                    raise _at_a_worker(future.exception(), futures[future])
                yield futures[future], future.result()
                future.release()
        except (*gone, distributed.client.CancelledError, distributed.client.FutureCancelledError) as error:
            cause = _first_line(error)
            raise WmrError(f"the scheduler at {scheduler} was lost ({cause})", "finished blocks are kept") from None
        finally:
            client.cancel(list(futures), force=True)


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
