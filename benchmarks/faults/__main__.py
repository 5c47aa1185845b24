"""`python -m benchmarks.faults`: a table of faults by command, and each thing that was wrong."""

from __future__ import annotations

import argparse
import shutil
import signal
import sys
import tempfile
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.faults import trials
from benchmarks.faults.commands import Command, prepare

OTHERS: dict[str, trials.Trial] = {
    "worker killed": trials.worker_killed,
    "Ctrl-C": partial(trials.stopped, number=signal.SIGINT),
    "SIGTERM": partial(trials.stopped, number=signal.SIGTERM),
    "disk full": trials.disk_full,
    "read-only": trials.read_only,
    "clock back": trials.clock_back,
    "recorded clock back": trials.recorded_clock_back,
    "input changed": trials.input_changed,
    "run twice": trials.run_twice,
}
DRAWS = 3  # moments that are drawn anew where the run was done before


def main() -> int:
    """Returns 1 where anything was wrong but last digits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=60, help="kill -9 in all, over all commands")
    parser.add_argument("--others", type=int, default=2, help="of each other fault, for each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="a part of the commands' names")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="tactilevision_faults_"))
    try:
        every = prepare(folder)
        chosen = [command for name, command in every.items() if (asked.only or "") in name]
        parts = np.cumsum([command.weight for command in chosen])
        kills = np.diff(np.round(asked.kills * parts / parts[-1]), prepend=0).astype(int).tolist()
        done = [
            _all_of(command, folder / f"{k}", kills=count, others=asked.others, seed=asked.seed + k)
            for k, (command, count) in enumerate(zip(chosen, kills, strict=True))
        ]
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if any(done) else 0


def _all_of(command: Command, folder: Path, *, kills: int, others: int, seed: int) -> int:
    """All trials of a command; returns in how many something was wrong but last digits."""
    folder.mkdir()
    whole, rng = trials.undisturbed(command, folder), np.random.default_rng(seed)
    print(f"{command.name}: {whole.seconds:.1f} s, {whole.events} events that write, {len(whole.found)} files")
    asked: list[tuple[str, trials.Trial]] = [
        (
            "kill -9 at a write" if k % 2 else "kill -9 at a moment",
            partial(trials.killed, at_write=bool(k % 2), over=k % 4 > 1),
        )
        for k in range(kills)
    ] + [(name, trial) for name, trial in OTHERS.items() for _ in range(others)]
    count: Counter[tuple[str, str]] = Counter()
    for number, (name, trial) in enumerate(asked):
        if name == "worker killed" and command.workers == 1:
            continue
        wrong = _drawn(trial, whole, folder / f"{number}", rng)
        kind = "not done" if wrong is None else "sound" if not wrong else "wrong"
        if wrong and all(line.endswith("last digits") for line in wrong):
            kind = "digits"
        count[name, kind] += 1
        if wrong:
            print(f"  {name}, trial {number} of seed {seed}: " + "; ".join(wrong[:4]), flush=True)
    for name in dict.fromkeys(name for name, _ in asked):
        told = ", ".join(
            f"{count[name, kind]} {kind}" for kind in ("sound", "digits", "wrong", "not done") if count[name, kind]
        )
        print(f"  {name:20s} {told}", flush=True)
    return sum(many for (_, kind), many in count.items() if kind == "wrong")


def _drawn(
    trial: trials.Trial, whole: trials.Undisturbed, folder: Path, rng: np.random.Generator
) -> list[str] | None:
    for _ in range(DRAWS):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        wrong = trial(whole, folder / "out", rng)
        if wrong is not None:
            break
    shutil.rmtree(folder, ignore_errors=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
