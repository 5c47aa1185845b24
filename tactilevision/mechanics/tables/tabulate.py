"""Fill a work folder with solved cases, one file each; stop and start again at will."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from tactilevision.mechanics.tables.cases import Case, SolvedCase, case_path, save_case
from tactilevision.mechanics.tables.solve import solve_case
from tactilevision.runs import output_lock, worker_pool


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is: `done` of `total` cases stand in the folder, of them `now` solved by this run, the last of
    them `case`, as deep as `depth` (w/h); `left_s` is an estimate of the time that the rest takes."""

    done: int
    total: int
    now: int
    case: Case
    depth: float
    left_s: float


Report = Callable[[Progress], None]


def tabulate(
    cases: Iterable[Case], folder: Path | str, *, workers: Executor | None = None, report: Report | None = None
) -> int:
    """Solve every case that `folder` does not hold yet; returns how many were solved now.

    A case is written under a temporary name and renamed: a run that is killed loses only what it was at. Without
    `workers` (see `processes`, and cluster/pool.py) the cases are solved one by one, here.
    """
    place, every = Path(folder), list(cases)
    with output_lock(place):
        missing = [case for case in every if not case_path(place, case).exists()]
        clock = _Clock(len(every), missing)
        for case, solved in _solved(missing, workers):
            save_case(case_path(place, case), solved)
            if report is not None:
                report(clock.tick(case, float(solved.depth[-1]) if solved.depth.size else 0.0))
    return len(missing)


def processes(count: int | None = None) -> AbstractContextManager[Executor]:
    """So many processes on this machine, all its cores where none is said; they end with their parent."""
    return worker_pool(count or len(os.sched_getaffinity(0)))


def _solved(missing: list[Case], workers: Executor | None) -> Iterator[tuple[Case, SolvedCase]]:
    if workers is None:
        for case in missing:
            yield case, solve_case(case)
        return
    waiting = {workers.submit(solve_case, case): case for case in missing}
    try:
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    finally:
        for future in waiting:
            future.cancel()


class _Clock:
    """Estimates the remaining time from the effort that cases of a kind usually need."""

    def __init__(self, total: int, missing: list[Case]) -> None:
        self.total, self.left, self.now = total, sum(map(effort, missing)), 0
        self.started, self.spent, self.standing = monotonic(), 0.0, total - len(missing)

    def tick(self, case: Case, depth: float) -> Progress:
        """One more case is solved."""
        self.now += 1
        self.spent += effort(case)
        self.left -= effort(case)
        left_s = (monotonic() - self.started) / self.spent * self.left
        return Progress(self.standing + self.now, self.total, self.now, case, depth, max(left_s, 0.0))


def effort(case: Case) -> float:
    """About how long a case takes beside one of some friction at an edge radius of h/60."""
    sliding = 3.0 if case.friction == 0 else 1.0
    return float(sliding * (1 / (60 * case.edge_over_h)) ** 0.7)
