"""Height maps of a whole folder of frames: streamed, on all cores, resumed after an interruption.

Each frame's map is written whole under its own name before the frame counts as done (jobs.py).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from tactilevision.batch.jobs import run_job
from tactilevision.contact.region import contact_flags, find_contact
from tactilevision.errors import InputError
from tactilevision.files.documents import csv_text
from tactilevision.files.tiff import masked, write_tiff
from tactilevision.files.writing import make_folder, remove, write_text
from tactilevision.files.zarr_store import begin_frames, end_frames, settle, write_frame
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certified_faces import NO_CORRECTION, FaceDepthCorrection
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.records.constants import KILO
from tactilevision.records.maps import FALSE, Frame, HeightMap, add
from tactilevision.records.measured import Bools
from tactilevision.robust import median

if TYPE_CHECKING:
    from tactilevision.heightmap.batch import BatchReader

TABLE = "depth.csv"
MAPS, STDS, STORE = "depth", "depth_std", "depth.zarr"
QUANTITIES = {MAPS: "depth into the gel", STDS: "standard deviation of the depth into the gel"}
JOURNAL, SCRATCH = ".depth-journal", ".depth.zarr-unfinished"
PEAK_SHARE = 1e-3  # of a map's depths is above its peak
PEAK_SAMPLED = 31  # step of the depths that are sampled for a lower bound of the peak
Form = Literal["tiff", "zarr"]


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One row of depth.csv: `status` is "ok", or why there is no map; `flags` as of a HeightMap."""

    frame: str
    status: str
    peak_mm: float = float("nan")
    contact_area_mm2: float = float("nan")
    ms: float = float("nan")
    peak_std_mm: float = float("nan")
    flags: tuple[str, ...] = ()

    @property
    def trusted(self) -> bool:
        """Return whether the map has a contact, and no flag that makes every depth of it false."""
        return self.status == "ok" and self.contact_area_mm2 > 0 and not FALSE.intersection(self.flags)


COLUMNS = tuple(part.name for part in fields(FrameResult))


