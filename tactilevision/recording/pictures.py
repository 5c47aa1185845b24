"""Find the pictures of a recording and read them one at a time."""

from __future__ import annotations

import math
import os
import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.cache import packed_record
from tactilevision.files.opening import check_plain, inside, open_regular, read_bytes
from tactilevision.files.pictures import orientation
from tactilevision.recording import layout
from tactilevision.recording.images import (
    TornImageError,
    as_rgb,
    count_frames,
    iter_video,
    read_image,
    read_stored,
    stated_frames,
)
from tactilevision.recording.layout import some
from tactilevision.recording.model import BadFrame, BallPress, Recording, require
from tactilevision.recording.read_tables import read_frame_table
from tactilevision.recording.tables import Table, read_table
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes

BLOCK = 1 << 20  # bytes of a file that are hashed at a time
_SIZED = 7  # pictures of a bare folder whose sizes are compared
_MAX_TRIALS = 10  # pictures to try for the size
_MAX_MISSING = 0.5  # share of the listed pictures that may be missing


def list_images(folder: Path) -> list[str]:
    """List the pictures in a folder by name, in numerical order (2 before 10).

    Raises InputError for a name that no table can hold.
    """
    names = sorted(_image_names(folder), key=_as_counted)
    for name in names:
        check_plain(name, where=folder)
    return names


def _image_names(folder: Path) -> list[str]:
    if not folder.is_dir():
        return []
    return [name for name in os.listdir(folder) if name.lower().endswith(layout.IMAGE_SUFFIXES) and name[0] != "."]


def _as_counted(name: str) -> list[tuple[int, int, str]]:
    parts = [part for part in re.split(r"([0-9]+)", name) if part]
    return [(0, int(part), "") if part[0] in "0123456789" else (1, 0, part) for part in parts]


def find_frames(root: Path) -> Path | None:
    """Find the folder of images, or the one video, of a recording; None if there is neither."""
    folder = root / layout.FRAMES
    if _image_names(folder):
        return folder
    here = [path for path in sorted(root.glob("*")) if path.stem == layout.FRAMES]
    here += sorted(folder.iterdir()) if folder.is_dir() else []
    found = [path for path in here if path.suffix.lower() in layout.VIDEO_SUFFIXES and path.is_file()]
    if len(found) > 1:
        raise RecordingError(
            f"there are {len(found)} videos of frames: {found[0].name}, {found[1].name}",
            where=root,
            remedy="Keep one.",
        )
    return found[0] if found else None


def frame_names(path: Path) -> tuple[str, ...]:
    """Return the names of all pictures of a folder, or the numbers of all frames of a video."""
    return tuple(map(str, range(count_frames(path)))) if path.is_file() else tuple(list_images(path))


def list_frames(root: Path, frames_path: Path) -> tuple[Table, tuple[str, ...]]:
    """Read frames.csv; return it and warnings of listed pictures that are missing and of unlisted ones.

    Readers yield a missing picture as a BadFrame. Raises RecordingError if most are missing, since such a list is
    of other pictures.
    """
    table = read_frame_table(root / layout.FRAME_TABLE)
    names = table.words["frame"]
    if frames_path.is_file():
        _check_indices(table, frames_path)
        return table, ()
    for name in names:
        inside(frames_path, name, where=table.path)
    present = set(_image_names(frames_path))
    missing = _check_present(table, names, present, spare=_MAX_MISSING)
    unlisted = len(present - set(names))
    warnings = []
    if missing:
        lost = f"{len(missing)} of {len(names)} pictures listed are missing and are skipped: {some(missing)}"
        warnings.append(f"{layout.FRAME_TABLE}: {lost}")
    if unlisted:
        warnings.append(f"{layout.FRAMES}/: {unlisted} pictures are not listed in {layout.FRAME_TABLE}")
    return table, tuple(warnings)


def _check_present(
    table: Table, names: Sequence[str], present: set[str], *, spare: float = 0.0
) -> tuple[str, ...]:
    """Return the names that are missing; raise if they exceed the share `spare`, or lack only their ending."""
    missing = [row for row, name in enumerate(names) if name not in present]
    if missing:
        name = names[missing[0]]
        ended = sorted(other for other in present if other.rsplit(".", 1)[0] == name)
        if not ended and len(missing) <= spare * len(names):
            return tuple(names[row] for row in missing)
        raise table.fault(
            missing[0],
            f"{len(missing)} of {len(names)} pictures listed are missing, the first is {name}",
            remedy=f"Write its name with its ending: {ended[0]}."
            if ended
            else "Copy them, or remove them from the list.",
        )
    return ()


