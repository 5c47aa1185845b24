"""The process that judges: `python -m benchmarks.fuzz.child READER FOLDER --engine ... --seconds ... --seed ...`.

What it found lies in FOLDER/findings, how many mutants it judged in FOLDER/runs. The mutant that killed it is
still where the reader looks.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

BATCH = 100  # mutants that hypothesis draws in one go


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("reader")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engine", choices=("structure", "bytes", "coverage", "replay"), required=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--mutants", type=int, default=0, help="stop after as many; 0: after --seconds")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    if asked.engine == "replay":
        sys.exit(_replay(asked))
    if asked.engine == "coverage":
        import atheris

        with atheris.instrument_imports(include=["tactilevision", "calibration", "tomllib", "zipfile"]):
            work = _Work(asked)
    else:
        work = _Work(asked)
    getattr(work, asked.engine)()


class _Work:
    """One judge and its notes. Imports are late: what atheris shall follow is loaded under its eyes."""

    def __init__(self, asked: argparse.Namespace) -> None:
        from benchmarks.fuzz.judge import Judge
        from benchmarks.fuzz.readers import READERS

        self.asked, self.reader = asked, READERS[asked.reader]
        self.folder: Path = asked.folder
        self.found = self.folder / "findings"
        self.found.mkdir(parents=True, exist_ok=True)
        self.end = time.monotonic() + asked.seconds
        self.judge = Judge(self.reader, self.folder / "input")
        self.counter = os.open(self.folder / "runs", os.O_WRONLY | os.O_CREAT, 0o600)

    def one(self, data: bytes) -> None:
        """Judge, count, and keep what was found in its smallest form."""
        from benchmarks.fuzz.judge import smaller

        finding = self.judge(data)
        if finding is not None and not (self.found / f"{finding.slug}.json").exists():
            data = smaller(self.judge, data, finding)
            (self.found / finding.slug).write_bytes(data)
            about = {"kind": finding.kind, "said": finding.said}
            (self.found / f"{finding.slug}.json").write_text(json.dumps(about))
        os.pwrite(self.counter, f"{self.judge.runs} {self.judge.accepted}  ".encode(), 0)

    def over(self) -> bool:
        """Whether time, or the number asked for, is used up."""
        return bool(time.monotonic() > self.end or 0 < self.asked.mutants <= self.judge.runs)

    def structure(self) -> None:
        """Mutants that keep the file's form."""
        from benchmarks.fuzz.mutants import mutants

        strategy = mutants(self.reader.form, self.judge.seed)
        for number in itertools.count():
            if self.over():
                return

            @seed(1000 * self.asked.seed + number)
            @settings(
                max_examples=min(BATCH, self.asked.mutants or BATCH),
                deadline=None,
                database=None,
                phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            )
            @given(strategy)
            def batch(data: bytes) -> None:
                if not self.over():
                    self.one(data)

            batch()

    def bytes(self) -> None:
        """Mutants of the bytes, drawn blindly."""
        from benchmarks.fuzz.binary_mutants import mutated_bytes

        rng = random.Random(self.asked.seed)  # noqa: S311 - drawn again from the same seed
        while not self.over():
            self.one(mutated_bytes(self.judge.seed, rng))

    def coverage(self) -> None:
        """Mutants of the bytes, guided by the lines that they reach."""
        import atheris

        corpus = self.folder / "coverage"
        corpus.mkdir(exist_ok=True)
        (corpus / "seed").write_bytes(self.judge.seed)
        options = [
            f"-max_total_time={int(self.asked.seconds)}",
            f"-seed={self.asked.seed + 1}",
            "-timeout=0",
            "-rss_limit_mb=0",
            "-verbosity=0",
            "-max_len=200000",
        ]
        take: Callable[[bytes], None] = self.one
        atheris.Setup([sys.argv[0], *options, str(corpus)], take)
        atheris.Fuzz()

    def replay(self) -> None:
        """The kept files of the corpus, and mutants of both kinds."""
        for path in sorted((Path("tests/fuzz_corpus") / self.asked.reader).glob("*")):
            self.one(path.read_bytes())
        each = self.asked.mutants
        for draw in (self.structure, self.bytes):
            self.asked.mutants = self.judge.runs + each
            draw()


def _replay(asked: argparse.Namespace) -> int:
    """Every reader's corpus and some mutants, in this one process; returns 1 where anything was found."""
    from benchmarks.fuzz.readers import READERS

    found = 0
    for name in READERS if asked.reader == "all" else [asked.reader]:
        print(name, flush=True)
        here = argparse.Namespace(**vars(asked) | {"reader": name, "folder": asked.folder / name})
        _Work(here).replay()
        for path in here.folder.glob("findings/*.json"):
            print(path.read_text(), flush=True)
            found = 1
    return found


if __name__ == "__main__":
    main()
