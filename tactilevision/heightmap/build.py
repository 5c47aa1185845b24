"""Build a reconstructor from a recording's balls, a saved method or a ready one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap import ball_validation, reference_match, reference_view, scene_faults
from tactilevision.heightmap.deviation import contributions_mm
from tactilevision.heightmap.inconsistent_light import measured_light
from tactilevision.heightmap.kept_light import kept_light
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import DEFAULT_BASELINE, FRAMES_READ, ReferenceMatch
from tactilevision.heightmap.reference_view import Registered
from tactilevision.heightmap.self_calibration import (
    MIN_CONTACTS,
    NETWORK_SCALE_STD,
    calibrated_on_frames,
    contacts_in,
    scale_warning,
)
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture, pressed_balls
from tactilevision.photometric.ball_samples import far_from
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.drift import block_means
from tactilevision.photometric.method import CalibratedMethod, TiledEvaluator, tile_px_for
from tactilevision.photometric.methods.network import find_model, ready_models
from tactilevision.photometric.protocols import PhotometricMethod, Progress, silent
from tactilevision.photometric.reference import (
    BackgroundSums,
    Reference,
    check_view,
    dark_colour_warning,
    light_of,
    make_reference,
    overexposed_warning,
    round_outline_warning,
)
from tactilevision.photometric.storage import load_method, load_network
from tactilevision.recording import layout
from tactilevision.records.constants import TINY
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Array, Bytes, Floats
from tactilevision.records.rig import Sensor
from tactilevision.robust import MAD_TO_STD
from tactilevision.sensors import may_have_marks
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# What frames of the free gel say of a method: its reference renewed, its bias taken off.

FREE_SHARE = 0.97  # of the blocks that follow the light's drift: the rest is noise
MIN_FREE = 4  # untouched frames; of fewer the noise would be taken for bias
MAX_FREE = 16  # untouched frames that are read, at most


def tare(method: CalibratedMethod, free: Sequence[Bytes]) -> Reference:
    """Return the reference of a method, renewed from `free` frames as `untouched_of` returns them.

    Reference pictures are often means of several frames, or older than the recording; in the dark, noise that is
    cut off at black then makes the two differ. Fewer than MIN_FREE frames leave it as it was, and so do frames
    that disagree, as strongly compressed ones may.
    """
    if len(free) < MIN_FREE:
        return method.reference
    try:
        renewed = make_reference(free, may_have_marks=method.reference.marks is not None)
    except InputError:
        return method.reference
    return replace(renewed, usable=renewed.usable & method.reference.usable)


def subtract_background(method: CalibratedMethod, free: Sequence[Bytes]) -> CalibratedMethod:
    """Return the method without its mean slopes in `free` frames as `untouched_of` returns them.

    They are found as surfaces will be read: from then on gentle gel in means of pixels, where that can be.
    Fewer than MIN_FREE frames leave it as it was: their noise would be taken for bias.
    """
    if len(free) < MIN_FREE:
        return method
    whole, mean = BackgroundSums(method.reference.shape), BackgroundSums(method.reference.shape)
    px = tile_px_for(method)
    coarse = TiledEvaluator(method, px) if px > 1 else None
    for rgb in free:
        read = method.read(rgb).slopes
        for sums, slopes in ((whole, read), (mean, coarse.read(rgb).slopes if coarse else read)):
            sums.add(np.asarray(slopes.dz_dx), np.asarray(slopes.dz_dy), method.reference.usable)
    card = replace(method.card, frame_noise=whole.noise_over(method.noise), tile_px=px)
    return method.noted(background=mean.added_to(method.current_background, method.kept_share), card=card)


def untouched_of(method: CalibratedMethod, frames: Sequence[Bytes]) -> list[Bytes]:
    """Return the `frames` that nearly entirely follow the light's drift, without false depths."""
    free = []
    for rgb in scene_faults.able_to_renew(method.reference.rgb, frames):
        try:
            drift = method.change.tracker.measure(rgb)
        except InputError:
            continue
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
    at = np.searchsorted(times, starts[chosen]).clip(0, len(times) - 1)
    return reference_match.rectified_frames(recording, np.unique(at))