def _check_indices(table: Table, video: Path) -> None:
    """Check that frames of a video are listed by number, from 0, rising; 12.0 is read as 12."""
    last = -1
    table.words["frame"] = [re.sub(r"\.0*$", "", name) for name in table.words["frame"]]
    for row, name in enumerate(table.words["frame"]):
        if not (name.isascii() and name.isdigit()):
            raise table.fault(row, f"frames of a video ({video.name}) are numbers, from 0", value=name)
        if int(name) <= last:
            raise table.fault(row, f"frame {name} comes after frame {last}", remedy="Numbers rise with time.")
        last = int(name)
    if last >= stated_frames(video) and last >= (count := count_frames(video)):
        row = next(row for row, name in enumerate(table.words["frame"]) if int(name) >= count)
        raise table.fault(
            row,
            f"frame {table.words['frame'][row]} is missing: {video.name} has {count} frames",
            remedy="The first frame of a video has the number 0.",
        )


def find_flats(root: Path) -> tuple[Path, ...]:
    """List the pictures of the untouched gel."""
    folder = root / layout.FLATS
    return tuple(folder / name for name in list_images(folder))


def read_balls(folder: Path, path: Path) -> tuple[tuple[BallPress, ...], tuple[str, ...]]:
    """Read the ball presses in a folder by the table at `path`.

    Return them and warnings, none if there is neither.
    """
    images = list_images(folder)
    if not images and not path.is_file():
        return (), ()
    if not path.is_file():
        raise RecordingError(
            f"the table is missing, though there are {len(images)} pictures of ball presses",
            where=path,
            remedy=f"Add it: columns {', '.join(layout.BALL_COLUMNS.required)}.",
        )
    table = read_table(path, layout.BALL_COLUMNS)
    names = table.words["frame"]
    below = {name for name in names if inside(folder, name, where=path).is_file()}  # also in folders below
    _check_present(table, names, set(images) | below)
    radius = table.numbers["ball_radius_mm"]
    unlikely = bool((radius > 100).any())
    warning = f"{path.name}: ball_radius_mm = {radius.max():g} is very large: is it in micrometres?"
    return tuple(_ball(table, row, folder) for row in range(len(radius))), (warning,) * unlikely


def _ball(table: Table, row: int, folder: Path) -> BallPress:
    x, y, contact = (float(table.optional(name)[row]) for name in layout.BALL_COLUMNS.maybe_numbers)
    if contact <= 0:
        raise table.fault(row, "contact_radius_px must be above 0", value=contact)
    centre = None if np.isnan(x) or np.isnan(y) else (x, y)
    name = table.words["frame"][row]
    return BallPress(
        folder / name,
        float(table.numbers["ball_radius_mm"][row]),
        centre,
        None if np.isnan(contact) else contact,
        name if "/" in name else "",
    )


def first_look(
    frames_path: Path, names: Sequence[str], *, white_level: float | None = None
) -> tuple[tuple[int, int], tuple[str, ...]]:
    """Return (width, height) of the first picture that can be read, and warnings.

    Raises if none of the first can.
    """
    why = ""
    if frames_path.is_file():
        rgb = next(iter_video(frames_path, [int(names[0])]))[1] if names else None
        if rgb is not None:
            return (rgb.shape[1], rgb.shape[0]), ()
    else:
        names = list(islice((name for name in names if (frames_path / name).is_file()), _MAX_TRIALS))
        for name in names:
            try:
                stored = read_stored(frames_path / name)
                height, width, _ = as_rgb(stored, frames_path / name, white_level=white_level).shape
                return (width, height), _doubts_of_depth(stored, name, white_level)
            except TornImageError as fault:
                why = why or f"Of the first: {fault.what}. {fault.remedy}"
    raise RecordingError(
        f"none of the first pictures can be read: {', '.join(names[:_MAX_TRIALS]) or 'there is none'}",
        where=frames_path,
        remedy=why or "Copy them again from their source.",
    )


