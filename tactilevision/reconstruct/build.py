"""The ways to a reconstructor: a recording's own balls, a method that was saved, or one that came ready."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.photometric import (
    PHOTOMETRIC,
    BallPicture,
    Calibration,
    Reference,
    calibrate_from_balls,
    load_method,
    load_network,
    make_reference,
)
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.ball.samples import far_from
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.contacts.self_calibration import MIN_CONTACTS
from tactilevision.photometric.illumination.light_match import check_view, light_of
from tactilevision.photometric.method import as_referenced
from tactilevision.photometric.methods.weights import find_model, ready_models
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.reference import dark_colour_warning
from tactilevision.quality.inconsistent_light import measured_light
from tactilevision.quality.reference_match import DEFAULT_BASELINE, ReferenceMatch, baseline, some_frames
from tactilevision.reconstruct.guessed_reference import with_free_reference
from tactilevision.reconstruct.own_contacts import calibrated_on_frames, scale_warning
from tactilevision.reconstruct.reconstructor import Reconstructor
from tactilevision.reconstruct.untouched_frames import free_frames, subtract_background, tare, untouched_of
from tactilevision.records import Bytes, Sensor
from tactilevision.sensors import may_have_marks, rectify
from tactilevision.uncertainty.ball_validation import held_out_depth, seen_gain_std
from tactilevision.uncertainty.depth import contributions_mm
from tactilevision.uncertainty.leakage import leakage_share
from tactilevision.uncertainty.untouched_gel import untouched_std_mm

if TYPE_CHECKING:
    from tactilevision.recording import Recording

DEFAULT = "auto"  # balls left out choose the fit: never one that they tell worse than the plain polynomial
MAX_WAVES = 8  # pictures with balls that are looked at, at most


def build_reconstructor(recording: Recording, method: str | PhotometricMethod | None = None) -> Reconstructor:
    """A reconstructor calibrated on the recording's own flats and ball presses.

    It warns where the recording's frames lie beside the reference, or show a contact in it. `method` is a name in
    PHOTOMETRIC, the path of a saved method, or a ready one; a ready one is used against the recording's flats
    where there are some. None: DEFAULT on the recording's balls or, without any, the method trained beforehand
    for this kind of sensor, which its warnings then say. Raises InputError or RecordingError where the reference
    is missing or cannot be used.
    """
    from tactilevision.recording import Recording, faults_of_flats

    if not isinstance(recording, Recording):
        raise InputError(
            "a reconstructor is built of a recording",
            value=type(recording).__name__,
            remedy='Read one: read_recording("FOLDER"); a bare folder of frames: read_folder.',
        )
    with faults_of_flats(recording):
        found = _built(recording, method)
    found.look([*some_frames(recording), *free_frames(recording)])
    return found


def _built(recording: Recording, method: str | PhotometricMethod | None) -> Reconstructor:
    from tactilevision.recording import read_flats, read_image

    sensor = recording.sensor
    flats = [rectify(sensor, rgb) for rgb in read_flats(recording)]
    if isinstance(method, str) and method not in PHOTOMETRIC:
        return _saved(method, sensor, flats)
    if method is None and not recording.balls:
        return _uncalibrated(recording, flats)
    if method is not None and not isinstance(method, str):
        return with_flats(sensor, method, flats=flats) if flats else Reconstructor(sensor, method)
    fit = PHOTOMETRIC[method or DEFAULT]
    reference, noted = _reference(sensor, flats)
    pictures = [
        BallPicture(
            rectify(sensor, read_image(ball.path, white_level=recording.white_level)),
            ball.ball_radius_mm,
            ball.centre_px,
            ball.contact_radius_px,
            ball.name,
        )
        for ball in recording.balls
    ]
    calibration = calibrate_from_balls(reference, pictures, mm_per_px=sensor.mm_per_px, fit=fit)
    found = tuned(sensor, calibration, pictures=pictures, free=free_frames(recording))
    found.warnings += noted
    return found


def _reference(sensor: Sensor, flats: Sequence[Bytes]) -> tuple[Reference, tuple[str, ...]]:
    """The reference of rectified flats; a warning where a colour is dark in it, and where it shows marks that the
    sensor was said not to have.
    """
    reference = make_reference(flats)
    noted = dark_colour_warning(reference)
    if reference.marks is None or may_have_marks(sensor):
        return reference, noted
    return reference, (
        *noted,
        f"the untouched gel shows a regular pattern of dark marks, and a {sensor.kind} has none: they are filled "
        "as markers are. Name a sensor with markers (gelslim3_markers, or a TOML file with has_markers = true)",
    )


def tuned(
    sensor: Sensor, calibration: Calibration, *, pictures: Sequence[BallPicture], free: Sequence[Bytes]
) -> Reconstructor:
    """The reconstructor of a calibration, made to fit rectified frames of the free gel, its errors measured.

    How far untouched gel is from flat is told, place by place, by the `free` frames where there are enough of
    them, else by the ball pictures.
    """
    gain = seen_gain_std(calibration.method, pictures, balls=calibration.balls, mm_per_px=sensor.mm_per_px)
    card = dataclasses.replace(calibration.method.card, sensor=sensor.kind, seen_gain_std=gain)
    card = card.extended(held_out_depth(calibration, pictures, mm_per_px=sensor.mm_per_px, seen_gain=gain))
    factor = float(card.other.get("depth_coverage_factor", 1.0))
    place_gain = np.round(factor * np.array(card.place_gain_std), 5).tolist()
    card = dataclasses.replace(card, seen_gain_std=factor * gain, place_gain_std=place_gain)
    card = dataclasses.replace(card, leakage_std=_spread(sensor, calibration, pictures))
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
    usual = baseline(reader.match_residuals, [*(picture.rgb for picture in pictures), *free])
    terms = depth_terms_mm(Reconstructor(sensor, settled), pictures, balls=calibration.balls)
    settled = settled.with_card(dataclasses.replace(settled.card, baseline=usual, depth_terms_mm=terms))
    return Reconstructor(sensor, settled, calibration=calibration)


def depth_terms_mm(
    reader: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> dict[str, float]:
    """What each term adds to the deviation of depth under a ball: rms in mm, the median over ball pictures."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            height = reader.rectified_map(picture.rgb)
            found.append(contributions_mm(height, reader.depth_terms(height)))
    return {name: round(float(np.median([one[name] for one in found])), 6) for name in found[0]} if found else {}


