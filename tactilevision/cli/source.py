"""Open frames of a recording or folder and build their reconstructor for several commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tactilevision.cli import console
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from tactilevision.heightmap.reconstructor import Reconstructor
    from tactilevision.press.certified_faces import FaceDepthCorrection
    from tactilevision.profile.model import Profile
    from tactilevision.profile.sensor import CalibratedSensor
    from tactilevision.recording.model import Recording


# What several commands begin with: frames of a recording or a bare folder, and the way from them to depth.

SensorOption = Annotated[
    str | None,
    typer.Option(
        help="A profile (.tvs) that `calibrate-sensor` wrote; for a bare folder of frames also a sensor's "
        "name, or a TOML file with a [sensor] table."
    ),
]
ReferenceOption = Annotated[
    Path | None,
    typer.Option(
        help="A frame of the untouched gel, or a folder of them; of a bare folder the first frame if left out."
    ),
]


def check_scale(mm_per_px: float | None) -> float | None:
    """The value of --mm-per-px. Raises InputError for one that no camera has on a gel."""
    from tactilevision import sensors

    if mm_per_px is not None:
        sensors.check_scale(mm_per_px, where="--mm-per-px")
    return mm_per_px


ScaleOption = Annotated[
    float | None,
    typer.Option(
        "--mm-per-px",
        callback=check_scale,
        help="Scale of the (rectified) frames; of a bare folder guessed from the sensor if left out.",
    ),
]
MethodOption = Annotated[
    str | None,
    typer.Option(
        help="polynomial, auto, lookup, network, or a file that `train` made; left out: the best there is."
    ),
]
BallOption = Annotated[
    float | None,
    typer.Option(min=0.01, max=1000.0, help="Of ball presses without a table: the radius of all balls."),
]
EvenSoOption = Annotated[
    bool, typer.Option("--even-so", help="Go on though the light's calibration fails its own balls.")
]


@dataclass(frozen=True)
class Choice:
    """What was said of sensor, untouched gel, light and scale; all of it may be left out."""

    sensor: str | None = None
    reference: Path | None = None
    method: str | None = None
    mm_per_px: float | None = None
    even_so: bool = True

    @cached_property
    def profile(self) -> Profile | None:
        """The sensor profile that was named. Raises InputError where it cannot be used with the rest."""
        from tactilevision.profile.storage import SUFFIX, read_profile

        if self.sensor is None or not self.sensor.lower().endswith(SUFFIX):
            return None
        for option, value in (("--method", self.method), ("--mm-per-px", self.mm_per_px)):
            if value is not None:
                raise InputError(
                    "is said by the sensor profile already", where=option, value=value, remedy="Leave it out."
                )
        return read_profile(self.sensor)

    @property
    def way(self) -> str:
        """What decides how frames are read: the method's name or content, or the profile's; and the scale."""
        from tactilevision.photometric.catalogue import PHOTOMETRIC
        from tactilevision.photometric.storage import digest

        name, path = self.method or "", None if self.profile is None else self.profile.path
        if name and name not in PHOTOMETRIC:
            path = Path(name).with_suffix(".json")  # the card, which holds the hashes of its files
        content = digest(path) if path is not None and path.is_file() else name
        return f"{content} {self.mm_per_px}"

    def open(self, path: Path, *, needs_frames: bool = True) -> Recording:
        """Read a recording, or a bare folder of frames whose sensor is named.

        Not `needs_frames`: one that holds ball presses alone will do.
        """
        from tactilevision.recording.folder import read_folder
        from tactilevision.recording.model import require

        if self.profile is not None:
            from tactilevision.profile.sensor import open_with_profile

            recording = open_with_profile(path, self.profile, reference=self.reference)
        elif self._is_recording(path):
            recording = self._of_recording(path)
        else:
            recording = read_folder(
                path,
                sensor=self.sensor,
                reference=self.reference,
                mm_per_px=self.mm_per_px,
                guess=not self._has_own_reference(),
            )
        if needs_frames or not recording.balls:
            require(recording, "frames", step="making height maps")
        return recording

    def open_branch(self, path: Path) -> Recording:
        """A source in a tree: without a profile, a recording knows its own sensor and reference."""
        from tactilevision.recording import layout

        own = self.profile is None and (path / layout.SETTINGS).is_file()
        return Choice(method=self.method, even_so=self.even_so).open(path) if own else self.open(path)

    def light(self, recording: Recording) -> Reconstructor:
        """Calibrate the light from the recording's own references, or use the method or profile that was named.

        Left out, balls decide how the light is fitted. A certificate keeps to the polynomial: its scale is the
        bevel's, and on one sample it saw the touch 2 um earlier with another fit.
        Not `even_so`: raises InputError for a calibration that fails its own balls.
        """
        from tactilevision.heightmap.ball_validation import check_fit, unfit_warnings
        from tactilevision.heightmap.build import build_reconstructor

        sensor = self.calibrated(recording)
        made = build_reconstructor(recording, self.method) if sensor is None else sensor.reconstructor
        if made.referenced is not None and not self.even_so:
            if same := unfit_warnings(made.referenced.card):  # what else is doubtful may say why
                console.warn([line for line in made.warnings if line not in same])
            named = self.sensor if sensor is not None else self.method if self._has_own_reference() else None
            check_fit(made.referenced.card, remedy="--even-so", where=named or "reference/ball")
        return made

    def calibrated(self, recording: Recording) -> CalibratedSensor | None:
        """The profile's sensor, once it has looked at some of the frames; None where no profile was named."""
        if self.profile is None:
            return None
        from tactilevision.profile.sensor import sensor_for

        return sensor_for(recording, self.profile)

    def _is_recording(self, path: Path) -> bool:
        """Whether recording.toml says all that is needed, or is asked for because there is nothing else."""
        from tactilevision.recording import layout

        if not path.exists() or any(path.glob(f"*/{layout.SETTINGS}")):  # the reader says what is meant
            return self.sensor is None
        return self.sensor is None and (path / layout.SETTINGS).is_file()

    def _has_own_reference(self) -> bool:
        """Whether a saved method was named, which brings a picture of the untouched gel along."""
        return self.method is not None and Path(self.method).with_suffix(".npz").is_file()

    def _of_recording(self, path: Path) -> Recording:
        from tactilevision.recording.folder import read_folder
        from tactilevision.recording.read import read_recording

        if self.reference is None and self.mm_per_px is None:
            return read_recording(path)
        return read_folder(path, reference=self.reference, mm_per_px=self.mm_per_px)


