"""`python -m benchmarks.fuzz`: a line for each reader, and a file in tests/fuzz_corpus for each finding."""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.fuzz.readers import READERS

CORPUS = Path("tests/fuzz_corpus")
MAX_DEATHS = 5  # of one reader's children: more say nothing new


def main() -> int:
    """Returns 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reader", nargs="+", choices=("all", *READERS), default=["all"])
    parser.add_argument("--minutes", type=float, default=1.0, help="for each reader")
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100_000)
    asked = parser.parse_args()
    guided = importlib.util.find_spec("atheris") is not None
    engines = ("structure", "coverage" if guided else "bytes")
    print(f"seed {asked.seed}; bytes are {'guided by coverage' if guided else 'drawn blindly: no atheris here'}")
    count = 0
    for name in READERS if "all" in asked.reader else asked.reader:
        for engine in engines:
            count += _fuzz(name, engine, 60 * asked.minutes / len(engines), asked.seed)
    return 1 if count else 0


def _fuzz(name: str, engine: str, seconds: float, first: int) -> int:
    """All the time of one reader and engine; returns the number of findings."""
    reader, deaths, runs, accepted = READERS[name], 0, 0, 0
    folder = Path(tempfile.mkdtemp(prefix="tactilevision_fuzz_"))
    begun = time.monotonic()
    found: dict[str, tuple[str, bytes]] = {}
    try:
        while (left := seconds - (time.monotonic() - begun)) > 1 and deaths < MAX_DEATHS:
            shutil.rmtree(folder / "input", ignore_errors=True)
            command = [sys.executable, "-m", "benchmarks.fuzz.child", name, os.fspath(folder), "--engine", engine]
            done = subprocess.run(
                [*command, "--seconds", f"{left:.0f}", "--seed", f"{first + deaths}"],
                capture_output=True,
                check=False,
                timeout=left + 120,
            )
            told = (folder / "runs").read_text().split() if (folder / "runs").exists() else []
            if not told:
                raise RuntimeError(f"{name}: {done.stderr.decode(errors='replace').strip()[-2000:]}")
            runs, accepted = runs + int(told[0]), accepted + int(told[1])
            if done.returncode == 0:
                break
            deaths += 1
            how = signal.Signals(-done.returncode).name if done.returncode < 0 else f"exit code {done.returncode}"
            how = {"SIGPROF": "more than 10 s of processor", "SIGALRM": "more than 60 s of waiting"}.get(how, how)
            said = done.stderr.decode(errors="replace").strip()[-300:]
            found[how] = (said, (folder / "input" / reader.file).read_bytes())
        for path in sorted((folder / "findings").glob("*.json")):
            about = json.loads(path.read_text())
            found[about["kind"]] = (about["said"], path.with_suffix("").read_bytes())
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    minutes = (time.monotonic() - begun) / 60
    line = f"{minutes:5.2f} min {runs:8d} runs {accepted:8d} accepted {len(found):3d} findings"
    print(f"{name:14s} {engine:10s} {line}", flush=True)
    for kind, (words, data) in found.items():
        path = CORPUS / name / f"{hashlib.sha256(data).hexdigest()[:10]}{Path(reader.file).suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        print(f"  {kind}: {words}\n    {path}, {len(data)} bytes", flush=True)
    return len(found)


if __name__ == "__main__":
    sys.exit(main())
