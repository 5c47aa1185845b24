"""Depth, contact and force of a tactile camera, added to a new LeRobot data set."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import chain, islice, starmap
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.documents import read_json
from tactilevision.files.opening import open_regular
from tactilevision.files.writing import copy_file, replacing, staged, write_text
from tactilevision.profile.model import Seen
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.records.constants import MILLI
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes, Floats
from tactilevision.records.wrench import COMPONENTS, PATCH_COLUMNS, STDS
from tactilevision.robots.depth_video import DepthVideo, Put, depth_range_mm
from tactilevision.robots.lerobot_dataset import INFO, STATS, VIDEO_PATH, DataSet, episode_files, parts
from tactilevision.robots.logs import library

# The new features: their schema for LeRobot, and their values for one frame.

MOST_PATCHES = 4  # patches of a frame; a feature has one size
STEP_MM = 2.0**-10  # mm: depths are rounded to this, far below their deviation, so that tables pack well


def base_of(camera: str) -> str:
    """Return the prefix of the new features: observation.left for observation.images.left.

    LeRobot takes a key with "image" in it for a picture; such a word becomes "tactile".
    """
    name = camera.removeprefix("observation.").removeprefix("images.")
    return "observation." + name.replace("images", "tactile").replace("image", "tactile")


def depth_key(camera: str) -> str:
    """Return the key of the native depth: observation.images.left_depth for observation.images.left."""
    return f"{camera}_depth"


def schema(
    camera: str, sensor: CalibratedSensor, *, shrink: int, video: DepthVideo | None
) -> dict[str, dict[str, Any]]:
    """Return the new features with their entries in info.json; a wrench only where E and nu are known.

    `video`: how depth becomes a video with a mask; None: it becomes a column, in mm.
    """
    base, size = base_of(camera), _size(sensor, shrink)
    scale = [one * shrink for one in sensor.profile.sensor.mm_per_px]
    about = {"profile": sensor.profile.name, "mm_per_px": scale, "positive": "into the gel"}
    found: dict[str, dict[str, Any]] = {}
    if video is not None:
        shape = _feature("video", [*size, 1], ["height", "width", "channels"])
        found[depth_key(camera)] = shape | {"info": about | video.info}
        found[f"{base}.depth_valid"] = _feature("bool", list(size), ["height", "width"])
    else:
        found[f"{base}.depth_mm"] = _feature("float32", list(size), ["height", "width"]) | {"info": about}
    found |= {
        f"{base}.contact": _feature("bool", [1], None),
        f"{base}.peak_mm": _feature("float32", [1], None),
        f"{base}.area_mm2": _feature("float32", [1], None),
        f"{base}.flags": _feature("string", [1], None),
    }
    if sensor.field is not None:
        found[f"{base}.wrench"] = _feature("float32", [6], list(COMPONENTS))
        found[f"{base}.wrench_std"] = _feature("float32", [6], list(STDS))
        found[f"{base}.could_hide_N"] = _feature("float32", [1], None)
        names = [f"{name}_{k}" for k in range(1, MOST_PATCHES + 1) for name in PATCH_COLUMNS]
        found[f"{base}.patches"] = _feature("float32", [len(names)], names)
    return found


def read_frame(sensor: CalibratedSensor, rgb: Bytes, *, shrink: int) -> dict[str, Any]:
    """Return the features of a frame (H, W, 3) uint8; one that cannot be read is all NaN, with the reason as flag.

    `depth_mm` (h, w), not rounded, NaN where it is not known; `contact`; `peak_mm`; `area_mm2`; `wrench` (6,) in N
    and N mm, and its deviation; `could_hide_N`; `patches`, those of the greatest normal force, PATCH_COLUMNS each.
    """
    unknown: dict[str, Any] = dict.fromkeys(("peak_mm", "area_mm2", "could_hide_N"), np.nan)
    sizes = {"wrench": 6, "wrench_std": 6, "patches": MOST_PATCHES * len(PATCH_COLUMNS)}
    unknown |= {name: np.full(size, np.nan, np.float32) for name, size in sizes.items()}
    try:
        seen = sensor.read(rgb)
    except InputError as fault:
        nothing = np.full(_size(sensor, shrink), np.nan)
        return unknown | {"depth_mm": nothing, "contact": False, "flags": f"not read: {fault.what}"}
    assert isinstance(seen, Seen)
    height, wrench = seen.height, seen.wrench
    depth = np.where(height.valid, height.depth_mm, np.nan).astype(np.float64)
    pressed = seen.contact & height.valid
    found: dict[str, Any] = {
        "depth_mm": shrunk(depth, shrink),
        "contact": bool(seen.contact.any()),
        "peak_mm": float(height.depth_mm[pressed].max()) if pressed.any() else 0.0,
        "area_mm2": float(seen.contact.sum() * np.prod(height.mm_per_px)),
        "flags": "; ".join(seen.flags),
    }
    if wrench is not None and seen.tractions is not None:
        found["wrench"] = wrench.values.astype(np.float32)
        found["wrench_std"] = np.array([*wrench.force_std_N, *wrench.moment_std_Nmm], np.float32)
        found["could_hide_N"] = seen.tractions.could_hide_N
        strongest = sorted(seen.patches, key=lambda one: -one.wrench.force_N[2])[:MOST_PATCHES]
        found["patches"] = unknown["patches"].copy()
        found["patches"][: len(strongest) * len(PATCH_COLUMNS)] = [value for one in strongest for value in one.row]
    return unknown | found


def shrunk(depth_mm: Floats, factor: int) -> Floats:
    """Return means of blocks of `factor` x `factor` pixels of a map (H, W) in mm; NaN where half is not known."""
    if factor == 1:
        return depth_mm
    rows, columns = depth_mm.shape[0] // factor, depth_mm.shape[1] // factor
    blocks = depth_mm[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    known = np.isfinite(blocks).sum(axis=(1, 3))
    total = np.where(np.isfinite(blocks), blocks, 0.0).sum(axis=(1, 3))
    means = np.where(2 * known > factor**2, total / np.maximum(known, 1), np.nan)
    return np.asarray(means)


def _size(sensor: CalibratedSensor, shrink: int) -> tuple[int, int]:
    return sensor.profile.sensor.height_px // shrink, sensor.profile.sensor.width_px // shrink


def _feature(kind: str, shape: list[int], names: list[str] | None) -> dict[str, Any]:
    return {"dtype": kind, "shape": shape, "names": names}


# Statistics of the new features of each episode and of all. NaN is excluded; where all is NaN, they are 0.

QUANTILES = ("q01", "q10", "q50", "q90", "q99")  # by their percent
MAX_SAMPLED = 256  # pixels of each map for the statistics of depth, besides its extremes
Stats = dict[str, Floats]


def sample_depth(depth_mm: Floats) -> Floats:
    """Return evenly spaced values (k,) of a map (H, W) in mm, its least and its greatest first."""
    flat = np.asarray(depth_mm, float).ravel()
    known = flat[np.isfinite(flat)]
    extremes = (known.min(), known.max()) if known.size else (np.nan, np.nan)
    return np.array([*extremes, *flat[:: -(-flat.size // MAX_SAMPLED)]])


def statistics_of_depth(samples: Sequence[Floats]) -> Stats:
    """Return statistics, mm, of the samples (N, k) of an episode's maps, of shape (1, 1)."""
    every = np.stack(samples)
    found = statistics_of_values(every[:, 2:].reshape(-1, 1))
    found |= {"min": statistics_of_values(every[:, :1])["min"], "max": statistics_of_values(every[:, 1:2])["max"]}
    found = {name: value.reshape(1, 1) for name, value in found.items()}
    return found | {"count": np.array([len(samples)])}


