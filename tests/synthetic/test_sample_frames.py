"""The samples that come with the project: complete, small, legal, and made again by one command."""

from __future__ import annotations

import filecmp
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.blind import samples as blind_samples
from tactilevision.recording.model import BadFrame
from tactilevision.recording.pictures import iter_frames
from tactilevision.recording.read import read_recording
from tactilevision.synthetic.options import FAULTS
from tactilevision.synthetic.samples import make_samples, write_paper_points

SAMPLES = Path(__file__).parents[2] / "sample_frames"
PATH_TRACED = {"hidden_shadow", "rendered_shadows"}  # by benchmarks.rendered, which needs mitsuba


def test_gelslim3_is_complete_and_small() -> None:
    recording = read_recording(SAMPLES / "gelslim3")
    truth = tomllib.loads((SAMPLES / "gelslim3" / "truth.toml").read_text())
    assert recording.warnings == ()
    assert {i.height_mm for i in recording.indenters.values()} == {0.15, 0.3, 0.4, 0.5, 0.6}
    good = [p["indenter"] for p in truth["press"] if p["good"]]
    assert all(good.count(name) >= 3 for name in recording.indenters)
    assert {p["reason"] for p in truth["press"]} == {"", *FAULTS}
    assert len(recording.balls) >= 12
    assert sum(isinstance(frame, BadFrame) for frame in iter_frames(recording)) == 1
    assert sum(p.stat().st_size for p in (SAMPLES / "gelslim3").rglob("*") if p.is_file()) < 12e6


def test_frames_keep_their_colours_at_full_resolution() -> None:
    data = (SAMPLES / "gelslim3" / "frames" / "00000.jpg").read_bytes()
    start = data.index(b"\xff\xc0")  # the frame header; the first component's sampling stands 11 bytes on
    assert data[start + 11] == 0x11


def test_a_touch_is_seen_beside_the_punch() -> None:
    """The last frame on the ramp of a good press differs from a flat one along the bevel's edge."""
    recording = read_recording(SAMPLES / "gelslim3")
    truth = tomllib.loads((SAMPLES / "gelslim3" / "truth.toml").read_text())
    press = next(p for p in truth["press"] if p["good"] and p["indenter"] == "A4")
    maps = recording.sensor.rectification
    assert maps is not None

    def straight(start_s: float, end_s: float) -> np.ndarray:
        frame = next(f for f in iter_frames(recording, start_s, end_s=end_s) if not isinstance(f, BadFrame))
        return np.asarray(cv2.remap(frame.rgb, *maps, cv2.INTER_LINEAR), dtype=np.float64)

    time_s = press["touch_time_s"]
    change = np.abs(straight(time_s + 0.17, time_s + 0.3) - straight(time_s - 0.1, time_s)).sum(axis=2)
    step = recording.sensor.mm_per_px[0]
    column = round((press["centre_mm"][0] + 5.0) / step + 213)
    row = round(press["centre_mm"][1] / step + 159.5)
    edge = change[row - 25 : row + 25, column - 3 : column + 4].mean()
    beside = change[row - 25 : row + 25, column + 25 : column + 60].mean()
    assert edge > 3 * beside


def test_paper_points_are_the_printed_line(tmp_path: Path) -> None:
    write_paper_points(tmp_path)
    for name in ("points.csv", "recording.toml"):
        assert (tmp_path / name).read_bytes() == (SAMPLES / "paper_points" / name).read_bytes()
    points = read_recording(SAMPLES / "paper_points").points
    eps = np.array([p.depth_mm for p in points]) / 3.0
    stiffness = np.array([p.fz_N / p.depth_mm for p in points])
    slope, intercept = np.polyfit(eps, stiffness, 1)
    assert (slope, intercept) == pytest.approx((5.2662, 3.4943), abs=3e-3)
    reference = SAMPLES.parent.parent / "shared" / "reference" / "paper_points.csv"
    if reference.exists():
        printed = np.loadtxt(reference, delimiter=",", skiprows=1, usecols=(3, 4))
        np.testing.assert_allclose(printed, [(p.depth_mm, p.fz_N) for p in points], atol=1e-9)


@pytest.mark.slow
def test_samples_are_made_again_bit_by_bit(tmp_path: Path) -> None:
    make_samples(tmp_path)
    blind_samples.main([str(tmp_path)])
    drawn = (folder for folder in SAMPLES.iterdir() if folder.name not in PATH_TRACED)
    for kept in (p for folder in drawn for p in folder.rglob("*") if p.is_file() and p.name != "README.md"):
        assert filecmp.cmp(kept, tmp_path / kept.relative_to(SAMPLES), shallow=False), kept.name
