"""Runs with worker processes that are interrupted, killed or starved; benchmarks/faults draws many more."""

from __future__ import annotations

import shutil
import signal
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.faults import trials
from benchmarks.faults.commands import FRAMES, Command, frame_commands, prepare
from tactilevision.errors import TactilevisionError
from tactilevision.files.runs import worker_pool
from tactilevision.files.tiff import write_tiff
from tactilevision.records.maps import HeightMap

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
sys.path.insert(0, str(Path(__file__).parents[1] / "logs"))

from drawn_logs import drawer
from lamp_sensor import saved, write_ball_folder, write_frames

KILLS = 4  # of each command
LEROBOT = Path(__file__).parents[1] / "data" / "lerobot_v3"
DRAWS = 6  # of a moment: a run that is done before it shows nothing
DONE = [f"all {DRAWS} runs were done before their moment: nothing was shown"]


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Command]:
    return prepare(tmp_path_factory.mktemp("faults"))


def more_commands(folder: Path) -> dict[str, Command]:
    """Commands that write logs, data sets, profiles and tables, on inputs made here."""
    folder.mkdir(exist_ok=True)
    made, balls = saved(folder), write_ball_folder(folder / "balls")
    frames, maps = folder / "timed", folder / "maps"
    shutil.copytree(frame_commands(folder / "frames")[0].source or folder, frames)
    (maps / "depth").mkdir(parents=True)
    height = HeightMap(np.ones((60, 80)), np.ones((60, 80), bool), (0.1, 0.1))
    for name in sorted(path.stem for path in (frames / "frames").iterdir()):
        write_tiff(maps / "depth" / f"{name}.tiff", height)
    tactile = ("--camera", "observation.images.tactile", "--sensor", str(made))
    of_balls = ("--sensor", str(balls / "sensor.toml"), "--light-only")
    live = ("--sensor", str(made), "--every", "--rate", "1000")
    both = ("--frames", "/camera", "--wrench", "/ft")
    every = (
        Command("import", ("import", str(drawer(folder)(frames=FRAMES)), *both)),
        Command("export", ("export", str(frames), "--depth", str(maps)), file="log.mcap"),
        Command("calibrate-sensor", ("calibrate-sensor", str(balls), *of_balls), file="lamp.tvs"),
        Command("lerobot", ("lerobot", str(LEROBOT), *tactile)),
        Command("live", ("live", "--camera", str(write_frames(folder / "pair")), *live), grows="live.csv"),
    )
    return {command.name: command for command in every}


@pytest.fixture(scope="module")
def more(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Command]:
    return more_commands(tmp_path_factory.mktemp("more"))


@pytest.fixture(scope="module")
def depth(tmp_path_factory: pytest.TempPathFactory) -> trials.Undisturbed:
    """Height maps by two processes."""
    folder = tmp_path_factory.mktemp("depth")
    return trials.undisturbed(frame_commands(folder / "frames")[0], folder)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_with_workers_stops_at_a_word_and_goes_on_later(
    number: signal.Signals, depth: trials.Undisturbed, tmp_path: Path
) -> None:
    """Ctrl-C: 130; SIGTERM: 143; no traceback, nothing unfinished, and the next run ends with the same bytes."""
    rng = np.random.default_rng(1)
    sooner = (replace(depth, seconds=0.6**k * depth.seconds) for k in range(DRAWS))
    tried = (trials.stopped(one, tmp_path / str(k), rng, number=number) for k, one in enumerate(sooner))
    assert next((found for found in tried if found is not None), DONE) == []


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_bytes(depth: trials.Undisturbed, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    tried = (trials.killed(depth, tmp_path / str(k), rng, at_write=True, over=False) for k in range(DRAWS))
    assert next((found for found in tried if found is not None), DONE) == []


@pytest.mark.slow
def test_a_second_run_on_the_same_output_is_refused(depth: trials.Undisturbed, tmp_path: Path) -> None:
    assert trials.run_twice(depth, tmp_path / "out", np.random.default_rng(3)) == []


def test_a_killed_worker_is_one_clear_error() -> None:
    with pytest.raises(TactilevisionError, match="a worker process was ended"), worker_pool(1) as pool:
        pool.submit(signal.raise_signal, signal.SIGKILL).result()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["depth tiff", "depth zarr", "calibrate", "force", "diagnose", "tabulate"])
def test_nothing_is_lost_or_doubled_by_kills(name: str, commands: dict[str, Command], tmp_path: Path) -> None:
    whole, rng = trials.undisturbed(commands[name], tmp_path), np.random.default_rng(4)
    for number in range(KILLS):
        out = tmp_path / str(number)
        wrong = trials.killed(whole, out, rng, at_write=bool(number % 2), over=number > 1)
        assert not wrong, (number, wrong)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["import", "export", "calibrate-sensor", "lerobot", "live"])
def test_kills_interrupts_and_full_disks_leave_whole_files(
    name: str, more: dict[str, Command], tmp_path: Path
) -> None:
    """After each, files are old or new and no others, and the next run gives the bytes of an undisturbed one."""
    once = name in ("import", "lerobot", "live")  # two refuse a folder that holds such results, one keeps its rows
    whole, rng = trials.undisturbed(more[name], tmp_path), np.random.default_rng(6)
    faults: list[trials.Trial] = [
        *(partial(trials.killed, at_write=bool(k % 2), over=k > 1 and not once) for k in range(KILLS)),
        *(partial(trials.stopped, number=number, over=not once) for number in (signal.SIGINT, signal.SIGTERM)),
        *([] if name == "live" else [trials.disk_full]),  # three rows fit on every disk
    ]
    for number, fault in enumerate(faults):
        wrong = fault(whole, tmp_path / str(number), rng)
        assert not wrong, (number, wrong)


@pytest.mark.slow
@pytest.mark.parametrize("fault", [trials.disk_full, trials.clock_back, trials.recorded_clock_back])
def test_other_faults_leave_nothing_behind(fault: trials.Trial, depth: trials.Undisturbed, tmp_path: Path) -> None:
    assert not fault(depth, tmp_path / "out", np.random.default_rng(5))
