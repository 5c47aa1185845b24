"""Pictures read with a profile: a recording's, whose own sensor must be the profile's, or a bare folder's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tactilevision.errors import InputError
from tactilevision.profile.model import Profile
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.quality.reference_match import spread_frames
from tactilevision.recording import Recording, faults_of_flats, layout, read_flats, read_folder, read_recording

NO_KIND = "custom"  # a kind that says nothing of the sensor


def open_with_profile(path: Path, profile: Profile, *, reference: Path | None = None) -> Recording:
    """The recording, folder, video or frame at `path`, its sensor the profile's.

    `reference` is a newer picture of the untouched gel, or a folder of such; None: the profile's own, and the
    recording then has no flats. Raises InputError where the recording is of another unit or kind, or its frames
    have another size.
    """
    if (path / layout.SETTINGS).is_file():
        own = read_recording(path, sensor=_keys(profile))
        _check_unit(own, profile)
        flats = read_folder(path, reference=reference).flats if reference is not None else ()
        gel = profile.sensor.gel or own.sensor.gel
        found = replace(
            own, sensor=replace(profile.sensor, gel=gel), flats=flats, balls=(), white_level=profile.white_level
        )
    else:
        sensor, white = profile.sensor, profile.white_level
        found = read_folder(path, sensor, reference=reference, white_level=white)
    size = found.frame_size_px
    if size is not None and size != profile.frame_size_px:
        raise InputError(
            f"frames of {_by(profile.frame_size_px)} are what the profile {profile.name} was made for",
            where=found.frames_path or path,
            value=_by(size),
            remedy="Set the camera as it was, or calibrate the sensor anew.",
        )
    return found


def sensor_for(recording: Recording, profile: Profile, *, shadows: bool = False) -> CalibratedSensor:
    """The calibrated sensor, against the recording's own pictures of the untouched gel where it has any.

    With `shadows`, those that lamps cast are undone where the profile knows its lamps; where only its balls told
    them, if the recording's frames show shadows.
    Some frames have been looked at: its reconstructor's warnings say where they are another unit's.
    """
    sensor = CalibratedSensor(profile, shadows=shadows)
    flats = read_flats(recording)
    if flats:
        with faults_of_flats(recording):
            sensor = sensor.with_reference(flats)
    sensor.look(spread_frames(recording))
    if shadows:
        sensor.look_for_shadows(recording)
    return sensor


def _keys(profile: Profile) -> dict[str, object]:
    """What a recording.toml may leave to the profile."""
    sensor = profile.sensor
    keys: dict[str, object] = {"kind": sensor.kind, "mm_per_px": list(sensor.mm_per_px)}
    if sensor.kind == NO_KIND and sensor.rectification is None:
        keys |= {"width_px": sensor.width_px, "height_px": sensor.height_px}
    return keys


def _check_unit(own: Recording, profile: Profile) -> None:
    theirs, ours = own.sensor, profile.sensor
    for what, said, known in (("kind", theirs.kind, ours.kind), ("serial", theirs.serial, ours.serial)):
        if said != known and not {"", NO_KIND} & {said, known}:
            raise InputError(
                f"the profile is of another unit: its {what} is {known}, the recording's {said}",
                where=profile.path,
                remedy=f"Calibrate this one: tactilevision calibrate-sensor {own.path}.",
            )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} px"
