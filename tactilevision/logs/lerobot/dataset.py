"""What a data set says of itself: meta/info.json and meta/episodes, checked; nothing of its frames is read yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactilevision.door.documents import read_json
from tactilevision.errors import InputError
from tactilevision.logs.lerobot.tables import parts, place_in

INFO, STATS, EPISODES = "meta/info.json", "meta/stats.json", "meta/episodes"
VERSION = "v3."
Place = tuple[int, int]  # numbers of chunk and file
_NUMBERS = ("episode_index", "length", "data/chunk_index", "data/file_index")


@dataclass(frozen=True, slots=True)
class Episode:
    """One episode: how many frames, in which file of the tables, in which video and from when on, s."""

    number: int
    length: int
    data: Place
    video: Place
    from_s: float


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set on disk, seen through one camera, which is kept as a video or as single pictures."""

    root: Path
    info: Mapping[str, Any]
    camera: str
    is_video: bool
    rate_Hz: float
    episodes: tuple[Episode, ...]

    @property
    def features(self) -> Mapping[str, Any]:
        """What each frame has, by key."""
        found: Mapping[str, Any] = self.info["features"]
        return found

    def data(self, place: Place) -> Path:
        """A table of frames. Raises InputError where it is missing."""
        return place_in(self.root, data_name(place))

    def video(self, place: Place) -> Path:
        """A video of the camera. Raises InputError where it is missing."""
        return place_in(self.root, f"videos/{self.camera}/{_name(place)}.mp4")


def data_name(place: Place) -> str:
    """Where a table of frames lies in its data set."""
    return f"data/{_name(place)}.parquet"


def read_dataset(root: Path | str, camera: str) -> DataSet:
    """Read what describes a data set. `camera` is the key of the tactile camera.

    Raises InputError for another version, a key that is no camera (and says which are), and missing files.
    """
    root = Path(root)
    if not (root / INFO).is_file():
        raise InputError("is no data set of LeRobot", where=root, value=f"{INFO} is missing")
    info = read_json(place_in(root, INFO))
    version, features, rate = info.get("codebase_version"), info.get("features"), info.get("fps")
    if not str(version).startswith(VERSION):
        raise InputError(
            "the data set is of a version that is not read",
            where=root / INFO,
            value=version,
            remedy="LeRobot turns one of v2.1 into v3.0: lerobot.datasets.v30.convert_dataset_v21_to_v30.",
        )
    if not isinstance(features, dict) or not isinstance(rate, int | float) or not 0 < rate < 1e5:
        raise InputError("states no features, or no rate (fps)", where=root / INFO, value=rate)
    cameras = {name: kind for name, kind in _kinds(features).items() if kind in ("video", "image")}
    if camera not in cameras:
        listed = ", ".join(f"{name} ({kind})" for name, kind in cameras.items()) or "none"
        raise InputError("the data set has no such camera", where=root, value=camera, remedy=f"It has: {listed}.")
    is_video = cameras[camera] == "video"
    return DataSet(root, info, camera, is_video, float(rate), _episodes(root, camera, is_video))


def episode_files(root: Path) -> list[str]:
    """The tables of episodes, by name in the data set."""
    return [path.relative_to(root).as_posix() for path in sorted((root / EPISODES).glob("*/*.parquet"))]


def _kinds(features: Mapping[str, Any]) -> dict[str, str]:
    return {name: str(one.get("dtype")) for name, one in features.items() if isinstance(one, dict)}


def _episodes(root: Path, camera: str, is_video: bool) -> tuple[Episode, ...]:
    names = list(_NUMBERS)
    if is_video:
        names += [f"videos/{camera}/{part}" for part in ("chunk_index", "file_index", "from_timestamp")]
    found = []
    for name in episode_files(root):
        for batch in parts(place_in(root, name), names):
            for row in zip(*(batch.column(key).to_pylist() for key in names), strict=True):
                if None in row:
                    raise InputError("an episode's number is missing", where=root / name, value=str(row)[:80])
                number, length, chunk, file, *video = row
                at, from_s = ((video[0], video[1]), video[2]) if video else ((0, 0), 0.0)
                found.append(Episode(number, length, (chunk, file), at, from_s))
    found.sort(key=lambda one: one.number)
    if not found or [one.number for one in found] != list(range(len(found))):
        missing = next((k for k, one in enumerate(found) if one.number != k), len(found))
        raise InputError("the data set lacks an episode", where=root / EPISODES, value=missing)
    return tuple(found)


def _name(place: Place) -> str:
    return f"chunk-{place[0]:03d}/file-{place[1]:03d}"
