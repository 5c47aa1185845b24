"""Return depth, contact, footprint, tractions and wrench of frames of a calibrated sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from tactilevision.contact.footprint import find_footprint
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.force.compliance import GelCompliance
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.heightmap.build import with_flats
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import spread_frames
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.profile.model import Profile, Seen, SeenBatch
from tactilevision.profile.storage import read_profile
from tactilevision.recording import layout
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import Recording, faults_of_flats
from tactilevision.recording.pictures import read_flats
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import Footprint, Frame, HeightMap, TractionMap, add, as_frame
from tactilevision.records.measured import Bytes, Material, Pair
from tactilevision.records.rig import Gel, Indenter
from tactilevision.sensors.rectification import rectify
from tactilevision.shear.displacement import Untouched, read_untouched

# A calibrated sensor in one object: a frame in; depth, contact, footprint, tractions and wrench out.
#
#     sensor = load_sensor("my_sensor.tvs")
#     seen = sensor.read(rgb)                 # rgb (H, W, 3) uint8 as the camera gives it, red first
#
# All that does not depend on the frame is made once, when the sensor is loaded.

NOT_SOLVED = "force not solved"


def load_sensor(path: Path | str, *, indenter: Indenter | str | None = None) -> CalibratedSensor:
    """The sensor of a profile that `tactilevision calibrate-sensor` wrote.

    `indenter` is what to look for in frames: a record, or its name in the profile; None for contact alone.
    Raises InputError where there is no such profile, where it is of a newer version, and where it was changed.
    """
    return CalibratedSensor(read_profile(path), indenter=indenter)


class CalibratedSensor:
    """What `load_sensor` gives; `profile` is all that the file holds.

    Threads may share one. Frames may be read with `Stream(sensor)`, too, which follows slow changes of the light;
    `read` keeps to the profile's reference.
    """

    def __init__(self, profile: Profile, *, indenter: Indenter | str | None = None) -> None:
        self.profile = profile
        self.reconstructor = Reconstructor(
            profile.sensor, profile.method, warnings=_as_then(profile), frame_size_px=profile.frame_size_px
        )
        self.indenter = _chosen(profile, indenter)
        self.untouched: Untouched | None = None
        if profile.followed != "nothing":
            markers = profile.followed == "markers"
            self.untouched = read_untouched(profile.untouched, profile.sensor.mm_per_px, markers=markers)
        if self.field is not None:
            fast_kappa(self.field.material.poisson_ratio, 1.0)  # so that its table is read now

    def __reduce__(self) -> tuple[object, ...]:
        """Sent to other processes as its profile."""
        return _again, (self.profile, self.indenter)

    @property
    def gel(self) -> Gel | None:
        """The gel, None where it is not described."""
        return self.profile.sensor.gel

    @property
    def material(self) -> Material | None:
        """E and nu with their covariance, None where they are not known."""
        return self.profile.material

    @property
    def mm_per_px(self) -> Pair:
        """Scale (x, y) of the rectified picture."""
        return self.profile.sensor.mm_per_px

    @property
    def compliance(self) -> GelCompliance | None:
        """The gel's compliance, None where E and nu are not known."""
        return self.profile.compliance

    @cached_property
    def field(self) -> ForceField | None:
        """What turns a height map into tractions; None where gel, E or nu are not known."""
        if self.gel is None or self.material is None:
            return None
        view = (self.profile.sensor.height_px, self.profile.sensor.width_px)
        return ForceField(self, view_px=view, settings=ForceSettings(cell_std=False))

    def read(self, rgb: Bytes) -> Seen | SeenBatch:
        """What a frame (H, W, 3) uint8 shows, or each of a batch (N, H, W, 3), red first, as the camera gives it.

        Raises InputError for one that is not of this sensor, black or saturated.
        """
        if getattr(rgb, "ndim", 3) != 4:
            return self._seen(Frame(rgb))
        if not len(rgb):
            raise InputError("a batch of frames holds at least one", where="read", value=rgb.shape)
        return SeenBatch(tuple(self._seen(Frame(one)) for one in rgb))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful: when the profile was made, and since."""
        return self.reconstructor.warnings

    def look(self, pictures: Sequence[Frame | Bytes]) -> tuple[str, ...]:
        """See by rectified `pictures` (H, W, 3), in order, whether the profile is this sensor's as it is now.

        The warnings tell another unit or light, a camera or gel that has moved, and a contact in the reference;
        maps are flagged from then on.
        """
        before = len(self.reconstructor.warnings)
        self.reconstructor = self.reconstructor.look(pictures)
        self.reconstructor = self.reconstructor.warned(*self._unlike([as_frame(one).rgb for one in pictures]))
        return self.reconstructor.warnings[before:]

    def with_reference(self, flats: Sequence[Bytes]) -> CalibratedSensor:
        """The same sensor against newer raw pictures (H, W, 3) of its untouched gel."""
        profile = self.profile
        rectified = [rectify(profile.sensor, one) for one in flats]
        made = with_flats(profile.sensor, profile.method, flats=rectified)
        assert made.referenced is not None
        fresh = CalibratedSensor(
            replace(profile, method=made.referenced, untouched=rectified[0]), indenter=self.indenter
        )
        known = (*_as_then(profile), *made.warnings)
        fresh.reconstructor = made.varied(warnings=known, frame_size_px=profile.frame_size_px)
        return fresh

    def held(self, height: HeightMap, face: Footprint | None) -> HeightMap:
        """The map (H, W), mm, with a flat face as deep as the profile's law of certified faces has it."""
        law, indenter = self.profile.face_law, self.indenter
        if law is None or indenter is None or indenter.shape != "flat_cylinder":
            return height
        from tactilevision.press.certified_faces import with_face  # takes a while to load

        return with_face(height, face, depth_scale=law)

    def tractions(self, height: HeightMap, rgb_rectified: Bytes, *, touched: bool = True) -> TractionMap | None:
        """Tractions (MPa) behind a map (H, W) and its rectified picture; None where they cannot be known.

        Where the map shows no contact they are none, whatever single cells of it say.
        """
        field = self.field
        if field is None:
            return None
        try:
            if not touched:
                return field.without_contact(height)
            if self.untouched is None or not field.touched(height):
                return field(height)
            return field(height, self.untouched.shear(rgb_rectified))
        except ConvergenceError:
            return None

    def _seen(self, frame: Frame) -> Seen:
        rgb = self.reconstructor.rectified(frame)
        height = self.reconstructor.rectified_map(rgb)
        contact = find_contact(height, self.reconstructor.error)
        touched = bool(contact.any())
        face = find_footprint(height, self.indenter) if touched and self.indenter is not None else None
        height = self.held(height, face)
        height = replace(height, flags=add(height.flags, contact_flags(contact, self.reconstructor.error)))
        found = self.tractions(height, rgb, touched=touched)
        unsolved = (NOT_SOLVED,) if found is None and self.field is not None else ()
        return Seen(height, contact, face, found, (*height.flags, *(found.flags if found else ()), *unsolved))

    def _unlike(self, pictures: Sequence[Bytes]) -> tuple[str, ...]:
        """A warning where most rectified pictures are unlike the reference in a way that no drift explains."""
        flagged = 0
        for rgb in pictures:
            try:
                flagged += "light" in self.reconstructor.rectified_map(rgb).flags
            except InputError:
                flagged += 1
        if 2 * flagged <= len(pictures):
            return ()
        return (
            f"{flagged} of {len(pictures)} frames are unlike the reference of the profile {self.profile.name}: "
            "is this another unit, gel or light? Give a picture of the untouched gel with --reference, or "
            "calibrate this sensor",
        )


