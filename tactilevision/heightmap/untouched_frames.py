"""Choose frames of the untouched gel, renew the reference, and correct a method's bias."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import held_out_depth, seen_gain_std
from tactilevision.heightmap.deviation import contributions_mm
from tactilevision.heightmap.deviation_terms import untouched_std_mm
from tactilevision.heightmap.inconsistent_light import measured_light
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import (
    baseline,
    contact_in_reference,
    pressed_beside,
    rectified_frames,
    some_frames,
)
from tactilevision.heightmap.scene_faults import able_to_renew
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import far_from
from tactilevision.photometric.calibrate import Calibration
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.multiresolution import TiledEvaluator, tile_px_for
from tactilevision.photometric.reference import BackgroundSums, Reference, make_reference
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes, Pair
from tactilevision.records.rig import Sensor
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# What frames of the free gel say of a method: its reference renewed, its bias taken off.

FREE_SHARE = 0.97  # of the blocks that follow the light's drift: the rest is noise
MIN_FREE = 4  # untouched frames; of fewer the noise would be taken for bias
MAX_FREE = 16  # untouched frames that are read, at most


def tare(method: CalibratedMethod, frames: Sequence[Bytes]) -> Reference:
    """Return the method with its reference renewed from rectified untouched `frames`.

    Reference pictures are often means of several frames, or older than the recording; in the dark, noise that is
    cut off at black then makes the two differ. Fewer than MIN_FREE untouched frames leave it as it was, and so do
    frames that disagree, as strongly compressed ones may.
    """
    free = untouched_of(method, frames)
    if len(free) < MIN_FREE:
        return method.reference
    try:
        renewed = make_reference(free, may_have_marks=method.reference.marks is not None)
    except InputError:
        return method.reference
    return dataclasses.replace(renewed, usable=renewed.usable & method.reference.usable)


def subtract_background(method: CalibratedMethod, frames: Sequence[Bytes]) -> CalibratedMethod:
    """Return the method without its mean slopes in rectified `frames` of untouched gel.

    They are found as surfaces will be read: from then on gentle gel in means of pixels, where that can be.
    Fewer than MIN_FREE untouched frames leave it as it was: their noise would be taken for bias.
    """
    free = untouched_of(method, frames)
    if len(free) < MIN_FREE:
        return method
    whole, mean = BackgroundSums(method.reference.shape), BackgroundSums(method.reference.shape)
    px = tile_px_for(method)
    coarse = TiledEvaluator(method, px) if px > 1 else None
    for rgb in free:
        read = method.read(rgb).slopes
        for sums, slopes in ((whole, read), (mean, coarse.read(rgb).slopes if coarse else read)):
            sums.add(np.asarray(slopes.dz_dx), np.asarray(slopes.dz_dy), method.reference.usable)
    card = dataclasses.replace(method.card, frame_noise=whole.noise_over(method.noise), tile_px=px)
    return dataclasses.replace(
        method, background=mean.added_to(method.current_background, method.kept_share), card=card
    )


def untouched_of(method: CalibratedMethod, frames: Sequence[Bytes]) -> list[Bytes]:
    """Return the `frames` that nearly entirely follow the light's drift, without false depths."""
    free = []
    for rgb in able_to_renew(method.reference.rgb, frames):
        drift = method.change.tracker.measure(rgb)
        if drift.untouched[method.change.tracker.usable.reshape(drift.untouched.shape)].mean() > FREE_SHARE:
            free.append(rgb)
    return free


def free_frames(recording: Recording) -> list[Bytes]:
    """Return the rectified pictures (H, W, 3) of `press_starts`, or at least MIN_FREE flats without presses."""
    from tactilevision.recording.pictures import read_reference

    if not recording.presses and len(recording.flats) >= MIN_FREE:
        flats = recording.flats[:MAX_FREE]
        return [rectify(recording.sensor, read_reference(recording, path)) for path in flats]
    return [frame.rgb for frame in press_starts(recording)]


def press_starts(recording: Recording) -> list[Frame]:
    """Return at most MAX_FREE rectified frames from the beginnings of the presses, usually untouched."""
    times = recording.frame_times_s
    if recording.frames_path is None or not len(times) or not recording.presses:
        return []
    starts = np.array([press.start_s for press in recording.presses])
    chosen = np.linspace(0, len(starts) - 1, min(MAX_FREE, len(starts))).astype(int)
    return rectified_frames(recording, np.unique(np.searchsorted(times, starts[chosen]).clip(0, len(times) - 1)))


# A calibration made to fit the free gel of its sensor, its errors measured on its own ball pictures.

MAX_WAVES = 8  # pictures with balls that are looked at, at most