def _spread(sensor: Sensor, calibration: Calibration, pictures: Sequence[BallPicture]) -> float:
    """How far errors of slope reach beside a contact, by laws that never saw a third of the balls."""
    method = calibration.method
    others = [dataclasses.replace(method, law=law) for law in calibration.other_laws]
    maps = [partial(_depth, Reconstructor(sensor, made)) for made in (method, *others)]
    gain = np.array(method.card.place_gain_std) / method.card.coverage_factor
    return leakage_share(maps, pictures, balls=calibration.balls, gain=gain, mm_per_px=sensor.mm_per_px)


def _depth(reader: Reconstructor, rgb: Bytes) -> npt.NDArray[Any]:
    return reader.rectified_map(rgb).depth_mm


def _saved(name: str, sensor: Sensor, flats: Sequence[Bytes]) -> Reconstructor:
    path = Path(name)
    if path.with_suffix(".npz").is_file():
        method = load_method(path)
        _check_kind(method.card, sensor)
        return with_flats(sensor, method, flats=flats) if flats else Reconstructor(sensor, method)
    if path.with_suffix(".onnx").is_file():
        return _without_balls(sensor, path, flats)
    raise InputError(
        "no photometric method of that name, nor a saved one there",
        where="method",
        value=name,
        remedy="Known are " + ", ".join(PHOTOMETRIC) + ".",
    )


def _uncalibrated(recording: Recording, flats: Sequence[Bytes]) -> Reconstructor:
    from tactilevision.recording import is_bare

    sensor, bare = recording.sensor, is_bare(recording)
    path = find_model(_family(sensor.kind))
    ready = _without_balls(sensor, path, flats) if path is not None and flats else None
    noted: tuple[str, ...] = ()
    if ready is not None and path is not None and recording.flat_frames:
        flats, ready, noted = with_free_reference(
            recording, flats, ready, read=partial(_without_balls, sensor, path)
        )
    own = _on_own_contacts(recording, flats, ready) if flats else None
    if own is not None:
        own.warnings += noted
        return own
    if ready is None:
        missing = (
            "ball presses to calibrate the light from, and too few contacts in the frames"
            if flats
            else "picture of the untouched gel"
        )
        named = "--method FILE.npz or --sensor FILE.tvs" if flats else "--reference"
        raise InputError(
            f"no {missing}",
            where=recording.path if bare else recording.path / "reference" / ("ball" if flats else "flat"),
            value=f"sensor {sensor.kind}",
            remedy=f"Name what was calibrated before with {named}."
            + (f" Kinds that are ready without balls: {', '.join(ready_models())}." if flats else "")
            + (f" Or take in a frame with something round on the gel; {MIN_CONTACTS} do better." if flats else "")
            + ("" if bare else " Or add them to the recording.")
            + _doubt_of_guess(recording),
        )
    ready.warnings += (*noted, _network_warning(ready, sensor.kind))
    return ready


