"""Every export read back by something that is not ours: zarr, tifffile, numpy, small readers of the formats."""

from __future__ import annotations

import json
import re
import threading
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import tifffile
import zarr

from tactilevision.errors import InputError, OutputError
from tactilevision.files.exports import EXPORTS, export
from tactilevision.files.tiff import read_tiff
from tactilevision.files.zarr_store import begin_frames, write_frame
from tactilevision.records.maps import LIGHT, HeightMap

SCALE = (0.05, 0.08)


@pytest.fixture
def height() -> HeightMap:
    """A slope down to the right, deeper to the bottom, with a hole and a rise."""
    y, x = np.mgrid[:6, :9].astype(float)
    depth = 0.1 * x + 0.01 * y - 0.05
    valid = np.ones((6, 9), dtype=bool)
    valid[2, 3] = False
    return HeightMap(depth, valid, SCALE, std_mm=np.full((6, 9), 0.004), time_s=1.5, name="a7.png", flags=(LIGHT,))


def expected(height: HeightMap) -> npt.NDArray[np.float32]:
    return np.where(height.valid, height.depth_mm, np.nan).astype(np.float32)


def test_npz(tmp_path: Path, height: HeightMap) -> None:
    with np.load(export(height, tmp_path, form="npz"), allow_pickle=False) as file:
        np.testing.assert_array_equal(file["depth_mm"], expected(height))
        assert tuple(file["mm_per_px"]) == SCALE
        assert float(file["time_s"]) == 1.5
        assert file["std_mm"] == pytest.approx(0.004)
        assert file["flags"].tolist() == [LIGHT]


def test_tiff(tmp_path: Path, height: HeightMap) -> None:
    with tifffile.TiffFile(export(height, tmp_path, form="tiff")) as file:
        np.testing.assert_array_equal(file.asarray(), expected(height))
        about = json.loads(file.pages[0].tags["ImageDescription"].value)  # type: ignore[union-attr]
    assert about["mm_per_px"] == list(SCALE)
    assert read_tiff(tmp_path / "a7.tiff").flags == (LIGHT,)


def test_zarr(tmp_path: Path, height: HeightMap) -> None:
    for _ in range(2):  # the second takes the first one's place
        path = export(height, tmp_path, form="zarr")
    group = zarr.open_group(str(path), mode="r")
    np.testing.assert_array_equal(np.asarray(group["depth_mm"]), expected(height))
    assert group["depth_mm"].attrs["_ARRAY_DIMENSIONS"] == ["y", "x"]
    assert group.attrs["mm_per_px"] == list(SCALE)
    assert group.attrs["flags"] == [LIGHT]
    assert [one.name for one in tmp_path.iterdir()] == ["a7.zarr"]


def test_ply_is_a_surface_with_a_hole(tmp_path: Path, height: HeightMap) -> None:
    raw = export(height, tmp_path, form="ply").read_bytes()
    head, body = raw.split(b"end_header\n", 1)
    counts = [int(found) for found in re.findall(rb"element \w+ (\d+)", head)]
    assert b"format binary_little_endian 1.0" in head
    assert b"doubtful: light" in head
    assert counts == [6 * 9 - 1, 2 * (5 * 8 - 4)]
    vertex = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("depth", "<f4")]), counts[0])
    face = np.frombuffer(body, np.dtype([("n", "u1"), ("v", "<i4", 3)]), counts[1], offset=vertex.nbytes)
    assert len(body) == vertex.nbytes + face.nbytes
    assert (face["n"] == 3).all()
    corners = vertex["xyz"][face["v"]].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.abs(normal[:, 2]).sum()
    assert area == pytest.approx((5 * 8 - 4) * SCALE[0] * SCALE[1], rel=1e-5)
    assert (normal[:, 2] > 0).all(), "all face the camera"
    # depth grows by 0.1 mm a pixel to the right and 0.01 mm a pixel downwards, where y falls
    slope = np.stack([-normal[:, 0], -normal[:, 1]]) / normal[:, 2]
    assert slope[0] == pytest.approx(0.1 / SCALE[0], rel=1e-3)
    assert slope[1] == pytest.approx(-0.01 / SCALE[1], rel=1e-3)


def test_vtk_is_a_grid_with_depth_on_it(tmp_path: Path, height: HeightMap) -> None:
    raw = export(height, tmp_path, form="vtk").read_bytes()
    assert raw.startswith(b"# vtk DataFile Version 3.0\n")
    found = re.search(rb"DIMENSIONS (\d+) (\d+) 1\nPOINTS (\d+) float\n", raw)
    assert found is not None
    columns, rows, count = (int(part) for part in found.groups())
    assert (rows, columns, count) == (6, 9, 54)
    points = np.frombuffer(raw, ">f4", 3 * count, offset=found.end()).reshape(rows, columns, 3)
    assert points[0, 1] - points[0, 0] == pytest.approx((SCALE[0], 0, 0.1), abs=1e-6)
    assert points[1, 0] - points[0, 0] == pytest.approx((0, -SCALE[1], 0.01), abs=1e-6)
    assert points[..., :2].mean(axis=(0, 1)) == pytest.approx(0, abs=1e-6)
    start = raw.index(b"LOOKUP_TABLE default\n", raw.index(b"SCALARS depth_mm")) + len(b"LOOKUP_TABLE default\n")
    np.testing.assert_array_equal(
        np.frombuffer(raw, ">f4", count, offset=start).reshape(rows, columns), expected(height)
    )
    assert b"SCALARS std_mm float 1" in raw


def test_an_unknown_format_is_named(tmp_path: Path, height: HeightMap) -> None:
    with pytest.raises(InputError, match="vtk"):
        export(height, tmp_path, form="stl")
    assert set(EXPORTS) == {"tiff", "npz", "zarr", "ply", "vtk"}


def test_a_store_that_cannot_be_filled_is_an_output_error(tmp_path: Path) -> None:
    """As on a full disk: the folder of an array's chunks is a file."""
    scratch = tmp_path / "store"
    begin_frames(scratch, ["a", "b"], fields={"depth_mm": "mm"}, shape=(4, 5), about={})
    (scratch / "depth_mm" / "1.0.0").mkdir()
    write_frame(scratch, 0, fields={"depth_mm": np.zeros((4, 5), np.float32)})
    with pytest.raises(OutputError, match="cannot be written"):
        write_frame(scratch, 1, fields={"depth_mm": np.zeros((4, 5), np.float32)})


def test_a_store_is_begun_without_leaving_threads_behind(tmp_path: Path) -> None:
    """Workers can then be copies of the process. Zarr works on, here and where somebody uses it already."""
    sync = pytest.importorskip("zarr.core.sync")
    sync.cleanup_resources()
    for number in range(2):
        begin_frames(tmp_path / f"{number}", ["a", "b"], fields={"depth_mm": "mm"}, shape=(3, 4), about={})
        assert sync.loop[0] is None
        assert "zarr_io" not in {thread.name for thread in threading.enumerate()}
    assert list(zarr.open_group(str(tmp_path / "1"), mode="r")["frame"][:]) == ["a", "b"]
    used = sync.loop[0]
    begin_frames(tmp_path / "other", ["a"], fields={"depth_mm": "mm"}, shape=(3, 4), about={})
    assert used is not None
    assert sync.loop[0] is used
    assert used.is_running()
