"""Processor time and memory of commands and frames, as ratios to another revision: python -m benchmarks.speed.

python -m benchmarks.speed [--base REVISION] [--turns N] [--quick] [--write] [CASE ...]
The base revision is checked out into a temporary folder. Each case runs in a process of its own, with the base and
this tree in turns; both read the samples of this tree, and each tree has a cache of its own.
Printed are medians over the turns: seconds of processor time, their ratio, and the largest resident memory.
`--write` writes the times that README states, of this tree on this machine, into its line.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

HERE = Path(__file__).parents[1]
SAMPLES = HERE / "sample_frames"
SAMPLE = str(SAMPLES / "gelslim3")
RESULTS = "results/calibration.json"  # of the case `calibrate`, which `force` and `validate` read
TURNS = 3  # runs of each case with each revision
Spent = tuple[float, float]  # seconds of processor time, MB of resident memory at most

FIVE_LINES = """
from tactilevision import build_reconstructor, read_frame, read_recording
recording = read_recording({recording!r})
reconstructor = build_reconstructor(recording)
height = reconstructor.height_map(read_frame(recording, {frame}))
"""
FRAME = """
import time
for again in range(3):
    reconstructor.height_map(read_frame(recording, {frame}))
frame, began = read_frame(recording, {frame}), time.process_time()
for again in range({times}):
    reconstructor.height_map(frame)
print((time.process_time() - began) / {times})
"""


README = HERE / "README.md"
STATED = re.compile(".*<!-- bench-speed -->")
LINE = (  # of README: its times by case
    "On one core of {machine}, these lines take {five lines of README, first run:.2g} s with imports, and "
    "{five lines of README, second run:.2g} s once the light is in the [cache](docs/start/two_commands.md#cache). "
    "A deep map takes {a deep frame:.2g} ms. <!-- bench-speed -->"
)


@dataclass(frozen=True, slots=True)
class Case:
    """A command, or lines of Python; `fresh`: with an empty cache; `timed`: the lines print their seconds."""

    name: str
    command: tuple[str, ...] = ()
    lines: str = ""
    fresh: bool = False
    timed: bool = False
    quick: bool = False


@dataclass(slots=True)
class Tree:
    """A checked-out revision, its folder for results, and what was measured: seconds and MB by case."""

    source: Path
    place: Path
    spent: dict[str, list[Spent]] = field(default_factory=dict)


def _lines(recording: str, frame: int, times: int = 0) -> str:
    given = {"recording": str(SAMPLES / recording), "frame": frame, "times": times}
    return (FIVE_LINES + (FRAME if times else "")).format(**given)


CALIBRATE = ("calibrate", SAMPLE, "--out", "results")
PROFILE = ("calibrate-sensor", SAMPLE, "--out", "sensor.tvs")
FORCE = ("force", SAMPLE, "--calibration", RESULTS, "--workers", "1", "--out")
DEPTH = ("depth", SAMPLE, "--workers", "1", "--out", "maps")
CURVES = str(SAMPLES / "hidden_material")
CASES = (  # in this order: later ones read what earlier ones wrote
    Case("calibrate, first run", CALIBRATE, fresh=True),
    Case("calibrate, second run", CALIBRATE),
    Case("calibrate-sensor, first run", PROFILE, fresh=True),
    Case("calibrate-sensor, second run", PROFILE),
    Case("force, 404 frames, first run", (*FORCE, "forces"), fresh=True),
    Case("force, 404 frames, second run", (*FORCE, "forces")),
    Case("depth, 404 frames, second run", DEPTH),
    Case("diagnose, curves", ("diagnose", CURVES, "--workers", "1", "--out", "diagnosis")),
    Case("validate", ("validate", SAMPLE, "--calibration", RESULTS, "--out", "validation")),
    Case("five lines of README, first run", lines=_lines("gelslim3", 96), fresh=True),
    Case("five lines of README, second run", lines=_lines("gelslim3", 96)),
    Case("a deep frame", lines=_lines("gelslim3", 102, times=50), timed=True),
    Case("--version", ("--version",), quick=True),
    Case("calibrate --help", ("calibrate", "--help"), quick=True),
    Case("plan", ("plan", "--radius", "3", "--heights", ".3,.6", "--thickness", "4"), quick=True),
)


def main(arguments: Sequence[str] = ()) -> None:
    options = _options().parse_args(list(arguments))
    named = {*options.cases, *(case.name for case in CASES if options.write and case.name in LINE)}
    wanted = [case for case in CASES if options.quick <= case.quick and (not named or case.name in named)]
    print(f"{'':34}{'base (s)':>10}{'now (s)':>10}{'ratio':>8}{'base (MB)':>11}{'now (MB)':>10}")
    with tempfile.TemporaryDirectory() as folder, _worktree(options.base, Path(folder) / "base") as base:
        both = [Tree(source, Path(folder) / f"of_{name}") for name, source in (("base", base), ("now", HERE))]
        for tree in both:
            tree.place.mkdir()
        for case in wanted:
            for turn in range(options.turns):
                for tree in both if turn % 2 else reversed(both):
                    tree.spent.setdefault(case.name, []).append(_run(case, tree))
            print(_row(case.name, *(tree.spent[case.name] for tree in both)), flush=True)
        if options.write:
            _write({name: median(seconds for seconds, _ in runs) for name, runs in both[1].spent.items()})


def _write(spent: Mapping[str, float]) -> None:
    """Write the seconds of processor time by case, and the machine's name, into README."""
    about = Path("/proc/cpuinfo")
    found = re.search("model name\\s*: (.*)", about.read_text()) if about.is_file() else None
    ms = {"a deep frame": 1e3 * spent["a deep frame"]}
    line = LINE.format(machine=found[1] if found else platform.processor(), **{**spent, **ms})
    README.write_text(STATED.sub(line, README.read_text(encoding="utf-8")), encoding="utf-8")