def _network_warning(ready: Reconstructor, kind: str) -> str:
    """What to expect of a ready network, by its card."""
    presses = {} if ready.referenced is None else ready.referenced.card.other.get("real_ball_presses", {})
    off = sorted(round(sensor["direction_error_deg"]) for sensor in presses.values())
    span = " to ".join(dict.fromkeys(map(str, off[:1] + off[-1:])))
    real = f"; on real ones slopes pointed {span} degrees off" if off else ""
    return f"no ball presses: depth rests on the light of a usual {kind}, not of this one{real}"


def _doubt_of_guess(recording: Recording) -> str:
    """What else may be wrong where a frame was taken for untouched gel, or is all there is."""
    names = recording.frame_names
    if len(names) == 1 and recording.path.is_file():
        return f" Or name its folder, {recording.frames_path}, whose other frames tell the light."
    if recording.flat_frames:
        return f" If {names[recording.flat_frames[0]]} shows a contact, name an untouched one with --reference."
    return ""


def _on_own_contacts(
    recording: Recording, flats: Sequence[Bytes], ready: Reconstructor | None
) -> Reconstructor | None:
    """A reconstructor whose light is calibrated on contacts in the frames; None where they do not tell it."""
    sensor = recording.sensor
    reference = make_reference(flats, may_have_marks=may_have_marks(sensor))
    _check_colours(reference)
    method = calibrated_on_frames(recording, reference, prior=ready.referenced if ready is not None else None)
    if method is None:
        return None
    found = Reconstructor(sensor, method)
    found.reference_match = ReferenceMatch(method, baseline=DEFAULT_BASELINE)
    found.warnings += (scale_warning(method, kind=sensor.kind),)
    return found


def _without_balls(sensor: Sensor, path: Path, flats: Sequence[Bytes]) -> Reconstructor:
    reference, noted = _reference(sensor, flats)
    _check_colours(reference)
    method = load_network(path, reference)
    _check_kind(method.card, sensor)
    found = Reconstructor(sensor, method)
    found.warnings += noted
    found.reference_match = ReferenceMatch(method, baseline=DEFAULT_BASELINE)
    if method.card.light is not None:  # else it was made for any light
        found.warnings += found.reference_match.check_light(method.card.light)
    return found


def _check_colours(reference: Reference) -> None:
    """Without balls there is no law of two colours."""
    if dark := dark_colour_warning(reference):
        raise InputError(
            "slopes are not told without ball presses where a colour is dark",
            where="the reference",
            value=dark[0].partition(":")[0],
            remedy="Check that lamp; or calibrate on ball presses, by which the other two colours tell slopes.",
        )


def _check_kind(card: MethodCard, sensor: Sensor) -> None:
    """A method of one kind of light says nothing of another; a custom sensor is its owner's affair."""
    kinds = _family(card.sensor or "custom"), _family(sensor.kind)
    if "custom" not in kinds and kinds[0] != kinds[1]:
        raise InputError(
            "the method was made for another sensor",
            where="method",
            value=f"{kinds[0]}, the recording's is {kinds[1]}",
            remedy="Train one on this sensor's balls.",
        )


def _family(kind: str) -> str:
    """Sensors that differ in their marks alone share their light."""
    return kind.removesuffix("_markers")


def untouched_rms_mm(
    reconstructor: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> float:
    """How far from flat untouched gel comes out: the median over ball pictures, away from the ball, mm."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            height = reconstructor.rectified_map(picture.rgb)
            away = far_from(ball, height.depth_mm.shape, mm_per_px=reconstructor.sensor.mm_per_px) & height.valid
            if away.any():
                found.append(float(np.sqrt(np.mean(np.square(height.depth_mm[away])))))
    return float(np.median(found)) if found else 0.0


def with_flats(sensor: Sensor, method: PhotometricMethod, *, flats: Sequence[Bytes]) -> Reconstructor:
    """A reconstructor of a ready method against rectified pictures of the untouched gel as it is today.

    Warns where the method was made in another light. Raises InputError where it was made for another view.
    """
    calibrated = as_referenced(method)
    if calibrated is None:
        return Reconstructor(sensor, method)
    reference, noted = _reference(sensor, flats)
    check_view(calibrated.reference.shape, reference.shape)
    found = Reconstructor(sensor, calibrated.with_reference(reference))
    found.warnings += noted
    if found.reference_match is not None:
        found.warnings += found.reference_match.check_light(light_of(calibrated.reference))
    return found
