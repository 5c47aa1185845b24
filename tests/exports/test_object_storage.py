"""A finished Zarr store on object storage through fsspec: copied, and read frame by frame from there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import zarr

from tactilevision.files.zarr_store import begin_frames, end_frames, write_frame

FRAMES = ("a.jpg", "b.jpg", "c.jpg")


def test_a_store_is_copied_to_object_storage_and_read_there(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    scratch, path = tmp_path / "scratch", tmp_path / "depth.zarr"
    begin_frames(scratch, FRAMES, fields={"depth_mm": "mm"}, shape=(4, 5), about={"sensor": "s"})
    maps = np.random.default_rng(3).normal(size=(2, 4, 5)).astype(np.float32)
    for number, depth_mm in enumerate(maps):
        write_frame(scratch, number, fields={"depth_mm": depth_mm})
    end_frames(scratch, path)

    storage = fsspec.filesystem("memory")
    storage.put(f"{path}/", "/bucket/depth.zarr/", recursive=True)
    try:
        there = zarr.open_group("memory://bucket/depth.zarr", mode="r")
        depth = there["depth_mm"]
        assert isinstance(depth, zarr.Array)
        assert depth.chunks == (1, 4, 5)
        assert np.array_equal(depth[1], maps[1])
        assert np.isnan(np.asarray(depth[2])).all()
        assert list(np.asarray(there["frame"])) == list(FRAMES)
        copied = {name.removeprefix("/bucket/depth.zarr/"): storage.cat(name) for name in storage.find("/bucket")}
        assert copied == {str(one.relative_to(path)): one.read_bytes() for one in path.rglob("*") if one.is_file()}
    finally:
        storage.rm("/bucket", recursive=True)
