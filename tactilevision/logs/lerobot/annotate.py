"""Depth, contact and force of a tactile camera, written beside its frames: a new data set of LeRobot.

All that the old one holds is kept: videos are copied byte for byte, and the tables gain columns.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.door.documents import read_json
from tactilevision.errors import InputError, OutputError
from tactilevision.files import staged, write_text
from tactilevision.logs.lerobot import statistics
from tactilevision.logs.lerobot.dataset import INFO, STATS, DataSet, data_name, episode_files
from tactilevision.logs.lerobot.features import Reading, base_of, columns_of, read_frame, schema
from tactilevision.logs.lerobot.pictures import pictures
from tactilevision.logs.lerobot.tables import opened, parts, place_in
from tactilevision.logs.library import library
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.records import Bytes, Frame

LOOKED_AT = 5  # frames at the beginning, which tell whether the profile is this sensor's
Tell = Callable[[int, int], None]  # frames done, and of how many


@dataclass(frozen=True, slots=True)
class Annotated:
    """What was written: counts, the keys of the new features, and what is doubtful."""

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
    tell: Tell = lambda done, of: None,
) -> Annotated:
    """Write the data set `out`: all of `dataset`, and what `sensor` reads in its camera's frames.

    Maps are means of `shrink` x `shrink` pixels. The reference is the profile's, best of raw frames: in packed
    ones the codec has changed the gel's noise. Raises InputError for frames of another size,
    features that are there already, and as `pictures` does; OutputError where `out` is a data set already.
    """
    if (Path(out) / INFO).exists():
        raise OutputError("is a data set already", where=out, remedy="Choose an empty folder with --out.")
    base = base_of(dataset.camera)
    added = schema(base, sensor, shrink=shrink)
    there = [key for key in added if key in dataset.features]
    if there:
        raise InputError("the data set has such a feature already", where=dataset.root, value=there[0])
    warnings = _look(dataset, sensor)
    work = _Work(dataset, base, added, _readings(dataset, sensor, shrink=shrink), tell)
    with staged(out) as folder:
        for place in dict.fromkeys(one.data for one in dataset.episodes):
            work.write_table(dataset.data(place), folder / data_name(place))
        work.write_episodes(folder)
        work.write_info(folder)
        _copy_rest(dataset.root, folder)
    return Annotated(len(dataset.episodes), work.done, work.in_contact, work.not_read, tuple(added), warnings)


class _Work:
    """The readings as they come, and their statistics."""

    def __init__(
        self,
        dataset: DataSet,
        base: str,
        added: dict[str, Any],
        readings: Iterator[tuple[int, Reading]],
        tell: Tell,
    ) -> None:
        self.dataset, self.base, self.added, self.readings, self.tell = dataset, base, added, readings, tell
        self.done = self.in_contact = self.not_read = 0
        self.gathered: dict[int, dict[str, list[Any]]] = {}
        self.total = sum(one.length for one in dataset.episodes)

    def write_table(self, source: Path, target: Path) -> None:
        """One table of frames, with the new columns."""
        arrow, parquet = library("pyarrow"), library("pyarrow.parquet")
        target.parent.mkdir(parents=True, exist_ok=True)
        with opened(source) as file:
            schema_in = file.schema_arrow.remove_metadata()  # which lists the old columns alone
        whole = arrow.schema([*schema_in, *(arrow.field(key, _type(one)) for key, one in self.added.items())])
        packing = {f"{self.base}.depth_mm.list.element.list.element": "BYTE_STREAM_SPLIT"}
        with parquet.ParquetWriter(
            target, whole, compression="zstd", use_dictionary=False, column_encoding=packing
        ) as writer:
            for batch in parts(source):
                readings = list(islice(self.readings, batch.num_rows))
                columns = self._taken(readings)
                new = [
                    arrow.array([_plain(v) for v in columns[key]], _type(self.added[key])) for key in self.added
                ]
                writer.write_batch(arrow.RecordBatch.from_arrays([*batch.columns, *new], schema=whole))

    def _taken(self, readings: list[tuple[int, Reading]]) -> dict[str, list[Any]]:
        """The columns of a part; their statistics are gathered."""
        columns = columns_of([one for _, one in readings], self.added, self.base)
        for key, column in columns.items():
            for (number, _), value in zip(readings, column, strict=True):
                kept = statistics.sampled(value) if key.endswith(".depth_mm") else value
                self.gathered.setdefault(number, {}).setdefault(key, []).append(kept)
        self.done += len(readings)
        self.in_contact += sum(one.contact for _, one in readings)
        self.not_read += sum(one.flags.startswith("not read") for _, one in readings)
        self.tell(self.done, self.total)
        return columns

    def write_episodes(self, folder: Path) -> None:
        """The tables of episodes, with the statistics of the new features in each."""
        arrow, parquet = library("pyarrow"), library("pyarrow.parquet")
        for name in episode_files(self.dataset.root):
            table = arrow.Table.from_batches(list(parts(place_in(self.dataset.root, name))))
            numbers = table.column("episode_index").to_pylist()
            each = [statistics.as_json(self._stats(number)) for number in numbers]
            for key, stats in each[0].items():
                for what in stats:
                    table = table.append_column(f"stats/{key}/{what}", [[one[key][what] for one in each]])
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            parquet.write_table(table, folder / name, compression="zstd")

    def write_info(self, folder: Path) -> None:
        """info.json with the new features, stats.json with their statistics."""
        root = self.dataset.root
        info = dict(self.dataset.info) | {"features": dict(self.dataset.features) | self.added}
        stats = read_json(place_in(root, STATS)) if (root / STATS).exists() else {}
        episodes = [self._stats(number) for number in sorted(self.gathered)]
        stats |= statistics.as_json(
            {key: statistics.together([one[key] for one in episodes]) for key in episodes[0]}
        )
        for name, content in ((INFO, info), (STATS, stats)):
            write_text(folder / name, json.dumps(content, indent=4, ensure_ascii=False))

    def _stats(self, number: int) -> dict[str, statistics.Stats]:
        found = {}
        for key, values in self.gathered[number].items():
            if self.added[key]["dtype"] == "string":
                continue
            if key.endswith(".depth_mm"):
                found[key] = statistics.of_depth(values)
            else:
                found[key] = statistics.of_values(np.asarray(values, float).reshape(len(values), -1))
        return found


def _readings(dataset: DataSet, sensor: CalibratedSensor, *, shrink: int) -> Iterator[tuple[int, Reading]]:
    """The episode's number and what was read, frame by frame."""
    for row, rgb in pictures(dataset):
        yield row.episode.number, read_frame(sensor, rgb, shrink=shrink)


