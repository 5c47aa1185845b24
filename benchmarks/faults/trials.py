"""One fault, what it left, and what a second run made of it: each trial returns what was wrong, in words."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.faults.commands import Command, contents, nearly_same, visible
from benchmarks.faults.process import Ended, ended as ended_of, import_what_it_took, run, started

OLD = b"\n old"  # marks a file of an earlier run


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """The results of a run that nothing disturbs; its length in s; its own events that write, and its workers'."""

    command: Command
    out: Path
    found: Mapping[str, bytes]
    seconds: float
    events: int
    worker_events: int


def undisturbed(command: Command, folder: Path) -> Undisturbed:
    """Run it, counting the events that write; its length is that of a run like those that follow."""
    out, count, worker_count = folder / "undisturbed", folder / "count", folder / "worker_count"
    worker_count.touch()
    first = run(command, out, fault={"count": str(count)}, fresh=True)
    assert first.code == 0, first.said
    if command.workers == 1:
        import_what_it_took(out.with_name("undisturbed.said"))
    start = time.monotonic()
    assert run(command, folder / "again", fault={"count": str(worker_count), "worker": True}).code == 0
    seconds, found, second = time.monotonic() - start, contents(out), contents(folder / "again")
    for name in sorted(name for name in set(found) | set(second) if found.get(name) != second.get(name)):
        print(f"{command.name}: {name} differs between two runs that nothing disturbs")
    return Undisturbed(command, out, found, seconds, count.stat().st_size, worker_count.stat().st_size)


def earlier_results(whole: Undisturbed, out: Path) -> dict[str, bytes]:
    """Put results of an earlier run into `out`, told by a mark; cases that a run goes on from stay."""
    shutil.copytree(whole.out, out)
    for path in out.rglob("*"):
        if path.is_file() and path.parent.name != "cases":
            path.write_bytes(path.read_bytes() + OLD)
    return contents(out)


def half_written(whole: Undisturbed, out: Path, before: Mapping[str, bytes]) -> list[str]:
    """Results that are neither the new ones nor those of before; a store must be the one or the other."""
    wrong: list[str] = []
    stores: dict[str, set[str]] = {}
    for name, data in visible(contents(out)).items():
        new, old = data == whole.found.get(name), data == before.get(name)
        new |= name == whole.command.grows and whole.found[name].startswith(data)
        if not new and not old and not nearly_same(whole.out, out, name):
            wrong.append(f"{name} is half written")
        if ".zarr/" in name:
            stores.setdefault(name.split(".zarr/")[0], set()).add("old" if old and not new else "new")
    return wrong + [f"{name}.zarr is mixed" for name, kinds in stores.items() if len(kinds) > 1]


def resumed(whole: Undisturbed, out: Path, *, fault: Mapping[str, object] | None = None) -> list[str]:
    """The second run ends with 0 or finds all done, and its bytes are those of an undisturbed run."""
    ended = run(whole.command, out, fault=fault)
    if ended.code != 0 and " already. " not in ended.said:
        return [f"the second run ended with {ended.code}: {ended.said[-300:]}"]
    found, wrong = contents(out), []
    for name in sorted(set(found) | set(whole.found)):
        if name not in whole.found:
            wrong.append(f"{name} is left over")
        elif name not in found:
            wrong.append(f"{name} is lost")
        elif found[name] != whole.found[name]:
            digits = nearly_same(whole.out, out, name)
            wrong.append(f"{name} differs" + (" in its last digits" if digits else ""))
    return wrong


def traceback(ended: Ended) -> list[str]:
    """Words that only a programmer understands."""
    return [f"traceback: {ended.said[-600:]}"] if "Traceback" in ended.said else []


def killed(
    whole: Undisturbed, out: Path, rng: np.random.Generator, *, at_write: bool, over: bool
) -> list[str] | None:
    """kill -9 at a drawn moment, or before a drawn event that writes; None where the run was done before it."""
    before = earlier_results(whole, out) if over else {}
    if at_write:
        ended = run(whole.command, out, fault={"at": int(rng.integers(whole.events))})
    else:
        with started(whole.command, out) as running:
            if running[0].wait(float(rng.uniform(0.05, 1.0)) * whole.seconds) is None:
                os.kill(running[0].pid, signal.SIGKILL)
            ended = ended_of(running)
    if ended.code != -signal.SIGKILL:
        return None
    return half_written(whole, out, before) + resumed(whole, out)


