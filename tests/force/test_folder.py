"""A recording's frames into tractions and resultants on disk, bad frames and F/T readings beside."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
import zarr
from planted_forces import SCALE, VIEW, hertz, measured

from tactilevision.errors import InputError
from tactilevision.force.field import DEEP
from tactilevision.force.frame import FAST, Readings, force_folder, force_job
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.model import Recording
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import BEYOND_BALLS, LIGHT, MEANING, Frame, HeightMap
from tactilevision.records.measured import Bytes, ForceSeries, Material
from tactilevision.records.rig import Gel, Press, Sensor

ROWS, COLUMNS = VIEW.shape


class Known:
    """Stands for a reconstructor: the frame's brightness says how deep the one known contact is."""

    match = None

    def __init__(
        self, sensor: Sensor, *, taught: TaughtWalls | None = None, error: Any = None, light: bool = False
    ) -> None:
        self.sensor, self.taught, self.error, self.flags = sensor, taught, error, (LIGHT,) if light else ()
        self.unit = measured(hertz(2.0, (0.0, 0.0), (0.0, 0.0, 0.5)), std_mm=0.001)[0].depth_mm

    def rectified(self, frame: Frame) -> Bytes:
        return frame.rgb

    def height_map(self, frame: Frame) -> HeightMap:
        return self.rectified_map(frame.rgb, time_s=frame.time_s, name=frame.name)

    def rectified_map(self, rgb: Bytes, *, time_s: float, name: str) -> HeightMap:
        level = float(rgb.mean()) / 100
        if level > 2:
            raise InputError("the frame is saturated", where=name)
        everywhere = np.ones(VIEW.shape, dtype=bool)
        depth = level * self.unit
        return HeightMap(depth, everywhere, SCALE, time_s=time_s, name=name, flags=self.flags)


def recorded(folder: Path) -> Recording:
    (folder / "frames").mkdir()
    for name, level in (("a.png", 0), ("b.png", 50), ("c.png", 100), ("d.png", 255)):
        cv2.imwrite(str(folder / "frames" / name), np.full((ROWS, COLUMNS, 3), level, dtype=np.uint8))
    (folder / "frames" / "e.png").write_bytes(b"torn")
    times = np.linspace(0, 10, 101)
    force = np.zeros((101, 3))
    force[(times > 1.5) & (times < 4.5), 2] = 0.5
    force += [0.1, 0.2, 0.3]  # the F/T sensor's own zero
    return Recording(
        path=folder,
        name="known",
        sensor=Sensor("custom", COLUMNS, ROWS, SCALE, gel=Gel(3.0)),
        presses=(Press("1", "A1", 1.5, 4.5),),
        clock_offset_s=0.0,
        frames_path=folder / "frames",
        frame_names=("a.png", "b.png", "c.png", "d.png", "e.png"),
        frame_times_s=np.array([1.0, 2.0, 3.0, 4.0, 5.0]),
        frame_size_px=(COLUMNS, ROWS),
        forces=ForceSeries(times, force, (0.01, 0.01, 0.01)),
    )


