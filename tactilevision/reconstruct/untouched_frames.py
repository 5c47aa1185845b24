"""What frames of the free gel say of a method: its reference renewed, its bias taken off."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.photometric import make_reference
from tactilevision.photometric.background import BackgroundSums
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.multiresolution import TiledEvaluator, tile_px_for
from tactilevision.photometric.reference import Reference
from tactilevision.quality.reference_match import rectified_frames
from tactilevision.quality.scene_faults import able_to_renew
from tactilevision.records import Bytes, Frame
from tactilevision.sensors import rectify

if TYPE_CHECKING:
    from tactilevision.recording import Recording

FREE_SHARE = 0.97  # of the blocks that follow the light's drift: the rest is noise
MIN_FREE = 4  # untouched frames; of fewer the noise would be taken for bias
MAX_FREE = 16  # untouched frames that are read, at most


def tare(method: CalibratedMethod, frames: Sequence[Bytes]) -> Reference:
    """The method's reference renewed out of rectified `frames`, as far as they show the gel untouched.

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
    """The method without the slopes that it still finds, on the mean, in rectified `frames` of untouched gel.

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
    """Those of `frames` nearly all of which follows the light's drift, and whose pictures no fault spoils."""
    free = []
    for rgb in able_to_renew(method.reference.rgb, frames):
        drift = method.change.tracker.measure(rgb)
        if drift.untouched[method.change.tracker.usable.reshape(drift.untouched.shape)].mean() > FREE_SHARE:
            free.append(rgb)
    return free


def free_frames(recording: Recording) -> list[Bytes]:
    """The rectified pictures (H, W, 3) of `press_starts`; of a recording without presses, its flats,
    where they are MIN_FREE or more.
    """
    from tactilevision.recording import read_reference

    if not recording.presses and len(recording.flats) >= MIN_FREE:
        flats = recording.flats[:MAX_FREE]
        return [rectify(recording.sensor, read_reference(recording, path)) for path in flats]
    return [frame.rgb for frame in press_starts(recording)]


def press_starts(recording: Recording) -> list[Frame]:
    """At most MAX_FREE rectified frames from the beginnings of the presses, when the gel is likely to be free."""
    times = recording.frame_times_s
    if recording.frames_path is None or not len(times) or not recording.presses:
        return []
    starts = np.array([press.start_s for press in recording.presses])
    chosen = np.linspace(0, len(starts) - 1, min(MAX_FREE, len(starts))).astype(int)
    return rectified_frames(recording, np.unique(np.searchsorted(times, starts[chosen]).clip(0, len(times) - 1)))