def statistics_of_values(values: Floats) -> Stats:
    """Return statistics (k,) of the values (N, k) of an episode, in their unit."""
    every = np.asarray(values, float)
    finite = np.isfinite(every)
    known = np.where(finite, every, np.where(finite.any(axis=0), np.nan, 0.0))
    found = {"min": np.nanmin(known, axis=0), "max": np.nanmax(known, axis=0)}
    found |= {"mean": np.nanmean(known, axis=0), "std": np.nanstd(known, axis=0)}
    quantiles = np.nanquantile(known, [int(name[1:]) / 100 for name in QUANTILES], axis=0)
    return found | dict(zip(QUANTILES, quantiles, strict=True)) | {"count": np.array([len(every)])}


def pooled_statistics(episodes: Sequence[Stats]) -> Stats:
    """Pool the statistics of episodes, weighted by their frames, in their unit and shape, as (1,)."""
    every = {name: np.stack([one[name] for one in episodes]) for name in episodes[0]}
    counts = every["count"][:, 0]
    means = {name: np.average(every[name], axis=0, weights=counts) for name in ("mean", *QUANTILES)}
    variance = np.average(every["std"] ** 2 + (every["mean"] - means["mean"]) ** 2, axis=0, weights=counts)
    found = {"min": every["min"].min(axis=0), "max": every["max"].max(axis=0), "mean": means["mean"]}
    return found | {"std": np.sqrt(variance)} | means | {"count": np.array([int(counts.sum())])}


