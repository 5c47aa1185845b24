"""What a height map states of untouched gel, on frames that it was not made from."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shared_scenes import sample_reconstructor

from tactilevision.heightmap.build import BLOCK_PX, untouched_std_mm
from tactilevision.heightmap.deviation import DepthError
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"
TORN = ("00017.jpg",)


def test_the_deviation_of_slow_waves_comes_back_place_by_place() -> None:
    rng = np.random.default_rng(0)
    planted = np.linspace(0.001, 0.01, 20 * BLOCK_PX) * np.ones((12 * BLOCK_PX, 1))
    waves = gaussian_filter(rng.standard_normal((16, *planted.shape)), (0, 6, 6), mode="wrap")
    waves *= planted / waves.std()
    waves -= waves.mean(axis=0)
    waves[3, 50:90, 50:90] += 0.2  # something touched already
    found = untouched_std_mm(list(waves))
    ratio = found / planted[::BLOCK_PX, BLOCK_PX // 2 :: BLOCK_PX]
    assert found.shape == (12, 20)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.07)
    assert ratio.min() > 0.6
    assert ratio.max() < 1.5


def test_the_sample_states_what_its_other_free_frames_show() -> None:
    """The frames at the ends of presses; the reconstructor has seen those at their beginnings alone."""
    recording = read_recording(SAMPLE)
    reconstructor = sample_reconstructor()
    ends = [press.end_s for press in recording.presses if press.end_s is not None]
    last = np.unique(np.searchsorted(recording.frame_times_s, np.array(ends) + 1e-3) - 1)
    whole = [number for number in last if recording.frame_names[number] not in TORN]
    maps = [reconstructor.height_map(read_frame(recording, int(number))) for number in whole[::2]]
    pulls = np.array([height.depth_mm / height.std_mm for height in maps if height.std_mm is not None])
    assert len(pulls) > 8
    corners = np.concatenate([pulls[:, :50, :50], pulls[:, -50:, :50]])
    for some in (pulls, corners, pulls[:, 100:220, 150:280]):
        assert 0.55 < np.sqrt(np.mean(some**2)) < 1.3
        assert 0.55 < np.mean(np.abs(some) < 1) < 0.93


def test_a_small_contact_beyond_the_balls_is_flagged_wherever_it_lies() -> None:
    method = sample_reconstructor().referenced
    assert method is not None
    card = dataclasses.replace(method.card, extrapolated_gain_std=[[0.3]])
    error = DepthError(dataclasses.replace(method, card=card), (0.02, 0.02))
    assert error.every > 4
    height, width = method.reference.shape[:2]
    for row, column in np.random.default_rng(0).integers(0, (height - 4, width - 4), (200, 2)):
        contact = np.zeros((height, width), np.bool_)
        contact[row : row + 4, column : column + 4] = True
        assert error.beyond_balls(contact)
    assert not error.beyond_balls(np.zeros((height, width), np.bool_))
