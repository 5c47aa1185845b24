"""The blind test: python -m benchmarks.blind [--small] [--repeats N] [--seed N] [--jobs N] [--cluster ADDRESS]
[--log FILE] [--most N] [--diagnose-only].

Makes recordings by a path of its own, hides effects in them, lets the diagnosis and two naive ways look at
them, and
prints the confusion matrix, the targets and what came out. Any seed does; the figures that are quoted name theirs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.blind.run import run
from benchmarks.blind.score import Result, by_setting, confusion, targets
from benchmarks.blind.sets import full_set, small_set


def main(arguments: Sequence[str] = ()) -> None:
    """Run and print."""
    options = _options().parse_args(list(arguments))
    cases = small_set(options.seed) if options.small else full_set(options.repeats, options.seed)
    said: dict[str, list[Result]] = {}
    print(f"{len(cases)} recordings, seeds {cases[0].seed} to {cases[-1].seed}")
    cases = cases[: options.most]
    outcomes = run(
        cases, options.log, jobs=options.jobs, cluster=options.cluster, with_naive=not options.diagnose_only
    )
    for number, outcome in enumerate(outcomes, start=1):
        for who, result in outcome.items():
            said.setdefault(who, []).append(result)
        print(_progress(number, len(cases), outcome["diagnose"]), flush=True)
    print(report(said))


def report(said: dict[str, list[Result]]) -> str:
    """Confusions of the diagnosis, the targets with every analyst beside each other, and the other settings."""
    lines = ["", "What was hidden, and what was said first (rich design)", ""]
    for hidden, answers in confusion(said["diagnose"]).items():
        parts = ", ".join(f"{answer} {count}" for answer, count in answers.most_common())
        lines.append(f"  {hidden:20s} {sum(answers.values()):3d}: {parts}")
    lines += ["", f"{'target':40s} {'asked':9s}" + "".join(f"{who:>18s}" for who in said)]
    for row in zip(*(targets(results) for results in said.values()), strict=True):
        lines.append(f"{row[0].what:40s} {row[0].target:9s}" + "".join(f"{cell.text():>18s}" for cell in row))
    lines += ["", "Other settings (diagnosis)", ""]
    for name, few in by_setting(said["diagnose"]):
        lines.append(f"  {name:26s} " + " | ".join(f"{line.what} {line.text()}" for line in few))
    return "\n".join(lines)


def _progress(number: int, total: int, result: Result) -> str:
    finding = result.finding
    shown = " + ".join(f"{key} ({result.strength[key]:.0f} sigma)" for key in result.hidden) or "nothing"
    answer = (
        finding.failed or f"{finding.verdict} {', '.join(finding.named)} of {{{', '.join(finding.candidates)}}}"
    )
    return f"[{number}/{total}] {result.case.name}: {shown} -> {answer}"


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("--small", action="store_true", help="a few recordings")
    parser.add_argument("--repeats", type=int, default=4, help="recordings of each effect")
    parser.add_argument("--seed", type=int, default=1, help="the first recording's seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--cluster", help="a Dask scheduler's address or file, instead of processes")
    parser.add_argument("--log", type=Path, help="keeps results as they come; a run that was cut goes on from it")
    parser.add_argument("--most", type=int, help="only the first so many: run it again with more to go on")
    parser.add_argument("--diagnose-only", action="store_true", help="leave the naive ways out")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