def most_sizes(
    frames_path: Path, names: Sequence[str], first_px: tuple[int, int]
) -> tuple[tuple[int, int], int, tuple[str, ...]]:
    """Return (width, height) that most of some pictures have, the number of the first such, and a warning if
    others come before. `first_px` is the size of the first that can be read; it holds if no other is more
    frequent.
    """
    if frames_path.is_file():
        return first_px, 0, ()
    looked = dict.fromkeys(np.linspace(0, len(names) - 1, _SIZED).astype(int).tolist())
    sizes = {row: size for row in looked if (size := _size_of(frames_path / names[row])) is not None}
    usual = Counter(sizes.values()).most_common(1)[0][0] if sizes else first_px
    if usual == first_px or list(sizes.values()).count(usual) <= list(sizes.values()).count(first_px):
        return first_px, 0, ()
    first = next(row for row in range(len(names)) if _size_of(frames_path / names[row]) == usual)
    was, now = (f"{width} x {height}" for width, height in (first_px, usual))
    return (
        usual,
        first,
        (f"the first pictures are {was}, most others {now}: {names[first]} and others of its size are read",),
    )


def _size_of(path: Path) -> tuple[int, int] | None:
    """Return width and height of a picture; None for one that cannot be read."""
    try:
        height, width = read_stored(path).shape[:2]
    except (InputError, OSError):
        return None
    return width, height


def check_references(
    frame_size_px: tuple[int, int], references: Sequence[Path], *, white_level: float | None = None
) -> tuple[str, ...]:
    """Raise where a reference that can be read has another size than the frames; warnings of its bit depth."""
    doubts: tuple[str, ...] = ()
    for path in references:
        with suppress(TornImageError):
            stored = read_stored(path)
            check_size((stored.shape[1], stored.shape[0]), frame_size_px, path)
            doubts += _doubts_of_depth(stored, f"{path.parent.name}/{path.name}", white_level)
    return doubts


def doubts_of_turning(
    frames_path: Path | None, names: Sequence[str], references: Sequence[Path]
) -> tuple[str, ...]:
    """Return a warning if references state another orientation than a folder's first frame; no tag is followed."""
    stated = {path: turned for path in references if (turned := _orientation(path)) is not None}
    usual = _orientation(frames_path / names[0]) or 1 if names and frames_path and frames_path.is_dir() else 1
    others = [path for path, turned in stated.items() if turned != usual]
    if not others:
        return ()
    names = some([f"{path.parent.name}/{path.name}" for path in others])
    return (
        f"{names}: the orientation tag is {stated[others[0]]}, that of the frames {usual} (1: not turned). Tags "
        "are not followed: if a program turned the pixels of one of them, turn them back",
    )


def _orientation(path: Path) -> int | None:
    """Return the orientation that a file states; None for one that cannot be read."""
    try:
        return orientation(read_bytes(path))
    except (InputError, OSError):
        return None


def check_size(size_px: tuple[int, int], frame_size_px: tuple[int, int], path: Path) -> None:
    """Raise RecordingError if a reference has another size (width, height) than the frames or first reference."""
    if size_px != frame_size_px:
        raise RecordingError(
            f"the picture is {size_px[0]} x {size_px[1]}, the others {frame_size_px[0]} x {frame_size_px[1]}",
            where=path,
            remedy="Take frames, untouched gel and ball presses with one camera setting, before rectification.",
        )


def _doubts_of_depth(stored: npt.NDArray[Any], name: str, white_level: float | None) -> tuple[str, ...]:
    """Return a warning if 16 bits probably hold numbers of 10, 12 or 14; nothing in the file states it."""
    brightest = int(stored.max()) if stored.dtype == np.uint16 else 65535
    if white_level is not None or brightest >= 2**14:
        return ()
    return (
        f"{name}: its largest value is {brightest} of 65535; if the camera has fewer than 16 bits, state "
        f"white_level in {layout.SETTINGS} [sensor] (4095 for 12 bits)",
    )


# Reading pictures one after another or by number, with a few of them in memory.

_AHEAD = 4  # frames read ahead


def iter_frames(
    recording: Recording, start_s: float = -math.inf, *, end_s: float = math.inf
) -> Iterator[Frame | BadFrame]:
    """Stream the frames with start_s <= time <= end_s, in order, as they are on disk (not rectified).

    A frame of unknown time is part of every stream. A picture that is missing or damaged is yielded as a BadFrame.
    Raises RecordingError for a recording without frames, and for a picture of another kind (grey, floating point
    beyond its range) or of another size than those before.
    """
    require(recording, "frames", step="reading frames")
    times = recording.frame_times_s
    wanted = np.flatnonzero(~((times < start_s) | (times > end_s))).tolist()
    return _checked(recording, _frames(recording, wanted))


