"""Worker side of a run: receives the run's data once, then does one task at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from distributed import Worker, WorkerPlugin

from tactilevision.cluster.connect import refusal, versions

Start = Callable[..., None]
Given = tuple[Any, ...]

_runs: dict[str, tuple[Start | None, Given]] = {}  # by the run's name: many may share a cluster
_ready = ""  # the run for which this process was started last
_one_at_a_time = threading.Lock()  # a worker may have many threads; they share what is begun


class NotBegun(Exception):
    """This worker has not received the run's data yet."""


class Begin(WorkerPlugin):  # type: ignore[misc]
    """Sends a run's data to a worker; the scheduler also sends it to workers that join later."""

    def __init__(self, run: str, start: Start | None, given: Given) -> None:
        self.name, self._what = run, (start, given)

    def setup(self, worker: Worker) -> None:
        """Store the data."""
        _runs[self.name] = self._what

    def teardown(self, worker: Worker) -> None:
        """Drop the data."""
        _runs.pop(self.name, None)


def do(run: str, here: dict[str, str], fn: Callable[..., Any], args: tuple[Any, ...]) -> Any:
    """Return `fn(*args)` as the run's own process would. Raises ClusterError if this worker's versions differ."""
    global _ready
    different = refusal(here, versions())
    if different is not None:
        raise different
    with _one_at_a_time:
        if run not in _runs:
            raise NotBegun
        if _ready != run:
            start, given = _runs[run]
            if start is not None:
                start(*given)
            _ready = run
        return fn(*args)
