"""What drifted is told apart: all lamps alike, under stray light or not, one lamp, a lean of the whole light."""

from __future__ import annotations

import numpy as np
import pytest
from lamp_room import SHAPE, ball, picture, places

from tactilevision.photometric import make_reference
from tactilevision.photometric.change import ColourChange
from tactilevision.photometric.drift import Drift, DriftTracker
from tactilevision.photometric.drift_kind import slopes_beside
from tactilevision.records import Floats

BRIGHT = 3.0  # pictures of a hundred grey levels
FLAT = np.zeros(SHAPE)


def tracker(stray_grey: float, rng: np.random.Generator) -> DriftTracker:
    flats = [picture(FLAT, FLAT, rng, stray_grey=stray_grey, bright=BRIGHT) for _ in range(3)]
    return DriftTracker(make_reference(flats))


def drift(gain: float | Floats, *, contact_mm: float = 0.0, stray_grey: float = 0.0, seed: int = 0) -> Drift:
    """The drift found in a frame whose lamps give `gain` of their light."""
    rng = np.random.default_rng(seed)
    following = tracker(stray_grey, rng)
    p, q = ball((2.5, 1.0), contact_mm, 8.0)[1:] if contact_mm else (FLAT, FLAT)
    return following.measure(picture(p, q, rng, gain=gain, stray_grey=stray_grey, bright=BRIGHT))


@pytest.mark.parametrize("gain", [0.95, 1.05])
@pytest.mark.parametrize("contact_mm", [0.0, 2.0, 3.6])
def test_lamps_that_fade_alike_leave_no_pattern(gain: float, contact_mm: float) -> None:
    told = drift(gain, contact_mm=contact_mm)
    found, off = told.gains, told.gains[:, 0] - (gain - 1.0)
    assert told.covariance is not None
    assert np.abs(off).max() < (0.006 if contact_mm > 3 else 0.002), "the gel beside a large ball is no drift"
    assert np.all(np.abs(off) < 2.5 * np.sqrt(told.covariance[:, 0, 0])), "and how well that is known is said"
    assert np.abs(found[:, 1:3]).max() < 0.001
    assert np.abs(found[:, 3]).max() < 0.2, "grey levels"


@pytest.mark.parametrize("contact_mm", [0.0, 1.8])
def test_stray_light_that_does_not_fade_is_found(contact_mm: float) -> None:
    found = drift(0.95, contact_mm=contact_mm, stray_grey=40.0).gains
    assert found[:, 0] == pytest.approx(-0.05, abs=0.005)
    assert found[:, 3] == pytest.approx(0.05 * 40.0, abs=0.5), "grey levels that the fading is too large by"


def test_a_lean_of_all_lights_is_believed_where_the_whole_gel_shows_it() -> None:
    lean = (0.95 * (1.0 + 0.01 * places()[1] / places()[1].max()))[..., None]
    found = drift(lean).gains
    assert found[:, 2] == pytest.approx(np.full(3, 0.0095), abs=0.003)


def test_a_frame_of_faded_lamps_shows_no_change() -> None:
    rng = np.random.default_rng(1)
    flats = [picture(FLAT, FLAT, rng, stray_grey=40.0, bright=BRIGHT) for _ in range(3)]
    change = ColourChange(make_reference(flats))
    for gain in (0.95, 1.0, 1.05):
        seen = change.measure(picture(FLAT, FLAT, rng, gain=gain, stray_grey=40.0, bright=BRIGHT))[0]
        halves = [float(seen[c, rows].mean()) for c in range(3) for rows in (slice(0, 90), slice(90, 180))]
        assert np.abs(halves).max() < 1.5e-3, "stray light taken off again when it is gone"


@pytest.mark.parametrize("lamp", [0, 1, 2])
def test_a_lamp_that_fades_in_three_channels_takes_its_pattern_along(lamp: int) -> None:
    """Where it shone brightest most is gone, in each channel its own part: no plane, and no change of the gel."""
    rng, gains = np.random.default_rng(2), [0.92 if number == lamp else 1.0 for number in range(3)]
    flats = [picture(FLAT, FLAT, rng, bright=BRIGHT) for _ in range(3)]
    change = ColourChange(make_reference(flats))
    p, q = ball((2.5, 1.0), 1.5, 8.0)[1:]
    seen = change.measure(picture(p, q, rng, bright=BRIGHT, lamps=gains))[0].copy()
    plain = change.measure(picture(p, q, rng, bright=BRIGHT))[0]
    off = (seen - plain)[:, 8:-8, 8:-8].reshape(3, 4, 41, 4, 56).mean(axis=(2, 4))
    assert np.abs(off).max() < 4e-3, "a plane leaves .01"


def test_the_gel_falls_away_from_a_contact_on_all_sides() -> None:
    touched = np.zeros((21, 31), np.bool_)
    touched[9:12, 14:17] = True
    x, y = slopes_beside(touched).reshape(6, 21, 31)[:2]
    assert x[10, 5] > 0 > x[10, 25]
    assert y[3, 15] > 0 > y[17, 15]
    assert abs(x[10, 5]) < abs(x[10, 11]), "less, farther away"