def read_frame(recording: Recording, index: int) -> Frame:
    """Read one frame by its place in `recording.frame_names`; negative ones count from the end.

    Raises RecordingError if the picture is missing or damaged, InputError if there is no such frame.
    """
    require(recording, "frames", step="reading frames")
    count = len(recording.frame_names)
    if not -count <= index < count:
        raise InputError(f"the recording has {count} frames", where=recording.path, value=index)
    frame = next(_checked(recording, _frames(recording, [index % count])))
    if isinstance(frame, BadFrame):
        raise RecordingError(frame.why, where=f"{recording.frames_path}, frame {frame.name}")
    return frame


def read_flats(recording: Recording) -> list[Bytes]:
    """Read the raw pictures (H, W, 3), grey levels, of the untouched gel: their own, or the frames taken for it.

    Raises RecordingError for one that cannot be read.
    """
    if recording.flats:
        return [read_reference(recording, path) for path in recording.flats]
    return [read_frame(recording, number).rgb for number in recording.flat_frames]


def read_reference(recording: Recording, path: Path) -> Bytes:
    """Read the raw picture (H, W, 3), grey levels, of the untouched gel or a ball press at `path`.

    Raises RecordingError where it cannot be read, or has another size than the frames.
    """
    rgb = read_image(path, white_level=recording.white_level)
    if recording.frame_size_px is not None:
        check_size((rgb.shape[1], rgb.shape[0]), recording.frame_size_px, path)
    return rgb


def content_of(recording: Recording) -> str:
    """Return a hash of a recording with all its pictures."""
    digest = sha256()
    for part in packed_record(recording, whatever=True).values():
        digest.update(part)
    folder = recording.frames_path
    names = ("",) if folder is not None and folder.is_file() else recording.frame_names  # "": the video itself
    frames = [folder / name for name in names] if folder is not None else []
    for path in (*frames, *recording.flats, *(ball.path for ball in recording.balls)):
        with suppress(OSError, InputError), open_regular(path, limit=None) as file:
            for block in iter(partial(file.read, BLOCK), b""):
                digest.update(block)
        digest.update(b"/")
    return digest.hexdigest()


def _frames(recording: Recording, wanted: list[int]) -> Iterator[Frame | BadFrame]:
    folder = recording.frames_path
    if folder is not None and folder.is_dir():
        return _read_ahead(recording, wanted)
    return _from_video(recording, wanted)


def _from_video(recording: Recording, wanted: list[int]) -> Iterator[Frame | BadFrame]:
    assert recording.frames_path is not None
    indices = [int(recording.frame_names[row]) for row in wanted]
    for row, (_, rgb) in zip(wanted, iter_video(recording.frames_path, indices), strict=True):
        name, time_s = recording.frame_names[row], float(recording.frame_times_s[row])
        if rgb is None:
            yield BadFrame(name, time_s, "the video ends before this frame, or is damaged there")
        else:
            yield Frame(rgb, time_s, name)


def _read_ahead(recording: Recording, wanted: Iterable[int]) -> Iterator[Frame | BadFrame]:
    """Decode a few pictures ahead in a second thread."""
    rows = iter(wanted)
    with ThreadPoolExecutor(1, thread_name_prefix="frames") as reader:
        pending: deque[Future[Frame | BadFrame]] = deque(
            reader.submit(_from_file, recording, row) for row in islice(rows, _AHEAD)
        )
        while pending:
            ready = pending.popleft().result()
            pending.extend(reader.submit(_from_file, recording, row) for row in islice(rows, 1))
            yield ready


def _from_file(recording: Recording, row: int) -> Frame | BadFrame:
    assert recording.frames_path is not None
    name, time_s = recording.frame_names[row], float(recording.frame_times_s[row])
    path = recording.frames_path / name
    try:
        rgb: Bytes = read_image(path, white_level=recording.white_level)
    except TornImageError as fault:
        return BadFrame(name, time_s, fault.what)
    return Frame(rgb, time_s, name)


def _checked(recording: Recording, frames: Iterator[Frame | BadFrame]) -> Iterator[Frame | BadFrame]:
    expected = recording.frame_size_px
    for frame in frames:
        if isinstance(frame, Frame):
            size = (frame.rgb.shape[1], frame.rgb.shape[0])
            expected = expected or size
            if size != expected:
                raise RecordingError(
                    f"the pictures are of two sizes: {frame.name} is {size[0]} x {size[1]}, "
                    f"those before {expected[0]} x {expected[1]}",
                    where=recording.frames_path or recording.path,
                    remedy="One recording is one camera with one setting: put the others into another folder.",
                )
        yield frame
