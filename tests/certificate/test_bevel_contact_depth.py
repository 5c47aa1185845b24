"""A touch that the height map hardly shows is read from the picture, where it is due by the law of all presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactilevision.contact.bevel import Growth, Onset, find_onset, strip_places
from tactilevision.press.bevel_contact import PILE_UP, PressSignal, find_in_pictures
from tactilevision.press.track import PressTrack
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter, Press

TOUCH_MM, EDGE_MM = 0.36, 5.0
GROWTH = Growth(0.3, 0.026)
# frames of the free gel, of half the way, and from just before the touch on, as samples keep them
DEPTH = np.concatenate([[0.0, 0.18], TOUCH_MM + np.linspace(-0.015, 0.011, 9), TOUCH_MM + np.array([0.03, 0.08])])


def press_signal(rng: np.random.Generator) -> PressSignal:
    """Colours that change beside the bevel's edge from the touch on; the rest of the track is empty."""
    s = strip_places(8.0)
    grown = GROWTH(DEPTH - TOUCH_MM)[:, None] * np.exp(-(((s - EDGE_MM) / 0.4) ** 2))
    colours = 100 + 5 * DEPTH[:, None, None] + 300 * grown[..., None] * np.array([1.0, -0.6, 0.3])
    colours += 0.05 * rng.standard_normal(colours.shape)
    empty: Floats = np.zeros(DEPTH.size)
    indenter = Indenter("A", "flat_cylinder", radius_mm=2.5, height_mm=(1 + PILE_UP) * TOUCH_MM, bevel="right")
    nothing = HeightMap(np.zeros((4, 4)), np.ones((4, 4), bool), (0.1, 0.1))
    track = PressTrack(
        Press("p", "A", 0.0, 1.0), indenter, ("",) * DEPTH.size, np.arange(DEPTH.size) / 90.0, DEPTH, 0.0,
        np.zeros((DEPTH.size, 2)), s, np.zeros((DEPTH.size, s.size)), colours, empty, empty, 0, nothing, None,
    )  # fmt: skip
    return PressSignal(track, DEPTH, np.ones(DEPTH.size, bool))


def of_height_map() -> Onset:
    found = find_onset(DEPTH, GROWTH(DEPTH - TOUCH_MM), growth=GROWTH)
    assert found is not None
    return replace(found, std=0.005, gain=200.0)


def test_an_unsure_onset_does_not_cost_the_picture_s() -> None:
    rng = np.random.default_rng(3)
    signals, sure = [press_signal(rng) for _ in range(4)], of_height_map()
    lost = replace(sure, at=TOUCH_MM - 0.13, std=0.105)
    found = find_in_pictures(signals, [sure, sure, sure, lost], distance_mm=EDGE_MM)
    assert all(one is not None and one.at == pytest.approx(TOUCH_MM, abs=0.004) for one in found)


def test_a_sure_onset_is_not_drawn_to_where_the_law_has_it() -> None:
    """A face that leans touches elsewhere: the height map saw it there, 6 % from where it is due."""
    signal = press_signal(np.random.default_rng(4))
    track = signal.track
    leaning = replace(signal, track=replace(track, indenter=replace(track.indenter, height_mm=0.41)))
    plain, leant = (
        find_in_pictures([one], [of_height_map()], distance_mm=EDGE_MM)[0] for one in (signal, leaning)
    )
    assert plain is not None
    assert leant is not None
    assert leant.at == plain.at
