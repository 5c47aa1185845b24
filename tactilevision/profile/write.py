"""A profile into its file: a zip that stores profile.json, which holds the hashes, and all that it names."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2

from tactilevision.errors import InputError
from tactilevision.files import as_json, pack_arrays, write_archive
from tactilevision.force.kept_compliance import as_arrays
from tactilevision.photometric.storage import pack_method
from tactilevision.profile import contents
from tactilevision.profile.model import Profile


def write_profile(profile: Profile, path: Path | str) -> Path:
    """Write the profile whole or not at all, and return its path; the same profile gives the same bytes.

    Raises InputError for a name that does not end in .tvs, OutputError where the file system refuses.
    """
    target = Path(path)
    check_name(target)
    files = _files(profile)
    about = _about(profile) | {"files": {name: contents.hash_of_bytes(data) for name, data in files.items()}}
    about = json.loads(as_json(about))  # numbers as they will be read
    about[contents.HASH] = contents.hash_of(about)
    write_archive(target, {contents.ABOUT: as_json(about).encode()} | files)
    return target


def check_name(path: Path) -> None:
    """Raise InputError for a name that does not end in .tvs: no command would know the file again."""
    if path.suffix.lower() != contents.SUFFIX:
        raise InputError(
            "the name of a sensor profile ends in .tvs",
            where="--out",
            value=str(path),
            remedy=f"Take {path.with_suffix(contents.SUFFIX)}.",
        )


def _about(profile: Profile) -> dict[str, Any]:
    sensor = profile.sensor
    return {
        "format": contents.FORMAT,
        "kind": sensor.kind,
        "serial": sensor.serial,
        "date": profile.date,
        "source": profile.source,
        "versions": dict(profile.versions),
        "warnings": list(profile.warnings),
        "sensor": {
            "width_px": sensor.width_px,
            "height_px": sensor.height_px,
            "mm_per_px": list(sensor.mm_per_px),
            "has_markers": sensor.has_markers,
            "followed": profile.followed,
            "frame_size_px": list(profile.frame_size_px),
            "white_level": profile.white_level,
            "gel": None if sensor.gel is None else asdict(sensor.gel),
        },
        "indenters": {name: asdict(one) for name, one in profile.indenters.items()},
    }


def _files(profile: Profile) -> dict[str, bytes]:
    files = {f"method{suffix}": content for suffix, content in pack_method(profile.method).items()}
    files[contents.UNTOUCHED] = cv2.imencode(".png", cv2.cvtColor(profile.untouched, cv2.COLOR_RGB2BGR))[
        1
    ].tobytes()
    if profile.sensor.rectification is not None:
        map_x, map_y = profile.sensor.rectification
        files[contents.MAPS] = pack_arrays({"map_x": map_x, "map_y": map_y}, small=False)
    if profile.calibration is not None:
        files[contents.CALIBRATION] = as_json(profile.calibration).encode()
    if profile.face_law is not None:
        files[contents.FACE_LAW] = as_json(asdict(profile.face_law)).encode()
    if profile.lamps is not None:
        files[contents.LAMPS] = as_json(asdict(profile.lamps)).encode()
    if profile.undone_face_law is not None:
        files[contents.UNDONE_FACE_LAW] = as_json(asdict(profile.undone_face_law)).encode()
    if profile.compliance is not None:
        files[contents.COMPLIANCE] = pack_arrays(as_arrays(profile.compliance), small=False)
    return files
