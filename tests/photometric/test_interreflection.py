"""Light from gel to gel, held against the exact exchange between a long wall and the level beside it."""

from __future__ import annotations

import numpy as np
import pytest

from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.interreflection import reflected, without
from tactilevision.photometric.illumination.lamps import Lamp, Lamps
from tactilevision.records.measured import Floats

SHAPE, MM_PER_PX = (400, 240), (0.05, 0.05)
ONE_EACH = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def field() -> LightField:
    """Three far lamps 27 degrees high, one a channel, the first to the right."""
    first, second, third = (
        Lamp(2 * np.pi * k / 3, 2000.0, 1000.0, 10.0, 0.0, colour) for k, colour in enumerate(ONE_EACH)
    )
    return LightField.of(Lamps((first, second, third), power=1.0, misfit=0.0), SHAPE, MM_PER_PX)


def wall(height_mm: float) -> tuple[Floats, Floats]:
    """A long level step that falls towards +x within .2 mm, and the distance (W,) mm from its foot."""
    x = np.asarray((np.arange(SHAPE[1]) - SHAPE[1] / 2) * MM_PER_PX[0], np.float64)
    line = np.asarray(height_mm * np.clip(0.5 - x / 0.2, 0.0, 1.0), np.float64)
    return np.broadcast_to(line, SHAPE).copy(), x


def test_a_long_wall_shines_as_the_exact_exchange_has_it() -> None:
    """Half of (1 - s/sqrt(s^2 + w^2)) of the wall's light, 2 of level gel's under a lamp of tangent .5.

    Cells of a quarter of a millimetre blur the wall, and a third to a half of it is lost beside the foot.
    """
    depth, s = wall(0.5)
    factor = reflected(field(), depth, reflectance=0.5)[SHAPE[0] // 2, :, 0]
    for place, least in ((0.8, 0.4), (1.2, 0.5), (2.0, 0.65), (3.0, 0.7)):
        exact = 0.5 * 2.0 * 0.5 * (1 - place / np.hypot(place, 0.5))
        assert least < (np.interp(place, s, factor) - 1) / exact < 1.0


def test_it_grows_as_the_square_of_the_depth_and_only_brightens() -> None:
    gentle, deep = (reflected(field(), wall(height)[0])[SHAPE[0] // 2] for height in (0.2, 0.4))
    at = np.searchsorted(wall(0.2)[1], 1.5)
    assert (deep[at, 0] - 1) / (gentle[at, 0] - 1) == pytest.approx(4.0, rel=0.25)
    assert min(gentle.min(), deep.min()) >= 1.0
    assert deep[at, 1] - 1 < 0.3 * (deep[at, 0] - 1), "a lamp behind the wall leaves it dark"


def test_level_gel_sends_itself_nothing() -> None:
    assert np.all(reflected(field(), np.zeros(SHAPE)) == 1.0)


def test_thousandths_of_a_grey_level_are_not_lost() -> None:
    rgb = np.full((*SHAPE, 3), 100, np.uint8)
    factor = np.full(rgb.shape, 1.002, np.float32)
    assert without(rgb, factor).mean() == pytest.approx(100 / 1.002, abs=0.01)
    assert np.array_equal(without(rgb, np.ones_like(factor)), rgb)
