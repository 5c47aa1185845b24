"""What a run is known by: its frames as they stand on disk, and what else decides its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator

from tactilevision.recording import Recording


def fingerprint_of(recording: Recording, *parts: object) -> str:
    """Of the recording's place and frames as they stand there, and of what else decides the result."""
    about = [str(recording.path.resolve()), *recording.frame_names, *as_they_stand(recording), *map(repr, parts)]
    return hashlib.sha256(json.dumps(about).encode()).hexdigest()


def as_they_stand(recording: Recording) -> Iterator[str]:
    """Size and time of every picture, or of the video: of one that was changed nothing is taken over."""
    path, names = recording.frames_path, recording.frame_names
    pictures = () if path is None else [path / name for name in names] if path.is_dir() else [path]
    for file in (*pictures, *recording.flats):
        try:
            about = file.stat()
        except OSError:
            yield "gone"
        else:
            yield f"{about.st_size} {about.st_mtime_ns}"
