"""Faults of real rigs: python -m benchmarks.experimenter [--kinds K,K] [--count N] [--clean N] [--seed S]
[--jobs J] [--log FILE] [--calibrate-only] [--all] [--report].

Each recording is made from its kind and seed, calibrated and diagnosed, and kept as a line of JSON in the log: a
run that was cut goes on from it, and none is counted twice. Seeds below 100000 are for tuning; `--all` runs what
is quoted, ten of each kind and 300 clean ones from seed 530000 on. A fault that changes the readings by less than
4 sigma beyond what E, nu and beta absorb is listed as not testable. `--report` prints the figures of what the log
has, and runs nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.experimenter import judge
from benchmarks.experimenter.faults import FAULTS
from benchmarks.experimenter.judge import Row

JUDGED = 530000  # the first seed of recordings that nothing was tuned on
FULL = (10, 300)  # recordings of each kind, and clean ones, that are quoted

Task = tuple[str, int, bool]


def main(arguments: Sequence[str] = ()) -> None:
    """Run what is left, and print the figures of all."""
    options = _options().parse_args(list(arguments))
    seed, (count, clean) = (JUDGED, FULL) if options.all else (options.seed, (options.count, options.clean))
    kinds = options.kinds.split(",") if options.kinds else list(FAULTS)
    if unknown := set(kinds) - set(FAULTS):
        raise SystemExit(f"no such kind: {', '.join(sorted(unknown))}; there are {', '.join(FAULTS)}")
    # seed by seed, so that a run that is cut has some of every kind
    tasks = [(kind, seed + n, options.calibrate_only) for n in range(count) for kind in kinds]
    tasks += [("clean", seed + n, options.calibrate_only) for n in range(clean)]
    kept = _kept(options.log)
    for row in _rows([] if options.report else [task for task in tasks if task not in kept], options.jobs):
        kept[_task(row)] = row
        if options.log is not None:
            with options.log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        print(_line(row), flush=True)
    print(judge.report([kept[task] for task in tasks if task in kept]))


def _rows(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    if jobs == 1:
        yield from map(_look, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_look, tasks)


def _look(task: Task) -> Row:
    kind, seed, calibrate_only = task
    return judge.look(kind, seed, calibrate_only=calibrate_only)


def _task(row: Row) -> Task:
    return row["kind"], row["seed"], row["calibrate_only"]


def _kept(log: Path | None) -> dict[Task, Row]:
    if log is None or not log.exists():
        return {}
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return {_task(row): row for row in rows}


def _line(row: Row) -> str:
    words = [f"{row['kind']} {row['seed']}, {row['presses']} presses, {row['strength']:.0f} sigma:"]
    for name in (one for one in ("calibrate", "diagnose") if one in row):
        one = row[name]
        words += [one.get("failed", ""), one.get("verdict", ""), "+".join(one.get("effects", ()))]
        words += [f"[{' '.join(one['candidates'])}]"] if "candidates" in one else []
        words += [*one.get("flags", ()), "holds E," if one["covered"] else "MISSES E,", f"{one['cpu_s']:.1f} s |"]
    return " ".join(word for word in words if word)


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.experimenter", description=__doc__)
    parser.add_argument("--kinds", help="of faults, separated by commas; left out: all")
    parser.add_argument("--count", type=int, default=3, help="recordings of each kind")
    parser.add_argument("--clean", type=int, default=0, help="recordings without a fault")
    parser.add_argument("--seed", type=int, default=1, help="the first recording's seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--log", type=Path, help="keeps results as they come; a run that was cut goes on from it")
    parser.add_argument("--calibrate-only", action="store_true", help="no diagnosis")
    parser.add_argument("--report", action="store_true", help="of what the log has; nothing is run")
    parser.add_argument("--all", action="store_true", help="everything that is quoted")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
