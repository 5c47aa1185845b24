"""What several commands begin with: frames of a recording or a bare folder, and the way from them to depth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console

if TYPE_CHECKING:
    from tactilevision.certificate.depth.face_depth import FaceDepthCorrection
    from tactilevision.reconstruct import Reconstructor
    from tactilevision.recording import Recording

SensorOption = Annotated[
    str | None,
    typer.Option(help="For a bare folder of frames: a sensor's name, or a TOML file with a [sensor] table."),
]
ReferenceOption = Annotated[
    Path | None,
    typer.Option(help="For a bare folder of frames: a frame of the untouched gel, or a folder of them."),
]
MethodOption = Annotated[
    str | None,
    typer.Option(
        help="polynomial, auto, lookup, network, or a file that `train` made; left out: the best there is."
    ),
]
EvenSoOption = Annotated[
    bool, typer.Option("--even-so", help="Go on though the light's calibration fails its own balls.")
]


def open_source(path: Path, sensor: str | None, *, reference: Path | None) -> Recording:
    """Read a recording, or a bare folder of frames where its sensor and reference are named."""
    from tactilevision.recording import layout, read_folder, read_recording, require

    bare = sensor is not None or reference is not None or path.suffix.lower() in layout.VIDEO_SUFFIXES
    recording = read_folder(path, sensor=sensor, reference=reference) if bare else read_recording(path)
    require(recording, "frames", step="making height maps")
    return recording


def is_tree(path: Path) -> bool:
    """Whether frames have to be looked for below `path`: not a recording, a video, or one folder of pictures."""
    from tactilevision.batch.tree import find_sources

    return path.is_dir() and find_sources(path) not in ((path,), ())


def open_branch(path: Path, sensor: str | None, *, reference: Path | None) -> Recording:
    """A source in a tree: a recording knows its own sensor and reference."""
    from tactilevision.recording import layout

    own = (path / layout.SETTINGS).is_file()
    return open_source(path, None if own else sensor, reference=None if own else reference)


def open_reconstructor(recording: Recording, method: str | None, *, even_so: bool = True) -> Reconstructor:
    """Calibrate the light from the recording's own references, or use the method file that was named.

    Balls decide how the light is fitted, for the sake of the depth's scale. A certificate keeps to the default:
    its scale is the bevel's, and on one sample it saw the touch 2 um earlier with the other fit.
    Not `even_so`: raises InputError for a calibration that fails its own balls.
    """
    from tactilevision.quality.fitness import check_fit
    from tactilevision.reconstruct import build_reconstructor

    found = build_reconstructor(recording, method or ("auto" if recording.balls else None))
    if found.referenced is not None and not even_so:
        check_fit(found.referenced.card, remedy="--even-so")
    return found


def open_face_correction(
    recording: Recording, reconstructor: Reconstructor, *, calibration: Path | None
) -> FaceDepthCorrection:
    """What holds the faces of presses that `calibration` certified; a warning where it knows too few."""
    from tactilevision.certificate.depth.face_depth import NO_CORRECTION, face_depth_correction, read_certified

    if calibration is None:
        return NO_CORRECTION
    anchor = face_depth_correction(recording, reconstructor, certified=read_certified(calibration))
    if anchor is NO_CORRECTION:
        points = calibration.parent / "points.csv"
        console.warn([f"{points} certifies too few faces of this recording: depths are the picture's own"])
    else:
        console.warn([anchor.doubt] if anchor.doubt else [])
        console.say("faces are as deep as the certificate beside the calibration has them")
    return anchor
