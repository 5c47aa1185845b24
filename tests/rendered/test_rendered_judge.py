"""The judge of rendered sets reads balls left out as `depth` does, shadows undone, unless it is plain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
import tomli_w

from benchmarks.rendered import judge as judge_module
from benchmarks.rendered.judge import judge

BALLS = 8


@dataclass(frozen=True)
class Stated:
    """What a set's recording has that the judge asks for."""

    balls: tuple[int, ...] = tuple(range(BALLS))
    frame_names: tuple[str, ...] = ()


def test_a_ball_held_out_calibrates_nothing_that_it_is_read_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "truth.toml").write_text(tomli_w.dumps({"ball": [{}] * BALLS, "step": []}))
    seen: dict[int, bool] = {}

    def ball(folder: Path, recording: Stated, reader: SimpleNamespace, number: int, truth: object) -> float:
        seen[number] = number in reader.kept
        return 1.0

    monkeypatch.setattr(judge_module, "read_recording", lambda folder: Stated())
    monkeypatch.setattr(judge_module, "build_reconstructor", lambda one: SimpleNamespace(kept=one.balls))
    monkeypatch.setattr(judge_module, "_ball", ball)
    ratios, steps = judge(tmp_path)
    assert (len(ratios), steps) == (BALLS, [])
    assert seen == dict.fromkeys(range(BALLS), False)
