"""A video's tag of rotation is not followed, as a picture's is not: references are as the sensor has them."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactilevision.recording.images import iter_video

SHAPE = (48, 64, 3)
UPRIGHT = (1, 0, 0, 1)  # ISO 14496-12, 8.3.2: the matrix of a track's header, a b u c d v x y w


def matrix(a: int, b: int, c: int, d: int) -> bytes:
    return struct.pack(">9i", a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)


@pytest.mark.parametrize("turned", [UPRIGHT, (0, 1, -1, 0), (-1, 0, 0, -1)], ids=["0", "90", "180"])
def test_frames_lie_as_the_sensor_has_them(tmp_path: Path, turned: tuple[int, int, int, int]) -> None:
    path = tmp_path / "frames.mp4"
    picture = np.zeros(SHAPE, np.uint8)
    picture[:16, :16] = 255
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30, SHAPE[1::-1])
    for _ in range(3):
        writer.write(picture)
    writer.release()
    data = path.read_bytes()
    header = data.index(matrix(*UPRIGHT), data.index(b"tkhd"))
    path.write_bytes(data[:header] + matrix(*turned) + data[header + 36 :])
    frame = next(iter_video(path, [0]))[1]
    assert frame is not None
    assert frame.shape == SHAPE
    assert frame[4, 4].min() > 200
    assert frame[-5, -5].max() < 50
