"""Independent steps of one analysis, done by other processes of this machine or by a cluster's workers.

A step is a function of what it is given and writes nothing, so it may be done twice. The results come in the order
of the steps, the bytes that this process would have made. What its worker could not do is done here.
"""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from tactilevision.cluster.pool import cluster_pool
from tactilevision.runs import copies_are_safe, worker_pool

Given = TypeVar("Given")
Made = TypeVar("Made")
MAX_COUNT = 8  # processes where none are asked for: a diagnosis seldom has more steps at a time
Sent = tuple[bool, object]  # whether it went well; what came of it, or what it raised
_log = logging.getLogger(__name__)


class Steps:
    """Many independent steps `act(one)`: each is fetched by a call, which raises what the step raised."""

    def __init__(self, pool: Executor | None = None) -> None:
        self._pool = pool

    def __call__(self, act: Callable[[Given], Made], given: Sequence[Given]) -> Iterator[Callable[[], Made]]:
        """In the order of `given`. What does not travel, as an effect of the user's own file, is done here."""
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
        except Exception as fault:  # of the worker or on the way, not of the step: it has no say in the result
            self._give_up(fault)
            return act(one)
        if not well:
            assert isinstance(came, Exception)
            raise came
        return came  # type: ignore[return-value]

    def _give_up(self, fault: Exception) -> None:
        if self._pool is not None:
            _log.warning("workers are lost (%s): the rest is done by this process", fault or type(fault).__name__)
        self._pool = None


def _done_there(act: bytes, one: bytes) -> Sent:
    do, given = pickle.loads(act), pickle.loads(one)  # noqa: S301 -- what this run has sent
    try:
        return True, do(given)
    except Exception as fault:
        return False, fault


@contextmanager
def step_pool(workers: int | None, cluster: str | None = None) -> Iterator[Steps]:
    """Steps on so many processes, or on the Dask cluster at this address.

    None: one process a core, MAX_COUNT at most, where they can be copies of this one, else this one alone.
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