def tuned(
    sensor: Sensor, calibration: Calibration, *, pictures: Sequence[BallPicture], free: Sequence[Bytes]
) -> Reconstructor:
    """Return the calibration's reconstructor fitted to rectified frames of the free gel, its errors measured.

    The local deviation of untouched gel from flat comes from the `free` frames where there are enough of them,
    else from
    the ball pictures.
    """
    gain = seen_gain_std(calibration.method, pictures, balls=calibration.balls, mm_per_px=sensor.mm_per_px)
    card = dataclasses.replace(calibration.method.card, sensor=sensor.kind, seen_gain_std=gain)
    card = card.extended(held_out_depth(calibration, pictures, mm_per_px=sensor.mm_per_px, seen_gain=gain))
    factor = float(card.other.get("depth_coverage_factor", 1.0))
    place_gain = np.round(factor * np.array(card.place_gain_std), 5).tolist()
    card = dataclasses.replace(card, seen_gain_std=factor * gain, place_gain_std=place_gain)
    method = dataclasses.replace(calibration.method, card=card)
    settled = subtract_background(dataclasses.replace(method, reference=tare(method, free)), free)
    if settled.background is method.background:
        waves_mm = untouched_rms_mm(Reconstructor(sensor, method), pictures, balls=calibration.balls)
        settled = settled.with_card(dataclasses.replace(card, untouched_depth_rms_mm=waves_mm))
    else:
        reader = Reconstructor(sensor, settled)
        flat = [reader.rectified_map(rgb).depth_mm for rgb in untouched_of(method, free)]
        std_mm = np.round(untouched_std_mm(flat), 6).tolist()
        settled = settled.with_card(dataclasses.replace(settled.card, untouched_std_mm=std_mm))
    light = measured_light(
        settled, pictures, balls=calibration.balls, free=untouched_of(settled, free), mm_per_px=sensor.mm_per_px
    )
    settled = dataclasses.replace(settled, light_law=light)
    reader = Reconstructor(sensor, settled)
    usual = baseline(
        lambda rgb: reader.read_rectified(rgb).residuals, [*(picture.rgb for picture in pictures), *free]
    )
    terms = depth_terms_mm(reader, pictures, balls=calibration.balls)
    settled = settled.with_card(dataclasses.replace(settled.card, baseline=usual, depth_terms_mm=terms))
    return Reconstructor(sensor, settled, calibration=calibration)


def depth_terms_mm(
    reader: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> dict[str, float]:
    """Return each term's deviation of depth under a ball: rms in mm, the median over ball pictures."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            seen = reader.read_rectified(picture.rgb)
            found.append(contributions_mm(seen.height, seen.terms_mm()))
    return {name: round(float(np.median([one[name] for one in found])), 6) for name in found[0]} if found else {}


def untouched_rms_mm(
    reconstructor: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> float:
    """Return the deviation of untouched gel from flat: median over ball pictures, outside the ball, mm."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            height = reconstructor.rectified_map(picture.rgb)
            away = far_from(ball, height.depth_mm.shape, mm_per_px=reconstructor.sensor.mm_per_px) & height.valid
            if away.any():
                found.append(float(np.sqrt(np.mean(np.square(height.depth_mm[away])))))
    return float(np.median(found)) if found else 0.0


# Where the frame that was taken for untouched gel shows a contact, the median of the frames may stand for it.
#
# A contact in the reference stands in every frame as a hill; contacts that move leave none in the median.

MAX_FRAMES = 25  # frames of which the median is taken: a place may be pressed in twelve of them


def with_free_reference(
    recording: Recording,
    flats: Sequence[Bytes],
    ready: Reconstructor,
    *,
    read: Callable[[Sequence[Bytes]], Reconstructor],
) -> tuple[Sequence[Bytes], Reconstructor, tuple[str, ...]]:
    """Return pictures (H, W, 3) of the untouched gel, their reconstructor, and their source.

    The same as before unless the guessed frame shows a contact and the median of the frames shows none, neither
    by the frames nor against the guessed frame. `read` makes a reconstructor against such pictures.
    """
    frames = some_frames(recording, count=MAX_FRAMES)
    at = _contact(ready, frames)
    if at is None:
        return flats, ready, ()
    median: Bytes = np.median(frames, axis=0).round().astype(np.uint8)
    against = read([median])
    if _contact(against, frames) is not None or _pressed(ready, median):
        return flats, ready, ()
    name = recording.frame_names[recording.flat_frames[0]]
    note = (
        f"{name} shows a contact near ({at[0]:.0f}, {at[1]:.0f}) px: in its place the median of {len(frames)} "
        "frames is taken for the untouched gel; --reference states a picture of it"
    )
    return [median], against, (note,)


def _contact(reader: Reconstructor, frames: Sequence[Bytes]) -> Pair | None:
    method = reader.referenced
    return None if method is None else contact_in_reference(method, reader.rectified_map, pictures=frames)


def _pressed(reader: Reconstructor, picture: Bytes) -> bool:
    method = reader.referenced
    return method is None or pressed_beside(method, reader.rectified_map, picture=picture)
