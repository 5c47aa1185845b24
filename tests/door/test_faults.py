"""Runs with worker processes that are interrupted, killed or starved; benchmarks/faults draws many more."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.faults import trials
from benchmarks.faults.commands import Command, frame_commands, prepare
from tactilevision.errors import TactilevisionError
from tactilevision.files.runs import worker_pool

KILLS = 4  # of each command
DRAWS = 6  # of a moment: a run that is done before it shows nothing
DONE = [f"all {DRAWS} runs were done before their moment: nothing was shown"]


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Command]:
    return prepare(tmp_path_factory.mktemp("faults"))


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
@pytest.mark.parametrize("fault", [trials.disk_full, trials.clock_back, trials.recorded_clock_back])
def test_other_faults_leave_nothing_behind(fault: trials.Trial, depth: trials.Undisturbed, tmp_path: Path) -> None:
    assert not fault(depth, tmp_path / "out", np.random.default_rng(5))
