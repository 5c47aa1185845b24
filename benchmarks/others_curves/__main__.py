"""Recordings by formulas of others: python -m benchmarks.others_curves [--kind K] [--count N] [--seed S] [--rich]
[--presses M] [--screen] [--jobs J] [--log FILE] [--all].

Each recording is made from its seed, diagnosed (or, with --screen, screened alone), and kept as a line of JSON in
the log: a run that was cut goes on from it. Of kind `near` another effect lies within 3 std of the hidden one, by
the same formulas: few radii, waits, places and days do not tell them apart. `--all` runs what is quoted: 300
clean, 300 with one effect, 100 pairs, 100 outside the catalogue, 2,000 screens, from seed 500000 on; seeds below
100000 are for tuning.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.others_curves.judge import Row, look, report
from benchmarks.others_curves.recording import KINDS

JUDGED = 500000  # the first seed of recordings that nothing was tuned on
FULL = (("clean", 300, False), ("single", 300, False), ("pair", 100, False), ("outside", 100, False))

Task = tuple[str, int, bool, bool, int]


def main(arguments: Sequence[str] = ()) -> None:
    """Run what is left, and print the figures of all."""
    options = _options().parse_args(list(arguments))
    seeds = range(options.seed, options.seed + options.count)
    tasks = [(options.kind, seed, options.rich, options.screen, options.presses) for seed in seeds]
    if options.all:
        tasks = [(k, JUDGED + n, n % 2 == 0, screen, 0) for k, count, screen in FULL for n in range(count)]
        tasks += [("clean", JUDGED + 10000 + n, n % 2 == 0, True, 0) for n in range(2000)]
    kept = _kept(options.log)
    left = [task for task in tasks if task not in kept]
    for row in _rows(left, options.jobs):
        kept[_task(row)] = row
        if options.log is not None:
            with options.log.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        print(_line(row), flush=True)
    print(report([kept[task] for task in tasks]))


def _rows(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    if jobs == 1:
        yield from map(_look, tasks)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_look, tasks)


def _look(task: Task) -> Row:
    kind, seed, rich, screen, count = task
    return look(kind, seed, rich=rich, screen=screen, count=count)


def _task(row: Row) -> Task:
    return row["kind"], row["seed"], row["rich"], row["screen"], row.get("count", 0)


def _kept(log: Path | None) -> dict[Task, Row]:
    if log is None or not log.exists():
        return {}
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return {_task(row): row for row in rows}


def _line(row: Row) -> str:
    hidden = " + ".join(row["sizes"]) or "nothing"
    left, screened = (", ".join(f"{k} {p:.2g}" for k, p in row.get(name, [])[:2]) for name in ("left", "screen_p"))
    end = " ".join(str(row[name]) for name in ("odd", "wanders", "failed") if row.get(name))
    noise = row["noise"] + ("" if row["stated"] else " unstated")
    return (
        f"{row['kind']} {row['seed']} {noise} {row['presses']} presses: {hidden} ({row['strength']:.0f} sigma) -> "
        f"{row['verdict']} {row.get('named', '')} | {left} | {screened} | {end} {row['cpu_s']:.0f} s"
    )


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.others_curves", description=__doc__)
    parser.add_argument("--kind", choices=KINDS, default="clean", help="what is hidden")
    parser.add_argument("--count", type=int, default=10, help="recordings")
    parser.add_argument("--seed", type=int, default=1, help="the first recording's seed")
    parser.add_argument("--rich", action="store_true", help="three radii, rates, places, days")
    parser.add_argument("--presses", type=int, default=0, help="of each recording; 0: drawn")
    parser.add_argument("--screen", action="store_true", help="the test of the base model alone")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--log", type=Path, help="keeps results as they come; a run that was cut goes on from it")
    parser.add_argument("--all", action="store_true", help="everything that is quoted")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
