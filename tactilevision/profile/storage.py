"""Files of sensor profiles, whose format, hashes, shapes and numbers are checked."""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_args

import cv2

from tactilevision.errors import InputError, found_in
from tactilevision.files.arrays import read_archive, unpack_arrays
from tactilevision.files.documents import parse_json
from tactilevision.files.opening import damage, number
from tactilevision.files.writing import as_json, pack_arrays, write_archive
from tactilevision.force.calibrated import material_of
from tactilevision.force.compliance import GelCompliance, as_arrays, of_arrays
from tactilevision.force.field import ForceSettings
from tactilevision.force.nodes import lay_grid
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.storage import pack_method, unpack_method
from tactilevision.profile.model import Followed, Profile
from tactilevision.recording.images import decode_image
from tactilevision.recording.sensor import maps_of
from tactilevision.records.measured import Material
from tactilevision.records.rig import Gel, GelLayer, Indenter, Sensor
from tactilevision.sensors import SENSORS

if TYPE_CHECKING:
    from tactilevision.press.certified_faces import DepthScale


SUFFIX = ".tvs"
FORMAT = 1  # version of a profile; newer ones are refused
ABOUT = "profile.json"
METHOD, CARD, NETWORK = "method.npz", "method.json", "method.onnx"
MAPS = "rectification.npz"
UNTOUCHED = "untouched.png"
CALIBRATION = "calibration.json"
FACE_LAW = "face_law.json"
COMPLIANCE = "compliance.npz"
NEEDED = (ABOUT, METHOD, CARD, UNTOUCHED)
READ = {*NEEDED, NETWORK, MAPS, CALIBRATION, FACE_LAW, COMPLIANCE}
HASH = "sha256"  # key of profile.json: of all its other keys


