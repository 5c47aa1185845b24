"""Each recording as a task of its own on a Dask cluster: what comes of it and its warnings travel back."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from typing import TYPE_CHECKING, Any, TypeVar

from tactilevision.cli import console

if TYPE_CHECKING:
    from tactilevision.errors import TactilevisionError
    from tactilevision.recording import Recording

T = TypeVar("T")
MARK = "warning: "  # how console.warn begins a line


def each_on_cluster(
    act: Callable[..., T], given: Sequence[Recording], *told: Any, cluster: str, title: str
) -> list[T]:
    """`act(path, *told)` of each recording, in their order; what it warns of is said here, what it raises raised.

    It writes nothing, so a task that is lost is done again. Raises ClusterError as `cluster_pool` does.
    """
    from tactilevision.cluster.pool import cluster_pool
    from tactilevision.errors import TactilevisionError

    with cluster_pool(cluster) as pool, console.progress_bar(title) as progress:
        tasks = [pool.submit(_listened, act, one.path.absolute(), *told) for one in given]
        found: list[T] = []
        for task in tasks:
            outcome, warnings = task.result()
            console.warn(warnings)
            if isinstance(outcome, TactilevisionError):
                raise outcome
            found.append(outcome)
            progress(len(found), len(given))
    return found


def _listened(act: Callable[..., T], *given: Any) -> tuple[T | TactilevisionError, list[str]]:
    """What came of it, or why nothing did, and its warnings."""
    from tactilevision.errors import TactilevisionError

    outcome: T | TactilevisionError
    with redirect_stderr(io.StringIO()) as said:
        try:
            outcome = act(*given)
        except TactilevisionError as fault:
            outcome = fault
    return outcome, [line.removeprefix(MARK) for line in said.getvalue().splitlines() if line.startswith(MARK)]
