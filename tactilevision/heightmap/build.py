"""Build a reconstructor from a recording's balls, a saved method or a ready one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import doubt_of_radii
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import DEFAULT_BASELINE, ReferenceMatch, some_frames, spread_frames
from tactilevision.heightmap.scene_faults import check_order
from tactilevision.heightmap.self_calibration import MIN_CONTACTS, calibrated_on_frames, scale_warning
from tactilevision.heightmap.untouched_frames import free_frames, press_starts, tuned, with_free_reference
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.network import find_model, ready_models
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.photometric.reference import (
    Reference,
    check_view,
    dark_colour_warning,
    light_of,
    make_reference,
    overexposed_warning,
)
from tactilevision.photometric.storage import load_method, load_network
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes, Pair
from tactilevision.records.rig import Sensor
from tactilevision.sensors import may_have_marks
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# Do pictures have the orientation and colour order of a ready network, neither mirrored nor red and blue swapped?
#
# Slopes of a surface have no curl. Of the squared slopes that a network reads, the best surface leaves .04 to .21
# unexplained on nine real sensors, and .30 to .69 with red and blue exchanged or the picture mirrored. On
# untouched gel there is no difference. With symmetric lamps, one exchange compensates the other. A picture rotated
# by 180 degrees only changes the sign.

FRAMES_FOR_ORDER = 6  # number of frames, spread over the recording
BLUR_PX = 2.0  # sigma: noise of single pixels is half curl
BETTER = 0.6  # of the curl: a false exchange at least doubles it, a correct one at least halves it
EXCHANGES: dict[str, Callable[[Bytes], Bytes]] = {
    "red and blue exchanged (BGR for RGB)": lambda rgb: rgb[..., ::-1],
    "the picture mirrored": lambda rgb: rgb[:, ::-1],
}


def order_warnings(
    path: Path, flats: Sequence[Bytes], frames: Sequence[Bytes], *, sensor: Sensor
) -> tuple[str, ...]:
    """Return a warning where slopes of `frames` by the network at `path` fit a surface far better if exchanged.

    `flats` and `frames` are rectified pictures (H, W, 3).
    """

    def curl(exchange: Callable[[Bytes], Bytes]) -> float:
        untouched, seen = ([np.ascontiguousarray(exchange(rgb)) for rgb in many] for many in (flats, frames))
        reference = make_reference(untouched, may_have_marks=may_have_marks(sensor))
        return curl_share(load_network(path, reference), seen, sensor.mm_per_px)

    plain = curl(lambda rgb: rgb)
    shares = {name: curl(exchange) for name, exchange in EXCHANGES.items()}
    better = [name for name, share in shares.items() if share < BETTER * plain]
    if not better:
        return ()
    return (
        f"as they are, the frames show no surface to the ready network for {sensor.kind} ({100 * plain:.0f} % of "
        f"the slopes is curl); with {' or '.join(better)} they do ({100 * min(shares.values()):.0f} %). Save "
        "frames and reference as the maker's software shows them; depths are false",
    )


def curl_share(method: PhotometricMethod, frames: Sequence[Bytes], mm_per_px: Pair) -> float:
    """Return the share, 0 to 1, of squared slopes in rectified `frames` (H, W, 3) with curl; NaN if none."""
    left = whole = 0.0
    for rgb in frames:
        with suppress(InputError):
            read = method.slopes(rgb)
            known = 1.0 if read.valid is None else read.valid
            p, q = (cv2.GaussianBlur(slope * known, (0, 0), BLUR_PX) for slope in (read.dz_dx, read.dz_dy))
            down, along = np.gradient(integrate(SlopeMap(p, q), mm_per_px), *mm_per_px[::-1])
            left += float(np.sum((p - along) ** 2 + (q - down) ** 2))
            whole += float(np.sum(p**2 + q**2))
    return left / whole if whole else float("nan")


# The sources of a reconstructor: a recording's own balls, a saved method, or a ready one.

DEFAULT = "auto"  # held-out balls choose the fit: never one worse than the plain polynomial on them


def build_reconstructor(recording: Recording, method: str | PhotometricMethod | None = None) -> Reconstructor:
    """Return a reconstructor calibrated on the recording's own flats and ball presses.

    It warns where the recording's frames are shifted against the reference, or the reference shows a contact.
    `method` is a name in PHOTOMETRIC, the path of a saved method, or a ready one; a ready one is used against the
    recording's flats where there are some. None: DEFAULT on the recording's balls or, without any, the method
    trained beforehand for this kind of sensor, which its warnings then say. Raises InputError or RecordingError
    where the reference is missing or cannot be used.
    """
    from tactilevision.recording.model import Recording, faults_of_flats

    if not isinstance(recording, Recording):
        raise InputError(
            "a reconstructor is built of a recording",
            value=type(recording).__name__,
            remedy='Read one: read_recording("FOLDER"); a bare folder of frames: read_folder.',
        )
    with faults_of_flats(recording):
        found = _built(recording, method)
    return found.look([*spread_frames(recording), *press_starts(recording)])


def _built(recording: Recording, method: str | PhotometricMethod | None) -> Reconstructor:
    from tactilevision.recording.pictures import read_flats, read_reference

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
            rectify(sensor, read_reference(recording, ball.path)),
            ball.ball_radius_mm,
            ball.centre_px,
            ball.contact_radius_px,
            ball.name,
        )
        for ball in recording.balls
    ]
    if pictures:
        check_order(reference.rgb, [picture.rgb for picture in pictures])
    calibration = calibrate_from_balls(reference, pictures, mm_per_px=sensor.mm_per_px, fit=fit)
    found = tuned(sensor, calibration, pictures=pictures, free=free_frames(recording))
    return found.warned(*noted, *doubt_of_radii(sensor, pictures, calibration))


def _reference(sensor: Sensor, flats: Sequence[Bytes]) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference of rectified flats; warn where a colour is dark in it or overexposed, and where it
    shows marks that the sensor should not have.
    """
    reference = make_reference(flats)
    noted = (*dark_colour_warning(reference), *overexposed_warning(reference))
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
    order = order_warnings(path, flats, some_frames(recording, count=FRAMES_FOR_ORDER), sensor=sensor)
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
    if not isinstance(method, CalibratedMethod):
        return Reconstructor(sensor, method)
    reference, noted = _reference(sensor, flats)
    check_view(method.reference.shape, reference.shape)
    against = method.with_reference(reference)
    match, said = ReferenceMatch(against).with_light(light_of(method.reference))
    return Reconstructor(sensor, against, match=match).warned(*noted, *said)
