"""What fuzzing once found stays mended, and a few mutants of every input file find nothing new."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from each import each

from benchmarks.fuzz.readers import READERS

ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "tests" / "fuzz_corpus"
MUTANTS = 2  # of each reader that keep the form of the file, and as many of its bytes


def test_no_reader_is_broken_by_the_corpus_or_by_mutants(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.fuzz.child", "all", str(tmp_path), "--engine", "replay"]
    done = subprocess.run(
        [*command, "--mutants", f"{MUTANTS}", "--seed", "18"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@each("folder", sorted(CORPUS.iterdir()))
def test_every_file_of_the_corpus_has_its_reader(folder: Path) -> None:
    assert folder.name in READERS
    assert all(path.stat().st_size < 300_000 for path in folder.iterdir())
