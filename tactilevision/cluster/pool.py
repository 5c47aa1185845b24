"""Run tasks and the steps of one analysis on a Dask cluster or on local processes."""

from __future__ import annotations

import logging
import os
import pickle
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from tactilevision.cluster.connect import WHERE, open_client, versions
from tactilevision.errors import ClusterError, TactilevisionError
from tactilevision.files.runs import copies_are_safe, worker_pool

# An executor on a Dask cluster that survives the loss of workers and of the scheduler. A lost task is submitted
# again once the scheduler is back. A task writes its result whole under its own name, so it may run twice.

RETRIES = 2  # of a task that fails for a temporary fault, as of a disk
BACK_S = 600  # s that a scheduler may be away before the run gives up
SWEEP_S = 1.0  # s between two checks for lost tasks
PAUSE_S = 0.5  # s between two tries to reach a scheduler
UNPREPARED = 20  # tries of a task on workers that have not received the run's data

_log = logging.getLogger(__name__)


class EndsWorkers(TactilevisionError):
    """A task whose worker ended each time it was tried, or that shared its worker with such a task."""


@dataclass(eq=False)
class _Ticket:
    fn: Callable[..., Any]
    args: tuple[Any, ...]
    future: Future[Any] = field(default_factory=Future)
    remote: Any = None
    unprepared: int = 0


class ClusterPool(Executor):
    """Executor on a Dask cluster of `width` workers."""

    def __init__(self, where: str, start: Callable[..., None] | None = None, given: tuple[Any, ...] = ()) -> None:
        self._where, self._start, self._given = where, start, given
        self._run, self._versions = f"tactilevision-{uuid.uuid4().hex}", versions()
        self._ended: queue.SimpleQueue[_Ticket | None] = queue.SimpleQueue()
        self._tickets: set[_Ticket] = set()
        self._lock = threading.RLock()
        self._closed = False
        self._client = open_client(where)
        self._tell()
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()

    @property
    def width(self) -> int:
        """Number of present workers, one at least."""
        with suppress(Exception):  # the scheduler is away
            return max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))
        return 1

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit a task; it takes no keywords."""
        if kwargs:
            raise TypeError("tasks for a cluster take no keywords")
        ticket = _Ticket(fn, args)
        with self._lock:
            self._tickets.add(ticket)
            self._hand_over(ticket)
        return ticket.future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnect from the cluster, which keeps running, and cancel the remaining tasks."""
        if self._closed:
            return
        self._closed = True
        self._ended.put(None)
        self._watcher.join()
        for ticket in self._tickets:
            ticket.future.cancel()
        with suppress(Exception):  # the scheduler is away
            self._client.cancel([ticket.remote for ticket in self._tickets])
            self._client.unregister_worker_plugin(self._run)
        with suppress(Exception):  # likewise
            self._client.close()

    def _tell(self) -> None:
        from tactilevision.cluster.worker import Begin

        self._client.register_plugin(Begin(self._run, self._start, self._given), name=self._run)

    def _hand_over(self, ticket: _Ticket) -> None:
        from tactilevision.cluster.worker import do

        key = f"{getattr(ticket.fn, '__name__', 'task').strip('_')}-{uuid.uuid4().hex}"
        given = (self._run, self._versions, ticket.fn, ticket.args)
        try:
            ticket.remote = self._client.submit(do, *given, key=key, pure=False, retries=RETRIES)
            ticket.remote.add_done_callback(lambda _: self._ended.put(ticket))
        except Exception:  # the scheduler is away: the sweep finds it
            ticket.remote = None

    def _watch(self) -> None:
        swept = time.monotonic()
        while not self._closed:
            with suppress(queue.Empty):
                ticket = self._ended.get(timeout=SWEEP_S)
                if ticket is not None and ticket in self._tickets:
                    self._settle(ticket)
            if time.monotonic() - swept > SWEEP_S:
                swept = time.monotonic()
                with self._lock:
                    if any(_is_lost(ticket) for ticket in self._tickets):
                        self._bring_back()

    def _settle(self, ticket: _Ticket) -> None:
        """Deliver the outcome of a task; a lost one waits for the sweep."""
        if _is_lost(ticket) or not ticket.remote.done():
            return
        try:
            outcome, fault = ticket.remote.result(timeout=BACK_S), None
        except Exception as raised:
            outcome, fault = None, raised
        if fault is not None:
            if _is_lost(ticket) or self._client.status != "running":
                return
            fault = self._meant(ticket, fault)
            if fault is None:
                return
        with self._lock:
            self._tickets.discard(ticket)
        ticket.remote = None
        if ticket.future.set_running_or_notify_cancel():
            ticket.future.set_result(outcome) if fault is None else ticket.future.set_exception(fault)

    def _meant(self, ticket: _Ticket, fault: Exception) -> Exception | None:
        """Return the error in our words; None if the task was submitted again."""
        from distributed import KilledWorker

        from tactilevision.cluster.worker import NotBegun

        if isinstance(fault, KilledWorker):
            return EndsWorkers(f"a task ended the workers that tried it: {fault.task}")
        if isinstance(fault, NotBegun) and ticket.unprepared < UNPREPARED:
            ticket.unprepared += 1
            with self._lock:
                self._tell()
                self._hand_over(ticket)
            return None
        return fault

    def _bring_back(self) -> None:
        """Reconnect to the scheduler, and submit lost tasks again."""
        until = time.monotonic() + BACK_S
        if self._client.status != "running":
            _log.warning("the scheduler is away: waiting %.0f s for it; workers may have ended with it", BACK_S)
        while not self._closed:
            try:
                if self._client.status != "running":
                    with suppress(Exception):  # it is gone already
                        self._client.close(timeout=PAUSE_S)
                    self._client = open_client(self._where)
                self._tell()
                break
            except Exception as fault:
                if time.monotonic() > until:
                    self._give_up(fault)
                    return
                time.sleep(PAUSE_S)
        for ticket in self._tickets:
            if _is_lost(ticket) and not self._closed:
                self._hand_over(ticket)

    def _give_up(self, fault: Exception) -> None:
        gone = ClusterError(
            f"the cluster was lost and has not come back for {BACK_S:.0f} s",
            where=WHERE,
            value=str(fault),
            remedy="Finished results are kept: start the cluster, and run the same command again.",
        )
        for ticket in self._tickets:
            if ticket.future.set_running_or_notify_cancel():
                ticket.future.set_exception(gone)
        self._tickets.clear()