@dataclass(frozen=True)
class DepthJob:
    """Job that writes the height map of a frame.

    `names` are the maps' by frame. `with_std` writes the standard deviation too. `anchor` corrects the faces of
    certified presses. Frames are read in batches on a torch `device`, None: one by one.
    """

    reconstructor: Reconstructor
    out: Path
    form: Form = "tiff"
    anchor: FaceDepthCorrection = NO_CORRECTION
    with_std: bool = False
    names: Mapping[str, str] = field(default_factory=dict)
    device: str | None = None
    record: type[FrameResult] = FrameResult
    journal: str = JOURNAL

    @property
    def kinds(self) -> tuple[str, ...]:
        """What is written of a frame."""
        return (MAPS, STDS) if self.with_std else (MAPS,)

    @property
    def scratch(self) -> Path | None:
        """The store that is being filled; None for TIFFs."""
        return self.out / SCRATCH if self.form == "zarr" else None

    def decides(self) -> tuple[object, ...]:
        """Return what determines a map besides the frame and the method."""
        return self.form, self.with_std, self.anchor.depth_scale, self.reconstructor.taught, self.device

    def prepare(self, names: Sequence[str], *, anew: bool) -> None:
        """Clean up after killed runs, and make the folders or an empty store."""
        settle(self.out / STORE)
        if self.scratch is None:
            remove(self.out / SCRATCH)  # of a killed run in the other form
            for kind in self.kinds:
                make_folder(self.out / kind)
        elif anew:
            sensor = self.reconstructor.sensor
            about = {"mm_per_px": list(sensor.mm_per_px), "quantity": QUANTITIES[MAPS]}
            fields = dict.fromkeys((f"{kind}_mm" for kind in self.kinds), "mm")
            shape = (sensor.height_px, sensor.width_px)
            begin_frames(self.scratch, names, fields=fields, shape=shape, about=about)

    def end(self, done: Sequence[FrameResult]) -> tuple[FrameResult, ...]:
        """Put the store in place, and write the table."""
        if self.scratch is not None:
            end_frames(self.scratch, self.out / STORE)
        write_text(self.out / TABLE, table(done))
        return tuple(done)

    def __call__(self, frame: Frame | BadFrame, number: int) -> FrameResult:
        """Write the map; return its record."""
        if isinstance(frame, BadFrame):
            return FrameResult(frame.name, f"unreadable: {frame.why}")
        start = time.perf_counter()
        try:
            height = self.reconstructor.height_map(frame)
        except InputError as fault:
            return FrameResult(frame.name, f"rejected: {fault.what}")
        return self._record(frame, number, height, KILO * (time.perf_counter() - start))

    def records(self, frames: Iterable[Frame | BadFrame], numbers: Iterable[int]) -> Iterator[FrameResult]:
        """Write the maps of frames, and yield their records: one by one, or in batches on the device."""
        if self.device is None:
            yield from map(self, frames, numbers)
            return
        reader, left = self._reader, zip(frames, numbers, strict=False)
        while some := list(islice(left, reader.chunk)):
            good = [frame for frame, _ in some if isinstance(frame, Frame)]
            start = time.perf_counter()
            maps = iter(reader.read(good).found)
            spent = KILO * (time.perf_counter() - start) / max(len(good), 1)
            for frame, number in some:
                height = next(maps) if isinstance(frame, Frame) else None
                if isinstance(frame, BadFrame) or height is None:
                    yield self(frame, number)
                elif isinstance(height, InputError):
                    yield FrameResult(frame.name, f"rejected: {height.what}")
                else:
                    yield self._record(frame, number, height, spent)

    @cached_property
    def _reader(self) -> BatchReader:
        """What reads batches, kept for the tasks of a process."""
        import torch

        from tactilevision.heightmap.batch import BatchReader

        assert self.device is not None
        torch.set_num_threads(1)  # processes share the cores
        return BatchReader(self.reconstructor, self.device)

    def _record(self, frame: Frame, number: int, height: HeightMap, spent: float) -> FrameResult:
        """Write the map of a frame, which took `spent` ms; return its record."""
        height = self.anchor(height)
        contact = find_contact(height, self.reconstructor.error)
        deepest_mm, area_mm2 = measure(height, contact)
        flags = add(height.flags, contact_flags(contact, self.reconstructor.error))
        self.keep(replace(height, flags=flags), frame.name, number)
        std_mm = std_at(height, deepest_mm)
        return FrameResult(frame.name, "ok", deepest_mm, area_mm2, spent, std_mm, flags)

    def kept(self, result: FrameResult) -> bool:
        """Return whether the map is there; a store that is being filled is there as a whole."""
        if result.status != "ok":
            return True
        if self.scratch is not None:
            return self.scratch.exists()
        return all(self._path(result.frame, kind).exists() for kind in self.kinds)

    def keep(self, height: HeightMap, name: str, number: int) -> None:
        """Write the map of the frame `name`, the `number`th."""
        std_mm = np.full(height.depth_mm.shape, np.nan) if height.std_mm is None else height.std_mm
        fields = {MAPS: height} | ({STDS: replace(height, depth_mm=std_mm)} if self.with_std else {})
        if self.scratch is not None:
            write_frame(self.scratch, number, fields={f"{kind}_mm": masked(one) for kind, one in fields.items()})
            return
        for kind, one in fields.items():
            write_tiff(self._path(name, kind), one, quantity=QUANTITIES[kind])

    def _path(self, name: str, kind: str) -> Path:
        return self.out / kind / f"{self.names.get(name, Path(name).stem)}.tiff"


