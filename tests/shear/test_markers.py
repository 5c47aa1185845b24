"""Drawn markers come back where the formula puts them, through large motion, loss, and the contact's own light."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_gels import SHAPE, marks, motion, origin, photograph

from tactilevision.errors import InputError
from tactilevision.photometric.markers import evenly_spaced
from tactilevision.records.measured import Bytes, Floats
from tactilevision.shear.displacement import LOST, find_markers, follow_markers, read_untouched

SCALE = (0.08, 0.08)
REAL = Path(__file__).parents[2] / ".." / "shared" / "real" / "gelslim3_mcubelab"
STILL = np.indices(SHAPE)[::-1].astype(float)


def pictures(
    push: tuple[float, float], *, shade: float = 0.5, bulge: float = 0.0, lost: Floats | None = None
) -> tuple[Bytes, Bytes]:
    rng = np.random.default_rng(4)
    before = photograph(marks(STILL[0], STILL[1]), 0.0, rng)
    skip = None if lost is None else lost.astype(bool)
    return before, photograph(marks(*origin(push, bulge), skip), shade, rng)


def test_places_are_found_to_a_tenth_of_a_pixel() -> None:
    found = find_markers(photograph(marks(STILL[0], STILL[1]), 0.0, np.random.default_rng(1)))
    assert len(found) == 13 * 17
    assert evenly_spaced(found)
    off = found - (12 + 18 * np.round((found - 12) / 18))
    assert np.sqrt(np.mean(off**2)) < 0.12


def test_light_alone_moves_nothing() -> None:
    before, after = pictures((0.0, 0.0), shade=0.6)
    moved = follow_markers(find_markers(before), find_markers(after))
    assert moved.found.all()
    assert np.hypot(*moved.motion_px.T).max() < 0.6
    assert np.sqrt(np.mean(moved.motion_px**2)) < 0.15


@pytest.mark.parametrize(("push", "bulge"), [((3.0, -2.0), 2.0), ((15.0, 10.0), 0.0)])
def test_motion_is_followed_also_beyond_half_a_spacing(push: tuple[float, float], bulge: float) -> None:
    before, after = pictures(push, bulge=bulge)
    shear = read_untouched(before, SCALE).shear(after)
    true = motion(STILL[0], STILL[1], push_px=push, bulge_px=bulge)
    off = np.stack([shear.u_x_mm / SCALE[0] - true[0], shear.u_y_mm / SCALE[1] - true[1]])[:, shear.valid]
    assert shear.flags == ()
    assert np.sqrt(np.mean(off**2)) < 0.25
    assert 0.3 < np.sqrt(np.mean(off**2)) * SCALE[0] / float(np.max(shear.std_mm)) < 2


def test_lost_markers_are_bridged_and_said() -> None:
    lost = np.zeros((13, 17))
    lost[4:7, 8:10] = 1
    before, after = pictures((4.0, 3.0), lost=lost)
    shear = read_untouched(before, SCALE).shear(after)
    true = motion(STILL[0], STILL[1], push_px=(4.0, 3.0))
    off = np.hypot(shear.u_x_mm / SCALE[0] - true[0], shear.u_y_mm / SCALE[1] - true[1])
    assert off[shear.valid].max() < 1.2
    assert shear.flags == ()
    lost[2:9, 3:15] = 1
    before, after = pictures((4.0, 3.0), lost=lost)
    assert any(LOST in flag for flag in read_untouched(before, SCALE).shear(after).flags)


def test_a_frame_without_markers_is_refused_where_they_are_promised_and_unknown_where_they_vanish() -> None:
    before, after = pictures((0.0, 0.0))
    grey = np.full_like(before, 120)
    with pytest.raises(InputError, match="too few markers"):
        read_untouched(grey, SCALE, markers=True)
    with pytest.raises(InputError, match="differ in size"):
        read_untouched(before, SCALE).shear(after[1:])
    vanished = read_untouched(before, SCALE, markers=True).shear(grey)
    assert not vanished.valid.any()
    assert any(LOST in flag for flag in vanished.flags)


@pytest.mark.skipif(not REAL.exists(), reason="real frames are not at hand")
def test_real_markers_part_from_a_pressed_ball() -> None:
    """GelSlim 3.0, ball presses: the surface beside a ball moves away from it; far away it stays."""
    maps = np.load(REAL / "abe_corr.npz", allow_pickle=False)

    def frame(name: str) -> Bytes:
        raw = cv2.imread(str(REAL / "markers" / name))
        assert raw is not None
        return np.ascontiguousarray(raw[maps["x"], maps["y"], ::-1])

    reference = frame("ref.jpg")
    for name, ball in (("sample_20.jpg", (283.0, 275.0)), ("sample_41.jpg", (175.0, 265.0))):
        moved = follow_markers(find_markers(reference), find_markers(frame(name)))
        assert moved.found.mean() > 0.95
        away = moved.place_px - np.array(ball)
        distance = np.hypot(*away.T)
        outward = (moved.motion_px * away).sum(axis=1) / distance
        ring = (distance > 35) & (distance < 75) & moved.found
        if name == "sample_20.jpg":
            assert np.median(outward[ring]) > 0.5
        assert np.median(np.hypot(*moved.motion_px[distance > 150].T)) < 0.6
