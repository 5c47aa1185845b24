"""Which colours a frame does not tell, in the window that holds them; and where it lies in shadow."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.photometric.colour_change import ColourChange, common, inside, outside
from tactilevision.photometric.reference import SATURATED, Reference
from tactilevision.records.measured import Bytes

SHAPE = (50, 66)
NOISE = (1.0, 1.2, 0.9)


def scene(*, overexposed: bool) -> tuple[Reference, Bytes]:
    """A reference, and a frame with glints, of one colour and of all, and with a shadow."""
    rng = np.random.default_rng(1)
    mean = rng.uniform(60, 200, (*SHAPE, 3)).astype(np.float32)
    mean[40:43, 60:65, 1] = 254.0 if overexposed else 120.0
    rgb = np.clip(mean * 1.02 + rng.normal(0, 1.2, mean.shape), 0, 250).astype(np.uint8)
    rgb[10:14, 20:30, 0], rgb[20:22, 5:9], rgb[30:33, 41:44] = 255, 254, 2
    return Reference(mean, NOISE, rng.random(SHAPE) > 0.05), rgb


@pytest.mark.parametrize("overexposed", [False, True])
def test_what_a_frame_does_not_tell(overexposed: bool) -> None:
    reference, rgb = scene(overexposed=overexposed)
    missing = (rgb >= SATURATED) | (reference.rgb >= SATURATED)
    change = ColourChange(reference)
    frame = change.take(rgb)
    found, valid = frame.missing, frame.valid
    assert found is not None
    whole = np.zeros((*SHAPE, 3), np.bool_)
    whole[found.window] = found.missing.transpose(1, 2, 0)
    np.testing.assert_array_equal(whole, missing)
    rows, columns = np.nonzero(missing.any(axis=2))
    assert found.window == (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1))
    count = missing.sum(axis=2)
    np.testing.assert_array_equal(found.count, count[found.window])
    np.testing.assert_array_equal(found.partly, (count == 1)[found.window])
    np.testing.assert_array_equal(found.blind, (count > 1)[found.window])
    dark = rgb.max(axis=2) <= change.darkest
    assert dark.sum() == 9
    np.testing.assert_array_equal(valid, reference.usable & (count == 0) & ~dark)


@pytest.mark.parametrize("px", [1, 4, 7])
def test_tiles_that_lack_a_colour(px: int) -> None:
    reference, rgb = scene(overexposed=True)
    found = ColourChange(reference).find_missing(rgb)
    assert found is not None
    height, width = (n // px for n in SHAPE)
    lacking = np.asarray(((rgb >= SATURATED) | (reference.rgb >= SATURATED)).any(axis=2))[
        : px * height, : px * width
    ]
    tiles = lacking.reshape(height, px, width, px).any(axis=(1, 3))
    np.testing.assert_array_equal(found.tiles(px, (width, height)), 255 * tiles)


def test_a_frame_that_tells_all_colours_lacks_none() -> None:
    reference, rgb = scene(overexposed=False)
    assert ColourChange(reference).find_missing(np.minimum(rgb, SATURATED - 1)) is None


def test_a_lone_dark_pixel_is_found_in_a_bright_frame_alone() -> None:
    reference, rgb = scene(overexposed=False)
    rgb[30:33, 41:44], rgb[1, 1] = 100, 0
    change = ColourChange(reference)
    assert not change.take(rgb).valid[1, 1]
    assert change.take(np.minimum(rgb, SATURATED - 1)).valid[1, 1] == reference.usable[1, 1]


def test_windows() -> None:
    one, other = (slice(4, 9), slice(2, 5)), (slice(6, 20), slice(0, 4))
    both = common(one, other)
    assert both == (slice(6, 9), slice(2, 4))
    assert inside(both, one) == (slice(2, 5), slice(0, 2))
    assert outside(inside(both, one), one) == both
    assert common(one, (slice(9, 12), slice(2, 5))) is None
