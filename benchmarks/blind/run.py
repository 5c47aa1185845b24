"""Runs the cases, one after the other or on several cores, and keeps what was said: a cut run goes on where it
stopped.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

from benchmarks.blind.analyst import Finding, diagnosing, naive
from benchmarks.blind.cases import Case, make
from benchmarks.blind.score import Result
from tactilevision.cluster.pool import cluster_pool


def run_case(case: Case, *, with_naive: bool) -> dict[str, Result]:
    """Make one recording, hand its folder to each analyst, and only then open the truth."""
    with tempfile.TemporaryDirectory() as folder:
        made = make(case, Path(folder))
        (made.folder / "truth.toml").unlink()
        said = {"diagnose": _said(made.folder)}
        if with_naive:
            said |= naive(made.folder)
    return {
        who: Result(case, made.strength, made.rivals, made.world.modulus_MPa, finding)
        for who, finding in said.items()
    }


def run(
    cases: Sequence[Case],
    log: Path | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    with_naive: bool = True,
) -> Iterator[dict[str, Result]]:
    """All cases, in order; `log` keeps them as lines of JSON, and those found in it are not run again.

    `cluster` is a Dask scheduler's address or file: its workers then take the place of `jobs` processes.
    """
    done = {} if log is None or not log.exists() else _kept(log.read_text(encoding="utf-8").splitlines())
    left = [case for case in cases if case not in done]
    yield from (done[case] for case in cases if case in done)
    if jobs == 1 and cluster is None:
        outcomes: Iterable[dict[str, Result]] = (run_case(case, with_naive=with_naive) for case in left)
        yield from _logged(outcomes, log)
        return
    with ProcessPoolExecutor(jobs) if cluster is None else cluster_pool(cluster) as pool:
        yield from _logged(pool.map(run_case_of, [(case, with_naive) for case in left]), log)


def run_case_of(task: tuple[Case, bool]) -> dict[str, Result]:
    """One case in another process."""
    return run_case(task[0], with_naive=task[1])


def _logged(outcomes: Iterable[dict[str, Result]], log: Path | None) -> Iterator[dict[str, Result]]:
    for outcome in outcomes:
        if log is not None:
            with log.open("a", encoding="utf-8") as file:
                file.write(json.dumps({who: asdict(result) for who, result in outcome.items()}) + "\n")
        yield outcome


def _kept(lines: Sequence[str]) -> dict[Case, dict[str, Result]]:
    kept = [{who: _result(content) for who, content in json.loads(line).items()} for line in lines]
    return {next(iter(outcome.values())).case: outcome for outcome in kept}


def _result(content: dict[str, object]) -> Result:
    fields = dict(content)
    case, finding = dict(fields.pop("case")), dict(fields.pop("finding"))  # type: ignore[call-overload]
    case["hidden"] = tuple(case["hidden"])
    for name in ("named", "candidates"):
        finding[name] = tuple(finding[name])
    interval = finding["interval_MPa"]
    finding["interval_MPa"] = None if interval is None else tuple(interval)
    fields["rivals"] = tuple(fields["rivals"])  # type: ignore[arg-type]
    return Result(case=Case(**case), finding=Finding(**finding), **fields)  # type: ignore[arg-type]


def _said(folder: Path) -> Finding:
    try:
        return diagnosing(folder)
    except Exception as fault:  # whatever it raises is a finding about the analyst, and the test goes on
        return Finding("RAISED", (), (), failed=f"{type(fault).__name__}: {fault}")
