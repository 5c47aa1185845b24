"""Pictures that are half of one moment and half of the next are named by the row; whole ones never are."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from each import each
from shared_scenes import SAMPLE, sample_reconstructor

from tactilevision.batch.folder import reconstruct_folder, summary
from tactilevision.errors import InputError
from tactilevision.heightmap.torn_frames import TearCheck
from tactilevision.recording.images import read_image
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Gel
from tactilevision.sensors import MAX_COMPRESSION, deepest_mm, get_sensor

REAL = Path(__file__).parents[3] / "shared" / "real" / "taxim_gelsight_mini"


def torn(above: Bytes, below: Bytes, row: int) -> Bytes:
    return np.concatenate([above[:row], below[row:]])


@each("row", [121, 168])
def test_a_torn_frame_is_rejected_by_its_row_in_the_raw_picture(row: int) -> None:
    recording, reader = read_recording(SAMPLE), sample_reconstructor()
    deep = [ball.path for ball in recording.balls]
    first, second = (read_image(path) for path in deep[:2])
    assert recording.sensor.rectification is not None
    for whole in (first, second):
        reader.height_map(whole)
    dark = np.clip(second.astype(int) + 12, 0, 255).astype(np.uint8)
    dark[:, :30] = second[:, :30]  # light that came between the two moments, not in every column
    with pytest.raises(InputError, match=rf"torn at row ({row - 1}|{row}|{row + 1}): above and below"):
        reader.height_map(torn(first, dark, row))


@pytest.mark.skipif(not REAL.is_dir(), reason="real frames are not here")
def test_real_presses_are_whole_until_they_are_torn() -> None:
    presses = [read_image(REAL / f"img_{k:02d}.png") for k in (1, 5, 9, 13, 17, 21)]
    sensor = get_sensor("gelsight_mini", width_px=640, height_px=480)
    rng, found, check = np.random.default_rng(0), [], TearCheck(sensor)
    before = check.frame_means(read_image(REAL / "f0.png"))

    def row_of(rgb: Bytes) -> int | None:
        return check.row_below(check.frame_means(rgb) - before)

    assert [row_of(rgb) for rgb in presses] == [None] * len(presses)
    for _ in range(80):
        above, below = (presses[k] for k in rng.choice(len(presses), 2, replace=False))
        row = int(rng.integers(80, 400))
        step = np.sqrt(np.mean((above[row].astype(float) - below[row]) ** 2))
        seen = row_of(torn(above, below, row))
        assert seen in (row, None)
        found.append((step, seen == row))
    assert all(seen for step, seen in found if step > 6)  # grey levels
    assert sum(step > 6 for step, _ in found) > 3


def test_a_rejected_frame_counts_nowhere(tmp_path: Path) -> None:
    """A black frame says nothing of the exposure, a flash nothing of the reference, and no map is theirs."""
    recording, reader = read_recording(SAMPLE), sample_reconstructor()
    frames = [read_frame(recording, k) for k in range(0, 40, 5)]
    bad = [dataclasses.replace(frame, rgb=np.zeros_like(frame.rgb)) for frame in frames[:2]]
    rectified = [Frame(reader.rectified(frame), frame.time_s, frame.name) for frame in [*frames, *bad]]
    assert reader.look(rectified).warnings == reader.look(rectified[:8]).warnings
    (tmp_path / "in").mkdir()
    for frame in [*frames, *bad]:
        write_image(tmp_path / "in" / f"{len(list((tmp_path / 'in').iterdir()))}.png", frame.rgb)
    names = tuple(f"{k}.png" for k in range(10))
    source = dataclasses.replace(
        recording, frames_path=tmp_path / "in", frame_names=names, frame_times_s=np.arange(10.0)
    )
    rows = reconstruct_folder(source, reader, tmp_path / "out", workers=1)
    assert summary(rows)["statuses"] == {"ok": 8, "rejected": 2}
    assert not any(row.trusted for row in rows[8:])


def test_depth_beyond_the_gel_rejects_a_frame() -> None:
    reader = sample_reconstructor()
    recording = read_recording(SAMPLE)
    frame = next(read_image(ball.path) for ball in recording.balls)
    deepest = float(reader.height_map(frame).depth_mm.max())
    thin = reader.varied(sensor=dataclasses.replace(reader.sensor, gel=Gel(thickness_mm=deepest)))
    with pytest.raises(InputError, match=r"mm deep, more than the .* mm that this gel allows"):
        thin.height_map(frame)
    thick = Gel(thickness_mm=1.1 * deepest / MAX_COMPRESSION)
    kept = reader.varied(sensor=dataclasses.replace(reader.sensor, gel=thick))
    assert isinstance(kept.height_map(frame), HeightMap)


def test_every_sensor_of_the_catalogue_has_a_greatest_depth() -> None:
    assert deepest_mm(get_sensor("gelsight_mini_markers")) == deepest_mm(get_sensor("gelsight_mini")) == 3.2
    assert deepest_mm(get_sensor("gelslim3", gel=Gel(2.0))) == 1.6
    assert deepest_mm(get_sensor("custom", width_px=9, height_px=9, mm_per_px=0.1)) == np.inf