def _as_then(profile: Profile) -> tuple[str, ...]:
    """What was doubtful when the profile was made: nothing that an option of today could mend."""
    return tuple(f"when {profile.path.name} was made: {one}" for one in profile.warnings)


def _again(profile: Profile, indenter: Indenter | None) -> CalibratedSensor:
    return CalibratedSensor(profile, indenter=indenter)


def _chosen(profile: Profile, indenter: Indenter | str | None) -> Indenter | None:
    if not isinstance(indenter, str):
        return indenter
    if indenter not in profile.indenters:
        known = ", ".join(profile.indenters) or "none"
        raise InputError(
            "the profile has no indenter of that name",
            where=profile.path,
            value=indenter,
            remedy=f"It has: {known}. In code an Indenter record may be given instead.",
        )
    return profile.indenters[indenter]


# Pictures read with a profile: a recording's, whose own sensor must be the profile's, or a bare folder's.

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


def sensor_for(recording: Recording, profile: Profile) -> CalibratedSensor:
    """The calibrated sensor, against the recording's own pictures of the untouched gel where it has any.

    Some frames have been looked at: its reconstructor's warnings say where they are another unit's.
    """
    sensor = CalibratedSensor(profile)
    flats = read_flats(recording)
    if flats:
        with faults_of_flats(recording):
            sensor = sensor.with_reference(flats)
    sensor.look(spread_frames(recording))
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