def _run(case: Case, tree: Tree) -> tuple[float, float]:
    """Return seconds of processor time, or those of a frame that the lines print, and MB; NaN where it failed."""
    cache = tree.place / "cache"
    if case.fresh:
        shutil.rmtree(cache, ignore_errors=True)
    environment = os.environ | {
        **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"),
        "PYTHONPATH": str(tree.source),
        "TACTILEVISION_CACHE": str(cache),
    }
    asked = ["-c", case.lines] if case.lines else ["-m", "tactilevision", *case.command]
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            [sys.executable, *asked], cwd=tree.place, env=environment, stdout=said, stderr=subprocess.STDOUT
        )
        _, status, used = os.wait4(process.pid, 0)  # its own and that of the processes it waited for
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        words = said.read()
    if process.returncode:
        print(f"{case.name} failed in {tree.source}: {words[-300:]}", file=sys.stderr)
        return math.nan, math.nan
    spent = float(words.split()[-1]) if case.timed else used.ru_utime + used.ru_stime
    return spent, used.ru_maxrss / 1024


@contextmanager
def _worktree(revision: str, folder: Path) -> Iterator[Path]:
    """Check a revision out into `folder`, and remove it afterwards."""
    git = ["git", "-C", str(HERE), "worktree"]
    subprocess.run([*git, "add", "--quiet", "--detach", str(folder), revision], check=True)
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def _row(name: str, base: Sequence[Spent], now: Sequence[Spent]) -> str:
    ratio = median(b[0] / a[0] for a, b in zip(base, now, strict=True))
    (base_s, base_MB), (now_s, now_MB) = (map(median, zip(*runs, strict=True)) for runs in (base, now))
    return f"{name:34}{base_s:10.3f}{now_s:10.3f}{ratio:8.2f}{base_MB:11.0f}{now_MB:10.0f}"


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    names = "; ".join(case.name for case in CASES)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {names}; all where none is named")
    parser.add_argument("--base", default="HEAD", metavar="REVISION", help="the revision compared with")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="runs of each case and revision")
    parser.add_argument("--write", action="store_true", help="write README's times")
    parser.add_argument("--quick", action="store_true", help="only the cases of a second")
    return parser


def quick() -> None:
    main(["--quick", "--turns", "1"])


if __name__ == "__main__":
    main(sys.argv[1:])
