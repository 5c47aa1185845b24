"""What is read: each input file with its valid neighbours, and the function that users' commands call."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from benchmarks.fuzz import seeds
from calibration.tasks.session import load_history
from tactilevision.batch.folder import DepthJob, FrameResult
from tactilevision.batch.jobs import Journal
from tactilevision.files.arrays import read_archive, read_arrays
from tactilevision.files.tiff import read_tiff
from tactilevision.force.calibrated import check_gel, read_clock_offset, read_material
from tactilevision.photometric.storage import digest, load_method, load_network
from tactilevision.press.certified_faces import read_certified
from tactilevision.profile import storage as contents
from tactilevision.profile.model import Profile
from tactilevision.profile.storage import read_profile, unpack_profile
from tactilevision.recording.images import read_image
from tactilevision.recording.pictures import iter_frames
from tactilevision.recording.read import read_recording
from tactilevision.records.rig import Gel
from tactilevision.robots.lerobot_dataset import read_dataset
from tactilevision.robots.messages import answers

TACTILE = "observation.images.tactile"
Form = Literal["table", "toml", "json", "npy", "npz", "tiff", "picture", "bytes"]


@dataclass(frozen=True, slots=True)
class Reader:
    """`file` is what is mutated. `make` writes it, valid, with its neighbours into an empty folder; `read` takes
    that folder. Numbers of the fields in `gaps` may be NaN: they say that nothing is known."""

    file: str
    form: Form
    make: Callable[[Path], None]
    read: Callable[[Path], Any]
    gaps: frozenset[str] = frozenset()


_GAPS = frozenset((
    "target_depth_mm", "x_mm", "y_mm", "rest_s", "speed_mm_s", "hold_s", "temperature_C", "time_of_day_s",
    "lubricated", "depth_mm", "fz_N", "depth_std_mm", "fz_std_N", "fx_N", "fy_N", "time_s", "depth_uncorrected_mm",
    "torque_Nm", "frame_times_s", "mm_per_px", "rectification",
))  # fmt: skip
_ERRORS = frozenset(("rms_before_N", "rms_after_N", "held_out_before_N", "held_out_after_N", "repeatability_N"))
_RESULT = frozenset(("peak_mm", "contact_area_mm2", "ms", "peak_std_mm"))


def _picture(suffix: str) -> Reader:
    name = f"frame{suffix}"
    form: Form = "npy" if suffix == ".npy" else "picture"
    return Reader(
        name, form, lambda folder: seeds.picture(folder / name), lambda folder: read_image(folder / name)
    )


def _recording(name: str, form: Form = "table") -> Reader:
    return Reader(name, form, seeds.recording, _read_recording, _GAPS)


def _read_recording(folder: Path) -> Any:
    recording = read_recording(folder)
    root = folder.resolve()
    for path in (*recording.flats, *(ball.path for ball in recording.balls)):
        assert path.resolve().is_relative_to(root), path
    frames = [folder / "frames" / name for name in recording.frame_names]
    assert all(path.resolve().is_relative_to(root) for path in frames), frames
    return replace(recording, settings={}), [len(frame.name) for frame in iter_frames(recording)]


def _read_video(folder: Path) -> Any:
    recording = read_recording(folder)
    return recording, [type(frame).__name__ for frame in iter_frames(recording)]


def _read_method(folder: Path) -> Any:
    path, card = folder / "method.npz", folder / "method.json"
    card.write_text(json.dumps(json.loads(card.read_text()) | {"sha256": digest(path)}))
    return load_method(path)


def _read_statements(folder: Path) -> Any:
    """A profile whose statements were changed by one who knows how to hash them."""
    files, text = read_archive(folder / "sensor.tvs"), (folder / "profile.json").read_bytes()
    try:
        about = json.loads(text)
        about[contents.HASH] = contents.hash_of(about)
        text = json.dumps(about).encode()
    except (ValueError, TypeError, AttributeError, RecursionError):
        pass
    return _seen(unpack_profile(files | {contents.ABOUT: text}, folder / "sensor.tvs"))


def _read_profile(folder: Path) -> Any:
    return _seen(read_profile(folder / "sensor.tvs"))


def _seen(profile: Profile) -> Any:
    return profile.sensor, profile.face_law, profile.frame_size_px, profile.white_level


def _read_network(folder: Path) -> Any:
    path, card = folder / "network.onnx", folder / "network.json"
    card.write_text(json.dumps(json.loads(card.read_text()) | {"onnx_sha256": digest(path)}))
    method = load_network(path, seeds.reference())
    return method.relative_error, getattr(method.law, "steepest", 0.0)


def _read_calibration(folder: Path) -> Any:
    path = folder / "calibration.json"
    material = read_material(path)
    check_gel(path, Gel(3.0))
    return material, read_clock_offset(path)


def _read_depth(folder: Path) -> Any:
    height = read_tiff(folder / "depth.tiff")
    return height.depth_mm[height.valid], height.mm_per_px


def _read_journal(folder: Path) -> Any:
    job = DepthJob(None, folder)  # type: ignore[arg-type]  # no map is made
    return list(Journal(folder / "journal", seeds.FINGERPRINT).read(FrameResult, job.kept).values())


def _read_map(folder: Path) -> Any:
    return {name: array.shape for name, array in read_arrays(folder / "map.npz").items()}


def _log(name: str) -> Reader:
    return Reader(name, "bytes", lambda folder: seeds.log(folder, name), lambda folder: _read_log(folder / name))


def _read_log(path: Path) -> Any:
    """What runs in the child: without its limits, and in this process."""
    found = list(answers(str(path), {"/camera": "picture", "/ft": "wrench"}))
    return [one[4] for one in found if one[0] == "wrench"], len(found)


def _dataset(file: str, form: Form = "bytes") -> Reader:
    return Reader(file, form, seeds.dataset, _read_dataset)


def _read_dataset(folder: Path) -> Any:
    found = read_dataset(folder, TACTILE)
    return found.rate_Hz, [row.time_s for row, _ in found.pictures()]


READERS: dict[str, Reader] = {
    **{suffix[1:]: _picture(suffix) for suffix in (".png", ".jpg", ".tiff", ".bmp", ".npy")},
    "video": Reader("frames.avi", "bytes", seeds.film, _read_video, _GAPS),
    "recording": _recording("recording.toml", "toml"),
    "frames": _recording("frames.csv"),
    "presses": _recording("presses.csv"),
    "forces": _recording("forces.csv"),
    "stage": _recording("stage.csv"),
    "curves": _recording("curves.csv"),
    "points": _recording("points.csv"),
    "balls": _recording("reference/ball.csv"),
    "rectification": _recording("maps.npz", "npz"),
    "certified": Reader(
        "points.csv", "table", seeds.recording, lambda folder: read_certified(folder / "calibration.json")
    ),
    "method": Reader("method.npz", "npz", seeds.method, _read_method),
    "card": Reader("method.json", "json", seeds.method, lambda folder: load_method(folder / "method.npz")),
    "network": Reader("network.onnx", "bytes", seeds.network, _read_network),
    "profile": Reader("profile.json", "json", seeds.profile, _read_statements, frozenset(("radius_mm",))),
    "archive": Reader("sensor.tvs", "bytes", seeds.profile, _read_profile),
    "calibration": Reader("calibration.json", "json", seeds.calibration, _read_calibration),
    "history": Reader(
        "history.json", "json", seeds.history, lambda folder: load_history(folder / "history.json"), _ERRORS
    ),
    "bag": _log("log.bag"),
    "db3": _log("log.db3"),
    "mcap": _log("log.mcap"),
    "set": _dataset("meta/info.json", "json"),
    "episodes": _dataset("meta/episodes/chunk-000/file-000.parquet"),
    "rows": _dataset("data/chunk-000/file-000.parquet"),
    "film": _dataset(f"videos/{TACTILE}/chunk-000/file-000.mp4"),
    "depth": Reader("depth.tiff", "tiff", seeds.depth, _read_depth),
    "map": Reader("map.npz", "npz", seeds.depth, _read_map),
    "journal": Reader("journal", "bytes", seeds.journal, _read_journal, _RESULT),
}
