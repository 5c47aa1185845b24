"""The grain of the ink is followed to a fraction of a pixel while the light of a contact changes over it."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_gels import SHAPE, ink, motion, origin, photograph

from tactilevision.records.measured import Bytes
from tactilevision.shear.displacement import read_untouched

SCALE = (0.08, 0.08)
STILL = np.indices(SHAPE)[::-1].astype(float)


def pictures(push: tuple[float, float], shade: float, bulge: float = 0.0) -> tuple[Bytes, Bytes]:
    before = ink(STILL[0], STILL[1], np.random.default_rng(7))
    after = ink(*origin(push, bulge), np.random.default_rng(7))
    rng = np.random.default_rng(8)
    return photograph(before, 0.0, rng), photograph(after, shade, rng)


@pytest.mark.parametrize(("push", "bulge"), [((0.0, 0.0), 0.0), ((2.0, -1.5), 1.0), ((7.0, 4.0), 0.0)])
def test_motion_comes_back_and_light_does_not_count(push: tuple[float, float], bulge: float) -> None:
    before, after = pictures(push, 0.5, bulge)
    shear = read_untouched(before, SCALE, markers=False).shear(after)
    true = motion(STILL[0], STILL[1], push_px=push, bulge_px=bulge)
    off = np.stack([shear.u_x_mm / SCALE[0] - true[0], shear.u_y_mm / SCALE[1] - true[1]])[:, shear.valid]
    assert shear.valid.mean() > 0.9
    rms = np.sqrt(np.mean(off**2))
    assert rms < 0.15
    assert 0.2 < rms * SCALE[0] / np.median(np.asarray(shear.std_mm)[shear.valid]) < 3


def test_a_gel_without_grain_has_no_known_motion() -> None:
    rng = np.random.default_rng(3)
    plain = [photograph(np.ones(SHAPE), shade, rng) for shade in (0.0, 0.5)]
    assert read_untouched(plain[0], SCALE).shear(plain[1]).valid.mean() < 0.1
