"""Independent steps of an analysis on other processes: the results of one, whatever happens to the others."""

from __future__ import annotations

import os
import signal
import sys
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from calibration.diagnosis.score_test import ScoreTest, score_test
from calibration.effects import EFFECTS
from calibration.inputs.deadline import Each, in_turn
from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import observe
from calibration.tasks.compare import base_fit, base_model
from tactilevision.cli import main
from tactilevision.cluster.pool import Steps, step_pool
from tactilevision.errors import ConvergenceError
from tactilevision.files.runs import worker_pool
from tactilevision.recording.read import read_recording

SAMPLES = Path(__file__).parents[2] / "sample_frames"
HERE = os.getpid()


def root(number: float) -> float:
    if number < 0:
        raise ConvergenceError(f"no root of {number}")
    return float(np.sqrt(number))


def where(number: int) -> tuple[int, int]:
    return number, os.getpid()


def ends_another_process(parent: int, number: int) -> int:
    if number == 3 and os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def scores(each: Each) -> ScoreTest:
    recording = read_recording(SAMPLES / "paper_points")
    data = observe([Measured(recording, recording.points)])
    fitted = base_fit(base_model(data), data)
    effects = [EFFECTS["depth_zero"], EFFECTS["force_bias"], EFFECTS["stiffening"]]
    return score_test(fitted, effects, rng=np.random.default_rng(5), of_rig=True, each=each)


def test_a_bootstrap_shared_by_two_processes_is_that_of_one() -> None:
    alone = scores(in_turn)
    assert alone.effects
    with step_pool(2) as each:
        assert repr(scores(each)) == repr(alone)


def test_steps_come_in_order_from_other_processes_and_raise_what_they_raised() -> None:
    with step_pool(2) as each:
        fetched = [step() for step in each(where, range(9))]
        roots = list(each(root, [4.0, -1.0, 9.0]))
        assert roots[2]() == 3.0
        with pytest.raises(ConvergenceError, match=r"no root of -1"):
            roots[1]()
    assert [number for number, _ in fetched] == list(range(9))
    assert HERE not in {pid for _, pid in fetched}


def test_what_does_not_travel_is_done_here() -> None:
    offset = 2
    with step_pool(2) as each:
        assert [step() for step in each(lambda one: one + offset, [1, 2, 3])] == [3, 4, 5]


def test_one_process_does_each_step_when_it_is_fetched() -> None:
    seen: list[int] = []
    with step_pool(1) as each:
        steps = each(seen.append, [7, 8])
        next(steps)()
    assert seen == [7]


@pytest.mark.parametrize("copies", [True, False])
def test_workers_that_end_lose_nothing_and_later_steps_are_done_here(
    caplog: pytest.LogCaptureFixture, *, copies: bool
) -> None:
    """Copies of this process, and workers that are started anew since another thread runs in it."""
    ended = threading.Event()
    beside = threading.Thread(target=ended.wait)
    if not copies:
        beside.start()
    with worker_pool(2) as pool:
        each = Steps(pool)
        assert [step() for step in each(partial(ends_another_process, HERE), range(20))] == list(range(0, 40, 2))
        assert [step() for step in each(where, [1, 2])] == [(1, HERE), (2, HERE)]
    ended.set()
    assert caplog.text.count("workers are lost") == 1


@pytest.mark.slow
def test_a_diagnosis_by_two_processes_gives_the_files_of_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for workers in ("1", "2"):
        words = [
            "diagnose",
            str(SAMPLES / "hidden_material"),
            "--workers",
            workers,
            "--out",
            str(tmp_path / workers),
        ]
        monkeypatch.setattr(sys, "argv", ["tactilevision", *words])
        assert main() == 0
    for path in (tmp_path / "1").rglob("*"):
        if path.is_file() and path.name != "repeat.sh":  # it names the folder
            assert path.read_bytes() == (tmp_path / "2" / path.relative_to(tmp_path / "1")).read_bytes(), path
