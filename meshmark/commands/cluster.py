"""Answers for many sources on a Dask cluster: what travels is paths, small values and answers.

Neither meshes nor keys do: a worker reads the files of keys where it works. It lets a
process of its own do so, so that it can answer its scheduler meanwhile, and lives on whatever
happens there.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import re
import threading
import uuid
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

from meshmark.commands.batch import Task, answer_apart
from meshmark.commands.outcome import AnyRequest, Outcome, failed
from meshmark.errors import OutputError, UsageError, WorkerError

if TYPE_CHECKING:
    from distributed import Client, Future

ADDRESS = re.compile(r"((tcp|tls)://)?[^/@\s]+:\d{1,5}")
ADVICE = 'pip install "meshmark[dask]"'
TO_CONNECT = 10  # seconds
QUIET = ("distributed", "distributed.client", "distributed.core", "distributed.comm")
# Sources that the scheduler knows of at a time.
IN_FLIGHT = 1000


def answer_on_cluster(
    sources: Sequence[str], task: Task, address: str, warn: Callable[[str], None]
) -> Generator[Outcome[Any]]:
    """Answer for sources on the workers of a cluster, one at a time in each of their threads.

    What a worker was at when it died, the scheduler gives to another one.

    Parameters
    ----------
    address : str
        Of the scheduler, `tcp://HOST:PORT`.
    warn : callable
        Told if there is nobody to do the work yet.

    Yields
    ------
    Outcome
        As they finish, each source's once.

    Raises
    ------
    UsageError
        If Dask is not installed, or the address is none.
    OutputError
        If the scheduler does not answer, or not any more.
    WorkerError
        If a worker cannot do such work at all.
    """
    with _connected(address) as client:
        from distributed import as_completed

        if not client.scheduler_info()["workers"]:
            warn(f"{address}: there are no workers yet")
        run = uuid.uuid4().hex
        # Its value is made again where it is lost with a worker.
        sent = client.submit(bytes, task.packed(), key=f"asked-{run}")
        left = enumerate(sources)
        waiting: dict[Future, str] = {}

        def submitted(n: int) -> list[Future]:
            added = []
            for number, source in islice(left, n):
                key = f"answer-{run}-{number}"
                future = client.submit(answer_on_worker, sent, source, key=key, pure=False)
                waiting[future] = source
                added.append(future)
            return added

        futures = as_completed(submitted(IN_FLIGHT), loop=client.loop)
        for future in futures:
            yield _outcome(future, waiting.pop(future), task.request, address)
            futures.update(submitted(1))


def answer_on_worker(task: bytes, source: str) -> Outcome[Any]:
    """Answer for a source in a process that belongs to this thread of a worker.

    Parameters
    ----------
    task : bytes
        A `Task`, packed.
    """
    apart = getattr(_own, "apart", None)
    if apart is None or apart.function != task:
        if apart is not None:
            apart.close()
        known: Task = pickle.loads(task)
        apart = _own.apart = known.apart()
    return answer_apart(apart, source)


_own = threading.local()


def _outcome(future: Future, source: str, request: AnyRequest, address: str) -> Outcome[Any]:
    """Take what a worker answers."""
    from distributed import KilledWorker

    try:
        outcome: Outcome[Any] = future.result()
    except KilledWorker:
        died = WorkerError("every worker of the cluster that took it on has died")
        return failed(source, died, request)
    except Exception as error:
        if future.cancelled():
            raise OutputError("the scheduler is gone", source=address) from None
        told = f"{type(error).__name__}: {error}"
        raise WorkerError(f"a worker cannot do this: {told}", source=address) from None
    return outcome


@contextmanager
def _connected(address: str) -> Generator[Client]:
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise UsageError(f"--scheduler needs Dask, which is not installed: {ADVICE}") from None
    # What matters of it is said by us.
    for name in QUIET:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    if not ADDRESS.fullmatch(address):
        raise UsageError(f"--scheduler takes tcp://HOST:PORT or tls://HOST:PORT, not {address!r}")
    try:
        asyncio.run(_greeted(address))
        client = Client(address, timeout=TO_CONNECT, set_as_default=False)
    except Exception:
        # Whatever else may listen there can answer anything.
        raise OutputError("no scheduler answers there", source=address) from None
    with client:
        yield client


async def _greeted(address: str) -> None:
    """Try whether somebody answers in time: for an answer, a client waits for ever."""
    from distributed.comm import connect
    from distributed.security import Security

    secured = Security().get_connection_args("client")
    greeting = connect(address, timeout=TO_CONNECT, **secured)
    comm = await asyncio.wait_for(greeting, TO_CONNECT)
    await comm.close()