def _is_lost(ticket: _Ticket) -> bool:
    return ticket.remote is None or ticket.remote.status in ("cancelled", "lost")


@contextmanager
def cluster_pool(where: str, start: Callable[..., None] | None = None, *given: Any) -> Iterator[ClusterPool]:
    """Connect to the workers of the scheduler at `where`, an address or a scheduler's file.

    `start(*given)` is called once in each, also in those that join later. Raises ClusterError if nothing answers,
    there are no workers, or they have another version of this library.
    """
    pool = ClusterPool(where, start, given)
    theirs = logging.getLogger("distributed.client")
    theirs.addFilter(_is_no_farewell)
    try:
        yield pool
    finally:
        pool.shutdown()
        theirs.removeFilter(_is_no_farewell)


def _is_no_farewell(record: logging.LogRecord) -> bool:
    """Return whether Dask's client reports more than the loss of its scheduler, which `_bring_back` reports."""
    return record.exc_info is None


# Independent steps of one analysis on other processes or a cluster's workers. A step is a pure function, so it may
# run twice; results are those of this process, in the order of the steps. What a worker cannot do is done here.

Given = TypeVar("Given")
Made = TypeVar("Made")
MAX_COUNT = 8  # default number of processes: a diagnosis seldom has more steps at a time
Sent = tuple[bool, object]  # whether it succeeded; its result, or its exception


class Steps:
    """Independent steps `act(one)`, each fetched by a call, which raises what the step raised."""

    def __init__(self, pool: Executor | None = None) -> None:
        self._pool = pool

    def __call__(self, act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]:
        """Yield results in the order of `given`.

        What cannot be sent, as an effect of the user's own file, is computed here.
        """
        tasks = list[Future[Sent]]()
        if self._pool is not None and len(given) > 1:
            try:
                sent = pickle.dumps(act, pickle.HIGHEST_PROTOCOL)
                each = [pickle.dumps(one, pickle.HIGHEST_PROTOCOL) for one in given]
                tasks = [self._pool.submit(_done_there, sent, one) for one in each]
            except (pickle.PicklingError, AttributeError, TypeError):
                tasks = []
            except RuntimeError as fault:  # its workers have ended
                self._give_up(fault)
        if not tasks:
            yield from (partial(act, one) for one in given)
            return
        try:
            for task, one in zip(tasks, given, strict=True):
                yield partial(self._fetched, task, act, one)
        finally:
            for task in tasks:
                task.cancel()

    def _fetched(self, task: Future[Sent], act: Callable[[Given], Made], one: Given) -> Made:
        try:
            well, came = task.result()
        except Exception as fault:  # of the worker or the transport, not of the step
            self._give_up(fault)
            return act(one)
        if not well:
            assert isinstance(came, Exception)
            raise came
        return came  # type: ignore[return-value]

    def _give_up(self, fault: Exception) -> None:
        if self._pool is not None:
            _log.warning("workers are lost (%s): this process does the rest", fault or type(fault).__name__)
        self._pool = None


def _done_there(act: bytes, one: bytes) -> Sent:
    do, given = pickle.loads(act), pickle.loads(one)  # noqa: S301 -- sent by this run
    try:
        return True, do(given)
    except Exception as fault:
        return False, fault


@contextmanager
def step_pool(workers: int | None, cluster: str | None = None) -> Iterator[Steps]:
    """Run steps on so many processes, or on the Dask cluster at this address.

    None: one process a core, MAX_COUNT at most, if they can be forked, else this one alone.
    Raises ClusterError as `cluster_pool` does.
    """
    if cluster is not None:
        with cluster_pool(cluster) as remote:
            yield Steps(remote)
        return
    count = workers or (min(os.cpu_count() or 1, MAX_COUNT) if copies_are_safe() else 1)
    if count == 1:
        yield Steps()
        return
    with worker_pool(count) as local:
        yield Steps(local)
