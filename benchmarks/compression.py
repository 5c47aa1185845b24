"""What packing frames into a video costs depth and clock: `python -m benchmarks.compression`.

Frames of the sample in a row are encoded and decoded again, and their height maps are compared with those of the
frames as they were. The reference of the untouched gel stays unpacked, as in a sensor profile.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from tactilevision import read_recording
from tactilevision.contact.region import find_contact
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Bools, Bytes, Floats

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"
FIRST, COUNT = 66, 60  # frames: the end of one press, free gel, the next press
RATE_HZ = 30  # of a writer that counts frames instead of stamping them
TICKS_HZ = 90_000  # of the clock that pictures are stamped with, as MPEG has it
JITTER_S = 0.004  # s: the camera's, one standard deviation
LOST = (20, 21, 40)  # frames that were dropped
WAYS: dict[str, tuple[str, str, dict[str, str]]] = {
    "H.264 lossless, RGB": ("libx264rgb", "rgb24", {"crf": "0"}),
    "H.264 crf 10, 4:4:4": ("libx264", "yuv444p", {"crf": "10"}),
    "H.264 crf 18, 4:4:4": ("libx264", "yuv444p", {"crf": "18"}),
    "H.264 crf 18": ("libx264", "yuv420p", {"crf": "18"}),
    "H.264 crf 23": ("libx264", "yuv420p", {"crf": "23"}),
    "H.264 crf 30": ("libx264", "yuv420p", {"crf": "30", "g": "2"}),
    "AV1 crf 30": ("libsvtav1", "yuv420p", {"crf": "30", "g": "2", "preset": "12"}),
}
QUALITIES = (95, 80, 50)  # of single pictures as JPEG, with half the colours' resolution: CompressedImage of ROS


@dataclass(frozen=True)
class Cost:
    """rms of grey levels, of depth off the contact and in it (um); peaks off (um); contacts made up, and lost."""

    grey: float
    free_um: float
    contact_um: float
    peaks_um: Floats
    made_up: int
    lost: int


def packed(pictures: list[Bytes], way: str, times_s: Floats | None = None) -> bytes:
    """The pictures (H, W, 3), red first, as a Matroska file; stamped with `times_s` (N,), s, or counted."""
    codec, colours, options = WAYS[way]
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as box:
        stream: Any = box.add_stream(codec, rate=RATE_HZ)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = colours
        stream.options = options
        if times_s is not None:
            stream.codec_context.time_base = Fraction(1, TICKS_HZ)
        for number, rgb in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            if times_s is not None:
                frame.pts, frame.time_base = round(times_s[number] * TICKS_HZ), Fraction(1, TICKS_HZ)
            box.mux(stream.encode(frame))
        box.mux(stream.encode())
    return file.getvalue()


def unpacked(data: bytes) -> tuple[list[Bytes], Floats]:
    """Pictures and their times, s."""
    with av.open(io.BytesIO(data)) as box:
        frames = [(one.to_ndarray(format="rgb24"), float(one.time or 0)) for one in box.decode(video=0)]
    return [rgb for rgb, _ in frames], np.array([time_s for _, time_s in frames])


def even(rgb: Bytes) -> Bytes:
    """The picture (H, W, 3), its last row and column repeated where there is an odd number of them."""
    return np.pad(rgb, [(0, rgb.shape[0] % 2), (0, rgb.shape[1] % 2), (0, 0)], mode="edge")


def packings(frames: list[Bytes], ways: Iterable[str]) -> Iterator[tuple[str, int, list[Bytes]]]:
    """Each way of packing: its name, all bytes, and the pictures (H, W, 3) that come back."""
    rows, columns = frames[0].shape[:2]
    for way in ways:
        data = packed([even(rgb) for rgb in frames], way)
        yield way, len(data), [rgb[:rows, :columns] for rgb in unpacked(data)[0]]
    for quality in QUALITIES:
        how = [cv2.IMWRITE_JPEG_QUALITY, quality]
        each = [cv2.imencode(".jpg", rgb[..., ::-1], how)[1] for rgb in frames]
        back = [np.asarray(cv2.imdecode(one, cv2.IMREAD_COLOR))[..., ::-1].copy() for one in each]
        yield f"JPEG {quality}", sum(one.size for one in each), back


def seen(reconstructor: Reconstructor, pictures: list[Bytes]) -> list[tuple[HeightMap, Bools]]:
    """Map and contact of each picture."""
    maps = [reconstructor.height_map(Frame(rgb)) for rgb in pictures]
    return [(one, find_contact(one, reconstructor.error)) for one in maps]


def cost(raw: list[tuple[HeightMap, Bools]], again: list[tuple[HeightMap, Bools]], *, grey: float) -> Cost:
    """What the packed pictures' maps have lost. The contact is that of the raw ones."""
    free, pressed, peaks, made_up, lost = [], [], [], 0, 0
    for (one, contact), (two, contact_again) in zip(raw, again, strict=True):
        both, off_um = one.valid & two.valid, 1e3 * (two.depth_mm - one.depth_mm)
        free.append(np.mean(off_um[both & ~contact] ** 2))
        made_up += bool(contact_again.any() and not contact.any())
        lost += bool(contact.any() and not contact_again.any())
        if contact.any():
            pressed.append(np.mean(off_um[both & contact] ** 2))
            peaks.append(1e3 * (two.depth_mm[both & contact].max() - one.depth_mm[both & contact].max()))
    return Cost(
        grey, float(np.sqrt(np.mean(free))), float(np.sqrt(np.mean(pressed))), np.abs(peaks), made_up, lost
    )


