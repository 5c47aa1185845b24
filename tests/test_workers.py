"""Worker processes: copies of a process that has one thread, else started anew; none outlives its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
needs_proc = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
HEAD = """
import os, sys, threading, time
import cv2, numpy as np
from tactilevision.files.runs import Ticker, output_lock, worker_pool

def told(number):
    time.sleep(0.05)
    return os.getpid(), list(started), number

started = []

def begin(word):
    started.append(word)

"""
LAST = """
with output_lock(sys.argv[1]), worker_pool(2, begin, "begun") as pool:
    said = [one.result() for one in [pool.submit(told, k) for k in range(8)]]
assert [number for _, _, number in said] == list(range(8))
assert all(begun == ["begun"] for _, begun, _ in said)
assert started == [] and os.getpid() not in {process for process, _, _ in said}
print("all told", flush=True)
"""


def script(folder: Path, middle: str, last: str = LAST) -> subprocess.CompletedProcess[str]:
    path = folder / "script.py"
    path.write_text(HEAD + middle + last)
    command = [sys.executable, "-W", "error", str(path), str(folder / "out")]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT, check=False)


@needs_proc
def test_a_script_without_a_main_guard_starts_workers_that_are_copies(tmp_path: Path) -> None:
    done = script(tmp_path, "")
    assert (done.stdout, done.stderr) == ("all told\n", "")


@needs_proc
def test_threads_of_opencv_and_of_progress_rest_meanwhile_and_go_on(tmp_path: Path) -> None:
    middle = """
cv2.GaussianBlur(np.zeros((2000, 2000, 3), np.float32), (0, 0), 3)
ticks = []
beside = Ticker(lambda: ticks.append(0), 0.02)
beside.__enter__()
threads = cv2.getNumThreads()
"""
    after = "assert cv2.getNumThreads() == threads\nseen = len(ticks)\ntime.sleep(0.2)\nassert len(ticks) > seen\n"
    done = script(tmp_path, middle, LAST + after)
    assert (done.stdout, done.stderr) == ("all told\n", "")


def test_beside_another_thread_workers_are_started_anew_and_a_missing_guard_is_named(tmp_path: Path) -> None:
    thread = "other = threading.Event()\nthreading.Thread(target=other.wait, daemon=True).start()\n"
    done = script(tmp_path, thread)
    assert done.returncode != 0
    assert "imports the script that started it" in done.stderr
    assert 'Put the call under `if __name__ == "__main__":`, or give workers=1.' in done.stderr
    indented = "".join(f"    {line}\n" for line in (thread + LAST).splitlines())
    guarded = script(tmp_path, f"if __name__ == '__main__':\n{indented}", "")
    assert (guarded.stdout, guarded.stderr) == ("all told\n", "")


@needs_proc
@pytest.mark.parametrize("ended_by", [signal.SIGKILL, signal.SIGTERM])
def test_workers_end_with_their_parent(tmp_path: Path, ended_by: signal.Signals) -> None:
    path = tmp_path / "script.py"
    path.write_text(HEAD + "def busy(k):\n    os.write(1, b'%d\\n' % os.getpid())\n    time.sleep(60)\n"
                    "with worker_pool(2) as pool:\n    list(pool.map(busy, range(2)))\n")  # fmt: skip
    with subprocess.Popen([sys.executable, str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT) as parent:
        assert parent.stdout is not None
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        assert parent.pid not in workers
        parent.send_signal(ended_by)
        parent.wait(10)
        until = time.monotonic() + 5
        while (left := [one for one in workers if _runs(one)]) and time.monotonic() < until:
            time.sleep(0.02)
    assert left == []


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1][:3]
    except (ProcessLookupError, FileNotFoundError):
        return False
