"""Frames through a Dask cluster of processes of this machine, which are killed at work."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each

from tactilevision.batch.folder import reconstruct_folder
from tactilevision.batch.tree import reconstruct_tree
from tactilevision.cli import main
from tactilevision.cluster import connect, pool
from tactilevision.cluster.connect import versions
from tactilevision.cluster.pool import step_pool
from tactilevision.errors import ClusterError
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import Recording
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Sensor

pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # the cluster's own farewells

SAMPLES = Path(__file__).parents[2] / "sample_frames"
SENSOR = Sensor("custom", 64, 48, (0.1, 0.2))
POISON = 255  # a pixel in a corner that ends the process that reads it
PAUSE_S = 0.02  # s a frame, so that there is time to kill something


class SlopeOrDeath:
    """Slope along x = (red - 100)/100; the poisoned frame kills whoever reads it."""

    name = "slope or death"

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        if rgb_rectified[0, 0, 2] == POISON:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(PAUSE_S)
        red = rgb_rectified[..., 0].astype(np.float32)
        return SlopeMap((red - 100) / 100, np.zeros_like(red))


def recording(folder: Path, count: int, poisoned: int | None = None) -> Recording:
    frames = folder / "frames"
    frames.mkdir(parents=True)
    names = []
    for number in range(count):
        rgb = np.full((48, 64, 3), 100, np.uint8)
        rgb[10:20, 20 : 24 + number % 9, 0] = 120
        rgb[0, 0, 2] = POISON if number == poisoned else 0
        names.append(f"{number:03d}.png")
        cv2.imwrite(str(frames / names[-1]), rgb[..., ::-1])
    return Recording(
        folder, "r", SENSOR, frames_path=frames, frame_names=tuple(names), frame_times_s=np.arange(count) / 30
    )


def reconstructor() -> Reconstructor:
    return Reconstructor(SENSOR, SlopeOrDeath())


class Machines:
    """A scheduler and workers, each a process of its own, as on a cluster."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.folder, self.started = folder, list[subprocess.Popen[bytes]]()
        self.scheduler = self.start_scheduler()
        self.workers = [self.start_worker(), self.start_worker()]

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
        told = {"PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
        command = [sys.executable, "-m", "dask", *words]
        with (self.folder / "log").open("ab") as log:
            process = subprocess.Popen(command, cwd=self.folder, env=os.environ | told, stdout=log, stderr=log)
        self.started.append(process)
        return process

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        words = ("--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard", "--scheduler-file", "at.json")
        return self._start("scheduler", *words)

    def start_worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, "--nthreads", "1", "--no-dashboard", "--death-timeout", "60")

    def restart(self) -> None:
        self.scheduler.kill()
        self.scheduler.wait()
        for worker in self.workers:
            worker.terminate()
            worker.wait(30)
        self.scheduler, self.workers = self.start_scheduler(), [self.start_worker()]

    def end(self) -> None:
        for process in reversed(self.started):
            process.terminate()
        for process in self.started:
            process.wait(30)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    running = Machines(tmp_path_factory.mktemp("cluster"))
    yield running
    running.end()


def at(count: int, act: Callable[[], object]) -> Callable[[int, int], None]:
    """`act` once, when so many frames are done."""
    left = [act]

    def report(done: int, total: int) -> None:
        if done >= count and left:
            left.pop()()

    return report


def alike(here: Path, there: Path) -> None:
    """Two folders of results are equal byte for byte, but for the column `ms`."""
    names = sorted(path.relative_to(here) for path in here.rglob("*"))
    assert names == sorted(path.relative_to(there) for path in there.rglob("*"))
    for name in names:
        if (here / name).is_file() and name.suffix != ".csv":
            assert (here / name).read_bytes() == (there / name).read_bytes(), name
    assert without_ms(here) == without_ms(there)


def without_ms(folder: Path) -> list[list[str]]:
    lines = [line.split(",") for line in (folder / "depth.csv").read_text().splitlines()]
    ms = lines[0].index("ms")
    return [line[:ms] + line[ms + 1 :] for line in lines]


def worker_pid(machines: Machines) -> int:
    with connect.open_client(machines.address) as client:
        return int(next(iter(client.run(os.getpid).values())))


@pytest.mark.slow
def test_a_killed_worker_loses_nothing_and_doubles_nothing(machines: Machines, tmp_path: Path) -> None:
    source = recording(tmp_path / "in", 80)
    reconstruct_folder(source, reconstructor(), tmp_path / "one", workers=1)
    pid, told = worker_pid(machines), list[int]()
    kill = at(10, lambda: os.kill(pid, signal.SIGKILL))

    def report(done: int, total: int) -> None:
        told.append(done)
        kill(done, total)

    reconstruct_folder(source, reconstructor(), tmp_path / "many", cluster=machines.address, progress=report)
    alike(tmp_path / "one", tmp_path / "many")
    assert told == list(range(81))


@pytest.mark.slow
def test_a_frame_that_kills_its_workers_is_named_and_the_others_are_read(
    machines: Machines, tmp_path: Path
) -> None:
    source = recording(tmp_path / "in", 40, poisoned=21)
    rows = reconstruct_folder(source, reconstructor(), tmp_path / "out", cluster=machines.address)
    assert [row.frame for row in rows if row.status != "ok"] == ["021.png"]
    assert rows[21].status == "unreadable: it ended every process that worked on it"
    assert len(list((tmp_path / "out" / "depth").iterdir())) == 39


