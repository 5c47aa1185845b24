"""A wrong ball radius is told from cast shadows by faces of a path tracer, whose depths are known."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from tactilevision.heightmap.shadows_seen import undo_by
from tactilevision.press import certified_faces as scale_doubt
from tactilevision.press.certified_faces import Certified, doubt_of_scale
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.rig import Indenter, Press

sys.path.insert(0, str(Path(__file__).parents[1]))
from rendered_light import SAMPLE, TRUTH, found_lamps, rendered_reconstructor

GENTLE = (1, 2, 5, 6)  # frames of faces .15 and .30 mm deep, of two radii


def drawn() -> tuple[Recording, list[Certified]]:
    """A recording with each gentle frame twice, as the press of an indenter, and its drawn depths."""
    recording = read_recording(SAMPLE)
    frames, presses, certified = [], [], []
    for place, number in enumerate(GENTLE):
        with np.load(SAMPLE / "truth" / f"frame_{number:05d}.npz") as file:
            depth_mm = float(file["depth_mm"].max())
        frames += [recording.frame_names[number]] * 2
        presses.append(Press(str(number), str(TRUTH["step"][number - 1]["radius_mm"]), place, place + 0.9))
        certified.append(Certified(str(number), place + 0.25, depth_mm))
    shapes = {
        press.indenter: Indenter(press.indenter, "flat_cylinder", float(press.indenter)) for press in presses
    }
    times = np.arange(len(frames)) / 2
    known = dataclasses.replace(
        recording, frame_names=tuple(frames), frame_times_s=times, presses=tuple(presses), indenters=shapes
    )
    return known, certified


@pytest.mark.parametrize("stated", [1.0, 1.1])
def test_a_wrong_radius_is_asked_for_whatever_shadows_do(stated: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Faces certified a tenth deeper are as those that balls stated a tenth too large tell too shallow."""
    recording, certified = drawn()
    certified = [dataclasses.replace(one, depth_mm=stated * one.depth_mm) for one in certified]
    reader = rendered_reconstructor()
    monkeypatch.setattr(scale_doubt, "find_lamps", lambda *_: found_lamps())  # it takes a while
    monkeypatch.setattr(scale_doubt, "share_seen", lambda _, one: undo_by(one, found_lamps()) and 0.58)
    pairs = [(1.09 * one.depth_mm, one.depth_mm) for one in certified]  # with shadows
    told = doubt_of_scale(recording, reader, pairs=pairs, certified=certified)
    if stated > 1:
        assert "without cast shadows is" in told
        assert "stated as 2, 4 mm really 1.8" in told
    else:
        assert "lamps cast shadows beside them" in told
        assert "the balls' radius stands" in told
    assert reader.shadows is None


def test_faces_as_certified_are_not_read_again() -> None:
    recording, certified = drawn()
    pairs = [(one.depth_mm, one.depth_mm) for one in certified]
    assert doubt_of_scale(recording, object(), pairs=pairs, certified=certified) == ""
