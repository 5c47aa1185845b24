"""Faces held by their certificate: what a map lacks in depth is put back, in the presses it knows alone."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from tactilevision.batch.folder import DepthJob
from tactilevision.files.tiff import read_tiff
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.press.certified_faces import (
    NO_CORRECTION,
    Certified,
    CertifiedFace,
    DepthScale,
    FaceDepthCorrection,
    MappedFace,
    face_depth_correction,
    read_certified,
    read_faces,
    teach_walls,
    with_scatter,
)
from tactilevision.recording.model import Recording
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.measured import Pair
from tactilevision.records.rig import Indenter, Press, Sensor

SIZE: Pair = (160, 120)
MM, RADIUS = 0.1, 2.5
DEPTHS = (0.15, 0.3, 0.45, 0.6)


def lacking(depth_mm: float) -> float:
    """What the map below reads of a face: a fifth short at 1 mm."""
    return depth_mm * (1 - 0.2 * depth_mm)


class Short:
    """The frame's brightness is the depth in hundredths of a millimetre; deep faces are read too shallow."""

    error = None
    edges: Sequence[PunchEdge] = ()
    taught: TaughtWalls | None = None
    sensor = Sensor("custom", int(SIZE[0]), int(SIZE[1]), (MM, MM))

    def varied(self, *, taught: TaughtWalls | None) -> Short:
        other = copy(self)
        other.taught = taught
        return other

    def read(self, frame: Frame) -> Any:
        height = self.height_map(frame)
        return SimpleNamespace(height=height, edges=self.edges)

    def height_map(self, frame: Frame) -> HeightMap:
        depth = float(np.median(frame.rgb)) / 100
        x, y = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * MM for n in map(int, SIZE)))
        r = np.hypot(x, y)
        beside = 2 / np.pi * np.arcsin(np.minimum(RADIUS / np.maximum(r, RADIUS), 1.0)) * np.exp(RADIUS - r)
        surface = lacking(depth) * np.where(r < RADIUS, 1.0, beside)
        noise = 1e-4 * np.random.default_rng(0).standard_normal(surface.shape)
        return HeightMap(surface + noise, np.ones(surface.shape, np.bool_), (MM, MM), time_s=frame.time_s)


class Walled(Short):
    """As `Short`; what it reads too little, its walls hide by half again as much as their law says."""

    read_with: list[TaughtWalls | None]

    def __init__(self, falls: float = 1.0) -> None:
        self.read_with, self.falls = [], falls

    def height_map(self, frame: Frame) -> HeightMap:
        self.read_with.append(self.taught)
        depth = float(np.median(frame.rgb)) / 100
        hidden, places = (depth - lacking(depth)) / 0.5, np.array([0.0, 0.2])
        middle = (int(SIZE[0]) - 1) / 2 * MM, (int(SIZE[1]) - 1) / 2 * MM
        far = PunchEdge((0.0, 0.0), RADIUS, 0.2, places, places, depth, 1.0, 0.02)
        near = PunchEdge(middle, RADIUS, 0.2, places, self.falls * places, lacking(depth), hidden, 0.02)
        self.edges = [far, near]
        return super().height_map(frame)


def recorded(folder: Path) -> Recording:
    """Four presses, each of five frames that go on from 20 um above the touch to 20 um beyond it."""
    (folder / "frames").mkdir()
    names, times, presses = [], [], []
    for k, depth in enumerate(DEPTHS):
        presses.append(Press(str(k), "A", 10.0 * k, 10.0 * k + 5))
        for j in range(5):
            names.append(f"{k}{j}.png")
            times.append(10.0 * k + 0.5 + j)
            level = np.uint8(round(100 * depth) + j - 2)
            cv2.imwrite(str(folder / "frames" / names[-1]), np.full((*map(int, SIZE[::-1]), 3), level, np.uint8))
    return Recording(
        path=folder,
        name="short",
        sensor=Sensor("custom", int(SIZE[0]), int(SIZE[1]), (MM, MM)),
        presses=tuple(presses),
        frames_path=folder / "frames",
        frame_names=tuple(names),
        frame_times_s=np.array(times),
        frame_size_px=(int(SIZE[0]), int(SIZE[1])),
        indenters={"A": Indenter("A", "flat_cylinder", RADIUS)},
    )


def certified() -> tuple[Certified, ...]:
    return tuple(Certified(str(k), 10.0 * k + 2.5, depth) for k, depth in enumerate(DEPTHS))


def correction(folder: Path, of: tuple[Certified, ...] | None = None) -> FaceDepthCorrection:
    """What the certified presses `of` the recording, all of them by default, make of `Short` maps."""
    recording = recorded(folder)
    faces = read_faces(recording, cast(Reconstructor, Short()), certified=certified() if of is None else of)
    return face_depth_correction(recording, faces, walls=None)


def test_faces_come_out_as_deep_as_the_certificate_says_and_the_gel_beside_stays(tmp_path: Path) -> None:
    anchor = correction(tmp_path)
    assert anchor is not NO_CORRECTION
    for depth in (0.2, 0.4, 0.55):
        frame = Frame(np.full((*map(int, SIZE[::-1]), 3), round(100 * depth), np.uint8), 12.0)
        seen = Short().height_map(frame)
        held = anchor(seen)
        middle = np.s_[50:70, 70:90]
        assert np.median(seen.depth_mm[middle]) < 0.97 * depth
        assert np.median(held.depth_mm[middle]) == pytest.approx(depth, rel=0.01)
        assert np.array_equal(held.depth_mm[:, :30], seen.depth_mm[:, :30])