def _look(dataset: DataSet, sensor: CalibratedSensor) -> tuple[str, ...]:
    """What is doubtful about the profile by the first frames. Raises InputError where they have another size."""
    shown: list[Bytes] = [rgb for _, rgb in islice(pictures(dataset), LOOKED_AT)]
    wanted, found = sensor.profile.frame_size_px, shown[0].shape[1::-1]
    if found != wanted:
        raise InputError(
            f"frames of {wanted[0]} x {wanted[1]} px are what the profile {sensor.profile.name} was made for",
            where=f"{dataset.root}, {dataset.camera}",
            value=f"{found[0]} x {found[1]} px",
            remedy="Calibrate the sensor on frames of this size.",
        )
    sensor.look([sensor.reconstructor.rectified(Frame(rgb)) for rgb in shown])
    return sensor.warnings


def _copy_rest(root: Path, folder: Path) -> None:
    """All files that are not written anew; what begins with a dot is a cache of the hub."""
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        target = folder / name
        if path.is_file() and not target.exists() and not any(part.startswith(".") for part in name.parts):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(place_in(root, name.as_posix()), target)


def _type(feature: dict[str, Any]) -> Any:
    arrow = library("pyarrow")
    kind = {"float32": arrow.float32(), "bool": arrow.bool_(), "string": arrow.string()}[feature["dtype"]]
    if feature["shape"] == [1]:
        return kind
    return arrow.list_(kind, feature["shape"][0]) if len(feature["shape"]) == 1 else arrow.list_(arrow.list_(kind))


def _plain(value: Any) -> Any:
    """A map as rows, which pyarrow takes; all else as it is."""
    return list(value) if isinstance(value, np.ndarray) and value.ndim == 2 else value
