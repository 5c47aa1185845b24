"""What commands read: frames of a recording or folder, and their reconstructor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from tactilevision.batch.tree import find_sources
from tactilevision.cli import console
from tactilevision.errors import InputError
from tactilevision.heightmap.ball_validation import check_fit, unfit_warnings
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.protocols import Progress, silent
from tactilevision.photometric.storage import digest
from tactilevision.press import certified_faces
from tactilevision.press.certified_faces import NO_CORRECTION, FaceDepthCorrection, read_certified
from tactilevision.recording import layout
from tactilevision.recording.ball_folder import read_ball_folder
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import Recording, require

if TYPE_CHECKING:
    from tactilevision.profile.model import Profile
    from tactilevision.profile.sensor import CalibratedSensor


@dataclass(frozen=True)
class Choice:
    """Options for sensor, untouched gel, light and scale, each of which may be omitted."""

    sensor: str | None = None
    reference: Path | None = None
    method: str | None = None
    mm_per_px: float | None = None
    even_so: bool = True

    @cached_property
    def profile(self) -> Profile | None:
        """Return the named sensor profile. Raises InputError where other options contradict it."""
        if self.sensor is None:
            return None
        from tactilevision.profile.storage import SUFFIX, read_profile  # with compliance, which takes a while

        if not self.sensor.lower().endswith(SUFFIX):
            return None
        for option, value in (("--method", self.method), ("--mm-per-px", self.mm_per_px)):
            if value is not None:
                raise InputError(
                    "is determined by the sensor profile", where=option, value=value, remedy="Omit it."
                )
        return read_profile(self.sensor)

    @property
    def way(self) -> str:
        """Return what determines the maps: name or hash of method or profile, and the scale."""
        name, path = self.method or "", None if self.profile is None else self.profile.path
        if name and name not in PHOTOMETRIC:
            path = Path(name).with_suffix(".json")  # the card, which holds the hashes of its files
        content = digest(path) if path is not None and path.is_file() else name
        return f"{content} {self.mm_per_px}"

    def open(self, path: Path, *, needs_frames: bool = True) -> Recording:
        """Read a recording, or a bare folder of frames whose sensor is named."""
        if self.profile is not None:
            from tactilevision.profile.sensor import open_with_profile

            recording = open_with_profile(path, self.profile, reference=self.reference)
        else:
            recording = read_folder(
                path,
                sensor=self.sensor,
                reference=self.reference,
                mm_per_px=self.mm_per_px,
                guess=not self._has_own_reference(),
            )
        if needs_frames:
            require(recording, "frames", step="making height maps")
        return recording

    def open_branch(self, path: Path) -> Recording:
        """Open a source in a tree; without a profile, a recording has its own sensor and reference."""
        own = self.profile is None and (path / layout.SETTINGS).is_file()
        return Choice(method=self.method, even_so=self.even_so).open(path) if own else self.open(path)

    def light(self, recording: Recording, progress: Progress = silent) -> Reconstructor:
        """Calibrate the light on the recording's own references, or use the named method or profile.

        Unless `even_so`, raises InputError for a calibration that fails its own balls.
        """
        sensor = self.calibrated(recording)
        made = sensor.reconstructor if sensor else build_reconstructor(recording, self.method, progress=progress)
        if made.referenced is not None and not self.even_so:
            if same := unfit_warnings(made.referenced.card):  # what else is doubtful may say why
                console.warn([line for line in made.warnings if line not in same])
            named = self.sensor if sensor is not None else self.method if self._has_own_reference() else None
            check_fit(made.referenced.card, remedy="--even-so", where=named or "reference/ball")
        return made

    def calibrated(self, recording: Recording) -> CalibratedSensor | None:
        """Return the profile's sensor, checked on some of the frames; None where no profile was named."""
        if self.profile is None:
            return None
        from tactilevision.profile.sensor import sensor_for

        return sensor_for(recording, self.profile)

    def _has_own_reference(self) -> bool:
        """Return whether a saved method was named, which has a picture of the untouched gel."""
        return self.method is not None and Path(self.method).with_suffix(".npz").is_file()


def open_balls(path: Path, chosen: Choice, ball_radius_mm: float | None) -> Recording:
    """Read a recording, or a bare folder of ball presses whose sensor is named."""
    if chosen.profile is not None:
        raise InputError(
            "a profile cannot be made from a profile",
            where="--sensor",
            value=chosen.sensor,
            remedy="Name the kind of sensor, or a TOML file.",
        )
    if (path / layout.SETTINGS).is_file() or not path.exists():
        return chosen.open(path, needs_frames=False)
    return read_ball_folder(
        path, chosen.sensor, reference=chosen.reference, mm_per_px=chosen.mm_per_px, ball_radius_mm=ball_radius_mm
    )


def is_tree(path: Path) -> bool:
    """Return whether `path` is a tree of recordings or folders of frames."""
    return path.is_dir() and find_sources(path) not in ((path,), ())


def taught(
    recording: Recording, reader: Reconstructor, certified: Sequence[certified_faces.Certified]
) -> tuple[Reconstructor, FaceDepthCorrection]:
    """Return the reader with walls as certified faces teach them, and the correction of faces by these."""
    faces = certified_faces.read_faces(recording, reader, certified=certified)
    made = certified_faces.teach_walls(reader, faces)
    return made, certified_faces.face_depth_correction(recording, faces, walls=made.taught)


def open_face_correction(
    recording: Recording, reconstructor: Reconstructor, *, calibration: Path | None
) -> tuple[Reconstructor, FaceDepthCorrection]:
    """Return `taught` by the certificate of `calibration`, with a warning where it certifies too few faces."""
    if calibration is None:
        return reconstructor, NO_CORRECTION
    made, anchor = taught(recording, reconstructor, read_certified(calibration))
    if anchor is NO_CORRECTION:
        points = calibration.parent / "points.csv"
        own = "those of the picture" + ("" if made is reconstructor else ", with the walls' law of these faces")
        console.warn([f"{points} certifies too few faces of this recording: depths are {own}"])
    else:
        console.warn([anchor.doubt] if anchor.doubt else [])
        console.say("depths of faces are corrected by the certificate next to the calibration")
    return made, anchor
