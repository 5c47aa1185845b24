"""A folder of frames into height maps: whole, resumable, and honest about what could not be read."""

from __future__ import annotations

import csv
import dataclasses
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
import zarr

from tactilevision.batch.folder import COLUMNS, Form, measure, reconstruct_folder, std_at
from tactilevision.batch.jobs import Journal
from tactilevision.contact.region import find_contact
from tactilevision.files.tiff import read_tiff, write_tiff
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.protocols import PhotometricMethod
from tactilevision.recording.model import Recording
from tactilevision.records.maps import Frame, HeightMap, SlopeMap
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Sensor

SENSOR = Sensor("custom", 64, 48, (0.1, 0.2))


class RedIsSlope:
    """A method whose truth is plain: slope along x = (red - 100)/100."""

    name = "red is slope"

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        red = rgb_rectified[..., 0].astype(np.float32)
        return SlopeMap((red - 100) / 100, np.zeros_like(red))


def recording(folder: Path, count: int = 5) -> Recording:
    frames = folder / "frames"
    frames.mkdir(parents=True)
    names = []
    for number in range(count):
        rgb = np.full((48, 64, 3), 100, np.uint8)
        rgb[10:20, 20 : 24 + number, 0] = 120
        names.append(f"{number:03d}.png")
        cv2.imwrite(str(frames / names[-1]), rgb[..., ::-1])
    return Recording(
        folder,
        "r",
        SENSOR,
        frames_path=frames,
        frame_names=tuple(names),
        frame_times_s=np.arange(count, dtype=np.float64),
    )


def method() -> PhotometricMethod:
    return RedIsSlope()


def test_every_frame_has_its_map_and_its_row(tmp_path: Path) -> None:
    source = recording(tmp_path / "in")
    rows = reconstruct_folder(source, Reconstructor(SENSOR, method()), tmp_path / "out", workers=1)
    assert [row.frame for row in rows] == list(source.frame_names)
    assert {row.status for row in rows} == {"ok"}
    with (tmp_path / "out" / "depth.csv").open(newline="") as file:
        table = list(csv.reader(file))
    assert tuple(table[0]) == COLUMNS
    assert len(table) == 6
    height = read_tiff(tmp_path / "out" / "depth" / "003.tiff")
    assert height.depth_mm.dtype == np.float32
    assert height.mm_per_px == pytest.approx(SENSOR.mm_per_px)


def test_a_torn_frame_is_listed_and_passed_over(tmp_path: Path) -> None:
    source = recording(tmp_path / "in")
    torn = tmp_path / "in" / "frames" / "002.png"
    torn.write_bytes(torn.read_bytes()[:60])
    rows = reconstruct_folder(source, Reconstructor(SENSOR, method()), tmp_path / "out", workers=1)
    assert [row.status == "ok" for row in rows] == [True, True, False, True, True]
    assert "unreadable" in rows[2].status
    assert not (tmp_path / "out" / "depth" / "002.tiff").exists()


def test_a_run_cut_off_goes_on_where_it_was(tmp_path: Path) -> None:
    """Cut off after three frames with a row half-written: the three are not done again, none is lost."""
    source, out = recording(tmp_path / "in"), tmp_path / "out"
    cut_off(source, out)
    with (out / ".depth-journal").open("a") as journal:
        journal.write('{"frame": "003.png", "st')
    stamps = {p.name: p.stat().st_mtime_ns for p in (out / "depth").iterdir()}
    assert len(stamps) == 3
    seen: list[int] = []
    rows = reconstruct_folder(
        source, Reconstructor(SENSOR, method()), out, workers=1, progress=lambda d, t: seen.append(d)
    )
    assert seen == [3, 4, 5], "what was done before is told first, so that a rate is this run's own"
    assert [row.status for row in rows] == ["ok"] * 5
    assert {p.name: p.stat().st_mtime_ns for p in (out / "depth").iterdir() if p.name in stamps} == stamps
    assert not (out / ".depth-journal").exists()


