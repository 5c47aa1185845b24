"""Read frames of a calibrated sensor: depth, contact, footprint, tractions and wrench.

sensor = load_sensor("my_sensor.tvs")
seen = sensor.read(rgb)                 # rgb (H, W, 3) uint8 as the camera gives it, red first
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import ConvergenceError, InputError, check_known
from tactilevision.force.compliance import gel_compliance
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.force.nodes import lay_grid
from tactilevision.heightmap.build import flats_in_view, with_flats, with_view
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.reference_match import some_frames, spread_frames
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.photometric.card import provenance
from tactilevision.profile.model import Followed, Profile, Seen
from tactilevision.profile.storage import read_profile
from tactilevision.recording import layout
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import Recording, faults_of_flats
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import LIGHT, Footprint, Frame, HeightMap, TractionMap, add, as_frame
from tactilevision.records.measured import Bytes, Estimate
from tactilevision.records.rig import Gel, Indenter
from tactilevision.sensors import usual_gel
from tactilevision.sensors.rectification import rectify
from tactilevision.shear.displacement import Untouched, read_untouched, untouched_frame

if TYPE_CHECKING:
    from tactilevision.press.certified_faces import DepthScale

NOT_SOLVED = "force not solved"
ORDERS = ("rgb", "bgr")  # of a frame's colours


def load_sensor(path: Path | str, *, indenter: Indenter | str | None = None) -> CalibratedSensor:
    """Return the sensor of a profile that `tactilevision calibrate-sensor` wrote.

    `indenter` is sought in frames: a record, or its name in the profile; None for contact alone.
    Raises InputError for a profile that is missing, of a newer version, or changed.
    """
    return CalibratedSensor(read_profile(path), indenter=indenter)


class CalibratedSensor:
    """A calibrated sensor; `profile` is the content of its file.

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
            fast_kappa(self.field.material.poisson_ratio, 1.0)  # reads its table

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the profile and rebuild the sensor from it."""
        return partial(CalibratedSensor, indenter=self.indenter), (self.profile,)

    @cached_property
    def field(self) -> ForceField | None:
        """Return the solver of tractions from a height map; None where gel, E or nu are not known.

        Of a kind with a usual gel, published values are assumed, and tractions are flagged "material_assumed".
        """
        sensor, material = self.profile.sensor, self.profile.material
        known = usual_gel(sensor) if sensor.gel is None or material is None else (sensor.gel, material)
        if known is None:
            return None
        return ForceField(
            *known,
            sensor.mm_per_px,
            view_px=(sensor.height_px, sensor.width_px),
            settings=ForceSettings(cell_std=False),
            compliance=self.profile.compliance,
        )

    def read(self, rgb: Bytes, *, order: str = "rgb") -> Seen:
        """Read a raw frame (H, W, 3) uint8; its colours are in the `order` "rgb", or "bgr" as OpenCV reads them.

        Raises InputError for a frame of another size, black or saturated.
        """
        check_known(order, ORDERS, what="colours have no such order", where="read: order")
        frame = Frame(rgb)
        return self._seen(frame if order == ORDERS[0] else Frame(np.ascontiguousarray(rgb[..., ::-1])))

    def read_batch(self, rgb: Bytes, *, order: str = "rgb") -> tuple[Seen, ...]:
        """Read each frame of a batch (N, H, W, 3) uint8 as `read` does; one reading a frame."""
        return tuple(self.read(one, order=order) for one in rgb)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of the profile and of the frames looked at."""
        return self.reconstructor.warnings

    def look(self, pictures: Sequence[Frame | Bytes]) -> tuple[str, ...]:
        """Check by rectified `pictures` (H, W, 3), in order, whether the profile still fits the sensor.

        Return warnings of another unit or light, of a camera or gel that moved, and of a contact in the reference;
        maps are flagged from then on.
        """
        before = len(self.reconstructor.warnings)
        self.reconstructor = self.reconstructor.look(pictures)
        self.reconstructor = self.reconstructor.warned(*self._unlike([as_frame(one).rgb for one in pictures]))
        return self.reconstructor.warnings[before:]

    def with_reference(self, flats: Sequence[Bytes]) -> CalibratedSensor:
        """Return the sensor with newer raw pictures (H, W, 3) of the untouched gel as its reference."""
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
        """Return the map (H, W), mm, with the depth of a flat face by the profile's law of certified faces."""
        law, indenter = self.profile.face_law, self.indenter
        if law is None or indenter is None or indenter.shape != "flat_cylinder":
            return height
        from tactilevision.press.certified_faces import with_face  # takes a while to load

        return with_face(height, face, depth_scale=law)

    def tractions(self, height: HeightMap, rgb_rectified: Bytes, *, touched: bool = True) -> TractionMap | None:
        """Return tractions (MPa) of a map (H, W) and its rectified picture; None where they are not known.

        Without contact (not `touched`) they are zero.
        """
        field = self.field
        if field is None:
            return None
        try:
            if not touched:
                return field.without_contact(height)
            if self.untouched is None:
                return field(height)
            free = field.free(height)
            return field(height, self.untouched.shear(rgb_rectified)) if free is None else free
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
        """Warn where most rectified pictures differ from the reference beyond drift."""
        maps = list(filter(None, map(self.reconstructor.sound_map, pictures)))
        flagged = sum(LIGHT in height.flags for height in maps) if maps else len(pictures)
        if 2 * flagged <= len(maps or pictures):
            return ()
        return (
            f"{flagged} of {len(maps or pictures)} frames differ from the reference of the profile "
            f"{self.profile.name}: is this another unit, gel or light? Give a picture of the untouched gel with "
            "--reference, or calibrate this sensor",
        )


