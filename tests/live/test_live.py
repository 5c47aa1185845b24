"""The stream: contact seen, light followed, nothing kept."""

from __future__ import annotations

import dataclasses
import gc
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.contact.region import find_contact
from tactilevision.errors import InputError
from tactilevision.heightmap.build import subtract_background
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.reference import make_reference
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Indenter
from tactilevision.robots.live import Stream

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import SENSOR, SHAPE, ball, flat, picture, room_calibration


def calibrated() -> CalibratedMethod:
    return room_calibration(8).method


def stream(renew: float = 0.0) -> Stream:
    fresh = calibrated().with_reference(calibrated().reference)
    return Stream(Reconstructor(SENSOR, fresh), Indenter("ball", "sphere", 4.0), renew)


def test_contact_is_seen_when_there_is_one() -> None:
    rng = np.random.default_rng(2)
    live = stream()
    depth, p, q = ball((0.5, 0.5), 1.5, 4.0)
    free = [live.take(Frame(flat(rng))) for _ in range(5)]
    pressed = live.take(Frame(picture(p, q, rng)))
    assert not any(moment.contact for moment in free)
    assert all(moment.peak_mm == 0.0 and moment.footprint is None for moment in free)
    assert pressed.contact
    assert pressed.peak_mm == pytest.approx(depth.max(), rel=0.08)
    assert live.frames == 6


def test_uneven_light_that_creeps_in_is_followed() -> None:
    still, following = stream(0.0), stream(0.3)
    rng = np.random.default_rng(3)
    x = np.linspace(-1, 1, SHAPE[1])[None, :, None]
    for step in range(120):
        warm = 1.0 + 0.05 * step / 120 * x**2 * np.array([1.0, -1.0, 0.5])
        frame = Frame(flat(rng, gain=warm))
        depths = [np.sqrt(np.mean(s.take(frame).height.depth_mm ** 2)) for s in (still, following)]
    assert depths[1] < 0.25 * depths[0]


def test_a_bad_frame_does_not_stop_the_stream() -> None:
    live = stream()
    rng = np.random.default_rng(4)
    with pytest.raises(InputError, match="black"):
        live.take(Frame(np.zeros((*SHAPE, 3), np.uint8)))
    assert not live.take(Frame(flat(rng))).contact


BAD: dict[str, Callable[[Bytes], Bytes]] = {
    "px, not as its sensor": lambda rgb: rgb[:-2].copy(),
    "order blue, green, red": lambda rgb: rgb[..., ::-1].copy(),
    "black": lambda rgb: rgb // 40,
    "frame is 1[6-9] times darker: are these numbers of 12 bits": lambda rgb: rgb // 16,
    "one of its channels": lambda rgb: rgb * np.array([1, 0, 1], np.uint8),
    "saturated": lambda rgb: np.full_like(rgb, 255),
    "nothing like the reference": lambda rgb: (
        np.where(np.indices(rgb.shape[:2]).sum(0)[..., None] % 32 < 16, 240, 4).repeat(3, axis=2).astype(np.uint8)
    ),
}


@each("said", BAD)
@each("halved", [False, True])
def test_a_frame_of_another_kind_is_refused_and_the_next_one_read(said: str, halved: bool) -> None:
    rng = np.random.default_rng(6)
    live = stream(0.1)
    if halved:
        reference = make_reference([flat(rng) for _ in range(3)], may_have_marks=False)
        method = subtract_background(calibrated().with_reference(reference), [flat(rng) for _ in range(4)])
        live = Stream(Reconstructor(SENSOR, method))
        assert method.tiled_evaluator is not None
    good = live.take(Frame(flat(rng)))
    with pytest.raises(InputError, match=said):
        live.take(Frame(BAD[said](flat(rng))))
    after = live.take(Frame(flat(rng)))
    assert not good.contact
    assert not after.contact
    assert live.frames == 2