def cut_off(source: Recording, out: Path, form: Form = "tiff") -> None:
    """A run that ends after three frames."""

    def stop_at_three(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_folder(
            source, Reconstructor(SENSOR, method()), out, workers=1, form=form, progress=stop_at_three
        )


def test_of_a_frame_that_changed_after_a_run_was_cut_off_nothing_is_taken_over(tmp_path: Path) -> None:
    source, out = recording(tmp_path / "in"), tmp_path / "out"
    cut_off(source, out)
    rgb = np.full((48, 64, 3), 100, np.uint8)
    cv2.imwrite(str(tmp_path / "in" / "frames" / "000.png"), rgb)
    os.utime(tmp_path / "in" / "frames" / "000.png", (1, 1))  # by a clock that went back
    reconstruct_folder(source, Reconstructor(SENSOR, method()), out, workers=1)
    assert np.abs(read_tiff(out / "depth" / "000.tiff").depth_mm).max() < 1e-6


def test_a_run_in_another_form_leaves_nothing_of_the_one_cut_off(tmp_path: Path) -> None:
    source, out = recording(tmp_path / "in"), tmp_path / "out"
    cut_off(source, out, "zarr")
    assert [path.name for path in out.iterdir() if "zarr" in path.name] == [".depth.zarr-unfinished"]
    reconstruct_folder(source, Reconstructor(SENSOR, method()), out, workers=1)
    assert sorted(path.name for path in out.iterdir()) == ["depth", "depth.csv"]


def test_a_store_comes_back_where_a_run_was_killed_between_its_two_renames(tmp_path: Path) -> None:
    source, out = recording(tmp_path / "in"), tmp_path / "out"
    reconstruct_folder(source, Reconstructor(SENSOR, method()), out, workers=1, form="zarr")
    (out / "depth.zarr").rename(out / ".depth.zarr-old")
    cut_off(source, out)
    assert (out / "depth.zarr" / "depth_mm").is_dir()
    assert not (out / ".depth.zarr-old").exists()


def test_rows_of_a_run_never_outlive_its_store(tmp_path: Path) -> None:
    """A run by another method that dies as soon as it has a store of its own: the first one starts anew."""
    source, out = recording(tmp_path / "in"), tmp_path / "out"
    cut_off(source, out, "zarr")

    def die(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Journal, "begin", die)
        with pytest.raises(KeyboardInterrupt):
            reconstruct_folder(source, Unsure(SENSOR, method()), out, workers=1, form="zarr", with_std=True)
    rows = reconstruct_folder(source, Reconstructor(SENSOR, method()), out, workers=1, form="zarr")
    store = zarr.open_group(str(out / "depth.zarr"), mode="r")
    assert np.isfinite(np.asarray(store["depth_mm"])).any(axis=(1, 2)).tolist() == [True] * len(rows)


def test_many_processes_give_the_same_maps(tmp_path: Path) -> None:
    source = recording(tmp_path / "in")
    reconstruct_folder(source, Reconstructor(SENSOR, method()), tmp_path / "one", workers=1)
    reconstruct_folder(source, Reconstructor(SENSOR, method()), tmp_path / "two", workers=2)
    for path in (tmp_path / "one" / "depth").iterdir():
        np.testing.assert_array_equal(
            read_tiff(path).depth_mm, read_tiff(tmp_path / "two" / "depth" / path.name).depth_mm
        )


def test_tiff_keeps_rise_and_unknown_places(tmp_path: Path) -> None:
    depth = np.array([[0.5, -0.03], [0.0, 0.2]], np.float32)
    valid = np.array([[True, True], [False, True]])
    write_tiff(tmp_path / "a.tiff", HeightMap(depth, valid, (0.05, 0.06)))
    back = read_tiff(tmp_path / "a.tiff")
    np.testing.assert_array_equal(back.valid, valid)
    np.testing.assert_array_equal(back.depth_mm[valid], depth[valid])
    assert back.mm_per_px == (0.05, 0.06)


def test_a_peak_says_how_sure_it_is() -> None:
    depth = np.zeros((40, 60))
    depth[10:14, 10:14] = 0.3
    std = np.where(depth > 0, 0.02, 0.005)
    unsure = HeightMap(depth, np.ones_like(depth, bool), (0.05, 0.05), std)
    assert std_at(unsure, 0.3) == pytest.approx(0.02)
    assert np.isnan(std_at(unsure, 0.4))
    assert np.isnan(std_at(HeightMap(depth, unsure.valid, (0.05, 0.05)), 0.3))


def test_measure_finds_a_pressed_disc() -> None:
    """A disc of 2 mm radius, 0.3 mm deep, in 5 um noise: area within the pixels of its edge."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:200, :200] * 0.05
    inside = np.hypot(x - 5, y - 5) < 2
    depth = np.where(inside, 0.3, 0.0) + rng.normal(0, 0.005, x.shape)
    height = HeightMap(depth, np.ones_like(inside), (0.05, 0.05))
    peak, area = measure(height, find_contact(height))
    assert peak == pytest.approx(0.3, abs=0.02)
    assert area == pytest.approx(np.pi * 4, rel=0.02)


def test_waves_of_untouched_gel_are_no_contact_and_a_gentle_touch_is() -> None:
    """Waves as deep as their stated deviation says, over 3 mm; then a ball that goes 30 um in among them."""
    rng, scale, std_mm = np.random.default_rng(4), 0.0634, 0.004
    y, x = (np.indices((320, 427)) - np.array([160, 213])[:, None, None]) * scale
    touch = np.maximum(0.03 - (x**2 + y**2) / 8.0, 0.0)
    areas = []
    for _ in range(20):
        waves = cv2.GaussianBlur(rng.standard_normal(x.shape), (0, 0), 1.5 / scale)
        waves *= std_mm / waves.std()
        std = np.full(x.shape, std_mm, np.float32)
        maps = [
            HeightMap(depth, np.ones(x.shape, np.bool_), (scale, scale), std) for depth in (waves, waves + touch)
        ]
        areas.append([measure(height, find_contact(height))[1] for height in maps])
    free, touched = np.array(areas).T
    assert np.count_nonzero(free) <= 1
    assert touched.min() > 0.2
    assert np.median(touched) < 1.5, "of .75 mm2 above the waves"


def test_frames_that_differ_in_their_ending_alone_have_each_its_map(tmp_path: Path) -> None:
    """One of them is pressed, one is not."""
    source = recording(tmp_path / "in", count=3)
    frames = tmp_path / "in" / "frames"
    cv2.imwrite(str(frames / "001.bmp"), np.full((48, 64, 3), 100, np.uint8))
    names = ("000.png", "001.png", "001.bmp")
    both = dataclasses.replace(source, frame_names=names)
    rows = reconstruct_folder(both, Reconstructor(SENSOR, method()), tmp_path / "out", workers=1)
    assert {row.status for row in rows} == {"ok"}
    depth = tmp_path / "out" / "depth"
    assert sorted(path.name for path in depth.iterdir()) == ["000.tiff", "001.bmp.tiff", "001.png.tiff"]
    assert (
        read_tiff(depth / "001.png.tiff").depth_mm.max() > 0.01 > read_tiff(depth / "001.bmp.tiff").depth_mm.max()
    )


class Unsure(Reconstructor):
    """States that all its depths are known to 12 um."""

    def height_map(self, frame: Frame | Bytes) -> HeightMap:
        height = super().height_map(frame)
        return dataclasses.replace(height, std_mm=np.full(height.depth_mm.shape, 0.012))


def test_deviations_are_kept_beside_the_depths(tmp_path: Path) -> None:
    source, out = recording(tmp_path / "in", count=2), tmp_path / "out"
    reconstruct_folder(source, Unsure(SENSOR, method()), out, workers=1, with_std=True)
    assert sorted(path.name for path in (out / "depth").iterdir()) == ["000.tiff", "001.tiff"]
    std = tifffile.imread(out / "depth_std" / "001.tiff")
    assert std.shape == tifffile.imread(out / "depth" / "001.tiff").shape == (48, 64)
    assert np.allclose(std, 0.012)
    reconstruct_folder(source, Unsure(SENSOR, method()), tmp_path / "z", workers=1, form="zarr", with_std=True)
    store = zarr.open_group(str(tmp_path / "z" / "depth.zarr"), mode="r")
    assert np.allclose(np.asarray(store["depth_std_mm"]), 0.012)
    assert store["depth_mm"].shape == store["depth_std_mm"].shape == (2, 48, 64)


def test_the_peak_is_the_percentile_of_all_depths() -> None:
    rng = np.random.default_rng(5)
    for size in ((30, 40), (101, 203), (320, 427)):
        depth = np.asarray(rng.normal(size=size) ** 3, np.float32)
        height = HeightMap(depth, np.ones(size, np.bool_), (0.05, 0.05))
        peak_mm, _ = measure(height, np.zeros(size, np.bool_))
        assert peak_mm == pytest.approx(np.percentile(depth, 99.9), rel=1e-6)