def hash_of(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of profile.json without its own hash, independent of order and spaces."""
    rest = {key: value for key, value in content.items() if key != HASH}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def hash_of_bytes(content: bytes) -> str:
    """Return the SHA-256 of a file in the profile."""
    return hashlib.sha256(content).hexdigest()


# Reading.

_MAKE = "Make one with `tactilevision calibrate-sensor PATH --out my_sensor.tvs`."
_AGAIN = "Make it again with `tactilevision calibrate-sensor`."
_WORDS = (
    "name",
    "shape",
    "bevel",
    "base",
    "axis",
    "mesh",
    "mesh_unit",
    "seen",
    "bonded",
)  # of gels and indenters: all else are numbers
T = TypeVar("T")


def read_profile(path: Path | str) -> Profile:
    """Read a profile, and check its format, hashes, shapes and numbers.

    Raises InputError for a file that is missing, of a newer version, damaged, changed or inconsistent.
    """
    _check_kind(path)
    path = Path(path)
    try:
        files = read_archive(path)
    except FileNotFoundError as fault:
        raise InputError("there is no such sensor profile", where=path, remedy=_MAKE) from fault
    except OSError as fault:
        raise InputError(f"cannot be read: {fault.strerror}", where=path) from fault
    return unpack_profile(files, path)


def _check_kind(path: Path | str) -> None:
    """Raise InputError for a kind of sensor, a folder, or another kind of file."""
    what = None
    if str(path) in SENSORS and not Path(path).exists():
        what = "this is a kind of sensor, not a profile of a calibrated one"
    elif Path(path).is_dir():
        what = "this is a folder, not a sensor profile"
    elif Path(path).is_file() and Path(path).suffix.lower() != SUFFIX and not zipfile.is_zipfile(path):
        what = "this is not a sensor profile"
    if what is not None:
        raise InputError(what, where=path, remedy=_MAKE)


def unpack_profile(files: Mapping[str, bytes], path: Path) -> Profile:
    """Return the profile of the files in an archive; `path` names it in errors. Raises as `read_profile`."""
    about = _about(files, path)
    with damage(path, what="the parts of the profile do not fit together", remedy=_AGAIN), found_in(path):
        return _profile(about, files, path)


def _about(files: Mapping[str, bytes], path: Path) -> dict[str, Any]:
    """Return profile.json after a check of format and hashes."""
    if ABOUT not in files:
        raise InputError("is not a sensor profile: it holds no profile.json", where=path, remedy=_AGAIN)
    content = parse_json(files[ABOUT], where=f"{path}, {ABOUT}")
    form = content.get("format")
    if isinstance(form, int) and not isinstance(form, bool) and form > FORMAT:
        raise InputError(
            f"the profile is of a newer version: this one reads format {FORMAT}",
            where=path,
            value=form,
            remedy="Install a newer version of tactilevision, or calibrate the sensor with this one.",
        )
    if form is True or form != FORMAT:
        raise InputError("is not a sensor profile of a known format", where=path, value=form, remedy=_AGAIN)
    stated = content.get("files")
    found = {name: hash_of_bytes(data) for name, data in files.items() if name != ABOUT}
    if content.get(HASH) != hash_of(content) or stated != found:
        raise InputError(
            "the profile was changed since it was written, or is damaged",
            where=path,
            value=", ".join(_changed(stated, found)) or ABOUT,
            remedy="Copy it again, or make it again with `tactilevision calibrate-sensor`.",
        )
    if unknown := sorted(files.keys() - READ):
        raise InputError(
            "the profile holds parts that this version does not read",
            where=path,
            value=", ".join(unknown),
            remedy=_AGAIN,
        )
    return content


def _changed(stated: object, found: Mapping[str, str]) -> list[str]:
    """Return the files whose hash differs, that are missing, or that are not stated."""
    said = stated if isinstance(stated, dict) else {}
    return sorted(name for name in {*said, *found} if said.get(name) != found.get(name))


def _profile(about: Mapping[str, Any], files: Mapping[str, bytes], path: Path) -> Profile:
    missing = [name for name in NEEDED if name not in files]
    if missing:
        raise InputError(f"the profile lacks {missing[0]}", where=path, remedy=_AGAIN)
    sensor, frame_size_px, white_level = _sensor(about, files, path)
    card = MethodCard.from_json(parse_json(files[CARD], where=f"{path}, {CARD}"))
    method = unpack_method(card, files[METHOD], files.get(NETWORK), where=path / METHOD)
    untouched = decode_image(files[UNTOUCHED], path / UNTOUCHED)
    shape = (sensor.height_px, sensor.width_px)
    if method.reference.shape != shape or untouched.shape[:2] != shape:
        raise InputError(
            "the profile's reference has another size than its sensor",
            where=path,
            value=(method.reference.shape, untouched.shape[:2], shape),
            remedy=_AGAIN,
        )
    calibration = _json(files, CALIBRATION, path)
    return Profile(
        sensor,
        method,
        untouched,
        frame_size_px,
        datetime.date.fromisoformat(str(about["date"])).isoformat(),
        _followed(about["sensor"]["followed"], path),
        str(about.get("source", "")),
        white_level,
        calibration,
        _compliance(files, sensor, calibration, path),
        _face_law(files, FACE_LAW, path),
        {str(name): _indenter(one, path) for name, one in dict(about.get("indenters", {})).items()},
        {str(name): str(one) for name, one in dict(about.get("versions", {})).items()},
        tuple(str(one) for one in about.get("warnings", ())),
        path,
    )


def _sensor(
    about: Mapping[str, Any], files: Mapping[str, bytes], path: Path
) -> tuple[Sensor, tuple[int, int], float | None]:
    stated = about["sensor"]
    width, height, *frame = map(index, (stated["width_px"], stated["height_px"], *stated["frame_size_px"]))
    scale = [_number(one, "mm_per_px", path) for one in stated["mm_per_px"]]
    maps = None
    if MAPS in files:
        maps = maps_of(unpack_arrays(files[MAPS], where=path / MAPS), path / MAPS)
        if maps[0].shape != (height, width):
            raise InputError("the rectification has another size than the sensor", where=path, value=maps[0].shape)
    gel = None if stated["gel"] is None else _gel(stated["gel"], path)
    white = stated.get("white_level")
    kind, serial, marks = str(about["kind"]), str(about["serial"]), bool(stated["has_markers"])
    sensor = Sensor(kind, width, height, (scale[0], scale[1]), gel, maps, marks, serial)
    return sensor, (frame[0], frame[1]), None if white is None else _number(white, "white_level", path)


def _compliance(
    files: Mapping[str, bytes], sensor: Sensor, calibration: Mapping[str, Any] | None, path: Path
) -> GelCompliance | None:
    if COMPLIANCE not in files or calibration is None or sensor.gel is None or not sensor.gel.is_flat:
        return None
    where = path / COMPLIANCE
    material: Material = material_of(calibration, where=f"{path}, {CALIBRATION}")
    view = (sensor.height_px, sensor.width_px)
    grid = lay_grid(view, sensor.mm_per_px, spacing_mm=ForceSettings().spacing_mm)
    arrays = unpack_arrays(files[COMPLIANCE], where=where)
    return of_arrays(arrays, sensor.gel, grid=grid, poisson_ratio=material.poisson_ratio, where=where)


def _face_law(files: Mapping[str, bytes], name: str, path: Path) -> DepthScale | None:
    content = _json(files, name, path)
    if content is None:
        return None
    from tactilevision.press.certified_faces import DepthScale  # takes a while to load

    coefficients = tuple(_number(one, "a coefficient", path) for one in content["coefficients"])
    low, high = (_number(one, "a limit", path) for one in content["limits_mm"])
    return DepthScale(coefficients, (low, high), _number(content["scatter"], "the scatter", path))


def _indenter(content: Mapping[str, Any], path: Path) -> Indenter:
    found = _record(Indenter, content, path)
    return replace(found, radius_mm=math.nan) if content.get("radius_mm") is None else found


def _gel(content: Mapping[str, Any], path: Path) -> Gel:
    layers = tuple(_record(GelLayer, one, path) for one in content.get("layers", ()))
    gel = _record(Gel, {key: value for key, value in content.items() if key != "layers"}, path)
    return replace(gel, layers=layers)


def _record(kind: Callable[..., T], content: Mapping[str, Any], path: Path) -> T:
    """Return a record of numbers and words; pairs are lists in the file."""
    for key, value in content.items():
        for one in value if isinstance(value, list) else [value]:
            if one is not None and (key in _WORDS) != isinstance(one, str):
                raise InputError(f"{key} has the wrong type", where=path, value=one)
            if key not in _WORDS:
                number(one, what=key, where=path)
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in content.items()})


def _json(files: Mapping[str, bytes], name: str, path: Path) -> dict[str, Any] | None:
    return parse_json(files[name], where=f"{path}, {name}") if name in files else None


def _number(value: object, what: str, path: Path) -> float:
    found = number(value, what=what, where=path)
    if found is None:
        raise InputError(f"{what} is not a number", where=path, value=value)
    return found


def _followed(value: object, path: Path) -> Followed:
    if value not in get_args(Followed):
        raise InputError("followed is one of " + ", ".join(get_args(Followed)), where=path, value=value)
    return cast(Followed, value)


# Writing: a zip of profile.json, which holds the hashes, and of the files that it names.


def write_profile(profile: Profile, path: Path | str) -> Path:
    """Write the profile atomically, and return its path; the same profile gives the same bytes.

    Raises InputError for a name that does not end in .tvs, OutputError where it cannot be written.
    """
    target = Path(path)
    check_name(target)
    files = _files(profile)
    about = _about_of(profile) | {"files": {name: hash_of_bytes(data) for name, data in files.items()}}
    about = json.loads(as_json(about))  # numbers as they will be read
    about[HASH] = hash_of(about)
    write_archive(target, {ABOUT: as_json(about).encode()} | files)
    return target


def check_name(path: Path) -> None:
    """Raise InputError for a name that does not end in .tvs."""
    if path.suffix.lower() != SUFFIX:
        raise InputError(
            "the name of a sensor profile ends in .tvs",
            where="--out",
            value=str(path),
            remedy=f"Use {path.with_suffix(SUFFIX)}.",
        )


def _about_of(profile: Profile) -> dict[str, Any]:
    sensor = profile.sensor
    return {
        "format": FORMAT,
        **{name: getattr(sensor, name) for name in ("kind", "serial")},
        **{name: getattr(profile, name) for name in ("date", "source", "versions", "warnings")},
        "sensor": {
            **{name: getattr(sensor, name) for name in ("width_px", "height_px", "mm_per_px", "has_markers")},
            **{name: getattr(profile, name) for name in ("followed", "frame_size_px", "white_level")},
            "gel": None if sensor.gel is None else asdict(sensor.gel),
        },
        "indenters": {name: asdict(one) for name, one in profile.indenters.items()},
    }


def _files(profile: Profile) -> dict[str, bytes]:
    files = {f"method{suffix}": content for suffix, content in pack_method(profile.method).items()}
    files[UNTOUCHED] = cv2.imencode(".png", profile.untouched[..., ::-1])[1].tobytes()
    if profile.sensor.rectification is not None:
        map_x, map_y = profile.sensor.rectification
        files[MAPS] = pack_arrays({"map_x": map_x, "map_y": map_y}, small=False)
    if profile.calibration is not None:
        files[CALIBRATION] = as_json(profile.calibration).encode()
    if profile.face_law is not None:
        files[FACE_LAW] = as_json(asdict(profile.face_law)).encode()
    if profile.compliance is not None:
        files[COMPLIANCE] = pack_arrays(as_arrays(profile.compliance), small=False)
    return files