def test_frames_of_no_certified_press_are_left_as_they_were(tmp_path: Path) -> None:
    anchor = correction(tmp_path)
    assert anchor is not NO_CORRECTION
    between = Short().height_map(Frame(np.full((120, 160, 3), 40, np.uint8), 7.0))
    assert anchor(between) is between
    free = Short().height_map(Frame(np.zeros((120, 160, 3), np.uint8), 12.0))
    assert anchor(free) is free


@pytest.mark.parametrize(
    "of",
    [
        certified()[:2],
        tuple(replace(one, time_s=one.time_s + 100) for one in certified()),
        tuple(replace(one, press="x") for one in certified()),
    ],
)
def test_another_recording_or_too_few_faces_make_no_anchor(tmp_path: Path, of: tuple[Certified, ...]) -> None:
    assert correction(tmp_path, of) is NO_CORRECTION


def test_only_accepted_presses_of_a_table_that_can_be_read_count(tmp_path: Path) -> None:
    calibration = tmp_path / "calibration.json"
    assert read_certified(calibration) == ()
    (tmp_path / "points.csv").write_text(
        "press,depth_mm,time_s,accepted\n1,0.3,2.5,1\n2,0.3,4.5,0\n3,,4.5,1\n4,0.4,nan,1\n5,0.5,9,True\n"
    )
    assert read_certified(calibration) == (Certified("1", 2.5, 0.3), Certified("5", 9.0, 0.5))
    (tmp_path / "points.csv").write_text("something,else\n1,2\n")
    assert read_certified(calibration) == ()


def test_maps_on_disk_hold_the_faces_too(tmp_path: Path) -> None:
    anchor = correction(tmp_path)
    frame = Frame(np.full((*map(int, SIZE[::-1]), 3), 40, np.uint8), 12.0, "20.png")
    peaks = []
    for held in (NO_CORRECTION, anchor):
        DepthJob(cast(Reconstructor, Short()), tmp_path, anchor=held)(frame, 0)
        peaks.append(float(np.median(read_tiff(tmp_path / "depth" / "20.tiff").depth_mm[50:70, 70:90])))
    assert peaks[0] == pytest.approx(lacking(0.4), rel=0.01)
    assert peaks[1] == pytest.approx(0.4, rel=0.01)


def test_certified_faces_teach_what_walls_hide(tmp_path: Path) -> None:
    recording, reader = recorded(tmp_path), cast(Reconstructor, Walled())
    faces = read_faces(recording, reader, certified=certified())
    known = teach_walls(reader, faces).taught
    assert known is not None
    for face in faces:
        wall = face.wall_face
        assert wall is not None
        change, std_mm = known.change_mm(wall.hidden_mm, wall.depth_mm)
        if face.certified_mm > 0.4:
            assert abs(change - (face.certified_mm - wall.read_mm)) < std_mm
        assert face.as_taught(known) == pytest.approx(wall.read_mm + change, abs=1e-4)
    assert teach_walls(reader, faces[:2]) is reader, "where nothing is taught, what was known stays"


def test_a_wall_in_one_of_two_maps_teaches_nothing_and_is_taught_there() -> None:
    walls = TaughtWalls(0.5, 0.0, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)
    maps = MappedFace(0.4, 0.1, 0.4), MappedFace(0.44, 0.0, 0.0)
    face = CertifiedFace(Press("1", "A", 0, 5), Indenter("A", "flat_cylinder", RADIUS), 0.45, maps, 0.25)
    assert face.wall_face is None
    assert face.as_taught(None) == pytest.approx(0.41)
    assert face.as_taught(walls) == pytest.approx(0.41 + 0.75 * 0.05)


def test_faces_are_read_once_and_with_walls_as_nobody_taught_them(tmp_path: Path) -> None:
    reader, known = Walled(), TaughtWalls(0.1, 0.2, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)
    reader.taught = known
    read_faces(recorded(tmp_path), cast(Reconstructor, reader), certified=certified())
    assert reader.read_with == [None] * 2 * len(DEPTHS)
    assert reader.taught is known


def test_a_wall_that_does_not_fall_is_taught_nothing(tmp_path: Path) -> None:
    """Reconstruction leaves such a wall as it is, and so does what its face is read at."""
    walls = TaughtWalls(0.5, 0.0, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)
    faces = read_faces(recorded(tmp_path), cast(Reconstructor, Walled(falls=0.0)), certified=certified())
    assert [face.as_taught(walls) for face in faces] == [face.as_taught(None) for face in faces]


def test_a_map_that_fails_leaves_what_was_known_of_walls(tmp_path: Path) -> None:
    class Failing(Short):
        def height_map(self, frame: Frame) -> HeightMap:
            raise MemoryError

    reader, known = Failing(), TaughtWalls(0.1, 0.2, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)
    reader.taught = known
    with pytest.raises(MemoryError):
        read_faces(recorded(tmp_path), cast(Reconstructor, reader), certified=certified())
    assert reader.taught is known


def test_faces_that_taught_walls_scatter_no_less_than_others() -> None:
    walls = TaughtWalls(0.1, 0.2, (0.01, 0.02, 0.0), (0.2, 0.6), 0.03)
    assert with_scatter(None, walls) is None
    for own, stated in ((0.001, 0.03), (0.05, 0.05)):
        law = with_scatter(DepthScale((1.0,), (0.2, 0.6), own), walls)
        assert law == DepthScale((1.0,), (0.2, 0.6), stated)