def statistics_as_json(stats: Mapping[str, Stats]) -> dict[str, Any]:
    """Return statistics of each feature, in their unit and shape, as (1,) and lists."""
    return {key: {name: value.tolist() for name, value in one.items()} for key, one in stats.items()}


# The new data set: videos are copied byte for byte, and the tables gain columns.

LOOKED_AT = 5  # frames at the beginning by which the profile is checked
Progress = Callable[[int, int], None]  # frames done, and of how many
Reading = tuple[int, dict[str, Any]]  # number of the episode, and what one of its frames holds


@dataclass(frozen=True, slots=True)
class Annotated:
    """Counts of what was written, the keys of the new features, and warnings."""

    episodes: int
    frames: int
    in_contact: int
    not_read: int
    features: tuple[str, ...]
    warnings: tuple[str, ...]


def annotate(
    dataset: DataSet,
    sensor: CalibratedSensor,
    out: Path | str,
    *,
    shrink: int = 4,
    native: bool = False,
    progress: Progress = lambda done, of: None,
) -> Annotated:
    """Write the data set `out`: all of `dataset`, and the readings of its camera's frames by `sensor`.

    Maps are means of `shrink` x `shrink` pixels; `native`: a video of LeRobot's depth maps with a mask, not a
    column. The reference is the profile's. Raises InputError for frames of another size, for features that exist,
    for native depth without a stated gel, and as `pictures` does; OutputError where `out` has metadata already.
    """
    video = None
    if native:
        video = DepthVideo(_size(sensor, shrink), dataset.rate_Hz, depth_range_mm(sensor.profile.sensor))
    added = schema(dataset.camera, sensor, shrink=shrink, video=video)
    there = [key for key in added if key in dataset.features]
    if there:
        raise InputError("the data set has such a feature already", where=dataset.root, value=there[0])
    warnings = _look(dataset, sensor)
    readings = ((row.episode.number, read_frame(sensor, rgb, shrink=shrink)) for row, rgb in dataset.pictures())
    work = _Work(dataset, added, readings, progress, video)
    with staged(out, last="meta") as folder:
        for place in dict.fromkeys(one.data for one in dataset.episodes):
            work.write_table(dataset.data(place), folder)
        work.write_episodes(folder)
        work.write_info(folder)
        _copy_rest(dataset, folder)
    return Annotated(len(dataset.episodes), work.done, work.in_contact, work.not_read, tuple(added), warnings)