def _as_then(profile: Profile) -> tuple[str, ...]:
    """Return the warnings of when the profile was made."""
    return tuple(f"when {profile.path.name} was made: {one}" for one in profile.warnings)


def _chosen(profile: Profile, indenter: Indenter | str | None) -> Indenter | None:
    if not isinstance(indenter, str):
        return indenter
    if indenter not in profile.indenters:
        known = ", ".join(profile.indenters) or "none"
        raise InputError(
            "the profile has no indenter of that name",
            where=profile.path,
            value=indenter,
            remedy=f"It has: {known}. An Indenter record may be given instead.",
        )
    return profile.indenters[indenter]


# Recordings and folders read with a profile.

NO_KIND = "custom"  # a kind that says nothing of the sensor


def open_with_profile(path: Path, profile: Profile, *, reference: Path | None = None) -> Recording:
    """Open the recording, folder, video or frame at `path` with the profile's sensor.

    `reference` is a newer picture of the untouched gel, or a folder of such; with None the profile's own is used,
    and the recording has no flats. Raises InputError for another unit, kind or size of frames.
    """
    if (path / layout.SETTINGS).is_file():
        own = read_recording(path, sensor=_keys(profile))
        _check_unit(own, profile)
        flats = read_folder(path, reference=reference).flats if reference is not None else ()
        gel = profile.sensor.gel or own.sensor.gel
        _check_shape(own, profile)
        sensor, white = replace(profile.sensor, gel=gel), profile.white_level
        found = replace(own, sensor=sensor, flats=flats, balls=(), white_level=white)
    else:
        white = profile.white_level
        found = read_folder(path, profile.sensor, reference=reference, white_level=white, guess=False)
    size = found.frame_size_px
    if size is not None and size != profile.frame_size_px:
        raise InputError(
            f"the profile {profile.name} was made for frames of {_by(profile.frame_size_px)}",
            where=found.frames_path or path,
            value=_by(size),
            remedy="Set the camera to that size, or calibrate the sensor again.",
        )
    return found


def _check_shape(own: Recording, profile: Profile) -> None:
    """Raise InputError where a gel is stated flat here and curved in the profile, or the other way round."""
    here, there = own.sensor.gel, profile.sensor.gel
    if here is not None and there is not None and here.is_flat != there.is_flat:
        raise InputError(
            f"the gel is stated as {here.shape} here, and as {there.shape} in the profile {profile.name}",
            where=own.path / layout.SETTINGS,
            value=here.shape,
            remedy="State the gel's own shape in [sensor.gel]: a round gel read as a flat layer is a third off.",
        )


def sensor_for(recording: Recording, profile: Profile) -> CalibratedSensor:
    """Return the calibrated sensor with the recording's own pictures of the untouched gel, if any, as reference.

    Some of the frames are checked against the profile; the sensor's warnings report what does not fit.
    """
    sensor, frames = CalibratedSensor(profile), spread_frames(recording)
    with faults_of_flats(recording):
        seen = flats_in_view(recording, [frame.rgb for frame in frames])
        if seen.flats:
            sensor = sensor.with_reference(seen.flats)
            sensor.reconstructor = with_view(sensor.reconstructor, seen)
    sensor.look(frames)
    return sensor


