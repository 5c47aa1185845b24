"""What drifted is told apart: all lamps alike, under stray light or not, one lamp, a lean of the whole light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from each import each
from lamp_room import SHAPE, ball, picture, places

from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.drift import (
    SLOPE_SHARE,
    Drift,
    DriftTracker,
    Response,
    drift_of,
    likely_slopes,
    noise_of,
    solid,
    undo_drift,
)
from tactilevision.photometric.reference import make_reference
from tactilevision.records.measured import Bytes, Floats

BRIGHT = 3.0  # pictures of a hundred grey levels
FLAT = np.zeros(SHAPE)
LIGHT = Response(power=1)  # what these pictures are made of


def tracker(stray_grey: float, rng: np.random.Generator) -> DriftTracker:
    flats = [picture(FLAT, FLAT, rng, stray_grey=stray_grey, bright=BRIGHT) for _ in range(3)]
    return DriftTracker(make_reference(flats), LIGHT)


def drift(gain: float | Floats, *, contact_mm: float = 0.0, stray_grey: float = 0.0, seed: int = 0) -> Drift:
    """The drift found in a frame whose lamps give `gain` of their light."""
    rng = np.random.default_rng(seed)
    following = tracker(stray_grey, rng)
    p, q = ball((2.5, 1.0), contact_mm, 8.0)[1:] if contact_mm else (FLAT, FLAT)
    return following.measure(picture(p, q, rng, gain=gain, stray_grey=stray_grey, bright=BRIGHT))


@each("gain", [0.95, 1.05])
@each("contact_mm", [0.0, 2.0, 3.6])
def test_lamps_that_fade_alike_leave_no_pattern(gain: float, contact_mm: float) -> None:
    rng = np.random.default_rng(0)
    following = tracker(0.0, rng)
    p, q = ball((2.5, 1.0), contact_mm, 8.0)[1:] if contact_mm else (FLAT, FLAT)
    told = following.measure(picture(p, q, rng, gain=gain, stray_grey=0.0, bright=BRIGHT))
    off = _left(following, told, picture(FLAT, FLAT, rng, gain=gain, stray_grey=0.0, bright=BRIGHT))
    assert np.abs(off.mean(axis=1)).max() < (0.004 if contact_mm > 3 else 0.001), "a ball is no drift"
    assert np.abs(told.gains[:, 1:]).max() < 0.001
    assert told.covariance is not None
    effects = following.effects.transpose(0, 2, 1) / following.level[:, :, None]
    for c in range(3):
        known = told.covariance[6 * c : 6 * c + 6, 6 * c : 6 * c + 6]
        stated = np.einsum("nk,kl,nl->n", effects[c], known, effects[c]).mean()
        assert off[c].mean() ** 2 < 2.5**2 * stated, "and how well that is known is said"


def _left(following: DriftTracker, told: Drift, rgb: Bytes) -> Floats:
    """What a drift leaves (3, blocks) of a picture of the untouched gel, in parts of it."""
    seen = (
        rgb
        if told.undo is None
        else undo_drift(rgb.transpose(2, 0, 1), told.undo, power=following.power).transpose(1, 2, 0)
    )
    blocks = seen.reshape(20, 9, 24, 10, 3).mean(axis=(1, 3)).reshape(-1, 3).T
    y, x = (places.ravel() for places in np.mgrid[-1:1:20j, -1:1:24j])
    gain = 1.0 + told.gains @ np.stack([np.ones_like(x), x, y])
    bright = picture(FLAT, FLAT, np.random.default_rng(5), stray_grey=0.0, bright=BRIGHT, noise=0.0)
    level = bright.reshape(20, 9, 24, 10, 3).mean(axis=(1, 3)).reshape(-1, 3).T
    return np.asarray(blocks / gain / level - 1.0)


@pytest.mark.parametrize("contact_mm", [0.0, 1.8])
def test_stray_light_that_does_not_fade_is_found(contact_mm: float) -> None:
    undo = drift(0.95, contact_mm=contact_mm, stray_grey=40.0).undo
    assert undo is not None
    assert np.diag(undo) == pytest.approx(1 / 0.95, abs=0.006)
    assert undo[:, 3] == pytest.approx(-40.0 * (1 / 0.95 - 1.0), abs=0.5), "grey levels that do not fade"


def test_a_lean_of_all_lights_is_believed_where_the_whole_gel_shows_it() -> None:
    lean = (0.95 * (1.0 + 0.01 * places()[1] / places()[1].max()))[..., None]
    found = drift(lean).gains
    assert found[:, 2] == pytest.approx(np.full(3, 0.0095), abs=0.003)


def test_a_frame_of_faded_lamps_shows_no_change() -> None:
    rng = np.random.default_rng(1)
    flats = [picture(FLAT, FLAT, rng, stray_grey=40.0, bright=BRIGHT) for _ in range(3)]
    change = ColourChange(make_reference(flats), LIGHT)
    for gain in (0.95, 1.0, 1.05):
        seen = change.measure(picture(FLAT, FLAT, rng, gain=gain, stray_grey=40.0, bright=BRIGHT))[0]
        halves = [float(seen[c, rows].mean()) for c in range(3) for rows in (slice(0, 90), slice(90, 180))]
        assert np.abs(halves).max() < 1.5e-3, "stray light taken off again when it is gone"


@each("power", [1, 2])
@each("lamp", [0, 1, 2])
def test_a_lamp_that_fades_in_three_channels_takes_its_pattern_along(lamp: int, power: int) -> None:
    """Where it shone brightest most is gone, in each channel its own part: no plane, and no change of the gel."""
    gains = [0.92 if number == lamp else 1.0 for number in range(3)]
    assert _passing_for_gel(gains, 0.0, contact_mm=1.5, power=power) < 4e-3, "a plane leaves .01"


@pytest.mark.parametrize("power", [1, 2])
def test_lamps_that_fade_apart_under_a_lean_leave_little(power: int) -> None:
    assert _passing_for_gel([0.94, 1.05, 0.97], 0.02, contact_mm=3.0, power=power) < 4e-3, (
        "one of both leaves .0065"
    )


def _passing_for_gel(gains: Sequence[float], lean: float, *, contact_mm: float, power: int) -> float:
    """What lamps of `gains`, and a lean in x, change of a ball's colours at most, in means over blocks."""
    rng = np.random.default_rng(2)

    def seen(p: Floats, q: Floats, lamps: Sequence[float], lean: float = 0.0) -> Bytes:
        gain = 1.0 + lean * places()[0] / places()[0].max()
        light = picture(p, q, rng, bright=BRIGHT, lamps=lamps, noise=0.1, gain=gain[..., None])
        return light if power == 1 else np.rint(np.sqrt(255.0 * light)).astype(np.uint8)

    change = ColourChange(make_reference([seen(FLAT, FLAT, (1.0, 1.0, 1.0)) for _ in range(3)]), Response(power))
    p, q = ball((2.5, 1.0), contact_mm, 8.0)[1:]
    faded = change.measure(seen(p, q, gains, lean))[0].copy()
    plain = change.measure(seen(p, q, (1.0, 1.0, 1.0)))[0]
    off = (faded - plain)[:, 8:-8, 8:-8].reshape(3, 4, 41, 4, 56).mean(axis=(2, 4))
    return float(np.abs(off).max())