def print_costs(count: int = COUNT, ways: Iterable[str] = WAYS) -> None:
    """One line a way of packing."""
    recording = read_recording(SAMPLE)
    reconstructor = build_reconstructor(recording)
    frames = [one.rgb for one in iter_frames(recording) if isinstance(one, Frame)][FIRST : FIRST + count]
    raw = seen(reconstructor, frames)
    touched = sum(bool(contact.any()) for _, contact in raw)
    deepest = max(float(one.depth_mm[one.valid].max()) for one, _ in raw)
    print(
        f"{count} frames of {frames[0].shape[1]}x{frames[0].shape[0]}, {touched} in contact, to {deepest:.3f} mm"
    )
    print("way | bits a pixel | grey rms | free um rms | contact um rms | peak um: median, worst | made up, lost")
    for way, size, again in packings(frames, ways):
        grey = np.sqrt(np.mean([(a.astype(float) - b) ** 2 for a, b in zip(again, frames, strict=True)]))
        found = cost(raw, seen(reconstructor, again), grey=float(grey))
        bits = 8 * size / frames[0][..., 0].size / count
        peaks = f"{np.median(found.peaks_um):.1f}, {found.peaks_um.max():.1f}"
        depths = f"{found.free_um:.1f} | {found.contact_um:.1f} | {peaks}"
        print(f"{way} | {bits:.2f} | {grey:.2f} | {depths} | {found.made_up}, {found.lost}", flush=True)


def print_clocks() -> None:
    """How far frames are from when they were taken, stamped and counted."""
    rng = np.random.default_rng(1)
    taken_s = np.delete(np.sort(np.arange(COUNT) / RATE_HZ + rng.normal(0, JITTER_S, COUNT)), LOST)
    taken_s -= taken_s[0]
    pictures = [np.full((64, 64, 3), number, np.uint8) for number in range(len(taken_s))]
    for name, given in (("stamped", taken_s), ("counted", None)):
        _, told_s = unpacked(packed(pictures, "H.264 crf 23", given))
        off_ms = 1e3 * (told_s - told_s[0] - taken_s)
        print(f"clock, {name}: rms {np.sqrt(np.mean(off_ms**2)):.2f} ms, largest {np.abs(off_ms).max():.2f} ms")


def main() -> None:
    """Print both tables."""
    print_costs()
    print_clocks()


def quick() -> None:
    print_costs(10, [*WAYS][:2])
    print_clocks()


if __name__ == "__main__":
    main()