@dataclass
class _Work:
    """Writer of the tables, which reads the frames on the way and gathers their statistics."""

    dataset: DataSet
    added: dict[str, Any]
    readings: Iterator[Reading]
    progress: Progress
    video: DepthVideo | None = None
    starts: dict[int, int] = field(default_factory=dict)  # of an episode within its table, and so its video
    done: int = 0
    in_contact: int = 0
    not_read: int = 0
    gathered: dict[int, dict[str, list[Any]]] = field(default_factory=dict)

    def write_table(self, source: Path, folder: Path) -> None:
        """Write one table of frames with the new columns."""
        arrow, parquet = library("pyarrow"), library("pyarrow.parquet")
        target = folder / source.relative_to(self.dataset.root)
        batches = parts(source)
        old = next(batches).schema
        types = {key: _type(one) for key, one in self.added.items() if one["dtype"] != "video"}
        whole = arrow.schema([*old, *starmap(arrow.field, types.items())])
        base, before = base_of(self.dataset.camera), self.done
        packing = {f"{base}.depth_mm.list.element.list.element": "BYTE_STREAM_SPLIT"}
        with (
            replacing(target) as temporary,
            parquet.ParquetWriter(
                temporary, whole, compression="zstd", use_dictionary=False, column_encoding=packing
            ) as writer,
            self._depth_writer(folder, source) as put,
        ):
            for batch in batches:
                readings = list(islice(self.readings, batch.num_rows))
                columns = self._taken(readings, put, before)
                new = [arrow.array([_plain(v) for v in columns[key]], kind) for key, kind in types.items()]
                writer.write_batch(arrow.RecordBatch.from_arrays([*batch.columns, *new], schema=whole))

    def _depth_writer(self, folder: Path, source: Path) -> AbstractContextManager[Put]:
        """Return what stores a depth map in mm: in the video of this table, or rounded in the table itself."""
        if self.video is None:
            return nullcontext(lambda depth_mm: np.round(depth_mm / STEP_MM) * STEP_MM)
        name = source.relative_to(self.dataset.root / "data").with_suffix(".mp4")
        return self.video.writer(folder / "videos" / depth_key(self.dataset.camera) / name)

    def _taken(self, readings: list[Reading], put: Put, before: int) -> dict[str, list[Any]]:
        """Return columns of a part of a table that begins after `before` frames, and gather their statistics."""
        camera = self.dataset.camera
        names = {key: key.removeprefix(f"{base_of(camera)}.") for key in self.added}
        for place, (number, one) in enumerate(readings, start=self.done - before):
            self.starts.setdefault(number, place)
            stored = put(one["depth_mm"])
            one |= {"depth_mm": stored.astype(np.float32), "depth_valid": np.isfinite(stored)}
            one[depth_key(camera)] = stored * MILLI
        columns = {key: [one[name] for _, one in readings] for key, name in names.items()}
        for key, column in columns.items():
            for (number, _), value in zip(readings, column, strict=True):
                kept = sample_depth(value) if np.ndim(value) == 2 else value
                self.gathered.setdefault(number, {}).setdefault(key, []).append(kept)
        self.done += len(readings)
        self.in_contact += sum(one["contact"] for _, one in readings)
        self.not_read += sum(one["flags"].startswith("not read") for _, one in readings)
        self.progress(self.done, sum(one.length for one in self.dataset.episodes))
        return columns

    def write_episodes(self, folder: Path) -> None:
        """Write the tables of episodes with the statistics of the new features."""
        arrow, parquet = library("pyarrow"), library("pyarrow.parquet")
        for name in episode_files(self.dataset.root):
            batches = (batch for batch in parts(self.dataset.file(name)) if batch.num_rows)
            tables = (self._with_statistics(arrow.Table.from_batches([batch])) for batch in batches)
            for first in islice(tables, 1):
                with (
                    replacing(folder / name) as temporary,
                    parquet.ParquetWriter(temporary, first.schema, compression="zstd") as writer,
                ):
                    for table in chain([first], tables):
                        writer.write_table(table)

    def _with_statistics(self, table: Any) -> Any:
        """Return a part of a table of episodes with statistics of the new features, and places in the video."""
        numbers = table.column("episode_index").to_pylist()
        if self.video is not None:
            for what, column in self._places(numbers).items():
                table = table.append_column(f"videos/{depth_key(self.dataset.camera)}/{what}", [column])
        each = [statistics_as_json(self._stats(number)) for number in numbers]
        for key, stats in each[0].items():
            for what in stats:
                table = table.append_column(f"stats/{key}/{what}", [[one[key][what] for one in each]])
        return table

    def _places(self, numbers: list[int]) -> dict[str, list[Any]]:
        """Return where the depth of these episodes lies: file, first and last moment in s."""
        episodes = [self.dataset.episodes[number] for number in numbers]
        rate_Hz, first = self.dataset.rate_Hz, [self.starts[number] for number in numbers]
        return {
            "chunk_index": [one.data[0] for one in episodes],
            "file_index": [one.data[1] for one in episodes],
            "from_timestamp": [start / rate_Hz for start in first],
            "to_timestamp": [(start + one.length) / rate_Hz for start, one in zip(first, episodes, strict=True)],
        }

    def write_info(self, folder: Path) -> None:
        """Write info.json with the new features, and stats.json with their statistics."""
        info = dict(self.dataset.info) | {"features": dict(self.dataset.features) | self.added}
        if self.video is not None:
            info["video_path"] = info.get("video_path") or VIDEO_PATH
        stats = read_json(self.dataset.file(STATS)) if (self.dataset.root / STATS).exists() else {}
        episodes = [self._stats(number) for number in sorted(self.gathered)]
        stats |= statistics_as_json(
            {key: pooled_statistics([one[key] for one in episodes]) for key in episodes[0]}
        )
        for name, content in ((INFO, info), (STATS, stats)):
            write_text(folder / name, json.dumps(content, indent=4, ensure_ascii=False))

    def _stats(self, number: int) -> dict[str, Stats]:
        found = {}
        for key, values in self.gathered[number].items():
            if self.added[key]["dtype"] == "string":
                continue
            if len(shape := self.added[key]["shape"]) > 1:
                each = statistics_of_depth(values)
                found[key] = {
                    name: one if name == "count" else one.reshape((1,) * len(shape)) for name, one in each.items()
                }
            else:
                found[key] = statistics_of_values(np.asarray(values, float).reshape(len(values), -1))
        return found


