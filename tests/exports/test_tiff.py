"""Depth TIFFs as any other program reads them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tifffile

from tactilevision.files.tiff import read_tiff, write_tiff
from tactilevision.records.maps import HeightMap


def test_other_readers_find_nothing_to_complain_of(tmp_path: Path) -> None:
    depth = np.linspace(-0.1, 0.6, 48 * 32).reshape(32, 48)
    valid = depth < 0.55
    write_tiff(tmp_path / "x.tiff", HeightMap(depth, valid, (0.06, 0.07)))
    with tifffile.TiffFile(tmp_path / "x.tiff") as file:
        codes = [tag.code for tag in file.pages[0].tags]  # type: ignore[union-attr]
    assert codes == sorted(set(codes))
    seen = cv2.imread(str(tmp_path / "x.tiff"), cv2.IMREAD_UNCHANGED)
    assert seen is not None
    assert seen.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(seen), ~valid)
    np.testing.assert_allclose(seen[valid], depth[valid], atol=1e-7)
    assert read_tiff(tmp_path / "x.tiff").mm_per_px == (0.06, 0.07)
