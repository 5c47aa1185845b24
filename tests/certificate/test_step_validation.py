"""Flat steps out of a recording's own presses: as high as the simulation has them, and told where none are."""

from __future__ import annotations

import dataclasses
import tomllib
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.lines import Line2D
from matplotlib.path import Path as Outline
from shared_scenes import sample_reconstructor

from tactilevision.heightmap.ball_validation import Known, told
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.plots.validation import draw_depth_report
from tactilevision.press.step_validation import flat_steps
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "gelslim3"


@lru_cache
def sample() -> tuple[Recording, Reconstructor]:
    """Every other press of the sample: heights of all five are among them."""
    recording = read_recording(SAMPLE)
    return dataclasses.replace(recording, presses=recording.presses[::2]), sample_reconstructor()


@lru_cache
def steps() -> tuple[list[Known], str]:
    return flat_steps(*sample())[:2]


@pytest.mark.slow
def test_the_steps_are_as_high_as_the_simulation_made_them() -> None:
    found, why = steps()
    truth = tomllib.loads((SAMPLE / "truth.toml").read_text())
    true = sorted(press["depth_mm"] for press in truth["press"][::2] if not press["reason"])
    assert why == ""
    assert len(found) == len(true)
    assert sorted(step.true_mm for step in found) == pytest.approx(true, rel=0.02)
    assert {round(step.radius_px) for step in found} == {39}


@pytest.mark.slow
def test_their_errors_lie_within_what_the_map_states() -> None:
    off = np.array([step.found_mm - step.true_mm for step in steps()[0]])
    stated = np.array([step.stated_mm for step in steps()[0]])
    assert np.all(stated < 0.15 * np.array([step.true_mm for step in steps()[0]]))
    assert np.all(np.abs(off) < 2.0 * stated)
    assert np.mean(np.abs(off) < stated) > 0.5


def test_a_recording_without_flat_presses_says_so() -> None:
    recording, reconstructor = sample()
    balls = {name: dataclasses.replace(one, shape="sphere") for name, one in recording.indenters.items()}
    few = dataclasses.replace(recording, indenters=balls, presses=recording.presses[:2])
    found, why, certified = flat_steps(few, reconstructor)
    assert (found, why, certified) == ([], "no flat steps in this recording", ())


def test_presses_that_cannot_be_certified_are_told() -> None:
    recording, reconstructor = sample()
    found, why, certified = flat_steps(dataclasses.replace(recording, forces=None), reconstructor)
    assert (found, certified) == ([], ())
    assert "cannot be certified" in why


def test_the_figure_shows_the_steps_or_says_that_there_are_none() -> None:
    ball = Known(0.3, 0.31, 0.02, 25.0)
    card = told("held_out_balls", [ball] * 4)
    assert len(draw_depth_report({**card, **told("flat_steps", [Known(0.25, 0.24, 0.02, 39.0)] * 3)}).axes) == 4
    bare = draw_depth_report({**card, "flat_steps": "no flat steps in this recording"})
    assert bare.axes[1].get_title(loc="left") == "no flat steps in this recording"


def test_the_legend_draws_a_percent_sign_not_the_words_for_one() -> None:
    card = {**told("held_out_balls", [Known(0.3, 0.31, 0.02, 25.0)] * 4), "flat_steps": "none"}
    handles, names = draw_depth_report(card).axes[0].get_legend_handles_labels()
    mark = handles[names.index("share of a band within its deviation")]
    assert isinstance(mark, Line2D)
    marker = mark.get_marker()
    assert isinstance(marker, Outline)
    size = marker.get_extents()
    assert 1.0 < size.width / size.height < 1.6, "one letter, about as high as wide"


def test_shares_of_bands_that_lie_close_do_not_run_into_each_other() -> None:
    depths = (0.185, 0.22, 0.242, 0.25, 0.277, 0.278, 0.282, 0.293, 0.296, 0.299)  # of ten real balls
    balls = [Known(depth, depth - 0.005, 0.015, 60.0 * depth**0.5) for depth in depths]
    figure = draw_depth_report({**told("held_out_balls", balls), "flat_steps": "none"})
    figure.canvas.draw()
    for axes in figure.axes:
        boxes = [one.get_window_extent() for one in axes.texts if one.get_text().endswith("%")]
        assert len(boxes) == 3
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
