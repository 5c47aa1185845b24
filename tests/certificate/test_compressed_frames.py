"""Pictures that are compressed so strongly that faint dents are lost widen what the bevel's touches share."""

from __future__ import annotations

import csv
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from tactilevision import read_recording
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certification import certify
from tactilevision.press.track import compression_warnings, late_std_mm, note_blocks
from tactilevision.recording.model import BadFrame
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes

RIG = Path(__file__).parents[2] / "sample_frames" / "hidden_rig"


def gel(quality: int | None = None) -> Bytes:
    """A free gel with a sensor's noise, and as it comes back from JPEG."""
    rng = np.random.default_rng(1)
    ramp = np.linspace(60, 170, 320)[None, :, None] + np.linspace(0, 40, 240)[:, None, None]
    rgb = np.clip(ramp + rng.normal(0, 2.0, (240, 320, 3)), 0, 255).astype(np.uint8)
    if quality is None:
        return rgb
    packed = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def blocks_of(rgb: Bytes) -> list[float]:
    found: list[float] = []
    frames: list[Frame | BadFrame] = [BadFrame("0.png", 0.0, "torn"), Frame(rgb, 0.1), Frame(rgb, 0.2)]
    assert list(note_blocks(frames, found)) == frames
    assert len(found) == 1, "one frame a press is enough"
    return found


@pytest.mark.parametrize("quality", [None, 95, 90])
def test_usual_pictures_cost_nothing(quality: int | None) -> None:
    seen = blocks_of(gel(quality))
    assert late_std_mm(seen) == 0
    assert compression_warnings(seen) == ()
    assert late_std_mm([]) == 0


def test_strong_compression_is_named_with_what_helps() -> None:
    strong, stronger = (late_std_mm(blocks_of(gel(quality))) for quality in (50, 20))
    assert 0 < strong < stronger
    (said,) = compression_warnings(blocks_of(gel(5)))
    assert "FFV1" in said


@pytest.mark.slow
def test_forces_of_a_compressed_video_are_right(tmp_path: Path) -> None:
    """The sample's frames as OpenCV packs them by itself."""
    folder = tmp_path / "packed"
    shutil.copytree(RIG, folder, ignore=shutil.ignore_patterns("frames"))
    rows = list(csv.DictReader((RIG / "frames.csv").read_text().splitlines()))
    writer = cv2.VideoWriter(str(folder / "frames.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, (280, 210))
    for row in rows:
        picture = cv2.imread(str(RIG / "frames" / row["frame"]))
        assert picture is not None
        writer.write(picture)
    writer.release()
    times = "".join(f"{k},{row['time_s']}\n" for k, row in enumerate(rows))
    (folder / "frames.csv").write_text("frame,time_s\n" + times)
    recording = read_recording(folder)
    certificate = certify(recording, build_reconstructor(recording, "polynomial"))
    truth = tomllib.loads((RIG / "truth.toml").read_text())["press"]
    true_N = {press["press"]: press["force_N"] for press in truth}
    sure = [point for point in certificate.points if point.accepted]
    assert len(sure) >= 7
    assert np.median([point.fz_N / true_N[point.press] for point in sure]) == pytest.approx(1, abs=0.015)
    assert any("strongly compressed" in said for said in certificate.warnings)