def test_slopes_are_expected_beside_a_contact_in_proportion_to_those_under_it() -> None:
    touched = np.zeros((21, 31), np.bool_)
    touched[8:13, 13:18] = True
    rng = np.random.default_rng(0)
    answers, under = rng.standard_normal((3, 2, 21 * 31)), 0.2 * rng.standard_normal((2, 21 * 31))
    likely = likely_slopes(np.einsum("ckb,kb->cb", answers, under), answers, touched=touched)
    steep = (likely / answers).reshape(3, 2, 21, 31)
    assert steep[0, 0, 10, 15] == pytest.approx(SLOPE_SHARE * 0.2 * np.sqrt(np.log(2)), rel=0.3)
    assert steep[:, :, 10, 17 + 3] == pytest.approx(
        steep[0, 0, 10, 15] * np.exp(-3 / np.sqrt(25 / np.pi)), rel=1e-3
    )


def test_slopes_that_colours_show_are_no_drift() -> None:
    """All of the gel round a contact slopes one way, and its lamps are as they were."""
    rng, blocks = np.random.default_rng(1), 600
    terms = np.zeros((3, 6, blocks))
    terms[:, :3] = 100.0 * np.stack([np.ones(blocks), *rng.uniform(-1, 1, (2, blocks))])
    answers = 100.0 * rng.standard_normal((3, 2, 1)) + 10.0 * rng.standard_normal((3, 2, blocks))
    change = answers[:, 0] * 0.05 + rng.standard_normal((3, blocks))
    drifts = [
        drift_of(change, np.ones(blocks), terms=terms, slopes=slopes, gain=np.full(3, 0.01), power=1)[0]
        for slopes in (None, 0.1 * answers)
    ]
    plain, told = (float(np.abs(drift[:, 0]).max()) for drift in drifts)
    assert plain > 0.03
    assert told < 0.003


def test_noise_is_what_blocks_differ_by_from_their_neighbours() -> None:
    rng, (y, x) = np.random.default_rng(3), np.mgrid[:21, :28]
    noisy = 0.4 * rng.standard_normal((3, 21, 28)) + 0.3 * (x + y * x / 20)
    assert noise_of(noisy, np.ones((21, 28))) == pytest.approx(0.4, rel=0.1)
    assert noise_of(noisy, np.zeros((21, 28))) == 1.0, "nothing known"


def test_lone_blocks_are_no_contact_and_the_others_stay_in_place() -> None:
    touched = np.zeros((6, 7), bool)
    touched[0:2, 0:3] = touched[4:6, 5:7] = True
    lone = touched.copy()
    lone[4, 2] = lone[0, 5] = lone[3, 5] = True
    assert np.array_equal(solid(lone), touched)
