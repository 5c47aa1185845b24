"""Fill a work folder with solved cases, one file each; stop and start again at will."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from tactilevision.mechanics.tables.cases import DEPTHS, Case, case_path, save_case, solve_case

Report = Callable[[Case, float, bool], None]


def tabulate(
    cases: Iterable[Case], folder: Path | str, *, processes: int = 1, report: Report | None = None
) -> int:
    """Solve every case that `folder` does not hold yet; returns how many were solved now.

    A case is written under a temporary name and renamed, so that a run that is killed loses only what it was at,
    and several runs may share a folder. `report` is told each case, the depth w/h that it reached, and whether
    that is all. With one process nothing is forked.
    """
    place = Path(folder)
    missing = [case for case in cases if not case_path(place, case).exists()]
    if processes <= 1:
        for case in missing:
            _tell(report, case, solve_into(case, place))
        return len(missing)
    from concurrent.futures import ProcessPoolExecutor, as_completed

    with ProcessPoolExecutor(processes) as pool:
        waiting = {pool.submit(solve_into, case, place): case for case in missing}
        for done in as_completed(waiting):
            _tell(report, waiting[done], done.result())
    return len(missing)


def solve_into(case: Case, folder: Path) -> float:
    """Solve one case and keep it in `folder`, if nobody else has meanwhile; returns the depth w/h reached."""
    path = case_path(folder, case)
    solved = solve_case(case)
    save_case(path, solved)
    return float(solved.depth[-1]) if len(solved.depth) else 0.0


def _tell(report: Report | None, case: Case, depth: float) -> None:
    if report is not None:
        report(case, depth, depth >= DEPTHS[-1] * (1 - 1e-9))
