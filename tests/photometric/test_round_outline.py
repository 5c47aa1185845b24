"""A round finger that is stated as a flat layer is seen from the outline of the untouched gel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lamp_room import MM_PER_PX, SENSOR, flat, picture, places

from tactilevision.photometric.reference import make_reference, round_outline_px, round_outline_warning
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

RADIUS_MM, CURVATURE_MM = 4.0, 9.0
RNG = np.random.default_rng(4)


def off_centre_mm() -> Floats:
    x, y = places()
    return np.hypot(x - 0.4, y + 0.3)


def test_a_dome_stated_flat_is_named() -> None:
    x, y = places()
    height = np.sqrt(np.maximum(CURVATURE_MM**2 - x**2 - y**2, 1.0))
    seen = make_reference(
        [picture(x / height, y / height, RNG, gain=(off_centre_mm() < RADIUS_MM).astype(float)[..., None])]
    )
    assert round_outline_px(seen) == pytest.approx(RADIUS_MM / MM_PER_PX, rel=0.01)
    (said,) = round_outline_warning(seen, replace(SENSOR, gel=Gel(3.0)))
    assert '"dome" for a round finger' in said
    assert not round_outline_warning(seen, replace(SENSOR, gel=Gel(3.0, shape="disc", radius_mm=RADIUS_MM)))
    assert not round_outline_warning(seen, SENSOR)


@pytest.mark.parametrize("kind", ["whole view", "rectangle", "vignetting"])
def test_flat_gel_is_not(kind: str) -> None:
    x, y = places()
    gain = {
        "whole view": np.ones_like(x),
        "rectangle": ((abs(x) < RADIUS_MM) & (abs(y) < RADIUS_MM)).astype(float),
        "vignetting": (1 + (off_centre_mm() / RADIUS_MM) ** 2) ** -2,
    }
    assert round_outline_px(make_reference([flat(RNG, gain=gain[kind][..., None])])) is None