def open_balls(path: Path, chosen: Choice, ball_radius_mm: float | None) -> Recording:
    """Read a recording, or a bare folder of ball presses whose sensor is named."""
    from tactilevision.recording import layout
    from tactilevision.recording.ball_folder import read_ball_folder

    if chosen.profile is not None:
        raise InputError(
            "a profile is made of a sensor that has none yet",
            where="--sensor",
            value=chosen.sensor,
            remedy="Name the kind of sensor, or a TOML file.",
        )
    if (path / layout.SETTINGS).is_file() or not path.exists():
        return chosen.open(path, needs_frames=False)
    return read_ball_folder(
        path,
        chosen.sensor,
        reference=chosen.reference,
        mm_per_px=chosen.mm_per_px,
        ball_radius_mm=ball_radius_mm,
    )


def is_tree(path: Path) -> bool:
    """Whether frames have to be looked for below `path`: not a recording, a video, or one folder of pictures."""
    from tactilevision.batch.tree import find_sources

    return path.is_dir() and find_sources(path) not in ((path,), ())


def open_face_correction(
    recording: Recording, reconstructor: Reconstructor, *, calibration: Path | None
) -> tuple[Reconstructor, FaceDepthCorrection]:
    """Return what reads walls as faces certified by `calibration` teach, and what holds the faces of presses.

    A warning where it knows too few.
    """
    from tactilevision.press.certified_faces import (
        NO_CORRECTION,
        face_depth_correction,
        read_certified,
        read_faces,
        teach_walls,
    )

    if calibration is None:
        return reconstructor, NO_CORRECTION
    faces = read_faces(recording, reconstructor, certified=read_certified(calibration))
    taught = teach_walls(reconstructor, faces)
    anchor = face_depth_correction(recording, faces, walls=taught.taught)
    if anchor is NO_CORRECTION:
        points = calibration.parent / "points.csv"
        own = "the picture's own" + ("" if taught is reconstructor else ", with walls as these faces teach them")
        console.warn([f"{points} certifies too few faces of this recording: depths are {own}"])
    else:
        console.warn([anchor.doubt] if anchor.doubt else [])
        console.say("faces are as deep as the certificate beside the calibration has them")
    return taught, anchor


# Which of many frames are worth a picture.


def telling(recording: Recording, size: Sequence[float], *, most: int) -> list[int]:
    """Numbers of at most `most` frames, in order: the one of greatest `size` (NaN: none) of each press, the
    greatest of these; where no presses or times are known, of each of `most` stretches of the frames."""
    values = np.asarray(size, dtype=float)
    best = []
    for part in _parts(recording, max(min(most, len(values)), 1)):
        known = part[np.isfinite(values[part])]
        if known.size:
            best.append(int(known[np.argmax(values[known])]))
    best.sort(key=lambda number: -values[number])
    return sorted(best[:most])


def _parts(recording: Recording, most: int) -> list[np.ndarray[tuple[int], np.dtype[np.intp]]]:
    times = recording.frame_times_s
    presses = [np.flatnonzero((times >= press.start_s) & (times <= press.end_s)) for press in recording.presses]
    if any(part.size for part in presses):
        return presses
    return np.array_split(np.arange(len(recording.frame_names)), most)