# A calibration made to fit the free gel of its sensor, its errors measured on its own ball pictures.

MAX_TERMS = 8  # pictures with balls of which terms of the deviation are kept, at most
BLOCK_PX = 16  # px: grid of the depth of untouched gel, finer than its waves


def tuned(
    sensor: Sensor,
    calibration: Calibration,
    *,
    pictures: Sequence[BallPicture],
    free: Sequence[Bytes],
    progress: Progress = silent,
) -> Reconstructor:
    """Return the calibration's reconstructor fitted to rectified frames of the free gel, its errors measured.

    The local deviation of untouched gel from flat comes from the `free` frames where there are enough of them,
    else from
    the ball pictures.
    """
    progress(0, 1, "depth of held-out balls")
    method, mm_per_px = calibration.method, sensor.mm_per_px
    gain = ball_validation.seen_gain_std(method, pictures, balls=calibration.balls, mm_per_px=mm_per_px)
    card = replace(method.card, sensor=sensor.kind, seen_gain_std=gain)
    held_out = ball_validation.held_out_depth(calibration, pictures, mm_per_px=mm_per_px, seen_gain=gain)
    card = card.extended(held_out)
    factor = float(card.other.get("depth_coverage_factor", 1.0))
    place_gain = np.round(factor * np.array(card.place_gain_std), 5).tolist()
    card = replace(card, seen_gain_std=factor * gain, place_gain_std=place_gain)
    method = method.noted(card=card)
    progress(0, 1, "untouched gel")
    renewing = untouched_of(method, free)
    renewed = replace(method, reference=tare(method, renewing))
    untouched = untouched_of(renewed, free)
    settled = subtract_background(renewed, untouched)
    if settled.background is method.background:
        settled = settled.noted(card=untouched_around_balls(sensor, calibration, card, pictures))
    else:
        reader = Reconstructor(sensor, settled)
        flat = [one.depth_mm for one in map(reader.sound_surface, renewing) if one]
        std_mm = np.round(untouched_std_mm(flat), 6).tolist()
        settled = settled.noted(card=replace(settled.card, untouched_std_mm=std_mm))
    progress(0, 1, "usual light of the pictures")
    light = measured_light(settled, pictures, balls=calibration.balls, free=untouched, mm_per_px=mm_per_px)
    settled = settled.noted(light_law=light)
    reader = Reconstructor(sensor, settled)
    every = [*(picture.rgb for picture in pictures), *free]
    usual = reference_match.baseline(lambda rgb: reader.surface(rgb).residuals, every)
    terms = depth_terms_mm(reader, pictures, balls=calibration.balls)
    settled = settled.noted(card=replace(settled.card, baseline=usual, depth_terms_mm=terms))
    return Reconstructor(sensor, settled, calibration=calibration)


