"""A video whose frames are copies says so, and how far that may put the clocks off."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.press.track import allow_for_repeats, note_repeats, repeated_share
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Estimate, Floats

TIMES = np.arange(40) / 14


def film(rng: np.random.Generator, *, group: int) -> list[Frame]:
    """Noisy frames; all but the first of each group repeat nine tenths of what they show."""
    frames: list[Frame] = []
    for k, time in enumerate(TIMES):
        rgb = rng.integers(100, 108, (60, 80, 3), dtype=np.uint8)
        if k % group:
            keep = rng.random((60, 80)) < 0.9
            rgb[keep] = frames[-1].rgb[keep]
        frames.append(Frame(rgb, float(time)))
    return frames


def share_of(frames: list[Frame]) -> float:
    alike: list[float] = []
    assert list(note_repeats(frames, alike)) == frames
    return repeated_share(alike)


def test_copied_frames_widen_the_clocks() -> None:
    share = share_of(film(np.random.default_rng(0), group=12))
    assert share == pytest.approx(0.9, abs=0.03)
    offset, notes = allow_for_repeats(Estimate(0.02, 0.001, (0.018, 0.022), "s"), share, times_s=TIMES)
    assert offset.value == 0.02
    assert offset.std == pytest.approx(1 / 14, rel=0.01)
    assert offset.interval95 is not None
    assert offset.interval95[1] == pytest.approx(0.02 + 1.96 / 14, rel=0.01)
    assert "compressed" in notes[0]


@pytest.mark.parametrize("still", [False, True])
def test_frames_seen_anew_do_not(still: bool) -> None:
    rng = np.random.default_rng(1)
    frames = film(rng, group=1)
    if still:  # a picture without noise is the same throughout, and no group of pictures begins anywhere
        frames = [Frame(frames[0].rgb, float(time)) for time in TIMES]
    found = Estimate(0.02, 0.001, (0.018, 0.022), "s")
    assert allow_for_repeats(found, share_of(frames), times_s=TIMES) == (found, ())


def test_too_few_frames_say_nothing() -> None:
    values: Floats = np.array([0.1, 0.9, 0.9])
    assert repeated_share(list(values)) == 0.0