def reconstruct_folder(
    recording: Recording,
    reconstructor: Reconstructor,
    out: Path | str,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    form: Form = "tiff",
    anchor: FaceDepthCorrection = NO_CORRECTION,
    with_std: bool = False,
    device: str | None = None,
) -> tuple[FrameResult, ...]:
    """Write every frame's height map, and depth.csv; return its rows in the order of the frames.

    `form` "tiff": depth/NAME.tiff, or depth/NAME.ENDING.tiff of two frames that differ only in their ending;
    "zarr": depth.zarr with depth_mm (frames, rows, columns) and frame, the names. `with_std` adds the standard
    deviation of every depth: depth_std/NAME.tiff, or depth_std_mm. `workers` is the number of processes (None: one
    a core); `cluster` the address of a Dask scheduler, or its file, whose workers see the same folders. A frame
    that cannot be read is listed and skipped. An unfinished run into the same folder with the same recording and
    method is resumed. `anchor` corrects the faces of certified presses (press/certified_faces.py). `device` reads
    frames in batches through torch, on "cpu", "cuda", "cuda:N" or "auto" (heightmap/batch.py); None: one by one.
    """
    place = Path(out).absolute()  # workers have another working directory
    job = DepthJob(reconstructor, place, form, anchor, with_std, _map_names(recording), device)
    return run_job(recording, job, end=job.end, workers=workers, cluster=cluster, progress=progress)


def _map_names(recording: Recording) -> dict[str, str]:
    """Return names of the frames' maps: without their endings, unless two frames differ in nothing else."""
    stems = Counter(Path(name).stem for name in recording.frame_names)
    names = {name: stem if stems[stem := Path(name).stem] == 1 else name for name in recording.frame_names}
    if len(set(names.values())) != len(names):
        raise InputError(
            "two frames would share a map's name",
            where=recording.path,
            remedy="Rename one: a map is stored under its frame's name.",
        )
    return names


def measure(height: HeightMap, contact: Bools) -> tuple[float, float]:
    """Return peak depth (mm) of a map (H, W), and its area in contact (mm²); NaN where no depth is known."""
    area_mm2 = float(np.count_nonzero(contact)) * height.mm_per_px[0] * height.mm_per_px[1]
    return peak_mm(height), area_mm2 if height.valid.any() else float("nan")


def peak_mm(height: HeightMap) -> float:
    """Return the 99.9th percentile of the valid depths (H, W), mm, which is robust to single pixels.

    Its neighbours are among the few that a sample of the depths shows to be the deepest. NaN where none is valid.
    """
    depth = height.depth_mm.ravel() if height.valid.all() else height.depth_mm[height.valid]
    if depth.size == 0:
        return float("nan")
    few = depth[::PEAK_SAMPLED]
    limit = np.partition(few, len(few) * 99 // 100)[len(few) * 99 // 100]
    deepest = depth.take(np.flatnonzero(depth > limit))
    above = PEAK_SHARE * (len(depth) - 1)  # number of depths above the percentile
    if len(deepest) < above + 2:
        return float(np.percentile(depth, 100 * (1 - PEAK_SHARE)))
    return float(np.percentile(deepest, 100 * (1 - above / (len(deepest) - 1))))


def std_at(height: HeightMap, depth_mm: float) -> float:
    """Return the standard deviation in mm of the depths (H, W) from `depth_mm` on: their median.

    NaN where it is not known.
    """
    if height.std_mm is None:
        return float("nan")
    deep = np.flatnonzero(height.depth_mm >= depth_mm)
    there = height.std_mm.take(deep)[height.valid.take(deep)]
    return float(median(there)) if there.size and not np.isnan(there).any() else float("nan")


def summary(rows: Sequence[FrameResult]) -> dict[str, object]:
    """Return the number of frames, of each status and flag, and the statuses of those without a map."""
    return {
        "frames": len(rows),
        "statuses": dict(Counter(row.status.split(":")[0] for row in rows)),
        "bad": {row.frame: row.status for row in rows if row.status != "ok"},
        "flags": dict(Counter(flag for row in rows for flag in row.flags)),
    }


def table(rows: Iterable[FrameResult]) -> str:
    """Return depth.csv; what is not known is left empty."""
    return csv_text([COLUMNS, *map(cells, rows)])


def cells(row: FrameResult) -> tuple[str, ...]:
    """Return a row of depth.csv."""
    numbers = (row.peak_mm, row.contact_area_mm2, row.ms, row.peak_std_mm)
    return (row.frame, row.status, *("" if np.isnan(n) else f"{n:.4f}" for n in numbers), " ".join(row.flags))