def test_every_frame_has_its_row_and_every_good_one_its_tractions(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    seen: list[tuple[int, int]] = []
    job = force_job(
        recording, cast(Reconstructor, Known(recording.sensor)), material=Material(0.2, 0.48), out=tmp_path / "out"
    )
    rows = force_folder(recording, job, workers=1, progress=lambda done, whole: seen.append((done, whole)))
    assert seen[-1] == (5, 5)
    assert [row.frame for row in rows] == list(recording.frame_names)
    with (tmp_path / "out" / "resultants.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["frame"] for row in table] == list(recording.frame_names)
    assert table[0]["flags"].endswith("no contact")
    for row, planted in ((table[1], 0.25), (table[2], 0.5)):  # frictionless, which the step cannot know
        assert float(row["fz_N"]) == pytest.approx(planted, rel=0.09)
    assert table[2]["fx_N"] == "", "without a reference frame there is no shear"
    assert float(table[2]["ft_fz_N"]) == pytest.approx(0.5), "its zero is taken on the free gel"
    assert float(table[0]["ft_fz_N"]) == pytest.approx(0.0, abs=1e-12)
    assert "saturated" in table[3]["flags"]
    assert "unreadable" in table[4]["flags"]
    with np.load(tmp_path / "out" / "tractions.npz", allow_pickle=False) as stacks:
        assert stacks["frame"].tolist() == ["a.png", "b.png", "c.png"]
        assert stacks["mm_per_px"].tolist() == [0.5, 0.5]
        assert stacks["t_z"][2].sum() * 0.25 == pytest.approx(float(table[2]["fz_N"]), rel=1e-5)


def test_what_was_cut_off_goes_on_and_zarr_holds_the_same(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    known, material = cast(Reconstructor, Known(recording.sensor)), Material(0.2, 0.48)

    def stop(done: int, whole: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    job = force_job(recording, known, material=material, out=tmp_path / "npz")
    with pytest.raises(KeyboardInterrupt):
        force_folder(recording, job, workers=1, progress=stop)
    assert not (tmp_path / "npz" / "tractions.npz").exists(), "half a result is none"
    told: list[int] = []
    force_folder(recording, job, workers=1, progress=lambda done, whole: told.append(done))
    assert told == [2, 3, 4, 5]
    stored = force_job(recording, known, material=material, out=tmp_path / "zarr", form="zarr")
    force_folder(recording, stored, workers=1)
    group = zarr.open_group(str(tmp_path / "zarr" / "tractions.zarr"), mode="r")
    with np.load(tmp_path / "npz" / "tractions.npz", allow_pickle=False) as stacks:
        np.testing.assert_array_equal(np.asarray(group["t_z"])[:3], stacks["t_z"])
    assert np.isnan(np.asarray(group["t_z"])[3:]).all()
    assert list(group["frame"][:]) == list(recording.frame_names)
    for out in ("npz", "zarr"):
        assert [path.name for path in (tmp_path / out).iterdir() if path.name.startswith(".")] == []


def test_a_contact_beyond_the_balls_is_flagged_and_free_gel_is_not(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    for beyond in (False, True):
        known = Known(recording.sensor, error=SimpleNamespace(beyond_balls=lambda contact, told=beyond: told))
        out, material = tmp_path / f"out{beyond}", Material(0.2, 0.48)
        job = force_job(recording, cast(Reconstructor, known), material=material, out=out)
        rows = force_folder(recording, job, workers=1)
        assert [MEANING[BEYOND_BALLS] in row.flags for row in rows[:3]] == [False, beyond, beyond]


def test_depth_rate_and_light_beyond_the_calibration_are_flagged(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    deepest = Known(recording.sensor).unit.max()
    known = Known(recording.sensor, light=True)

    def flags(deepest_mm: float | None, fastest_mm_s: float | None) -> list[str]:
        folder = tmp_path / f"{deepest_mm}-{fastest_mm_s}"
        material = Material(0.2, 0.48, deepest_mm=deepest_mm, fastest_mm_s=fastest_mm_s)
        job = force_job(recording, cast(Reconstructor, known), material=material, out=folder)
        return [row.flags for row in force_folder(recording, job, workers=1)[:3]]

    assert [DEEP in row for row in flags(0.8 * deepest, None)] == [False, False, True]
    assert [FAST in row for row in flags(None, deepest / 4)] == [False, True, True], "half in a second"
    plain = flags(deepest, deepest)
    assert not any(DEEP in row or FAST in row for row in plain)
    assert all(MEANING[LIGHT] in row for row in plain)


def test_another_material_starts_anew(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    known = cast(Reconstructor, Known(recording.sensor))

    def stop(done: int, whole: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        force_folder(
            recording,
            force_job(recording, known, material=Material(0.2, 0.48), out=tmp_path / "out"),
            workers=1,
            progress=stop,
        )
    rows = force_folder(
        recording, force_job(recording, known, material=Material(0.4, 0.48), out=tmp_path / "out"), workers=1
    )
    assert rows[2].resultant_N[2] == pytest.approx(1.0, rel=0.09)


def test_other_lessons_of_walls_start_anew(tmp_path: Path) -> None:
    recording, told = recorded(tmp_path), list[int]()
    lesson = TaughtWalls(0.1, 0.2, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)

    def solve(walls: TaughtWalls | None, progress: Callable[[int, int], None]) -> None:
        known = cast(Reconstructor, Known(recording.sensor, taught=walls))
        job = force_job(recording, known, material=Material(0.2, 0.48), out=tmp_path / "out")
        force_folder(recording, job, workers=1, progress=progress)

    def stop(done: int, whole: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solve(None, stop)
    solve(lesson, lambda done, whole: told.append(done))
    assert told[0] == 0


def test_a_sensor_that_stood_at_its_end_is_found_and_noise_is_not(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    assert recording.forces is not None
    rng = np.random.default_rng(1)
    noisy = recording.forces.force_N + rng.normal(0, 0.01, recording.forces.force_N.shape)
    press = recording.presses[0]
    free = replace(recording, forces=replace(recording.forces, force_N=noisy))
    assert not Readings(free).clipped(press)
    cut = np.minimum(noisy, 0.7)
    assert Readings(replace(recording, forces=replace(recording.forces, force_N=cut))).clipped(press)


def test_a_gel_that_is_not_described_is_asked_for(tmp_path: Path) -> None:
    recording = recorded(tmp_path)
    bare = replace(recording, sensor=replace(recording.sensor, gel=None))
    with pytest.raises(InputError, match="thickness"):
        force_job(
            bare, cast(Reconstructor, Known(recording.sensor)), material=Material(0.2, 0.48), out=tmp_path / "out"
        )