def _keys(profile: Profile) -> dict[str, object]:
    """Return the keys of [sensor] that a recording.toml may omit."""
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
                f"the profile is of another unit: its {what} is {known}, the recording's is {said}",
                where=profile.path,
                remedy=f"Calibrate this one: tactilevision calibrate-sensor {own.path}.",
            )


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} px"


# The profile of a recording's sensor, its reconstructor and, where known, E, nu and certified faces.


def make_profile(
    recording: Recording,
    reconstructor: Reconstructor,
    *,
    calibration: Mapping[str, Any] | None = None,
    face_law: DepthScale | None = None,
) -> Profile:
    """Return the profile of a recording's sensor, read by its `reconstructor`.

    The method keeps the walls' law of certified faces; `face_law` is the true over the read depth of these faces.
    `calibration` is the content of calibration.json; without one, E and nu are those stated of the gel. Where gel,
    E and nu are known its compliance is computed, which takes half a minute near free sides. Raises InputError
    where the method has no reference, or E and nu are not fixed.
    """
    method, picture, sensor = reconstructor.referenced, untouched_frame(recording), recording.sensor
    if method is None or picture is None or recording.frame_size_px is None:
        raise InputError(
            "a profile needs a method with a reference, and a picture of the untouched gel",
            where=recording.path,
            remedy="Name the picture with --reference.",
        )
    source = f"{recording.name}: {len(recording.balls)} ball presses, {len(recording.flats)} flats"
    about = provenance(source, licence="")
    today = datetime.datetime.now(tz=datetime.UTC).date()
    made = Profile(
        sensor,
        replace(method, walls=reconstructor.taught),
        picture,
        recording.frame_size_px,
        (recording.date or today).isoformat(),
        "nothing" if reconstructor.match and reconstructor.match.registered else followed_in(recording, picture),
        about["data"],
        recording.white_level,
        calibration or stated_material(sensor.gel),
        face_law=face_law,
        indenters=recording.indenters,
        versions=about["versions"],
        warnings=(*recording.warnings, *reconstructor.warnings),
        path=recording.path,
    )
    return with_compliance(made)


def followed_in(recording: Recording, untouched: Bytes) -> Followed:
    """Return which pattern of the `untouched` picture (H, W, 3), grey levels, single frames show above noise."""
    sensor = recording.sensor
    found = read_untouched(untouched, sensor.mm_per_px, markers=sensor.has_markers or None)
    if found.markers is not None:
        return "markers"
    if found.shows and any(found.shear(rgb).valid.any() for rgb in some_frames(recording)):
        return "texture"
    return "nothing"


def with_compliance(profile: Profile) -> Profile:
    """Return the profile with its gel's compliance; unchanged where gel, E or nu are not known."""
    gel, material, sensor = profile.sensor.gel, profile.material, profile.sensor
    if gel is None or material is None or not gel.is_flat:
        return profile  # the cache keeps that of a mesh, which is a hundred times as large
    view = (sensor.height_px, sensor.width_px)
    grid = lay_grid(view, sensor.mm_per_px, spacing_mm=ForceSettings().spacing_mm)
    made = gel_compliance(gel, grid, poisson_ratio=material.poisson_ratio, slopes=True)
    return replace(profile, compliance=made)


def stated_material(gel: Gel | None) -> dict[str, Any] | None:
    """Return the gel's stated E and nu as in calibration.json; None where it does not state both."""
    if gel is None or gel.youngs_modulus_MPa is None or gel.poisson_ratio is None:
        return None
    return {
        "youngs_modulus_MPa": Estimate.normal(
            gel.youngs_modulus_MPa, gel.youngs_modulus_std_MPa or 0.0, "MPa"
        ).as_json(),
        "poisson_ratio": Estimate.normal(gel.poisson_ratio, gel.poisson_ratio_std or 0.0, "1").as_json(),
        "poisson_ratio_source": "prior",
        "gel": {"thickness_mm": gel.thickness_mm, "shape": gel.shape},
        "assumptions": ["E and nu are as stated of the gel, not measured here"],
    }
