"""The area of contact against exact solutions for a half-space: ball (Hertz), flat punch and cone (Sneddon)."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from each import each

from tactilevision.contact.region import at_border, find_contact
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats, Pair

SCALE, SHAPE = 0.05, (240, 320)
NOISE_MM = 0.001


def radii(centre_mm: Pair = (0.0, 0.0)) -> Floats:
    y, x = np.indices(SHAPE) * SCALE - 0.5 * (np.array(SHAPE)[:, None, None] - 1) * SCALE
    return np.asarray(np.hypot(x - centre_mm[0], y - centre_mm[1]))


def ball(r: Floats, contact_mm: float, radius_mm: float) -> Floats:
    """K. L. Johnson, Contact Mechanics, eqs. 3.41a and 3.42a: w = a^2/R in the middle, half of it at the rim."""
    out = np.maximum(r, contact_mm)
    square = contact_mm**2
    beside = (2 * square - out**2) * np.arcsin(contact_mm / out) + contact_mm * np.sqrt(out**2 - square)
    return np.where(r < contact_mm, (2 * square - r**2) / (2 * radius_mm), beside / (np.pi * radius_mm))


def punch(r: Floats, contact_mm: float, depth_mm: float) -> Floats:
    """Johnson, eq. 3.37."""
    return depth_mm * 2 / np.pi * np.arcsin(contact_mm / np.maximum(r, contact_mm))


def cone(r: Floats, contact_mm: float, slope: float) -> Floats:
    """Sneddon, Int. J. Eng. Sci. 3 (1965) 47."""
    out = np.maximum(r, contact_mm) / contact_mm
    beside = np.arcsin(1 / out) + np.sqrt(out**2 - 1) - out
    return slope * np.where(r < contact_mm, np.pi / 2 * contact_mm - r, contact_mm * beside)


def seen(depth: Floats, blur_px: float = 0.8) -> HeightMap:
    """As a camera shows it: a little blurred, in integrated noise."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).standard_normal(SHAPE), (0, 0), 3.0)
    depth = cv2.GaussianBlur(depth, (0, 0), blur_px) + NOISE_MM * noise / noise.std()
    far = np.quantile(depth, 0.05)  # a half-space sinks everywhere; the zero plane is laid through its far gel
    return HeightMap(depth - far, np.ones(SHAPE, np.bool_), (SCALE, SCALE), np.full(SHAPE, NOISE_MM))


@each("contact_mm", [0.5, 1.2, 2.5])
@each("radius_mm", [4.0, 12.0])
def test_a_ball_touches_within_its_rim(contact_mm: float, radius_mm: float) -> None:
    area = np.count_nonzero(find_contact(seen(ball(radii(), contact_mm, radius_mm)))) * SCALE**2
    assert area == pytest.approx(np.pi * contact_mm**2, rel=0.21), "the gentlest is 20 um deep"


@pytest.mark.parametrize("depth_mm", [0.05, 0.4])
def test_a_flat_face_touches_with_all_of_it(depth_mm: float) -> None:
    area = np.count_nonzero(find_contact(seen(punch(radii(), 2.5, depth_mm)))) * SCALE**2
    assert area == pytest.approx(np.pi * 2.5**2, rel=0.1)


def test_a_cone_touches_up_to_where_its_slope_ends() -> None:
    area = np.count_nonzero(find_contact(seen(cone(radii(), 2.0, 0.15)))) * SCALE**2
    assert area == pytest.approx(np.pi * 2.0**2, rel=0.2)


def test_two_contacts_count_both_and_a_far_speck_does_not() -> None:
    depth = ball(radii((-4.0, 0.0)), 1.2, 6.0) + ball(radii((4.0, 1.0)), 0.9, 6.0)
    depth[5:8, 5:8] += 0.1
    contact = find_contact(seen(depth, blur_px=0.3))
    assert np.count_nonzero(contact) * SCALE**2 == pytest.approx(np.pi * (1.2**2 + 0.9**2), rel=0.15)
    assert not contact[:12, :12].any()
    assert not at_border(contact)


def test_what_is_cut_off_by_the_border_is_told() -> None:
    assert at_border(find_contact(seen(ball(radii((7.5, 0.0)), 1.5, 6.0))))


def test_free_gel_and_a_map_without_a_valid_pixel_have_no_contact() -> None:
    assert not find_contact(seen(np.zeros(SHAPE))).any()
    nothing = HeightMap(np.zeros(SHAPE), np.zeros(SHAPE, np.bool_), (SCALE, SCALE))
    assert not find_contact(nothing).any()


def test_a_contact_is_seen_however_wide_the_deviation_is_stated() -> None:
    """A ball .3 mm deep whose map is stated to be known to .12 mm; waves of free gel as wide are none."""
    depth = ball(radii(), 1.2, 4.8)
    pressed = seen(depth)
    wide = replace(pressed, std_mm=np.full(SHAPE, 0.12))
    assert find_contact(wide).any()
    np.testing.assert_array_equal(find_contact(wide), find_contact(pressed))
    y, x = np.indices(SHAPE) * SCALE
    waves = 0.1 * np.sin(2 * np.pi * x / 8.0) * np.sin(2 * np.pi * y / 8.0)
    assert not find_contact(replace(seen(waves), std_mm=np.full(SHAPE, 0.12))).any()


def test_colours_show_a_contact_whose_slopes_are_blurred() -> None:
    blurred = cv2.GaussianBlur(ball(radii(), 0.6, 4.0), (0, 0), 12.0)
    wide = replace(seen(blurred), std_mm=np.full(SHAPE, 0.12))
    change = np.ones((24, 32))
    assert not find_contact(replace(wide, colour_change=change)).any()
    change[10:14, 14:18] = 150.0
    assert find_contact(replace(wide, colour_change=change)).any()