def depth_terms_mm(
    reader: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> dict[str, float]:
    """Return each term's deviation of depth under a ball: rms in mm, the median over ball pictures."""
    found = []
    for rgb, _ in pressed_balls(pictures[:MAX_TERMS], balls[:MAX_TERMS]):
        with suppress(InputError):
            seen = reader.read_rectified(rgb)
            found.append(contributions_mm(seen.height, seen.terms_mm()))
    return {name: round(float(np.median([one[name] for one in found])), 6) for name in found[0]} if found else {}


def untouched_around_balls(
    sensor: Sensor, calibration: Calibration, card: MethodCard, pictures: Sequence[BallPicture]
) -> MethodCard:
    """Return the `card` with the deviation of untouched gel from flat, in mm, by the ball pictures.

    Outside each ball, by the law fitted without it: the median rms over pictures, and the rms by blocks. Where no
    ball is near, a law may read any slope of a slight change of colour, which integrates to the picture's border.
    """
    method, readers = replace(calibration.method, card=card), dict[int, Reconstructor]()
    size = block_grid(method.reference.shape)
    sums, found = np.zeros((2, size[1], size[0])), []
    for picture, ball, held in ball_validation.chosen_balls(calibration, pictures):
        law = method.law if held is None else held.law
        if id(law) not in readers:
            readers[id(law)] = Reconstructor(sensor, replace(method, law=law))
        surface = readers[id(law)].sound_surface(picture.rgb)
        if surface is None:
            continue
        away = far_from(ball, surface.depth_mm.shape, mm_per_px=sensor.mm_per_px) & surface.reading.valid
        square = np.where(away, np.square(surface.depth_mm), 0.0)
        sums += [block_means(square, size), block_means(away, size)]
        if away.any():
            found.append(float(np.sqrt(square.sum() / np.count_nonzero(away))))
    squares, share = (cv2.GaussianBlur(one, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE) for one in sums)
    std_mm = np.round(np.sqrt(squares / np.maximum(share, TINY)), 6).tolist()
    return replace(card, untouched_depth_rms_mm=float(np.median(found)) if found else 0.0, untouched_std_mm=std_mm)


def block_grid(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return how many blocks of BLOCK_PX lie across and down a picture (H, W)."""
    return max(2, shape[1] // BLOCK_PX), max(2, shape[0] // BLOCK_PX)


def untouched_std_mm(depths: Sequence[Array]) -> Floats:
    """Return the standard deviation (h, w) mm of N >= 2 depths (H, W) mm of the free gel, in blocks of BLOCK_PX.

    The median over the frames, robust against touched ones; N/(N - 1) of the variance, as the mean of the same
    frames'
    slopes was subtracted; smoothed over neighbouring blocks.
    """
    block_std = block_means(MAD_TO_STD * np.median(np.abs(np.stack(depths)), axis=0), block_grid(depths[0].shape))
    smooth = cv2.GaussianBlur(block_std, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smooth * np.sqrt(len(depths) / (len(depths) - 1)), np.float64)


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
    frames, method = reference_match.some_frames(recording, count=MAX_FRAMES), ready.referenced
    at = method and reference_match.contact_in_reference(method, ready.rectified_map, pictures=frames)
    if not (at and method):
        return flats, ready, ()
    median: Bytes = np.median(frames, axis=0).round().astype(np.uint8)
    against = read([median])
    renewed = against.referenced
    if renewed and reference_match.contact_in_reference(renewed, against.rectified_map, pictures=frames):
        return flats, ready, ()
    if reference_match.pressed_beside(method, ready.rectified_map, picture=median):
        return flats, ready, ()
    name = recording.frame_names[recording.flat_frames[0]]
    note = (
        f"{name} shows a contact near ({at[0]:.0f}, {at[1]:.0f}) px: in its place the median of {len(frames)} "
        "frames is taken for the untouched gel; --reference states a picture of it"
    )
    return [median], against, (note,)


# The sources of a reconstructor: a recording's own balls, a saved method, or a ready one.

_log = logging.getLogger(__name__)
DEFAULT = "auto"  # held-out balls choose the fit: never one worse than the plain polynomial on them


def build_reconstructor(
    recording: Recording, method: str | PhotometricMethod | None = None, *, progress: Progress = silent
) -> Reconstructor:
    """Return a reconstructor calibrated on the recording's own flats and ball presses.

    It warns where the recording's frames are shifted against the reference, or the reference shows a contact.
    `method` is a name in PHOTOMETRIC, the path of a saved method, or a method, which uses the recording's
    flats as reference where there are any. None: DEFAULT on the recording's balls; without balls, the recording's
    own contacts or the network of this kind of sensor, with a warning. `progress` hears of each pass; a
    calibration on balls is logged (INFO). Raises InputError or RecordingError where the reference is missing or
    cannot be used.
    """
    from tactilevision.recording.model import Recording, faults_of_flats

    if not isinstance(recording, Recording):
        raise InputError(
            "a reconstructor is built of a recording",
            value=type(recording).__name__,
            remedy='Read one: read_recording("FOLDER"); a bare folder of frames: read_folder.',
        )
    frames = [*reference_match.spread_frames(recording), *press_starts(recording)]
    with faults_of_flats(recording):
        seen = flats_in_view(recording, [frame.rgb for frame in frames])
        found = _built(recording, [rectify(recording.sensor, rgb) for rgb in seen.flats], method, progress)
    progress(0, 1, "frames")
    return with_view(found, seen).look(frames)


def flats_in_view(recording: Recording, pictures: Sequence[Bytes]) -> Registered:
    """Return the raw pictures of the untouched gel, in the view of rectified `pictures` (H, W, 3) of a recording.

    Without such pictures, its ball presses are taken. Raises InputError where all colours have one light, and for
    flats of another view.
    """
    from tactilevision.recording.pictures import read_flats, read_reference

    sensor, raw = recording.sensor, read_flats(recording)
    flats = [rectify(sensor, rgb) for rgb in raw]
    pressing, by_balls = recording.balls[:FRAMES_READ], not pictures
    if by_balls:
        pictures = [rectify(sensor, read_reference(recording, ball.path)) for ball in pressing]
    if len({rgb.shape for rgb in flats}) != 1 or not (pictures := reference_view.shown(pictures, flats)):
        return Registered(raw)
    reference_view.check_three_lights(np.asarray(np.mean(flats, axis=0, dtype=np.float32)), pictures)
    if not recording.flats or reference_view.in_view_of(flats, pictures):
        return Registered(raw)
    balls = [read_reference(recording, ball.path) for ball in pressing]
    others = balls if by_balls else [one.rgb for one in reference_match.spread_frames(recording, raw=True)]
    found = reference_view.register(raw, reference_view.shown(others, raw))
    pressed = [] if by_balls else [rectify(sensor, rgb) for rgb in balls]
    if found.note and pressed and reference_view.in_view_of(flats, pressed):
        what = "the frames are not of the view of the reference and the ball presses"
        raise InputError(what, where=layout.FLATS, remedy="Take all of them with one camera setting.")
    note = found.note and f"{recording.flats[0].name}: {found.note}; --reference states another"
    return replace(found, note=note)


def with_view(found: Reconstructor, seen: Registered) -> Reconstructor:
    """Return a reconstructor whose reference is known only where the flats as `seen` cover it, with their note."""
    method = found.referenced
    if not seen.note or method is None:
        return found
    if seen.covered is not None:
        covered = rectify(found.sensor, np.dstack([255 * seen.covered.astype(np.uint8)] * 3))[..., 0] == 255
        method = method.with_reference(replace(method.reference, usable=method.reference.usable & covered))
    match = found.match and replace(found.match, method=method, registered=True)
    return found.varied(method=method, match=match, taught=found.taught).warned(seen.note)


def _built(
    recording: Recording, flats: Sequence[Bytes], method: str | PhotometricMethod | None, progress: Progress
) -> Reconstructor:
    from tactilevision.recording.pictures import read_reference

    sensor = recording.sensor
    if isinstance(method, str) and method not in PHOTOMETRIC:
        return _saved(method, sensor, flats)
    if method is None and not recording.balls:
        return _uncalibrated(recording, flats)
    if method is not None and not isinstance(method, str):
        return with_flats(sensor, method, flats=flats)
    name = method or DEFAULT
    fit = PHOTOMETRIC[name]
    reference, noted = _reference(sensor, flats)
    pictures = [
        BallPicture(
            rectify(sensor, read_reference(recording, ball.path)),
            ball.ball_radius_mm,
            ball.centre_px,
            ball.contact_radius_px,
            ball.name,
        )
        for ball in recording.balls
    ]
    if pictures:
        scene_faults.check_order(reference.rgb, [picture.rgb for picture in pictures])
    free = free_frames(recording)

    def calibrated() -> Reconstructor:
        _log.info("%s: calibrating the light on %d ball presses", recording.name, len(pictures))
        how: Any = {"mm_per_px": sensor.mm_per_px, "fit": fit, "progress": progress}
        calibration = calibrate_from_balls(reference, pictures, **how)
        found = tuned(sensor, calibration, pictures=pictures, free=free, progress=progress)
        return found.warned(*ball_validation.doubt_of_radii(sensor, pictures, calibration))

    found = kept_light(sensor, name, reference, pictures=pictures, free=free, make=calibrated)
    return found.warned(*noted)


def _reference(sensor: Sensor, flats: Sequence[Bytes]) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference of rectified flats; warn where a colour is dark in it or overexposed, and where it
    shows marks that the sensor should not have.
    """
    reference = make_reference(flats)
    noted = (
        *dark_colour_warning(reference),
        *overexposed_warning(reference),
        *round_outline_warning(reference, sensor),
    )
    if reference.marks is None or may_have_marks(sensor):
        return reference, noted
    return reference, (
        *noted,
        f"the untouched gel shows a regular pattern of dark marks, and a {sensor.kind} has none: they are filled "
        "as markers are. Name a sensor with markers (gelslim3_markers, or a TOML file with has_markers = true)",
    )


def _saved(name: str, sensor: Sensor, flats: Sequence[Bytes]) -> Reconstructor:
    path = Path(name)
    if path.with_suffix(".npz").is_file():
        method = load_method(path)
        _check_kind(method.card, sensor)
        return with_flats(sensor, method, flats=flats)
    if path.with_suffix(".onnx").is_file():
        return _without_balls(sensor, path, flats)
    raise InputError(
        "no photometric method of that name, nor a saved one there",
        where="method",
        value=name,
        remedy="Known are " + ", ".join(PHOTOMETRIC) + ".",
    )


def _uncalibrated(recording: Recording, flats: Sequence[Bytes]) -> Reconstructor:
    sensor = recording.sensor
    path = find_model(_family(sensor.kind))
    ready = _without_balls(sensor, path, flats) if path is not None and flats else None
    noted: tuple[str, ...] = ()
    if ready is not None and path is not None and recording.flat_frames:
        flats, ready, noted = with_free_reference(
            recording, flats, ready, read=partial(_without_balls, sensor, path)
        )
    own = _on_own_contacts(recording, flats, ready) if flats else None
    if own is not None:
        return own.warned(*noted)
    if ready is None or path is None:
        raise _nothing_known(recording, flats)
    few = reference_match.some_frames(recording, count=scene_faults.FRAMES_FOR_ORDER)
    order = scene_faults.order_warnings(path, flats, few, sensor=sensor)
    if not order and (method := ready.referenced) is not None:
        touched = [rgb for rgb in few if contacts_in([rgb], method.reference, ready.tear_check)]
        pressed = [rgb for rgb in touched if not untouched_of(method, [rgb])]
        scene_faults.check_surface(method, pressed, sensor=sensor, where=recording.path)
    if order and ready.match is not None:
        ready = ready.varied(match=replace(ready.match, other_light=True))
    return ready.warned(*noted, _network_warning(ready, sensor.kind), *order)


def _nothing_known(recording: Recording, flats: Sequence[Bytes]) -> InputError:
    """Return what to do where neither balls nor contacts nor a network determine the light."""
    from tactilevision.recording.model import is_bare

    bare = is_bare(recording)
    missing = (
        "ball presses to calibrate the light from, and too few contacts in the frames"
        if flats
        else "picture of the untouched gel"
    )
    named = "--method FILE.npz or --sensor FILE.tvs" if flats else "--reference"
    return InputError(
        f"no {missing}",
        where=recording.path if bare else recording.path / "reference" / ("ball" if flats else "flat"),
        value=f"sensor {recording.sensor.kind}",
        remedy=f"Name what was calibrated before with {named}."
        + (f" Kinds that are ready without balls: {', '.join(ready_models())}." if flats else "")
        + (f" Or take in a frame with something round on the gel; {MIN_CONTACTS} do better." if flats else "")
        + ("" if bare else " Or add them to the recording.")
        + _doubt_of_guess(recording),
    )


def _network_warning(ready: Reconstructor, kind: str) -> str:
    """Return the expected accuracy of a ready network, by its card."""
    presses = {} if ready.referenced is None else ready.referenced.card.other.get("real_ball_presses", {})
    off = sorted(round(sensor["direction_error_deg"]) for sensor in presses.values())
    span = " to ".join(dict.fromkeys(map(str, off[:1] + off[-1:])))
    real = f"; on real ones slopes pointed {span} degrees off" if off else ""
    return f"no ball presses: depth rests on the light of a usual {kind}, not of this one{real}"


def _doubt_of_guess(recording: Recording) -> str:
    """Return other possible errors where a frame was taken for untouched gel, or is the only one."""
    names = recording.frame_names
    if len(names) == 1 and recording.path.is_file():
        return f" Or name its folder, {recording.frames_path}, whose other frames tell the light."
    if recording.flat_frames:
        return f" If {names[recording.flat_frames[0]]} shows a contact, name an untouched one with --reference."
    return ""


def _on_own_contacts(
    recording: Recording, flats: Sequence[Bytes], ready: Reconstructor | None
) -> Reconstructor | None:
    """Return a reconstructor calibrated on contacts in the frames; None where they do not determine the light."""
    sensor = recording.sensor
    reference = make_reference(flats, may_have_marks=may_have_marks(sensor))
    _check_colours(reference)
    method = calibrated_on_frames(recording, reference, prior=ready.referenced if ready is not None else None)
    if method is None:
        return None
    found = Reconstructor(sensor, method, match=ReferenceMatch(method, DEFAULT_BASELINE))
    return found.warned(scale_warning(method, kind=sensor.kind), *overexposed_warning(reference))


def _without_balls(sensor: Sensor, path: Path, flats: Sequence[Bytes]) -> Reconstructor:
    reference, noted = _reference(sensor, flats)
    _check_colours(reference)
    method = load_network(path, reference)
    _check_kind(method.card, sensor)
    if ball_validation.scale_is_assumed(method.card):
        card = method.card
        std = max(card.held_out_gain_std or 0.0, NETWORK_SCALE_STD)
        method = replace(method, card=replace(card, held_out_gain_std=std))
    match, said = ReferenceMatch(method, DEFAULT_BASELINE), tuple[str, ...]()
    if method.card.light is not None:  # else it applies to any light
        match, said = match.with_light(method.card.light)
    return Reconstructor(sensor, method, match=match).warned(*noted, *said)


def _check_colours(reference: Reference) -> None:
    """Check that no colour is missing: without balls there is no law of two colours."""
    if dark := dark_colour_warning(reference):
        raise InputError(
            "slopes are not told without ball presses where a colour is dark",
            where="the reference",
            value=dark[0].partition(":")[0],
            remedy="Check that lamp; or calibrate on ball presses, by which the other two colours tell slopes.",
        )


def _check_kind(card: MethodCard, sensor: Sensor) -> None:
    """Check the kind of light: a method of another kind is invalid; custom sensors are not checked."""
    kinds = _family(card.sensor or "custom"), _family(sensor.kind)
    if "custom" not in kinds and kinds[0] != kinds[1]:
        raise InputError(
            "the method was made for another sensor",
            where="method",
            value=f"{kinds[0]}, the recording's is {kinds[1]}",
            remedy="Train one on this sensor's balls.",
        )


def _family(kind: str) -> str:
    """Return the sensor's family: sensors that differ in their marks alone share their light."""
    return kind.removesuffix("_markers")


def with_flats(sensor: Sensor, method: PhotometricMethod, *, flats: Sequence[Bytes]) -> Reconstructor:
    """Return a reconstructor of a ready method against current rectified pictures (H, W, 3), grey, of the
    untouched gel.

    Warns where the method was made in another light. Raises InputError where it was made for another view.
    """
    if not (flats and isinstance(method, CalibratedMethod)):
        return Reconstructor(sensor, method)
    reference, noted = _reference(sensor, flats)
    check_view(method.reference.shape, reference.shape)
    against = method.with_reference(reference)
    match, said = ReferenceMatch(against).with_light(light_of(method.reference))
    return Reconstructor(sensor, against, match=match).warned(*noted, *said)