def _look(dataset: DataSet, sensor: CalibratedSensor) -> tuple[str, ...]:
    """Return warnings of the profile by the first frames. Raises InputError where they have another size."""
    name = f"{dataset.root}, {dataset.camera}"
    shown = [Frame(rgb, name=name) for _, rgb in islice(dataset.pictures(), LOOKED_AT)]
    sensor.look([sensor.reconstructor.rectified(frame) for frame in shown])
    return sensor.warnings


def _copy_rest(dataset: DataSet, folder: Path) -> None:
    """Copy all other files; names that begin with a dot are caches of the hub."""
    for path in sorted(dataset.root.rglob("*")):
        name = path.relative_to(dataset.root)
        target = folder / name
        if path.is_file() and not target.exists() and not any(part.startswith(".") for part in name.parts):
            copy_file(open_regular(dataset.file(name.as_posix())), target)


def _type(feature: dict[str, Any]) -> Any:
    arrow = library("pyarrow")
    kind = {"float32": arrow.float32(), "bool": arrow.bool_(), "string": arrow.string()}[feature["dtype"]]
    if feature["shape"] == [1]:
        return kind
    return arrow.list_(kind, feature["shape"][0]) if len(feature["shape"]) == 1 else arrow.list_(arrow.list_(kind))


def _plain(value: Any) -> Any:
    """Return a map as a list of rows for pyarrow; other values unchanged."""
    return list(value) if isinstance(value, np.ndarray) and value.ndim == 2 else value
