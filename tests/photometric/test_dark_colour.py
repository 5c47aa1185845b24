"""Where one lamp is off on all of the gel, the other two colours tell the slope."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import BALL_MM, SENSOR, ball, ball_pictures, flat, in_px, picture, room_calibration
from shared_scenes import shared

from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_samples import radii_from
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.reference import (
    DARK,
    Reference,
    dark_colour_warning,
    make_reference,
    overexposed_warning,
)
from tactilevision.recording.folder import read_folder
from tactilevision.records.measured import Bytes

CONTACT_MM = 1.6
PLACES = ((0.0, 0.0), (3.5, 2.0), (-4.0, -2.5))  # mm from the picture's centre


def dark(rgb: Bytes, colour: int, grey: float = 0.0) -> Bytes:
    """The picture with that channel at a level that tells nothing."""
    out = rgb.copy()
    noise = np.random.default_rng(11).normal(0.0, 0.7 if grey else 0.0, out.shape[:2])
    out[..., colour] = np.clip(np.rint(grey + noise), 0, 255)
    return out


@lru_cache
@shared
def calibrated(colour: int, grey: float, method: str) -> Calibration:
    rng = np.random.default_rng(1)
    flats = [dark(flat(rng), colour, grey) for _ in range(3)]
    shots = [dataclasses.replace(one, rgb=dark(one.rgb, colour, grey)) for one in ball_pictures(14, rng)]
    return calibrate_from_balls(make_reference(flats), shots, mm_per_px=SENSOR.mm_per_px, fit=PHOTOMETRIC[method])


def reference(*, colours: tuple[int, ...], grey: float = 0.0) -> Reference:
    rng = np.random.default_rng(2)
    flats = [flat(rng) for _ in range(3)]
    for colour in colours:
        flats = [dark(one, colour, grey) for one in flats]
    return make_reference(flats)


def assert_balls_are_deep(reader: Reconstructor, colour: int, grey: float, within: float) -> None:
    for place in PLACES:
        depth, p, q = ball(place, CONTACT_MM, BALL_MM)
        height = reader.rectified_map(dark(picture(p, q, np.random.default_rng(5)), colour, grey))
        under = radii_from(
            Ball(in_px(place), CONTACT_MM / SENSOR.mm_per_px[0], BALL_MM), depth.shape, mm_per_px=SENSOR.mm_per_px
        )
        assert height.valid[under < 1.0].mean() > 0.98
        assert height.depth_mm[under < 1.0].max() == pytest.approx(depth.max(), rel=within)


@pytest.mark.parametrize(
    ("colour", "grey", "method"),
    [
        (2, 0.0, "polynomial"),
        pytest.param(0, 0.0, "polynomial", marks=pytest.mark.slow),
        pytest.param(1, 4.0, "auto", marks=pytest.mark.slow),
    ],
)
def test_balls_are_as_deep_by_two_colours(colour: int, grey: float, method: str) -> None:
    found = calibrated(colour, grey, method)
    assert all(one is not None for one in found.balls)
    assert_balls_are_deep(Reconstructor(SENSOR, found.method), colour, grey, within=0.15)


def test_a_lamp_that_fails_after_the_calibration_leaves_two_colours() -> None:
    whole = room_calibration(14).method
    method = whole.with_reference(reference(colours=(2,)))
    assert method.relative_error > whole.relative_error
    assert_balls_are_deep(Reconstructor(SENSOR, method), 2, 0.0, within=0.15)


def test_a_dark_colour_changes_nothing_whatever_it_shows() -> None:
    change = ColourChange(reference(colours=(1,)))
    rgb = dark(flat(np.random.default_rng(3)), 1, 30.0)
    assert not change.measure(rgb)[0][1].any()
    assert not change.noise[1].any()
    change.follow(rgb, 0.5)
    assert not change.measure(rgb)[0][1].any()


def test_only_one_colour_is_called_dark_and_by_its_name() -> None:
    assert reference(colours=(0,), grey=DARK - 1.0).dark_colour == 0
    assert reference(colours=(0,), grey=DARK + 1.0).dark_colour is None
    assert "dark in blue (grey 0 of 255)" in dark_colour_warning(reference(colours=(2,)))[0]
    assert dark_colour_warning(reference(colours=())) == ()


def test_a_gel_lit_in_one_colour_or_none_is_refused() -> None:
    rng = np.random.default_rng(2)
    one = [dark(dark(flat(rng), 0), 2) for _ in range(3)]
    capped = [np.full_like(flat(rng), 3)] * 3  # free of noise
    for flats, told in ((one, r"red 0, green \d+, blue 0"), (capped, "red 3, green 3, blue 3")):
        with pytest.raises(InputError, match=f"dark in two colours or more.*{told}"):
            make_reference(flats)


def test_an_overexposed_colour_of_the_untouched_gel_is_named_with_its_share(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    for number in range(3):
        rgb = flat(rng)
        rgb[:60, :, 2] = 255  # a third of the rows
        assert cv2.imwrite(str(tmp_path / f"{number}.png"), rgb[..., ::-1])
    folder = read_folder(tmp_path, "gelslim3", reference=tmp_path / "0.png", mm_per_px=0.08)
    said = [one for one in build_reconstructor(folder).warnings if "overexposed" in one]
    assert len(said) == 1
    assert "blue in 33 % of it" in said[0]
    assert overexposed_warning(reference(colours=())) == ()


@pytest.mark.parametrize("kind", ["gelslim3", "custom"])
def test_without_balls_a_dark_colour_is_refused(tmp_path: Path, kind: str) -> None:
    for number in range(3):
        rgb = dark(flat(np.random.default_rng(number)), 0)
        assert cv2.imwrite(str(tmp_path / f"{number}.png"), rgb[..., ::-1])
    sensor = SENSOR if kind == "custom" else kind
    with pytest.raises(InputError, match="without ball presses where a colour is dark") as refused:
        build_reconstructor(read_folder(tmp_path, sensor, reference=tmp_path / "0.png", mm_per_px=0.08))
    assert "dark in red" in str(refused.value)