def test_a_frame_of_another_type_is_refused_when_it_is_made() -> None:
    rgb = flat(np.random.default_rng(7))
    others: tuple[Any, ...] = (
        rgb.astype(np.float32),
        rgb.astype(np.uint16),
        rgb[..., 0],
        np.dstack([rgb, rgb[..., :1]]),
    )
    for wrong in others:
        with pytest.raises(InputError, match="uint8"):
            Frame(wrong)


def test_memory_does_not_grow() -> None:
    """What a frame leaves behind it leaves each time: so the least of a few spans tells, and chance does not."""
    live = stream(0.01)
    frame = Frame(flat(np.random.default_rng(5)))
    for _ in range(3):
        live.take(frame)
    tracemalloc.start()
    grown = []
    for _ in range(3):
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(5):
            live.take(frame)
        gc.collect()
        grown.append(tracemalloc.get_traced_memory()[0] - before)
    tracemalloc.stop()
    assert min(grown) < 4_000  # bytes of 5 frames, as 20,000 of 25 would be


def test_a_picture_that_says_nothing_is_not_followed() -> None:
    """Half of it black: no contact is claimed, but one could hide, and the reference stays as it was."""
    rng = np.random.default_rng(8)
    live = stream(0.3)
    before = live.take(Frame(flat(rng)))
    dark = flat(rng)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    black = y > SHAPE[0] / 2 + 0.2 * (x - SHAPE[1] / 2)  # not along a row, as a tear
    dark[black] = 0
    level = live.reconstructor.method.change.maps.mean.copy()  # type: ignore[attr-defined]
    blind = live.take(Frame(dark))
    assert not blind.contact
    assert blind.least_mm > 10 * before.least_mm
    assert not blind.height.valid[black].any()
    np.testing.assert_array_equal(live.reconstructor.method.change.maps.mean, level)  # type: ignore[attr-defined]


def test_a_contact_is_seen_at_any_scale_of_depth() -> None:
    """A method that knows its scale to 40 % is in doubt of the depth, not of the contact; nor does it see one in
    free gel."""
    rng = np.random.default_rng(10)
    rough = dataclasses.replace(calibrated(), card=dataclasses.replace(calibrated().card, place_gain_std=[[0.4]]))
    reader = Reconstructor(SENSOR, rough)
    live = Stream(reader)
    depth, p, q = ball((0.5, 0.5), 1.5, 4.0)
    assert not any(live.take(Frame(flat(rng))).contact for _ in range(5))
    pressed = live.take(Frame(picture(p, q, rng)))
    assert pressed.height.std_mm is not None
    assert pressed.height.std_mm.max() > 0.3 * depth.max()
    assert pressed.contact
    assert find_contact(pressed.height, reader.error).any()
    assert not find_contact(reader.height_map(Frame(flat(rng))), reader.error).any()


def test_a_slow_press_is_not_taken_for_light() -> None:
    """It grows by .2 um a frame, which following faster takes for untouched gel."""
    rng = np.random.default_rng(9)
    live = Stream(stream().reconstructor)
    depth, p, q = ball((0.5, 0.5), 1.5, 4.0)
    seen = []
    for step in range(250):
        share = 0.0002 * step / depth.max()
        seen.append(live.take(Frame(picture(share * p, share * q, rng))).contact)
    assert all(seen[150:])


@pytest.mark.parametrize("renew", [-0.1, 1.5, float("nan")])
def test_a_share_to_renew_by_lies_between_0_and_1(renew: float) -> None:
    with pytest.raises(InputError, match="from 0 to 1"):
        stream(renew)


def test_an_array_is_told_to_become_a_frame() -> None:
    rgb: Any = flat(np.random.default_rng(7))
    with pytest.raises(InputError, match=r"Frame\(rgb\)"):
        stream().take(rgb)
    with pytest.raises(InputError, match="list"):
        Frame(rgb.tolist())