def worker_killed(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """kill -9 of a worker before a drawn event of its own: one line, and what is done is kept."""
    each = max(4, whole.worker_events // whole.command.workers)
    ended = run(whole.command, out, fault={"worker": True, "at": int(rng.integers(each))})
    if ended.code == 0:
        return None
    wrong = [] if ended.code == 1 and "worker" in ended.said else [f"ended with {ended.code}: {ended.said[-300:]}"]
    return wrong + traceback(ended) + half_written(whole, out, {}) + resumed(whole, out)


def stopped(
    whole: Undisturbed, out: Path, rng: np.random.Generator, *, number: signal.Signals, over: bool = True
) -> list[str] | None:
    """Ctrl-C as a terminal sends it, to all processes; or SIGTERM to the first. Nothing half done stays."""
    before = earlier_results(whole, out) if over else {}
    with started(whole.command, out, fresh=True) as running:
        if running[0].wait(float(rng.uniform(0.3, 1.0)) * whole.seconds) is None:
            (os.killpg if number == signal.SIGINT else os.kill)(running[0].pid, number)
        sent = time.monotonic()
        ended = ended_of(running)
    if ended.code == 0:
        return None
    early = ended.code == -number and not out.exists()  # before the command had begun
    wrong = [] if ended.code == 128 + number or early else [f"ended with {ended.code}"]
    wrong += [f"took {time.monotonic() - sent:.1f} s to end"] if time.monotonic() - sent > 3 else []
    left = contents(out) if out.exists() else {}
    wrong += [f"left {name}" for name in left if ".unfinished" in name or name.endswith(".lock")]
    return wrong + traceback(ended) + half_written(whole, out, before) + resumed(whole, out)


def _refused(ended: Ended) -> list[str]:
    lines = [line for line in ended.said.split("\n") if line and not line.startswith("warning")]
    fine = ended.code == 2 and len(lines) == 1 and lines[0].startswith("error:")
    return [] if fine else [f"ended with {ended.code}: {ended.said[-600:]}"]


def disk_full(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """A disk too small by a drawn share, then one large enough; without mounts, a limit on a file's size."""
    size = sum(path.stat().st_size for path in whole.out.rglob("*") if path.is_file())
    share = float(rng.uniform(0.05, 0.9))
    out.mkdir()
    small = f"size={int(share * size) // 4096 * 4 + 8}k"
    if subprocess.run(["mount", "-t", "tmpfs", "-o", small, "tmpfs", str(out)], check=False).returncode:
        largest = max(path.stat().st_size for path in whole.out.rglob("*") if path.is_file())
        ended = run(whole.command, out, most=int(share * largest))
        return _refused(ended) + half_written(whole, out, {}) + resumed(whole, out)
    try:
        ended = run(whole.command, out)
        wrong = _refused(ended) + half_written(whole, out, {})
        subprocess.run(["mount", "-o", "remount,size=1g", str(out)], check=True)
        return wrong + resumed(whole, out)
    finally:
        subprocess.run(["umount", "-l", str(out)], check=False)


def read_only(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """A folder of earlier results on a disk that takes nothing; None where binding is not allowed."""
    before = earlier_results(whole, out)
    if subprocess.run(["mount", "--bind", str(out), str(out)], capture_output=True, check=False).returncode:
        return None
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", str(out)], check=True)
        wrong = _refused(run(whole.command, out))
        wrong += [] if contents(out) == before else ["results were touched"]
    finally:
        subprocess.run(["umount", "-l", str(out)], check=False)
    return wrong + resumed(whole, out)


def clock_back(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """Killed before a drawn event; then files date from tomorrow, and the second run's clock is a day back."""
    ended = run(whole.command, out, fault={"at": int(rng.integers(whole.events // 2, whole.events))})
    if ended.code != -signal.SIGKILL:
        return None
    for path in out.rglob("*"):
        os.utime(path, (time.time() + 86400,) * 2)
    return half_written(whole, out, {}) + resumed(whole, out, fault={"clock_s": -86400.0})


def recorded_clock_back(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """The camera's or the force sensor's clock jumps back at a drawn row: refused in one line, or passed over."""
    source = whole.command.source
    if source is None or not (source / "frames.csv").exists():
        return None
    path = source / str(rng.choice(["frames.csv", "forces.csv"]))
    text = path.read_text(encoding="utf-8")
    head, *rows = text.splitlines()
    column, at = head.split(",").index("time_s"), int(rng.integers(2, len(rows)))
    for number in range(at, len(rows)):
        cells = rows[number].split(",")
        cells[column] = f"{float(cells[column]) - 3600:.4f}"
        rows[number] = ",".join(cells)
    try:
        path.write_text("\n".join((head, *rows)) + "\n", encoding="utf-8")
        ended = run(whole.command, out)
    finally:
        path.write_text(text, encoding="utf-8")
    wrong = [] if ended.code == 0 else _refused(ended)
    return wrong + traceback(ended) + resumed(whole, out)


def input_changed(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """A file of the recording is cut in half, or vanishes, at a drawn moment; then it is back as it was."""
    source = whole.command.source
    if source is None:
        return None
    path = rng.choice(sorted(str(path) for path in source.glob(whole.command.changing)))
    path, data, times = Path(path), Path(path).read_bytes(), Path(path).stat()
    try:
        with started(whole.command, out) as running:
            if running[0].wait(float(rng.uniform(0.0, 0.9)) * whole.seconds) is None:
                path.write_bytes(data[: len(data) // 2]) if rng.random() < 0.5 else path.unlink()
            ended = ended_of(running)
    finally:
        path.write_bytes(data)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    wrong = [] if ended.code == 0 else _refused(ended)
    left = (
        [name for name in contents(out) if ".unfinished" in name or name.endswith(".lock")] if out.exists() else []
    )
    return wrong + traceback(ended) + [f"left {name}" for name in left] + resumed(whole, out)


def run_twice(whole: Undisturbed, out: Path, rng: np.random.Generator) -> list[str] | None:
    """A second run on the same output while the first is at work: refused in one line, the first is unharmed."""
    with started(whole.command, out) as running:
        while not (out / ".lock").exists() and running[0].wait(0.01) is None:
            pass
        if running[0].wait(float(rng.uniform(0.0, 0.2)) * whole.seconds) is not None:
            return None
        os.killpg(running[0].pid, signal.SIGSTOP)  # or it ends before the second has started
        second = run(whole.command, out)
        os.killpg(running[0].pid, signal.SIGCONT)
        first = ended_of(running)
    wrong = _refused(second) if "is being written by process" in second.said else [f"let in: {second.said[-300:]}"]
    wrong += [] if first.code == 0 else [f"the first ended with {first.code}: {first.said[-300:]}"]
    return wrong + [f"{name} differs" for name, data in contents(out).items() if data != whole.found.get(name)]


Trial = Callable[[Undisturbed, Path, np.random.Generator], list[str] | None]
