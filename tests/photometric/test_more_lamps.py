"""Two lamps of one colour on different sides, drawn by the small renderer: balls and untouched gel tell both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from lamp_room import MM_PER_PX, SHAPE, ball, picture, places, presses

from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.illumination.cast_shadow import LightField, dimming, visibility
from tactilevision.photometric.illumination.glossy_lamps import fit_glossy_lamps
from tactilevision.photometric.illumination.lamps import BEST_MISFIT, Lamps, fit_lamps
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Floats

RED, GREEN, BLUE = (0.6, 0.07, 0.04), (0.06, 0.5, 0.09), (0.04, 0.08, 0.6)
AT = ((-20.0, 1.0, 8.5), (21.0, 0.0, 11.0), (0.5, -19.0, 8.0), (0.0, 18.0, 9.5))  # mm; the fourth is red, too
TINTS = np.array([RED, GREEN, BLUE, RED])
SCALE = (MM_PER_PX, MM_PER_PX)
Place = tuple[float, float, float]


def shown(p: Floats, q: Floats, rng: np.random.Generator, at: Sequence[Place], stain: Floats | float) -> Floats:
    bright = 6.0 * np.asarray(stain)[..., None]
    seen = picture(
        p,
        q,
        rng,
        at=at,
        tints=TINTS[: len(at)],
        lamps=[1.0] * len(at),
        stray_grey=2.0 * float(np.min(stain)),
        gain=bright,
    )
    return np.asarray(seen)


def told(at: Sequence[Place], *, stain: Floats | float = 1.0) -> Lamps:
    """The lamps that twelve balls, and the untouched gel of brightness `stain` (H, W), tell."""
    rng, level = np.random.default_rng(2), np.zeros(SHAPE)
    reference = make_reference([shown(level, level, rng, at, stain).astype(np.uint8) for _ in range(3)])
    change, x_y, rows = ColourChange(reference), places(), []
    for centre, contact in presses(12, rng):
        z, p, q = ball(centre, contact, 4.0)
        seen, _, _ = change.measure(shown(p, q, rng, at, stain).astype(np.uint8))
        under = np.flatnonzero(np.hypot(x_y[0] - centre[0], x_y[1] - centre[1]) < 0.9 * contact)
        under = rng.choice(under, 30, replace=False)
        half = 0.5 * (np.array(SHAPE[::-1]) - 1) * MM_PER_PX
        where = np.stack([one.ravel()[under] for one in x_y], axis=1) / half
        slopes = np.stack([p.ravel()[under], q.ravel()[under]], axis=1)
        rows.append((seen.reshape(3, -1)[:, under].T, slopes, where, z.ravel()[under]))
    changes, slopes, where, z = (np.concatenate(part) for part in zip(*rows, strict=True))
    found = fit_lamps(changes, slopes, place=where, reference=reference, mm_per_px=SCALE)
    assert found is not None
    if found.doubtful:
        return found
    refined = fit_glossy_lamps(
        changes, slopes, height_mm=z, place=where, reference=reference, mm_per_px=SCALE, like=found
    )
    return replace(found, refined=refined)


def off_deg(found: Lamps, at: Place) -> float:
    """How far the nearest lamp's azimuth lies off."""
    turns = [np.exp(1j * (lamp.azimuth_rad - np.arctan2(at[1], at[0]))) for lamp in found.lamps]
    return float(np.degrees(min(abs(np.angle(turn)) for turn in turns)))


@lru_cache
def two_reds() -> Lamps:
    return told(AT)


def test_each_lamp_of_a_colour_that_has_two_is_found_on_its_side() -> None:
    found = two_reds()
    assert len(found.lamps) == 4
    assert not found.doubtful
    assert found.refined is not None
    for one in (found, found.refined):
        assert all(off_deg(one, at) < 6 for at in AT)
        assert sum(np.argmax(lamp.colour) == 0 for lamp in one.lamps) == 2


def test_three_lamps_stay_three() -> None:
    found = told(AT[:3])
    assert len(found.lamps) == 3
    assert not found.doubtful
    assert all(off_deg(found, at) < 6 for at in AT[:3])


def test_lamps_of_a_dim_picture_are_told_within_its_noise() -> None:
    """At 8 to 10 grey levels a pixel's noise is ten times what lamps are off by."""
    found = told(AT[:3], stain=0.15)
    assert found.refined is not None
    assert max(found.misfit, found.refined.misfit) < BEST_MISFIT
    for x, y, z in AT[:3]:
        lamp = min(
            found.refined.lamps, key=lambda one: abs(np.exp(1j * one.azimuth_rad) - (x + 1j * y) / np.hypot(x, y))
        )
        assert lamp.height_mm / lamp.distance_mm == pytest.approx(z / np.hypot(x, y), rel=0.15)


@pytest.mark.slow
def test_gel_of_which_half_is_stained_is_lit_by_no_lamps_that_could_be_told() -> None:
    """A stain dims balls and untouched gel alike, so that no ball speaks for another lamp."""
    x, _ = places()
    found = told(AT[:3], stain=np.where(np.abs(x) < 4.0, 1.0, 0.6))
    assert found.doubtful


def test_either_lamp_of_a_colour_casts_its_own_shadow() -> None:
    """Of a block's foot a lamp of two is kept off: the colour keeps the other's share."""
    found = two_reds()
    block = np.zeros(SHAPE)
    block[70:110, 100:140] = 0.5
    field = LightField.of(found, SHAPE, SCALE)
    seen = visibility(found, block, SCALE)
    assert seen.shape == (4, *SHAPE)
    left = dimming(field, block, seen) ** found.power  # red comes from the left and from below (y down)
    right, above = left[90, 145], left[65, 120]
    for foot in (right, above):
        assert 0.15 < foot[0] < 0.85, "one of two red lamps is hidden"
    assert right[1] > 0.9
    assert left[90, 95, 1] < 0.4, "the only green lamp is hidden"
    assert left[90, 95, 0] > 0.9