@pytest.mark.slow
def test_a_scheduler_that_is_started_anew_is_found_again(
    machines: Machines, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    source = recording(tmp_path / "in", 120)
    reconstruct_folder(source, reconstructor(), tmp_path / "one", workers=1)

    before = len(machines.started)
    address = str(machines.folder / "at.json")
    reconstruct_folder(
        source, reconstructor(), tmp_path / "many", cluster=address, progress=at(20, machines.restart)
    )
    assert len(machines.started) > before
    assert "the scheduler is away: waiting 600 s for it" in caplog.text
    assert "Traceback" not in caplog.text
    alike(tmp_path / "one", tmp_path / "many")


def test_a_cut_run_goes_on_and_does_next_to_nothing_again(machines: Machines, tmp_path: Path) -> None:
    source = recording(tmp_path / "in", 60)

    def cut() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_folder(
            source, reconstructor(), tmp_path / "out", cluster=machines.address, progress=at(30, cut)
        )
    told: list[int] = []
    reconstruct_folder(
        source,
        reconstructor(),
        tmp_path / "out",
        cluster=machines.address,
        progress=lambda done, total: told.append(done),
    )
    assert told == list(range(30, 61))


def test_a_tree_on_the_cluster_equals_one_process(machines: Machines, tmp_path: Path) -> None:
    sources = {name: recording(tmp_path / "in" / name, 5) for name in ("a", "b")}

    def run(out: Path, cluster: str | None) -> None:
        reconstruct_tree(
            tmp_path / "in",
            out,
            read=lambda path: sources[path.relative_to(tmp_path / "in").parts[0]],
            light=lambda _: reconstructor(),
            cluster=cluster,
            workers=1,
        )

    run(tmp_path / "one", None)
    run(tmp_path / "many", machines.address)
    alike(tmp_path / "one", tmp_path / "many")


@pytest.mark.slow
@pytest.mark.parametrize("sample", ["paper_points", "gelslim3"])
def test_recordings_calibrated_on_the_cluster_give_the_same_files(
    machines: Machines, sample: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tree of two, the newer one of which is named for its date."""
    for name, date in (("b", "2025-01-02"), ("a", "2025-01-01")):
        shutil.copytree(SAMPLES / sample, tmp_path / "in" / name)
        settings = tmp_path / "in" / name / "recording.toml"
        lines = [line for line in settings.read_text().splitlines() if not line.startswith("date")]
        settings.write_text("\n".join([f"date = {date}", *lines]))
    for out, more in (("one", ()), ("many", ("--cluster", machines.address))):
        command = ["tactilevision", "calibrate", str(tmp_path / "in"), "--out", str(tmp_path / out), *more]
        monkeypatch.setattr(sys, "argv", command)
        assert main() == 0
    names = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*"))
    assert names == sorted(path.relative_to(tmp_path / "many") for path in (tmp_path / "many").rglob("*"))
    for path in names:
        if (tmp_path / "one" / path).is_file():
            assert (tmp_path / "one" / path).read_bytes() == (tmp_path / "many" / path).read_bytes(), path


@pytest.mark.slow
def test_recordings_diagnosed_on_the_cluster_give_the_same_findings(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = []
    for out, more in (("one", ()), ("many", ("--cluster", machines.address))):
        command = ["tactilevision", "diagnose", str(SAMPLES / "paper_points"), "--out", str(tmp_path / out), *more]
        monkeypatch.setattr(sys, "argv", command)
        assert main() == 0
        said.append(capsys.readouterr().out.replace(str(tmp_path / out), "OUT"))
    assert said[0] == said[1]
    for name in ("diagnosis.json", "report.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "many" / name).read_bytes()


def tripled(number: int) -> int:
    time.sleep(PAUSE_S)
    return 3 * number


@pytest.mark.slow
def test_steps_of_an_analysis_outlive_a_worker_and_the_scheduler(machines: Machines) -> None:
    def kill() -> None:
        os.kill(worker_pid(machines), signal.SIGKILL)

    with step_pool(None, machines.address) as each:
        for act in (kill, machines.restart):
            steps = each(tripled, range(100))
            found = [next(steps)() for _ in range(10)]
            act()
            assert found + [step() for step in steps] == list(range(0, 300, 3))


def test_a_task_that_raises_says_so_here(machines: Machines) -> None:
    with pool.cluster_pool(machines.address) as workers:
        assert workers.submit(divmod, 7, 2).result(60) == (3, 1)
        with pytest.raises(ZeroDivisionError):
            workers.submit(divmod, 7, 0).result(60)


def test_workers_of_another_version_are_refused(machines: Machines, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connect, "versions", lambda: versions() | {"tactilevision": "9.9"})
    with pytest.raises(ClusterError, match=r"another version of tactilevision.*Install tactilevision 9\.9"):
        connect.check_cluster(machines.address)


@each("where", ["tcp://127.0.0.1:1", "missing.json", "no address", "tcp://nohost.invalid:8786", "tcp://localhost"])
def test_a_cluster_out_of_reach_is_one_sentence_and_nothing_is_written(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(connect, "ANSWER_S", 0.5)
    out = tmp_path / "out"
    with pytest.raises(ClusterError, match="--cluster"):
        reconstruct_folder(recording(tmp_path / "in", 3), reconstructor(), out, cluster=where)
    assert not out.exists()
    monkeypatch.setattr(sys, "argv", ["tactilevision", "tabulate", str(out), "--cluster", where])
    assert main() == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()
